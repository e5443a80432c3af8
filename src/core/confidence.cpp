#include "confidence.hpp"

#include <algorithm>
#include <vector>

#include "progress_part.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMinFrames = 5;
constexpr std::size_t kMaxGroups = 20;  // bounds the cost; more would hardly make the covariance any better

Frames withoutGroup(const Frames& frames, std::size_t group, std::size_t groups) {
  Frames kept;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (i % groups != group) kept.push_back(frames[i]);
  }
  return kept;
}

/// Each deviation misses only one of the groups, so they scatter less than results of different frames: by
/// the factor (groups - 1)^2, of which one groups - 1 is in the mean.
Matrix6d jackknifeCovariance(const std::vector<Vector6d>& deviations) {
  const auto groups = static_cast<double>(deviations.size());
  Vector6d mean = Vector6d::Zero();
  for (const Vector6d& d : deviations) mean += d / groups;
  Matrix6d scatter = Matrix6d::Zero();
  for (const Vector6d& d : deviations) scatter += (d - mean) * (d - mean).transpose();
  return (groups - 1.0) / groups * scatter;
}

}  // namespace

Uncertainty jackknife(const Search& search, const Objective& objective, const Frames& frames,
                      const Eigen::Isometry3d& result, const Progress& progress) {
  Uncertainty uncertainty;
  if (frames.size() < kMinFrames) return uncertainty;
  const std::size_t groups = std::min(frames.size(), kMaxGroups);
  std::vector<Vector6d> deviations;
  for (std::size_t g = 0; g < groups; ++g) {
    const double begin = double(g) / double(groups), end = double(g + 1) / double(groups);
    const SearchResult refined =
        search.refine(objective, withoutGroup(frames, g, groups), result, partOf(progress, begin, end));
    uncertainty.evaluations += refined.evaluations;
    uncertainty.cancelled = refined.cancelled;
    if (refined.cancelled) return uncertainty;
    deviations.push_back(log(refined.T_camera_lidar * result.inverse()));
  }
  uncertainty.covariance = jackknifeCovariance(deviations);
  return uncertainty;
}

}  // namespace lidar_camera_recalibration

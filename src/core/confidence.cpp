#include "confidence.hpp"

#include <algorithm>
#include <numeric>
#include <vector>

#include "progress_part.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMinFrames = 5;
// They bound the cost; more would hardly make the covariance any better.
constexpr std::size_t kMaxJackknifeGroups = 20, kMaxDisjointGroups = 6;

/// The frames of one of so many groups, or all others.
Frames select(const Frames& frames, std::size_t group, std::size_t groups, bool others) {
  Frames selected;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if ((i % groups == group) != others) selected.push_back(frames[i]);
  }
  return selected;
}

Matrix6d scatterOf(const std::vector<Vector6d>& deviations) {
  Vector6d mean = Vector6d::Zero();
  for (const Vector6d& d : deviations) mean += d / static_cast<double>(deviations.size());
  Matrix6d scatter = Matrix6d::Zero();
  for (const Vector6d& d : deviations) scatter += (d - mean) * (d - mean).transpose();
  return scatter;
}

}  // namespace

Uncertainty estimateUncertainty(const Search& search, const Objective& objective, const Frames& frames,
                                const Eigen::Isometry3d& result, int threads, const Progress& progress) {
  Uncertainty uncertainty;
  if (frames.size() < kMinFrames) return uncertainty;
  const bool jackknife = search.refinesExactly();
  const std::size_t groups = std::min(frames.size(), jackknife ? kMaxJackknifeGroups : kMaxDisjointGroups);
  const auto count = static_cast<double>(groups);
  std::vector<Vector6d> deviations(groups);
  std::vector<std::size_t> evaluations(groups, 0);
  const auto refine = [&](std::size_t g, const Progress& own_progress) {
    const SearchResult refined =
        search.refine(objective, select(frames, g, groups, jackknife), result, own_progress);
    evaluations[g] = refined.evaluations;
    deviations[g] = log(refined.T_camera_lidar * result.inverse());
  };
  uncertainty.cancelled = !runJobs(groups, threads, progress, refine);
  uncertainty.evaluations = std::accumulate(evaluations.begin(), evaluations.end(), std::size_t{0});
  if (uncertainty.cancelled) return uncertainty;
  // Results with one group missing share almost all frames and scatter little; those of single groups scatter
  // more than the mean of all.
  const double factor = jackknife ? (count - 1.0) / count : 1.0 / ((count - 1.0) * count);
  uncertainty.covariance = factor * scatterOf(deviations);
  return uncertainty;
}

}  // namespace lidar_camera_recalibration

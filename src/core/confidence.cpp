#include "confidence.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include "progress_part.hpp"
#include "strips.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMinFrames = 5;
// Of strips in place of frames. With fewer draws without any edge in half of the image become likely.
constexpr std::size_t kMinStrips = 8;
// They bound the cost; more would hardly make the covariance any better.
constexpr std::size_t kBootstraps = 20, kMaxDisjointGroups = 6;

/// Each set as large as `frames`; each frame is as often in all of them together as any other, so that the
/// mean of the results has no scatter from the draw.
std::vector<Frames> bootstraps(const Frames& frames) {
  Frames pool;
  for (std::size_t i = 0; i < kBootstraps; ++i) pool.insert(pool.end(), frames.begin(), frames.end());
  std::mt19937 random(static_cast<std::mt19937::result_type>(frames.size()));
  std::shuffle(pool.begin(), pool.end(), random);
  std::vector<Frames> sets;
  const auto size = static_cast<std::ptrdiff_t>(frames.size());
  for (auto first = pool.begin(); first != pool.end(); first += size) sets.emplace_back(first, first + size);
  return sets;
}

std::vector<Frames> disjointGroups(const Frames& frames) {
  std::vector<Frames> groups(std::min(frames.size(), kMaxDisjointGroups));
  for (std::size_t i = 0; i < frames.size(); ++i) groups[i % groups.size()].push_back(frames[i]);
  return groups;
}

Vector6d meanOf(const std::vector<Vector6d>& deviations) {
  Vector6d mean = Vector6d::Zero();
  for (const Vector6d& d : deviations) mean += d / static_cast<double>(deviations.size());
  return mean;
}

/// Covariance of single deviations.
Matrix6d scatterOf(const std::vector<Vector6d>& deviations, const Vector6d& mean) {
  Matrix6d scatter = Matrix6d::Zero();
  for (const Vector6d& d : deviations) scatter += (d - mean) * (d - mean).transpose();
  return scatter / static_cast<double>(deviations.size() - 1);
}

/// What no draw of frames shows, since all of them share it: borders are placed on the image's edges to a
/// tenth of a pixel, and level edges of the LiDAR are known to the gap between two rings, each on average not
/// quite in the middle. In metres, the same for things at 10 m and, as level edges are mostly nearer, at 6 m.
/// The sizes come from simulated drives with 16 and 64 beams.
Vector6d commonSigma(const Frames& frames) {
  constexpr double kPixels = 0.1, kShareOfGap = 0.015, kDistance = 10.0, kLevelDistance = 6.0;  // [m]
  const double border = kPixels / frames.front()->camera.intrinsics().fx;
  const double level = kShareOfGap * frames.front()->edges.ring_step;
  Vector6d sigma = Vector6d::Constant(border);
  sigma.tail<3>() *= kDistance;
  sigma[0] = std::hypot(border, level);
  sigma[4] = std::hypot(kDistance * border, kLevelDistance * level);
  return sigma;
}

}  // namespace

Resampling resample(const Search& search, const Objective& objective, const Frames& frames,
                    const Eigen::Isometry3d& result, int threads, const Progress& progress) {
  Resampling resampling;
  resampling.T_camera_lidar = result;
  const bool few = frames.size() < kMinFrames, exact = search.refinesExactly();
  if (few && !exact) return resampling;
  const Frames units = few ? framesOrStrips(frames, result, kMinStrips) : frames;
  const std::vector<Frames> sets = exact ? bootstraps(units) : disjointGroups(units);
  std::vector<Vector6d> deviations(sets.size());
  std::vector<std::size_t> evaluations(sets.size(), 0);
  const auto refine = [&](std::size_t i, const Progress& own_progress) {
    const SearchResult refined = search.refine(objective, sets[i], result, own_progress);
    evaluations[i] = refined.evaluations;
    deviations[i] = log(refined.T_camera_lidar * result.inverse());
  };
  resampling.cancelled = !runJobs(sets.size(), threads, progress, refine);
  resampling.evaluations = std::accumulate(evaluations.begin(), evaluations.end(), std::size_t{0});
  if (resampling.cancelled) return resampling;
  const Vector6d mean = meanOf(deviations);
  const Matrix6d scatter = scatterOf(deviations, mean);
  const auto count = static_cast<double>(units.size()), groups = static_cast<double>(sets.size());
  if (exact) {
    if (!few) resampling.T_camera_lidar = exp(mean) * result;
    // Of n frames drawn with replacement the mean scatters less than that of n new ones.
    resampling.covariance = scatter * (count / (count - 1.0));
  } else {
    resampling.covariance = scatter / groups;  // single groups scatter more than the mean of all
  }
  resampling.covariance->diagonal() += commonSigma(frames).cwiseAbs2();
  return resampling;
}

}  // namespace lidar_camera_recalibration

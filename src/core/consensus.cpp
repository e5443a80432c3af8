#include "consensus.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "progress_part.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMinFrames = 4;
constexpr std::size_t kMaxShare = 3;  // one in so many may be left out
constexpr int kMaxRounds = 3;

// Measured on kitti_00, objective `consistency_edges`, 6 frames: good frames have at least 0.38 of the median
// contrast, frames with the masks or the cloud of another one at most 0.2. Good frames lose at most 40 % of
// their own contrast at the joint extrinsic, and then mostly in roll.
constexpr double kChance = 0.25;  // less of the median contrast means that a frame sees nothing
constexpr double kMinFit = 0.65;  // less of its own contrast means that a frame prefers another extrinsic
constexpr double kFar = 3.0;      // robust standard deviations from the median of the frames
// Even where few frames agree by chance, single ones scatter by so much. [rad, m]
constexpr double kRotationFloor = 0.1 * kDegree, kTranslationFloor = 0.03;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return 0.5 * (*middle + *std::max_element(values.begin(), middle));
}

template <typename Value>
double medianOf(const std::vector<Opinion>& opinions, const Value& value) {
  std::vector<double> values;
  for (const Opinion& opinion : opinions) values.push_back(value(opinion));
  return median(std::move(values));
}

/// Of each frame's wish from the median, in robust standard deviations of the axis where that is most.
std::vector<double> distances(const std::vector<Opinion>& opinions) {
  constexpr double kSigmaPerDeviation = 1.4826;  // median absolute deviation of a normal distribution
  std::vector<double> result(opinions.size(), 0.0);
  for (int axis = 0; axis < 6; ++axis) {
    const double centre = medianOf(opinions, [axis](const Opinion& opinion) { return opinion.wish[axis]; });
    const auto deviation = [&](const Opinion& opinion) { return std::abs(opinion.wish[axis] - centre); };
    const double sigma = std::max(kSigmaPerDeviation * medianOf(opinions, deviation),
                                  axis < 3 ? kRotationFloor : kTranslationFloor);
    for (std::size_t i = 0; i < opinions.size(); ++i) {
      result[i] = std::max(result[i], deviation(opinions[i]) / sigma);
    }
  }
  return result;
}

/// Mean score over rotations that are off so far that a frame with the right masks notices it.
double scoreBeside(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar) {
  double sum = 0.0;
  int count = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double angle : {-2.0, -1.0, 1.0, 2.0}) {
      Vector6d xi = Vector6d::Zero();
      xi[axis] = angle * kDegree;
      sum += evaluator(exp(xi) * T_camera_lidar).total;
      ++count;
    }
  }
  return sum / count;
}

double contrast(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar) {
  return evaluator(T_camera_lidar).total - scoreBeside(evaluator, T_camera_lidar);
}

/// One for each frame; meaningless if cancelled.
std::vector<Opinion> askEach(const Search& search, const Objective& objective, const Frames& frames,
                             Consensus& state, int threads, const Progress& progress) {
  const Eigen::Isometry3d& joint = state.T_camera_lidar;
  std::vector<Opinion> opinions(frames.size());
  std::vector<std::size_t> evaluations(frames.size(), 0);
  const auto ask = [&](std::size_t i, const Progress& own_progress) {
    const SearchResult own = search.refine(objective, {frames[i]}, joint, own_progress);
    evaluations[i] = own.evaluations;
    if (own.cancelled) return;
    // The points that both see, or a frame could gain by moving easy ones into the image.
    const std::unique_ptr<Evaluator> evaluator =
        objective.evaluator({frames[i]}, {joint, own.T_camera_lidar});
    opinions[i] = {log(own.T_camera_lidar * joint.inverse()), contrast(*evaluator, joint),
                   contrast(*evaluator, own.T_camera_lidar)};
  };
  state.cancelled = !runJobs(frames.size(), threads, progress, ask);
  state.evaluations += std::accumulate(evaluations.begin(), evaluations.end(), std::size_t{0});
  return opinions;
}

}  // namespace

std::vector<std::size_t> contradicting(const std::vector<Opinion>& opinions) {
  if (opinions.size() < kMinFrames) return {};
  const double usual = medianOf(opinions, [](const Opinion& opinion) { return opinion.contrast; });
  if (!(usual > 0.0)) return {};  // nothing that could be contradicted
  const std::vector<double> distance = distances(opinions);
  const auto support = [&](std::size_t i) {
    return opinions[i].contrast / std::max(opinions[i].own_contrast, usual);
  };
  std::vector<std::size_t> found;
  for (std::size_t i = 0; i < opinions.size(); ++i) {
    const Opinion& opinion = opinions[i];
    const bool blind = opinion.contrast < kChance * usual;
    const bool elsewhere = distance[i] > kFar && opinion.contrast < kMinFit * opinion.own_contrast;
    if (blind || elsewhere) found.push_back(i);
  }
  std::stable_sort(found.begin(), found.end(),
                   [&](std::size_t a, std::size_t b) { return support(a) < support(b); });
  return found;
}

Consensus findConsensus(const Search& search, const Objective& objective, const Frames& frames,
                        const Eigen::Isometry3d& joint, int threads, const Progress& progress) {
  Consensus result;
  result.T_camera_lidar = joint;
  if (frames.size() < kMinFrames) return result;
  for (int round = 0; round < kMaxRounds; ++round) {
    const double begin = double(round) / kMaxRounds, end = double(round + 1) / kMaxRounds;
    const double asked = begin + 0.8 * (end - begin);
    const std::vector<Opinion> opinions =
        askEach(search, objective, frames, result, threads, partOf(progress, begin, asked));
    if (result.cancelled) break;
    std::vector<std::size_t> left_out = contradicting(opinions);
    result.contradicting = left_out.size();
    left_out.resize(std::min(left_out.size(), frames.size() / kMaxShare));
    std::sort(left_out.begin(), left_out.end());
    if (left_out == result.left_out) break;
    const SearchResult refined = search.refine(objective, without(frames, left_out), result.T_camera_lidar,
                                               partOf(progress, asked, end));
    result.evaluations += refined.evaluations;
    result.T_camera_lidar = refined.T_camera_lidar;
    result.left_out = std::move(left_out);
    result.cancelled = refined.cancelled;
    if (result.cancelled) break;
  }
  return result;
}

Frames without(const Frames& frames, const std::vector<std::size_t>& left_out) {
  Frames kept;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (std::find(left_out.begin(), left_out.end(), i) == left_out.end()) kept.push_back(frames[i]);
  }
  return kept;
}

}  // namespace lidar_camera_recalibration

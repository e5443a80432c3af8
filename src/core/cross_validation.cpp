#include "cross_validation.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include "parallel.hpp"
#include "progress_part.hpp"
#include "search_space.hpp"
#include "strips.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMinPieces = 5;
constexpr std::size_t kMinSearched = 4;  // with less a search itself goes wrong too often

/// How many searches: the fewest that leave each one kMinSearched pieces, and 2 at least.
std::size_t foldsOf(std::size_t pieces) {
  const std::size_t unseen = pieces - kMinSearched;  // at most, by one search
  return std::max<std::size_t>(2, (pieces + unseen - 1) / unseen);
}

/// @return mean and its standard deviation
std::pair<double, double> meanOf(const std::vector<double>& values) {
  const auto count = static_cast<double>(values.size());
  double mean = 0.0, squares = 0.0;
  for (const double value : values) mean += value / count;
  for (const double value : values) squares += (value - mean) * (value - mean);
  return {mean, std::sqrt(squares / (count - 1.0) / count)};
}

/// Jackknife: how far the result of all would scatter.
Vector6d scatterOf(const std::vector<Vector6d>& deviations) {
  const auto count = static_cast<double>(deviations.size());
  Vector6d mean = Vector6d::Zero(), squares = Vector6d::Zero();
  for (const Vector6d& d : deviations) mean += d / count;
  for (const Vector6d& d : deviations) squares += (d - mean).cwiseAbs2();
  return (squares * (count - 1.0) / count).cwiseSqrt();
}

}  // namespace

double distinctness(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar) {
  constexpr int kSteps = 2;
  constexpr double kStep = 2.0 * kDegree;
  double sum = 0.0, squares = 0.0;
  int count = 0;
  for (const Eigen::Isometry3d& T : rotationGrid(T_camera_lidar, kSteps, kStep)) {
    if (extrinsicError(T, T_camera_lidar).angle() < 0.5 * kStep) continue;  // the middle of the grid
    const double score = evaluator(T).total;
    sum += score;
    squares += score * score;
    ++count;
  }
  const double mean = sum / count, sigma = std::sqrt(std::max(0.0, squares / count - mean * mean));
  return sigma > 0.0 ? (evaluator(T_camera_lidar).total - mean) / sigma : 0.0;
}

CrossValidation crossValidate(const Search& search, const Objective& objective, const Frames& frames,
                              const Eigen::Isometry3d& start, const SearchRange& range,
                              const Eigen::Isometry3d& result, const Applied& applied, int threads,
                              const Progress& progress) {
  const Frames pieces = framesOrStrips(frames, start, kMinPieces);
  const std::size_t folds = foldsOf(pieces.size());
  CrossValidation validation;
  std::vector<Eigen::Isometry3d> found;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    Frames searched;
    for (std::size_t i = 0; i < pieces.size(); ++i) {
      if (i % folds != fold) searched.push_back(pieces[i]);
    }
    const double begin = double(fold) / double(folds), end = double(fold + 1) / double(folds);
    const SearchResult one = search.run(objective, searched, start, range, partOf(progress, begin, end));
    validation.evaluations += one.evaluations;
    validation.cancelled = one.cancelled;
    if (validation.cancelled) return validation;
    found.push_back(one.T_camera_lidar);
  }

  std::vector<double> gains(pieces.size()), distinctnesses(pieces.size());
  parallelFor(pieces.size(), static_cast<std::size_t>(threads), [&](std::size_t, std::size_t i) {
    const Eigen::Isometry3d &T = found[i % folds], used = applied(T);
    const std::unique_ptr<Evaluator> both = objective.evaluator({pieces[i]}, {start, used});
    gains[i] = (*both)(used).total - (*both)(start).total;
    if (objective.isPeaked()) distinctnesses[i] = distinctness(*objective.evaluator({pieces[i]}, {T}), T);
  });
  UnseenEvidence& evidence = validation.evidence;
  std::tie(evidence.gain, evidence.gain_sigma) = meanOf(gains);
  if (objective.isPeaked()) {
    // Chance would give each a deviation of about 1, and their sum one of the root of their number.
    const auto count = static_cast<double>(pieces.size());
    evidence.distinctness = meanOf(distinctnesses).first * std::sqrt(count);
  }
  std::vector<Vector6d> deviations;
  for (const Eigen::Isometry3d& T : found) deviations.push_back(log(T * result.inverse()));
  evidence.scatter = scatterOf(deviations);
  return validation;
}

}  // namespace lidar_camera_recalibration

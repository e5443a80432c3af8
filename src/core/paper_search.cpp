#include "paper_search.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "parallel.hpp"
#include "search_space.hpp"

namespace lidar_camera_recalibration {

namespace {

constexpr std::size_t kBatch = 50;  ///< candidates between two looks at progress and cancellation
constexpr int kRounds = 8;          ///< of the random refinement
constexpr double kShrink = 0.65;    ///< of the range from round to round

/// Scores candidates in parallel and keeps the best. The first of equals wins, so the number of threads does
/// not matter.
class Contest {
 public:
  Contest(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start, int threads,
          std::size_t planned, const Progress& progress)
      : objective_(objective), frames_(frames), evaluators_(threads), planned_(planned), progress_(progress) {
    result_.T_camera_lidar = start;
    beginStage();
  }

  /// From here on scores the points that are in view under the best extrinsic so far.
  void beginStage() {
    const Views views = {result_.T_camera_lidar};
    parallelFor(evaluators_.size(), evaluators_.size(),
                [&](std::size_t, std::size_t i) { evaluators_[i] = objective_.evaluator(frames_, views); });
    best_ = (*evaluators_.front())(result_.T_camera_lidar).total;
  }

  /// @return false if cancelled
  bool enter(const std::vector<Eigen::Isometry3d>& candidates) {
    std::vector<double> scores(std::min(kBatch, candidates.size()));
    for (std::size_t first = 0; first < candidates.size(); first += kBatch) {
      const std::size_t count = std::min(kBatch, candidates.size() - first);
      parallelFor(count, evaluators_.size(), [&](std::size_t worker, std::size_t i) {
        scores[i] = (*evaluators_[worker])(candidates[first + i]).total;
      });
      for (std::size_t i = 0; i < count; ++i) {
        if (scores[i] <= best_) continue;
        best_ = scores[i];
        result_.T_camera_lidar = candidates[first + i];
      }
      result_.evaluations += count;
      const double fraction = static_cast<double>(result_.evaluations) / static_cast<double>(planned_);
      if (progress_ && !progress_(fraction, best_)) {
        result_.cancelled = true;
        return false;
      }
    }
    return true;
  }

  const SearchResult& result() const { return result_; }

 private:
  const Objective& objective_;
  const Frames& frames_;
  std::vector<std::unique_ptr<Evaluator>> evaluators_;  ///< one per thread
  std::size_t planned_;
  const Progress& progress_;
  SearchResult result_;
  double best_ = 0.0;
};

/// @param limit  of the translation, see withLimitedTranslation
std::vector<Eigen::Isometry3d> randomCandidates(const Eigen::Isometry3d& centre, const Vector6d& range,
                                                std::size_t count, std::mt19937_64& random,
                                                const Eigen::Isometry3d& start, double limit) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Eigen::Isometry3d> candidates;
  for (std::size_t i = 0; i < count; ++i) {
    Vector6d xi;
    for (int k = 0; k < 6; ++k) xi[k] = range[k] * uniform(random);
    candidates.push_back(withLimitedTranslation(exp(xi) * centre, start, limit));
  }
  return candidates;
}

/// @param rotation,translation  half widths of the first round [rad, m]
bool refineRandomly(Contest& contest, const SearchConfig& config, std::size_t evaluations, double rotation,
                    double translation, const Eigen::Isometry3d& start, double limit) {
  std::mt19937_64 random(config.seed);
  Vector6d range;
  range << Eigen::Vector3d::Constant(rotation), Eigen::Vector3d::Constant(translation);
  for (int round = 0; round < kRounds; ++round, range *= kShrink) {
    contest.beginStage();
    const std::size_t count = evaluations * (round + 1) / kRounds - evaluations * round / kRounds;
    if (!contest.enter(
            randomCandidates(contest.result().T_camera_lidar, range, count, random, start, limit))) {
      return false;
    }
  }
  return true;
}

}  // namespace

PaperSearch::PaperSearch(const SearchConfig& config) : config_(config) {
  if (!(config.grid_step_deg >= 0.05 && config.grid_step_deg <= 10.0)) {
    throw Error(ErrorCause::kParameter,
                "grid_step_deg: " + std::to_string(config.grid_step_deg) + " is outside of 0.05 to 10");
  }
  if (config.refine_evaluations < 0 || config.refine_evaluations > 10000000) {
    throw Error(ErrorCause::kParameter, "refine_evaluations: " + std::to_string(config.refine_evaluations) +
                                            " is outside of 0 to 10000000");
  }
  requireThreads(config.threads);
}

SearchResult PaperSearch::run(const Objective& objective, const Frames& frames,
                              const Eigen::Isometry3d& start, const SearchRange& range,
                              const Progress& progress) const {
  requireFrames(frames);
  const int steps = static_cast<int>(std::floor(range.rotation_deg / config_.grid_step_deg + 1e-9));
  const std::vector<Eigen::Isometry3d> grid = rotationGrid(start, steps, config_.grid_step_deg * kDegree);
  const std::size_t refinement = static_cast<std::size_t>(config_.refine_evaluations);
  Contest contest(objective, frames, start, config_.threads, grid.size() + refinement, progress);
  if (contest.enter(grid)) {
    const double rotation = std::min(config_.grid_step_deg, range.rotation_deg) * kDegree;
    refineRandomly(contest, config_, refinement, rotation, range.translation_m, start, range.translation_m);
  }
  return contest.result();
}

SearchResult PaperSearch::refine(const Objective& objective, const Frames& frames,
                                 const Eigen::Isometry3d& start, const Progress& progress) const {
  requireFrames(frames);
  // From an optimum there is less to search: a quarter of the candidates, half a grid step and 10 cm around
  // it.
  const std::size_t evaluations =
      std::max<std::size_t>(1, static_cast<std::size_t>(config_.refine_evaluations) / 4);
  constexpr double kTranslation = 0.1;
  constexpr int kThreads = 1;  // see Search::refine
  Contest contest(objective, frames, start, kThreads, evaluations, progress);
  refineRandomly(contest, config_, evaluations, 0.5 * config_.grid_step_deg * kDegree, kTranslation, start,
                 kTranslation);
  return contest.result();
}

}  // namespace lidar_camera_recalibration

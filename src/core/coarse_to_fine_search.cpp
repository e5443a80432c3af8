#include "coarse_to_fine_search.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "consistency_edges_objective.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "parallel.hpp"
#include "search_space.hpp"

namespace lidar_camera_recalibration {
namespace {

using Isometries = std::vector<Eigen::Isometry3d>;

constexpr double kGridStep = 0.7 * kDegree;
constexpr double kGridMargin = 1.1;  // the grid covers so many times the range
constexpr std::size_t kCandidates = 30;
constexpr double kCandidateDistance = 0.9 * kDegree;
constexpr std::size_t kFinalists = 5;
constexpr std::size_t kCoarseEdges = 4000;  // enough to find the places that deserve a closer look

// Edges come in rows from the same borders, so they are worth fewer independent measurements. From 5 frames
// on the result does not depend on it from 1 to 5; at 20 the prior pulls single frames to the start.
constexpr double kEdgesPerMeasurement = 2.0;
constexpr double kMinRotationSigma = 0.3 * kDegree, kMinTranslationSigma = 0.03;  // of the prior [rad, m]
// Weak, so that a scatter of refinements is visible [rad, m].
constexpr double kRefineRotationSigma = 5.0 * kDegree, kRefineTranslationSigma = 0.2;
constexpr int kMaxSteps = 40;  // of Gauss-Newton at one width; convergence ends it earlier

/// What is known before the edges are looked at: how far off the start can be.
struct Prior {
  Eigen::Isometry3d start;
  double rotation_sigma, translation_sigma;  // [rad, m]
  double limit;                              // of the shift on each axis [m]

  /// The truth is taken to be uniform over the range.
  static Prior fromRange(const Eigen::Isometry3d& start, const SearchRange& range) {
    const double root = std::sqrt(3.0);
    return {start, std::max(kMinRotationSigma, range.rotation_deg * kDegree / root),
            std::max(kMinTranslationSigma, range.translation_m / root), range.translation_m};
  }

  void addTo(const Eigen::Isometry3d& T, Matrix6d& H, Vector6d& b) const {
    const double rotation = 1.0 / (rotation_sigma * rotation_sigma),
                 translation = 1.0 / (translation_sigma * translation_sigma);
    H.diagonal().head<3>().array() += rotation;
    H.diagonal().tail<3>().array() += translation;
    b.head<3>() += rotation * log(T * start.inverse()).head<3>();
    b.tail<3>() += translation * (T.translation() - turnedTranslation(T, start));
  }
};

struct Optimum {
  Eigen::Isometry3d T;
  double score;
  std::size_t evaluations;
};

/// Gauss-Newton at one width after the other until the steps are small.
Optimum descend(const ConsistencyEdgesEvaluator& evaluator, const Prior& prior, Eigen::Isometry3d T,
                std::initializer_list<std::size_t> levels) {
  constexpr double kMaxRotation = 0.5 * kDegree, kMaxTranslation = 0.1;         // of a step [rad, m]
  constexpr double kFineRotation = 0.002 * kDegree, kFineTranslation = 0.0005;  // small enough to stop
  std::size_t evaluations = 0;
  for (const std::size_t level : levels) {
    // A wide border only has to lead into the reach of the next one.
    const double tolerance = level + 1 < kBoundaryLevels ? 5.0 : 1.0;
    for (int step = 0; step < kMaxSteps; ++step) {
      const Linearisation data = evaluator.linearise(T, level);
      ++evaluations;
      Matrix6d H = data.H * (2.0 / kEdgesPerMeasurement);
      Vector6d b = data.b * (2.0 / kEdgesPerMeasurement);
      prior.addTo(T, H, b);
      Vector6d xi = -H.ldlt().solve(b);
      xi *= std::min({1.0, kMaxRotation / xi.head<3>().norm(), kMaxTranslation / xi.tail<3>().norm()});
      T = withLimitedTranslation(exp(xi) * T, prior.start, prior.limit);
      if (xi.head<3>().norm() < tolerance * kFineRotation &&
          xi.tail<3>().norm() < tolerance * kFineTranslation) {
        break;
      }
    }
  }
  T.linear() = Eigen::Quaterniond(T.linear()).normalized().toRotationMatrix();
  return {T, 0.0, evaluations};
}

/// Runs jobs in parallel and tells about them in batches: results do not depend on threads or batches.
class Stages {
 public:
  Stages(int threads, const Progress& progress, SearchResult& result)
      : threads_(static_cast<std::size_t>(threads)), progress_(progress), result_(result) {}

  /// @param share  of the whole search, @param best  called after each batch with its end; returns the best
  /// score so far
  /// @return false if cancelled
  template <typename Job, typename Best>
  bool run(std::size_t count, std::size_t batch, double share, const Job& job, const Best& best) {
    for (std::size_t first = 0; first < count; first += batch) {
      const std::size_t end = std::min(count, first + batch);
      parallelFor(end - first, threads_, [&](std::size_t, std::size_t i) { job(first + i); });
      const double score = best(first, end);
      const double fraction = done_ + share * static_cast<double>(end) / static_cast<double>(count);
      if (progress_ && !progress_(std::min(fraction, 1.0), score)) {
        result_.cancelled = true;
        return false;
      }
    }
    done_ += share;
    return true;
  }

 private:
  std::size_t threads_;
  const Progress& progress_;
  SearchResult& result_;
  double done_ = 0.0;
};

/// The best places of the grid that are not next to a better one.
Isometries candidates(const Isometries& grid, const std::vector<double>& scores) {
  std::vector<std::size_t> order(grid.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return scores[a] > scores[b]; });
  Isometries chosen;
  for (const std::size_t i : order) {
    if (chosen.size() == kCandidates) break;
    const auto close = [&](const Eigen::Isometry3d& T) {
      return extrinsicError(grid[i], T).angle() < kCandidateDistance;
    };
    if (std::none_of(chosen.begin(), chosen.end(), close)) chosen.push_back(grid[i]);
  }
  return chosen;
}

/// @throw Error as CoarseToFineSearch::run
std::unique_ptr<ConsistencyEdgesEvaluator> edgeEvaluator(const Objective& objective, const Frames& frames) {
  requireFrames(frames);
  std::unique_ptr<Evaluator> evaluator = objective.evaluator(frames, {});
  auto* const edges = dynamic_cast<ConsistencyEdgesEvaluator*>(evaluator.get());
  if (edges == nullptr) {
    throw Error(ErrorCause::kParameter,
                "search: 'coarse_to_fine' works with objective 'consistency_edges' only; set both, or search "
                "'paper'");
  }
  evaluator.release();
  std::unique_ptr<ConsistencyEdgesEvaluator> result(edges);
  if (result->edgeCount() == 0) {
    throw Error(
        ErrorCause::kNotEnough,
        "objective 'consistency_edges': no edge was found in the clouds; it needs clouds of a spinning "
        "LiDAR with a field 'ring', or in the order of the rings; use objective and search 'paper' for "
        "others");
  }
  return result;
}

}  // namespace

CoarseToFineSearch::CoarseToFineSearch(const SearchConfig& config) : config_(config) {
  requireThreads(config.threads);
}

SearchResult CoarseToFineSearch::run(const Objective& objective, const Frames& frames,
                                     const Eigen::Isometry3d& start, const SearchRange& range,
                                     const Progress& progress) const {
  const std::unique_ptr<ConsistencyEdgesEvaluator> evaluator = edgeEvaluator(objective, frames);
  const ConsistencyEdgesEvaluator coarse = evaluator->thinned(kCoarseEdges);
  const Prior prior = Prior::fromRange(start, range);
  SearchResult result;
  result.T_camera_lidar = start;
  Stages stages(config_.threads, progress, result);

  // 1. Rotations, with wide borders.
  // The outermost places reach half a step further.
  const double reach = kGridMargin * range.rotation_deg * kDegree / kGridStep - 0.5;
  const Isometries grid = rotationGrid(start, std::max(0, static_cast<int>(std::ceil(reach))), kGridStep);
  std::vector<double> scores(grid.size());
  double best = -1.0;
  const auto score = [&](std::size_t i) {
    scores[i] = 0.5 * (coarse.edgeScore(grid[i], 0) + coarse.edgeScore(grid[i], 1));
  };
  const auto best_of_grid = [&](std::size_t first, std::size_t end) {
    for (std::size_t i = first; i < end; ++i) {
      if (scores[i] <= best) continue;
      best = scores[i];
      result.T_camera_lidar = grid[i];
    }
    result.evaluations += 2 * (end - first);
    return best;
  };
  if (!stages.run(grid.size(), grid.size() / 20 + 1, 0.4, score, best_of_grid)) return result;

  // All terms: the edges alone can be fooled by a frame or two.
  const auto judge = [&](Optimum& optimum) {
    optimum.score = (*evaluator)(optimum.T).total;
    ++optimum.evaluations;
  };

  // 2. The optima around the best of them, with borders wide enough to reach from one place of the grid to
  // the next.
  const Isometries places = candidates(grid, scores);
  std::vector<Optimum> optima(places.size());
  best = -1.0;
  const auto keepBest = [&](std::size_t first, std::size_t end) {
    for (std::size_t i = first; i < end; ++i) {
      result.evaluations += optima[i].evaluations;
      if (optima[i].score <= best) continue;
      best = optima[i].score;
      result.T_camera_lidar = optima[i].T;
    }
    return best;
  };
  const auto approach = [&](std::size_t i) {
    optima[i] = descend(coarse, prior, places[i], {0, 1});
    judge(optima[i]);
  };
  if (!stages.run(places.size(), 2, 0.5, approach, keepBest)) return result;

  // 3. The best of these to the end.
  std::stable_sort(optima.begin(), optima.end(),
                   [](const Optimum& a, const Optimum& b) { return a.score > b.score; });
  optima.resize(std::min(kFinalists, optima.size()));
  best = -1.0;
  const auto finish = [&](std::size_t i) {
    optima[i] = descend(*evaluator, prior, optima[i].T, {1, 2, 3});
    judge(optima[i]);
  };
  stages.run(optima.size(), 1, 0.1, finish, keepBest);
  return result;
}

SearchResult CoarseToFineSearch::refine(const Objective& objective, const Frames& frames,
                                        const Eigen::Isometry3d& start, const Progress& progress) const {
  const std::unique_ptr<ConsistencyEdgesEvaluator> evaluator = edgeEvaluator(objective, frames);
  constexpr double kLimit = 1.0;
  const Prior prior{start, kRefineRotationSigma, kRefineTranslationSigma, kLimit};
  const Optimum optimum = descend(*evaluator, prior, start, {1, 2, 3});
  const double score = (*evaluator)(optimum.T).total;
  SearchResult result{optimum.T, optimum.evaluations + 1, false};
  result.cancelled = progress && !progress(1.0, score);
  return result;
}

}  // namespace lidar_camera_recalibration

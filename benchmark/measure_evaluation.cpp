// The cost of one candidate: how long it takes to score an extrinsic on prepared frames.

#include <memory>
#include <random>

#include "consistency_edges_objective.hpp"
#include "floor.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "measurements.hpp"
#include "parallel.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

/// As a search enters them at a time; divides well among threads.
constexpr std::size_t kBatch = 20;

/// Frames to score on.
struct Place {
  std::shared_ptr<FrameStore> store;
  std::string source;
  std::size_t frame_count;

  std::string text() const { return source + "/frames:" + std::to_string(frame_count); }
  const Eigen::Isometry3d& truth() const { return store->source(source).T_camera_lidar(); }
  Frames frames() const { return store->frames(source, frame_count); }
};

/// Extrinsics like those of a search that has the optimum in reach: within 1 deg and 10 cm on each axis.
std::vector<Eigen::Isometry3d> candidatesAround(const Eigen::Isometry3d& T_camera_lidar) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Eigen::Isometry3d> candidates;
  for (std::size_t i = 0; i < kBatch; ++i) {
    Vector6d xi;
    for (int k = 0; k < 6; ++k) xi[k] = uniform(random) * (k < 3 ? kDegree : 0.1);
    candidates.push_back(exp(xi) * T_camera_lidar);
  }
  return candidates;
}

std::vector<Points> pointsOf(const Place& place) {
  std::vector<Points> points;
  for (const FramePtr& frame : place.frames()) points.push_back(pointsInView(*frame, place.truth()));
  return points;
}

/// What the figures are divided by.
void addSizes(const Place& place, Counters& counters) {
  double points = 0.0, edges = 0.0, masks = 0.0;
  for (const FramePtr& frame : place.frames()) {
    points += static_cast<double>(pointsInView(*frame, place.truth()).size());
    edges += static_cast<double>(frame->edges.size());
    masks += static_cast<double>(frame->masks.maskCount());
  }
  counters["candidates"] = kBatch;
  counters["cloud_points"] = static_cast<double>(place.store->cloudPoints(place.source, place.frame_count));
  counters["points"] = points;
  counters["edges"] = edges;
  counters["masks_per_frame"] = masks / static_cast<double>(place.frame_count);
}

/// One evaluator a thread, as the searches have it, on the points in view under the truth.
void addObjective(Measurements& measurements, const std::string& objective, const Place& place,
                  std::size_t threads) {
  measurements.add("evaluation/" + objective + "/" + place.text() + "/threads:" + std::to_string(threads),
                   [=](Counters& counters) -> Work {
                     addSizes(place, counters);
                     ObjectiveConfig config;
                     config.objective = objective;
                     const Frames frames = place.frames();
                     auto evaluators = std::make_shared<std::vector<std::unique_ptr<Evaluator>>>();
                     for (std::size_t i = 0; i < threads; ++i) {
                       evaluators->push_back(makeObjective(config)->evaluator(frames, {place.truth()}));
                     }
                     const auto candidates = candidatesAround(place.truth());
                     return [=](Counters& result) {
                       std::vector<Score> scores(candidates.size());
                       parallelFor(candidates.size(), threads, [&](std::size_t worker, std::size_t i) {
                         scores[i] = (*(*evaluators)[worker])(candidates[i]);
                       });
                       result["score"] = scores.front().total;
                     };
                   });
}

/// What the coarse-to-fine search asks for most: the edges alone, and the steps of its fits.
void addEdges(Measurements& measurements, const Place& place) {
  const auto add = [&](const std::string& name, const auto& evaluate) {
    measurements.add("evaluation/" + name + "/" + place.text() + "/threads:1",
                     [=](Counters& counters) -> Work {
                       addSizes(place, counters);
                       std::shared_ptr<Evaluator> evaluator =
                           makeObjective(ObjectiveConfig())->evaluator(place.frames(), {place.truth()});
                       const auto edges = std::dynamic_pointer_cast<ConsistencyEdgesEvaluator>(evaluator);
                       const auto candidates = candidatesAround(place.truth());
                       return [=](Counters& result) {
                         double sum = 0.0;
                         for (const Eigen::Isometry3d& T : candidates) sum += evaluate(*edges, T);
                         result["score"] = sum;
                       };
                     });
  };
  constexpr std::size_t kLevel = ConsistencyEdgesEvaluator::kScoreLevel;
  add("edge_score", [](const ConsistencyEdgesEvaluator& edges, const Eigen::Isometry3d& T) {
    return edges.edgeScore(T, kLevel);
  });
  add("least_squares_step", [](const ConsistencyEdgesEvaluator& edges, const Eigen::Isometry3d& T) {
    return edges.linearise(T, kLevel).cost;
  });
}

void addFloor(Measurements& measurements, const Place& place) {
  const auto add = [&](const std::string& name, const auto& project) {
    measurements.add("evaluation/" + name + "/" + place.text() + "/threads:1",
                     [=](Counters& counters) -> Work {
                       addSizes(place, counters);
                       const Frames frames = place.frames();
                       const std::vector<Points> points = pointsOf(place);
                       const auto candidates = candidatesAround(place.truth());
                       return [=](Counters& result) {
                         std::int64_t sum = 0;
                         for (const Eigen::Isometry3d& T : candidates) {
                           for (std::size_t i = 0; i < frames.size(); ++i)
                             sum += project(points[i], *frames[i], T);
                         }
                         result["sum"] = static_cast<double>(sum);
                       };
                     });
  };
  add("projection", [](const Points& points, const Frame& frame, const Eigen::Isometry3d& T) {
    return projectAll(points, frame.camera.intrinsics(), T);
  });
  add("projection_and_label", [](const Points& points, const Frame& frame, const Eigen::Isometry3d& T) {
    return projectAllAndLookUp(points, frame.camera.intrinsics(), T, frame.masks.setOfPixel());
  });
}

}  // namespace

void addEvaluation(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                   const std::string& source, std::size_t frames, const std::vector<std::size_t>& threads) {
  const Place place{store, source, frames};
  addFloor(measurements, place);
  for (const char* objective : {"paper", "consistency_edges"}) {
    for (const std::size_t count : threads) addObjective(measurements, objective, place, count);
  }
  addEdges(measurements, place);
}

}  // namespace lidar_camera_recalibration::performance

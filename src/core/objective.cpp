#include "lidar_camera_recalibration/objective.hpp"

#include "consistency_edges_objective.hpp"
#include "paper_objective.hpp"

namespace lidar_camera_recalibration {

std::vector<Score> Evaluator::scores(const std::vector<Eigen::Isometry3d>& extrinsics, int) {
  std::vector<Score> scores;
  scores.reserve(extrinsics.size());
  for (const Eigen::Isometry3d& T : extrinsics) scores.push_back((*this)(T));
  return scores;
}

std::unique_ptr<Objective> makeObjective(const ObjectiveConfig& config) {
  if (config.objective == "paper") return std::make_unique<PaperObjective>(config);
  if (config.objective == "consistency_edges") return std::make_unique<ConsistencyEdgesObjective>(config);
  throw Error(ErrorCause::kParameter,
              "objective: '" + config.objective + "' is unknown; use 'consistency_edges' or 'paper'");
}

}  // namespace lidar_camera_recalibration

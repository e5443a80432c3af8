#include "lidar_camera_recalibration/objective.hpp"

#include "consistency_edges_objective.hpp"
#include "paper_objective.hpp"

namespace lidar_camera_recalibration {

std::unique_ptr<Objective> makeObjective(const ObjectiveConfig& config) {
  if (config.objective == "paper") return std::make_unique<PaperObjective>(config);
  if (config.objective == "consistency_edges") return std::make_unique<ConsistencyEdgesObjective>(config);
  throw Error(ErrorCause::kParameter,
              "objective: '" + config.objective + "' is unknown; use 'consistency_edges' or 'paper'");
}

}  // namespace lidar_camera_recalibration

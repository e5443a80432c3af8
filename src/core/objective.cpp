#include "lidar_camera_recalibration/objective.hpp"

#include "edges_objective.hpp"
#include "paper_objective.hpp"

namespace lidar_camera_recalibration {

std::unique_ptr<Objective> makeObjective(const ObjectiveConfig& config) {
  if (config.objective == "paper") return std::make_unique<PaperObjective>(config);
  if (config.objective == "edges") return std::make_unique<EdgesObjective>();
  throw Error(ErrorCause::kParameter,
              "objective: '" + config.objective + "' is unknown; use 'paper' or 'edges'");
}

}  // namespace lidar_camera_recalibration

#pragma once

#include "lidar_camera_recalibration/calibrator.hpp"

namespace lidar_camera_recalibration {

/// The default method, from starts that are a few degrees off.
inline CalibratorConfig edgesConfig() {
  CalibratorConfig config;
  config.objective.objective = "consistency_edges";
  config.search.search = "coarse_to_fine";
  config.range.rotation_deg = 2.5;
  config.range.translation_m = 0.1;
  return config;
}

}  // namespace lidar_camera_recalibration

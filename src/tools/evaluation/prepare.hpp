#pragma once

#include <vector>

#include "evaluation/inputs.hpp"
#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration::evaluation {

/// All frames that can be used, around one guess; the others are named on stderr.
/// @throw Error(kNotEnough) if there is none
Frames prepareAll(const std::vector<Input>& inputs, const Camera& camera, const Eigen::Isometry3d& guess,
                  const FrameConfig& config);

}  // namespace lidar_camera_recalibration::evaluation

#pragma once

#include <string>
#include <vector>

#include "evaluation/inputs.hpp"
#include "evaluation/methods.hpp"
#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration::evaluation {

/// Scores along each axis through the reference, +-2 deg and +-40 cm, on all frames, which are prepared
/// around the reference. CSV: method, axis, offset in its unit, then the figures of Score.
/// @throw Error(kNotEnough) if no frame can be used
std::string scoreSlices(const std::vector<Method>& methods, const std::vector<Input>& inputs,
                        const Camera& camera, const Eigen::Isometry3d& reference);

}  // namespace lidar_camera_recalibration::evaluation

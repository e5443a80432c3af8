#pragma once

#include <Eigen/Core>

#include "simulation/scene.hpp"

namespace lidar_camera_recalibration::simulation {

/// Linear RGB albedo of a surface with its procedural texture.
/// @param footprint  size of a pixel on the surface [m]; finer detail is faded out
Eigen::Vector3f surfaceColor(const Part& part, const Hit& hit, float footprint);

/// Linear RGB of the sky in a direction.
Eigen::Vector3f skyColor(const Eigen::Vector3f& direction, const Eigen::Vector3f& to_sun);

/// Smooth noise in -1..1, about one wave per unit of length.
float smoothNoise(float x, float y);

}  // namespace lidar_camera_recalibration::simulation

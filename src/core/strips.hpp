#pragma once

#include <Eigen/Geometry>
#include <cstddef>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// The frames, if there are at least so many; otherwise their upright strips, the same number of each frame,
/// so that there are as many. A strip is a frame with the points and edges of one part of the image.
/// @param T_camera_lidar  tells where in the image a point is
Frames framesOrStrips(const Frames& frames, const Eigen::Isometry3d& T_camera_lidar, std::size_t at_least);

}  // namespace lidar_camera_recalibration

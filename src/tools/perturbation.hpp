#pragma once

#include <Eigen/Geometry>
#include <cstdint>

namespace lidar_camera_recalibration {

/// An extrinsic off by exactly `angle` [rad] and `distance` [m] as extrinsicError() measures them, in random
/// directions.
Eigen::Isometry3d perturbedBy(const Eigen::Isometry3d& T_camera_lidar, double angle, double distance,
                              std::uint64_t seed);

}  // namespace lidar_camera_recalibration

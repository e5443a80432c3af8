#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <random>

namespace lidar_camera_recalibration {

/// An extrinsic off by exactly `angle` [rad] and `distance` [m] as extrinsicError() measures them, in random
/// directions.
Eigen::Isometry3d perturbedBy(const Eigen::Isometry3d& T_camera_lidar, double angle, double distance,
                              std::uint64_t seed);

/// exp(xi) * T with xi uniform in +-angle [rad] and +-distance [m] on each axis of the optical frame.
Eigen::Isometry3d perturbedWithin(const Eigen::Isometry3d& T_camera_lidar, double angle, double distance,
                                  std::mt19937_64& random);

}  // namespace lidar_camera_recalibration

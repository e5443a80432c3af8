#pragma once

#include <Eigen/Geometry>
#include <cstdint>

namespace lidar_camera_recalibration::simulation {

/// Where the sensors sit: LiDAR on the roof, camera ahead of it and lower, behind the windscreen.
struct Rig {
  Eigen::Isometry3d T_base_lidar;
  Eigen::Isometry3d T_camera_lidar;
};

/// The nominal rig with small seeded deviations (about 1 deg and 2 cm) in the camera's mounting.
Rig makeRig(std::uint64_t seed);

/// T with an error of exactly the given rotation angle [rad] and translation distance [m] (see
/// ExtrinsicError), directions seeded.
Eigen::Isometry3d disturbed(const Eigen::Isometry3d& T_camera_lidar, double angle, double distance,
                            std::uint64_t seed);

/// camera_link (x forward, z up) to its optical frame (z forward, y down), REP 103.
Eigen::Isometry3d opticalFromLink();

}  // namespace lidar_camera_recalibration::simulation

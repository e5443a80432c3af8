#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Where the LiDAR was at a time, in a frame that does not move with the vehicle.
struct LidarPose {
  double time;  ///< after the stamp of the cloud [s]
  Eigen::Isometry3d T_fixed_lidar;
};

/// Moves every point to where a LiDAR that stands still at its pose of `time` would have seen it. A cloud
/// without times per point was taken as a whole at its stamp. Afterwards all points belong to `time`, and
/// their own times are forgotten. What moved by itself stays smeared.
///
/// Between two poses the LiDAR moves along a screw, with constant speed and turn rate.
/// @param poses  in the order of time, each later than the one before; first and last enclose the points'
/// times and `time`
/// @param time   after the stamp of the cloud [s]
/// @throw Error(kMotion) if they do not.
void deskew(PointCloud& cloud, const std::vector<LidarPose>& poses, double time);

}  // namespace lidar_camera_recalibration

#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <tf2/buffer_core.h>

#include <Eigen/Geometry>
#include <string>

#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// The two frames between which the extrinsic lies.
struct FrameIds {
  std::string camera;  ///< optical frame
  std::string lidar;
};

/// T_target_source at the stamp, or the latest one if tf does not reach that stamp.
/// @throw Error(kExtrinsic) saying which frames are not connected and what to do.
Eigen::Isometry3d lookUp(const tf2::BufferCore& tf, const std::string& target, const std::string& source,
                         const ros::Time& stamp);

/// The transform to broadcast: by default LiDAR frame -> `<camera frame>_recalibrated`; with
/// tf_correct_parent and tf_correct_child the extrinsic re-expressed on that edge, so that the vehicle's
/// chain from LiDAR to camera comes out as `T_camera_lidar`.
/// @throw Error(kExtrinsic) if the edge does not lie between the two sensors.
geometry_msgs::TransformStamped outputTransform(const tf2::BufferCore& tf, const ServerConfig& config,
                                                const FrameIds& frames,
                                                const Eigen::Isometry3d& T_camera_lidar);

}  // namespace lidar_camera_recalibration

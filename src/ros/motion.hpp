#pragma once

#include <ros/time.h>
#include <tf2/buffer_core.h>

#include <string>

#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Moves a cloud to the stamp of its image, each point from its own time if it has one, by the way of the
/// LiDAR in the fixed frame. tf is asked for some 100 poses at most.
/// @return how fast the vehicle turned when the image was taken [deg/s]
/// @throw Error(kMotion) if tf does not cover the frame, naming the frames and what to do.
double moveToImage(PointCloud& cloud, const tf2::BufferCore& tf, const std::string& fixed_frame,
                   const std::string& lidar_frame, const ros::Time& cloud_stamp,
                   const ros::Time& image_stamp);

}  // namespace lidar_camera_recalibration

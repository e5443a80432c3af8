#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <string>

namespace lidar_camera_recalibration {

/// A camera_info YAML as camera_calibration writes it. Left out may be the distortion, and one of
/// camera_matrix and projection_matrix. @throw Error(kFile) naming the file and the key.
sensor_msgs::CameraInfo readCameraInfoFile(const std::string& path);

}  // namespace lidar_camera_recalibration

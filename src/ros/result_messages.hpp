#pragma once

#include <lidar_camera_recalibration/CalibrationResult.h>
#include <lidar_camera_recalibration/CalibrationScore.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <Eigen/Geometry>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/frame.hpp"
#include "tf_output.hpp"

namespace lidar_camera_recalibration {

/// What the core found, as messages.

CalibrationResult toMessage(const CalibrationOutcome& outcome, const FrameIds& frames,
                            const ros::Time& stamp);

/// Scores of one frame under one extrinsic; `used` and `reason` are left to the caller.
CalibrationScore scoreMessage(const std_msgs::Header& image_header, const Score& score, double validity);

/// Of a frame that could not be scored.
/// @param frame   what the frame alone says
/// @param window  what it says together with the frames before it
void addDrift(const DriftVerdict& frame, const DriftVerdict& window, const DriftConfig& config,
              CalibrationScore& message);
CalibrationScore refusedMessage(const std_msgs::Header& image_header, const std::string& reason);

/// The points that the camera sees, in the LiDAR frame, painted with its image: fields x, y, z, rgb.
sensor_msgs::PointCloud2Ptr coloredPoints(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar,
                                          const std_msgs::Header& cloud_header);

sensor_msgs::ImagePtr toImageMessage(const cv::Mat& bgr, const std_msgs::Header& header);

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "frame_synchroniser.hpp"
#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"
#include "server_config.hpp"
#include "tf_output.hpp"

namespace lidar_camera_recalibration {

/// The four messages of a frame as core types.
struct FrameInputs {
  Camera camera;
  cv::Mat image;
  std::vector<cv::Mat> layers;
  PointCloud cloud;
};

/// @throw Error naming the input (image, camera_info, points, masks) and what is wrong with it.
FrameInputs readMessages(const FrameMessages& messages, const ServerConfig& config);

/// The parameters' frame ids, otherwise the messages'. @throw Error(kImage, kCloud) if a message names none.
FrameIds frameIds(const FrameMessages& messages, const ServerConfig& config);

/// How much of the cloud the camera sees under the first guess; a guess that is quite wrong shows here before
/// any search.
struct StartupCheck {
  bool plausible = false;
  std::string text;  ///< for the log; says what to try if it is not plausible
};
StartupCheck checkProjection(const FrameInputs& inputs, const Eigen::Isometry3d& T_camera_lidar,
                             const FrameIds& frames);

}  // namespace lidar_camera_recalibration

#include "frame_builder.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "conversions.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

/// Runs a conversion and puts the input's name before its complaint.
template <typename Convert>
auto named(const char* input, const Convert& convert) {
  try {
    return convert();
  } catch (const Error& e) {
    throw Error(e.cause(), std::string(input) + ": " + e.what());
  }
}

std::string frameId(const std::string& parameter, const std::string& from_message, ErrorCause cause,
                    const char* input, const char* parameter_name) {
  std::string id = parameter.empty() ? from_message : parameter;
  id.erase(0, id.find_first_not_of('/'));  // tf2 knows no leading slash
  if (id.empty())
    throw Error(cause, std::string(input) +
                           ": the message has no frame id; set it in the driver, or the parameter " +
                           parameter_name);
  return id;
}

double shareInImage(const FrameInputs& inputs, const Eigen::Isometry3d& T_camera_lidar) {
  const Intrinsics& camera = inputs.camera.intrinsics();
  const auto inImage = [&](const Eigen::Vector3f& point) {
    const auto pixel = inputs.camera.project(T_camera_lidar * point.cast<double>());
    return pixel && pixel->x() >= 0.0 && pixel->y() >= 0.0 && pixel->x() < camera.width &&
           pixel->y() < camera.height;
  };
  const auto count = std::count_if(inputs.cloud.points.begin(), inputs.cloud.points.end(), inImage);
  return static_cast<double>(count) / static_cast<double>(std::max<std::size_t>(1, inputs.cloud.size()));
}

std::string percent(double share) {
  char text[16];
  std::snprintf(text, sizeof text, "%.1f %%", 100.0 * share);
  return text;
}

}  // namespace

FrameInputs readMessages(const FrameMessages& messages, const ServerConfig& config) {
  Camera camera = named("camera_info", [&] { return toCamera(*messages.info, config.image_rectified); });
  cv::Mat image = named("image", [&] { return toBgr(*messages.image); });
  const Intrinsics& intrinsics = camera.intrinsics();
  const auto requireSize = [&](const char* input, ErrorCause cause, const cv::Mat& actual) {
    if (actual.cols == intrinsics.width && actual.rows == intrinsics.height) return;
    throw Error(cause, std::string(input) + ": is " + std::to_string(actual.cols) + " x " +
                           std::to_string(actual.rows) + " px, but camera_info says " +
                           std::to_string(intrinsics.width) + " x " + std::to_string(intrinsics.height) +
                           "; publish it at the size that the camera was calibrated for");
  };
  requireSize("image", ErrorCause::kImage, image);
  std::vector<cv::Mat> layers = named("masks", [&] { return toMaskLayers(*messages.masks); });
  for (const cv::Mat& layer : layers) requireSize("masks", ErrorCause::kMasks, layer);
  PointCloud cloud = named("points", [&] { return toPointCloud(*messages.cloud, config.intensity_field); });
  return {std::move(camera), std::move(image), std::move(layers), std::move(cloud)};
}

FrameIds frameIds(const FrameMessages& messages, const ServerConfig& config) {
  return {frameId(config.camera_frame, messages.image->header.frame_id, ErrorCause::kImage, "image",
                  "camera_frame"),
          frameId(config.lidar_frame, messages.cloud->header.frame_id, ErrorCause::kCloud, "points",
                  "lidar_frame")};
}

StartupCheck checkProjection(const FrameInputs& inputs, const Eigen::Isometry3d& T_camera_lidar,
                             const FrameIds& frames) {
  // A camera with 20 deg of view still sees about 5 % of a spinning LiDAR's points.
  constexpr double kPlausibleShare = 0.02;
  const double share = shareInImage(inputs, T_camera_lidar);
  StartupCheck check;
  check.plausible = share >= kPlausibleShare;
  check.text = percent(share) + " of " + std::to_string(inputs.cloud.size()) +
               " points land in the image under the initial extrinsic";
  if (check.plausible) return check;

  // A frame with x forward, y left, z up (REP 103's body) in place of the optical one is the usual mistake.
  Eigen::Isometry3d T_optical_body = Eigen::Isometry3d::Identity();
  T_optical_body.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  const double share_if_body = shareInImage(inputs, T_optical_body * T_camera_lidar);
  const double share_if_inverse = shareInImage(inputs, T_camera_lidar.inverse());
  if (share_if_body >= std::max(kPlausibleShare, share_if_inverse)) {
    check.text += "; '" + frames.camera +
                  "' seems to be no optical frame (z forward, x right, y down): with x forward it " +
                  "would be " + percent(share_if_body) +
                  ". Set the parameter camera_frame to the optical frame";
  } else if (share_if_inverse >= kPlausibleShare) {
    check.text += "; the inverse of it would give " + percent(share_if_inverse) +
                  ". The extrinsic must map points of '" + frames.lidar + "' into '" + frames.camera + "'";
  } else {
    check.text += "; check the frames '" + frames.lidar + "' and '" + frames.camera +
                  "' in tf, or give the parameter initial_guess";
  }
  return check;
}

}  // namespace lidar_camera_recalibration

#include "bag_writing.hpp"

#include <vector>

namespace lidar_camera_recalibration {

sensor_msgs::CameraInfo toCameraInfo(const std_msgs::Header& header, const Intrinsics& intrinsics) {
  sensor_msgs::CameraInfo info;
  info.header = header;
  info.width = static_cast<std::uint32_t>(intrinsics.width);
  info.height = static_cast<std::uint32_t>(intrinsics.height);
  const bool distorted = intrinsics.model != DistortionModel::kNone;
  info.distortion_model = name(distorted ? intrinsics.model : DistortionModel::kPlumbBob);
  info.D = distorted ? intrinsics.distortion : std::vector<double>(5, 0.0);
  info.K = {intrinsics.fx, 0.0, intrinsics.cx, 0.0, intrinsics.fy, intrinsics.cy, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {intrinsics.fx, 0.0, intrinsics.cx, 0.0, 0.0, intrinsics.fy,
            intrinsics.cy, 0.0, 0.0,           0.0, 1.0, 0.0};
  return info;
}

}  // namespace lidar_camera_recalibration

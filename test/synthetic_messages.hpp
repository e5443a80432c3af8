#pragma once

#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/TransformStamped.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>
#include <boost/make_shared.hpp>

#include <string>

#include "conversions.hpp"
#include "frame_synchroniser.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {

/// The scene as a driver and a segmenter would publish it, in the frames `camera` and `lidar`.
inline FrameMessages syntheticMessages(const SyntheticScene& scene, const Camera& camera,
                                       const PointCloud& points, const ros::Time& stamp) {
  std_msgs::Header header;
  header.stamp = stamp;
  header.frame_id = "camera";
  FrameMessages messages;
  const cv::Mat labels = scene.labels(camera);
  messages.image = cv_bridge::CvImage(header, "bgr8", SyntheticScene::image(labels)).toImageMsg();
  messages.masks = boost::make_shared<sensor_msgs::Image>(toMaskMessage(header, {labels}));

  const Intrinsics& intrinsics = camera.intrinsics();
  auto info = boost::make_shared<sensor_msgs::CameraInfo>();
  info->header = header;
  info->width = static_cast<std::uint32_t>(intrinsics.width);
  info->height = static_cast<std::uint32_t>(intrinsics.height);
  info->distortion_model = "plumb_bob";
  info->D.assign(5, 0.0);
  info->K = {intrinsics.fx, 0.0, intrinsics.cx, 0.0, intrinsics.fy, intrinsics.cy, 0.0, 0.0, 1.0};
  info->R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info->P = {intrinsics.fx, 0.0, intrinsics.cx, 0.0, 0.0, intrinsics.fy,
             intrinsics.cy, 0.0, 0.0,           0.0, 1.0, 0.0};
  messages.info = info;

  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = header;
  cloud->header.frame_id = "lidar";
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2Fields(4, "x", 1, sensor_msgs::PointField::FLOAT32, "y", 1,
                                sensor_msgs::PointField::FLOAT32, "z", 1, sensor_msgs::PointField::FLOAT32,
                                "intensity", 1, sensor_msgs::PointField::FLOAT32);
  modifier.resize(points.size());
  sensor_msgs::PointCloud2Iterator<float> value(*cloud, "x");
  for (std::size_t i = 0; i < points.size(); ++i, ++value) {
    for (int k = 0; k < 3; ++k) value[static_cast<std::size_t>(k)] = points.points[i][k];
    value[3] = points.reflectivity[i];
  }
  messages.cloud = cloud;
  return messages;
}

template <typename Message>
boost::shared_ptr<Message> stamped(const boost::shared_ptr<const Message>& message, const ros::Time& stamp) {
  const auto copy = boost::make_shared<Message>(*message);
  copy->header.stamp = stamp;
  return copy;
}

inline FrameMessages syntheticMessages(unsigned seed, const ros::Time& stamp) {
  const SyntheticScene scene(seed);
  return syntheticMessages(scene, SyntheticScene::camera(), scene.cloud(), stamp);
}

/// About 1.7 deg and 6 cm from the scene's extrinsic.
inline Eigen::Isometry3d wrongGuess() {
  Vector6d xi;
  xi << 0.015, -0.02, 0.015, 0.04, -0.03, 0.03;
  return exp(xi) * SyntheticScene::T_camera_lidar();
}

inline geometry_msgs::TransformStamped stampedTransform(const Eigen::Isometry3d& T_parent_child,
                                                        const std::string& parent, const std::string& child) {
  geometry_msgs::TransformStamped message = tf2::eigenToTransform(T_parent_child);
  message.header.frame_id = parent;
  message.child_frame_id = child;
  return message;
}

}  // namespace lidar_camera_recalibration

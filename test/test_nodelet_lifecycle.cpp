// Loads and unloads nodelets in a running manager, as an operator or a crash-proof vehicle would.
#include <gtest/gtest.h>
#include <nodelet/NodeletList.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <sensor_msgs/CompressedImage.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include <algorithm>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>

#include "ros_rig.hpp"

namespace lidar_camera_recalibration {
namespace {

const std::string kManager = "/manager";

bool load(const std::string& name, const std::string& image = "/camera/image_raw",
          const std::string& masks = "/camera/masks") {
  nodelet::NodeletLoad service;
  service.request.name = name;
  service.request.type = "lidar_camera_recalibration/RecalibrationNodelet";
  const std::pair<std::string, std::string> remappings[] = {{"/image", image},
                                                            {"/camera_info", "/camera/camera_info"},
                                                            {"/points", "/lidar/points"},
                                                            {"/masks", masks}};
  for (const auto& [from, to] : remappings) {
    service.request.remap_source_args.push_back(from);
    service.request.remap_target_args.push_back(to);
  }
  return ros::service::waitForService(kManager + "/load_nodelet", ros::Duration(20.0)) &&
         ros::service::call(kManager + "/load_nodelet", service) && service.response.success;
}

bool unload(const std::string& name) {
  nodelet::NodeletUnload service;
  service.request.name = name;
  return ros::service::call(kManager + "/unload_nodelet", service) && service.response.success;
}

std::vector<std::string> loaded() {
  nodelet::NodeletList service;
  EXPECT_TRUE(ros::service::call(kManager + "/list", service)) << "the manager is gone";
  return service.response.nodelets;
}

sensor_msgs::CompressedImage compressed(const sensor_msgs::Image& image, const std::string& format,
                                        const std::string& extension) {
  sensor_msgs::CompressedImage message;
  message.header = image.header;
  message.format = format;
  cv::imencode(extension, cv_bridge::toCvCopy(image)->image, message.data);
  return message;
}

void setQuickParameters(const std::string& node) {
  ros::param::set(node + "/frames/min", 2);
  ros::param::set(node + "/features/normal_neighbours", 10);
}

TEST(NodeletLifecycle, UnloadsDuringASearch) {
  const std::string node = "/recalibration";
  setQuickParameters(node);
  ros::param::set(node + "/objective", "paper");
  ros::param::set(node + "/search", "paper");
  ros::param::set(node + "/paper/refine_evaluations", 1000000);  // minutes
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(stampedTransform(wrongGuess().inverse(), "lidar", "camera"));
  RosRig rig(node);
  for (int round = 0; round < 5; ++round) {
    ASSERT_TRUE(load(node)) << "round " << round;
    ASSERT_TRUE(rig.connect());
    double stamp = 1000.0 * (round + 1);
    ASSERT_TRUE(RosRig::eventually([&] { return rig.frame(1, ros::Time(stamp += 2.0)).used; }));
    ASSERT_TRUE(rig.frame(2, ros::Time(stamp += 2.0)).used);
    Recalibrate service;
    ASSERT_TRUE(rig.call("recalibrate", service));
    EXPECT_TRUE(service.response.success) << service.response.message;
    ASSERT_TRUE(RosRig::eventually([&] { return rig.state().state == RecalibrationState::SEARCHING; }));
    const ros::WallTime start = ros::WallTime::now();
    ASSERT_TRUE(unload(node));
    EXPECT_LT((ros::WallTime::now() - start).toSec(), 5.0);
    EXPECT_TRUE(loaded().empty());
    ASSERT_TRUE(RosRig::eventually([&] { return !rig.isConnected(); }));
  }
}

TEST(NodeletLifecycle, ABadParameterLeavesTheManagerAlive) {
  const std::string node = "/misconfigured";
  ros::param::set(node + "/frames/min", -3);
  RosRig rig(node);
  EXPECT_TRUE(load(node));
  EXPECT_TRUE(RosRig::eventually([&] {
    return rig.diagnostic("misconfigured: inputs").level == diagnostic_msgs::DiagnosticStatus::ERROR;
  }));
  EXPECT_NE(rig.diagnostic("misconfigured: inputs").message.find("frames/min"), std::string::npos)
      << rig.diagnostic("misconfigured: inputs").message;
  EXPECT_FALSE(rig.isConnected()) << "it must not work with it";
  EXPECT_TRUE(unload(node));
  EXPECT_TRUE(loaded().empty());
}

TEST(NodeletLifecycle, ABadParameterEndsTheNode) {
  ros::param::set("/misconfigured_node/search", "magic");
  const int status = std::system(NODE_PROGRAM " __name:=misconfigured_node");
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 1);
}

TEST(NodeletLifecycle, TakesCompressedImages) {
  const std::string node = "/compressed_recalibration";
  setQuickParameters(node);
  ros::param::set(node + "/compressed", true);
  ros::param::set(node + "/masks_compressed", true);
  ros::param::set(node + "/initial/T_camera_lidar",
                  std::vector<double>{0, -1, 0, 0.05, 0, 0, -1, -0.3, 1, 0, 0, -0.2, 0, 0, 0, 1});
  ros::NodeHandle handle;
  ros::Publisher image = handle.advertise<sensor_msgs::CompressedImage>("/zipped/image/compressed", 10);
  ros::Publisher masks = handle.advertise<sensor_msgs::CompressedImage>("/zipped/masks/compressed", 10);
  RosRig rig(node);
  ASSERT_TRUE(load(node, "/zipped/image", "/zipped/masks"));
  ASSERT_TRUE(
      RosRig::eventually([&] { return image.getNumSubscribers() > 0 && masks.getNumSubscribers() > 0; }));
  ASSERT_TRUE(rig.connect(false));
  double stamp = 20000.0;
  EXPECT_TRUE(RosRig::eventually([&] {
    return rig
        .frame(1, ros::Time(stamp += 2.0),
               [&](FrameMessages& messages) {
                 image.publish(compressed(*messages.image, "bgr8; jpeg compressed bgr8", ".jpg"));
                 masks.publish(compressed(*messages.masks, "16UC1; png compressed", ".png"));
                 messages.image.reset();
                 messages.masks.reset();
               })
        .used;
  }));
  EXPECT_TRUE(unload(node));
}

TEST(NodeletLifecycle, TwoInOneManagerBothKeepTheirTransform) {
  ros::param::set("/first/initial/T_camera_lidar",
                  std::vector<double>{0, -1, 0, 0.1, 0, 0, -1, 0, 1, 0, 0, 0, 0, 0, 0, 1});
  ros::param::set("/second/initial/T_camera_lidar",
                  std::vector<double>{0, -1, 0, 0.2, 0, 0, -1, 0, 1, 0, 0, 0, 0, 0, 0, 1});
  ros::param::set("/first/tf/child_frame", "first_camera");
  ros::param::set("/second/tf/child_frame", "second_camera");
  RosRig first("/first"), second("/second");
  ASSERT_TRUE(load("/first"));
  ASSERT_TRUE(load("/second"));
  ASSERT_TRUE(first.connect());
  ASSERT_TRUE(second.connect());
  ASSERT_TRUE(RosRig::eventually([&] {
    static double stamp = 9000.0;
    return first.frame(1, ros::Time(stamp += 2.0)).used;
  }));
  // A listener that comes late must get both from the latched topic.
  ros::WallDuration(1.0).sleep();
  std::vector<std::string> children;
  ros::NodeHandle handle;
  const ros::Subscriber late = handle.subscribe<tf2_msgs::TFMessage>(
      "/tf_static", 10, [&](const tf2_msgs::TFMessage::ConstPtr& message) {
        for (const auto& transform : message->transforms) children.push_back(transform.child_frame_id);
      });
  const auto has = [&](const char* child) { return std::count(children.begin(), children.end(), child) > 0; };
  EXPECT_TRUE(RosRig::eventually([&] { return has("first_camera") && has("second_camera"); }, 10.0));
  EXPECT_TRUE(unload("/first"));
  EXPECT_TRUE(unload("/second"));
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_nodelet_lifecycle");
  ros::AsyncSpinner spinner(1);
  spinner.start();
  return RUN_ALL_TESTS();
}

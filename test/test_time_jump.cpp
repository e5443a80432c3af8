// A bag that starts again: simulated time and stamps go back.
#include <gtest/gtest.h>
#include <rosgraph_msgs/Clock.h>
#include <tf2_ros/static_transform_broadcaster.h>

#include "ros_rig.hpp"

namespace lidar_camera_recalibration {
namespace {

TEST(TimeJump, ClearsCachesAndGoesOn) {
  ros::NodeHandle handle;
  ros::Publisher clock = handle.advertise<rosgraph_msgs::Clock>("/clock", 10, true);
  const auto setClock = [&](double seconds) {
    rosgraph_msgs::Clock message;
    message.clock = ros::Time(seconds);
    clock.publish(message);
    RosRig::eventually([&] { return ros::Time::now() == message.clock; });
  };
  setClock(5000.0);
  tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(stampedTransform(wrongGuess().inverse(), "lidar", "camera"));
  RosRig rig;
  ASSERT_TRUE(rig.connect());
  double stamp = 5000.0;
  ASSERT_TRUE(RosRig::eventually([&] { return rig.frame(1, ros::Time(stamp += 2.0)).used; }));
  const auto held = rig.state().frames;

  FrameMessages pending = syntheticMessages(2, ros::Time(stamp += 2.0));
  pending.masks.reset();
  rig.publish(pending);
  ASSERT_TRUE(RosRig::eventually([&] { return rig.state().pending == 1; }));

  setClock(4000.0);
  EXPECT_TRUE(RosRig::eventually([&] { return rig.state().pending == 0; }))
      << "the waiting image is of another round";
  EXPECT_GE(rig.state().frames, held) << "prepared frames stay";
  const CalibrationScore score = rig.frame(3, ros::Time(4001.0));
  EXPECT_TRUE(score.used) << score.reason;
  EXPECT_TRUE(rig.frame(4, ros::Time(4003.0)).used) << "one jump is noticed once";
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_time_jump");
  ros::AsyncSpinner spinner(1);
  spinner.start();
  return RUN_ALL_TESTS();
}

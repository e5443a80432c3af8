#include "result_messages.hpp"

#include <gtest/gtest.h>

namespace lidar_camera_recalibration {
namespace {

TEST(ResultMessage, SaysWhichFramesWereLeftOut) {
  CalibrationOutcome outcome;
  outcome.frames = 8;
  outcome.left_out = {1, 4};
  outcome.left_out_stamps = {1317046450.25, 1317046453.5};
  outcome.unseen.distinctness = 7.5;
  outcome.unseen.scatter[4] = 0.25;
  outcome.kept[5] = true;
  const CalibrationResult message = toMessage(outcome, {"camera", "lidar"}, ros::Time(5));
  EXPECT_EQ(message.frames, 8u);
  EXPECT_EQ(message.frames_left_out, 2u);
  ASSERT_EQ(message.stamps_left_out.size(), 2u);
  EXPECT_EQ(message.stamps_left_out[0], ros::Time(1317046450, 250000000));
  EXPECT_EQ(message.stamps_left_out[1], ros::Time(1317046453, 500000000));
  EXPECT_EQ(message.distinctness, 7.5);
  EXPECT_EQ(message.scatter[4], 0.25);
  EXPECT_TRUE(message.kept[5]);
  EXPECT_FALSE(message.kept[4]);
}

TEST(ResultMessage, WhatIsUnknownIsMinusOne) {
  const CalibrationResult message = toMessage(CalibrationOutcome(), {"camera", "lidar"}, ros::Time(5));
  EXPECT_EQ(message.covariance[0], -1.0);
  EXPECT_EQ(message.distinctness, -1.0);
  EXPECT_EQ(message.frames_left_out, 0u);
  EXPECT_TRUE(message.stamps_left_out.empty());
}

}  // namespace
}  // namespace lidar_camera_recalibration

#include "automatic_policy.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace lidar_camera_recalibration {
namespace {

/// Times at which a search starts, if a frame is judged each second and a search takes no time.
std::vector<double> starts(AutomaticPolicy& policy, const std::vector<double>& probabilities,
                           double begin = 100.0) {
  std::vector<double> times;
  double time = begin;
  for (const double probability : probabilities) {
    if (policy.judge(probability, time)) {
      times.push_back(time);
      policy.searchEnded();
    }
    time += 1.0;
  }
  return times;
}

std::vector<double> constant(double probability, std::size_t count) {
  return std::vector<double>(count, probability);
}

TEST(AutomaticPolicy, anExtrinsicThatFitsStartsNothing) {
  AutomaticPolicy policy(10.0);
  EXPECT_TRUE(starts(policy, constant(0.5, 1000)).empty());
  EXPECT_TRUE(starts(policy, constant(0.89, 1000)).empty()) << "doubt is not enough";
}

TEST(AutomaticPolicy, aDriftCountsAfterThreeFramesInARow) {
  AutomaticPolicy policy(10.0);
  EXPECT_EQ(starts(policy, {0.1, 0.95, 0.95, 0.8, 0.95, 0.95}), std::vector<double>());
  EXPECT_EQ(starts(policy, {0.95, 0.3}), std::vector<double>{100.0});
}

TEST(AutomaticPolicy, searchesKeepTheirDistanceAndItDoubles) {
  AutomaticPolicy policy(10.0);
  const std::vector<double> times = starts(policy, constant(1.0, 2000));
  ASSERT_GE(times.size(), 5u);
  EXPECT_EQ(times[0], 102.0);
  EXPECT_EQ(times[1], 112.0);
  EXPECT_EQ(times[2], 132.0);
  EXPECT_EQ(times[3], 172.0);
  EXPECT_LE(times.back() - times[times.size() - 2], 320.0) << "it does not give up";
}

TEST(AutomaticPolicy, anExtrinsicThatFitsAgainEndsTheBackingOff) {
  AutomaticPolicy policy(10.0);
  starts(policy, constant(1.0, 80));  // the next one would be 80 s later
  starts(policy, constant(0.1, 100), 180.0);
  EXPECT_EQ(starts(policy, constant(1.0, 15), 280.0), (std::vector<double>{282.0, 292.0}));
}

TEST(AutomaticPolicy, jumpingProbabilitiesCannotMakeItOscillate) {
  AutomaticPolicy policy(60.0);
  std::vector<double> jumping;
  for (int i = 0; i < 600; ++i) jumping.push_back(i % 6 < 3 ? 0.0 : 1.0);
  EXPECT_LE(starts(policy, jumping).size(), 600u / 60u);
}

TEST(AutomaticPolicy, afterARestoreItWaitsUntilTheExtrinsicFits) {
  AutomaticPolicy policy(10.0);
  policy.restored();
  EXPECT_TRUE(starts(policy, constant(1.0, 1000)).empty());
  EXPECT_TRUE(starts(policy, {0.2, 1.0, 1.0}, 1100.0).empty());
  EXPECT_EQ(starts(policy, {1.0}, 1103.0).size(), 1u);
}

TEST(AutomaticPolicy, knowsSinceWhenItDoubts) {
  AutomaticPolicy policy(10.0);
  policy.judge(0.1, 100.0);
  EXPECT_FALSE(policy.doubtfulSince());
  policy.judge(0.6, 101.0);
  policy.judge(0.95, 102.0);
  EXPECT_EQ(policy.doubtfulSince().value(), 101.0);
  policy.judge(0.5, 103.0);
  EXPECT_FALSE(policy.doubtfulSince());
}

TEST(AutomaticPolicy, survivesABagThatStartsAgain) {
  AutomaticPolicy policy(10.0);
  EXPECT_EQ(starts(policy, constant(1.0, 3), 5000.0).size(), 1u);
  EXPECT_EQ(starts(policy, constant(1.0, 30), 100.0).size(), 1u)
      << "it does not wait for the old times to return";
  ASSERT_TRUE(policy.doubtfulSince());
  EXPECT_EQ(*policy.doubtfulSince(), 100.0);
}

}  // namespace
}  // namespace lidar_camera_recalibration

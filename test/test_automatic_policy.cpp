#include "automatic_policy.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace lidar_camera_recalibration {
namespace {

using State = DriftVerdict::State;
constexpr State kFits = State::kFits, kDoubt = State::kDoubtful, kOff = State::kOff;

/// Times at which a search starts, if a frame is judged each second and a search takes no time.
std::vector<double> starts(AutomaticPolicy& policy, const std::vector<State>& verdicts,
                           double begin = 100.0) {
  std::vector<double> times;
  double time = begin;
  for (const State verdict : verdicts) {
    if (policy.judge(verdict, time)) {
      times.push_back(time);
      policy.searchEnded();
    }
    time += 1.0;
  }
  return times;
}

std::vector<State> constant(State verdict, std::size_t count) { return std::vector<State>(count, verdict); }

TEST(AutomaticPolicy, anExtrinsicThatFitsStartsNothing) {
  AutomaticPolicy policy(10.0);
  EXPECT_TRUE(starts(policy, constant(kFits, 1000)).empty());
  EXPECT_TRUE(starts(policy, constant(kDoubt, 1000)).empty()) << "doubt is not enough";
}

TEST(AutomaticPolicy, aDriftCountsAfterThreeFramesInARow) {
  AutomaticPolicy policy(10.0);
  EXPECT_EQ(starts(policy, {kFits, kOff, kOff, kDoubt, kOff, kOff}), std::vector<double>());
  EXPECT_EQ(starts(policy, {kOff, kFits}), std::vector<double>{100.0});
}

TEST(AutomaticPolicy, searchesKeepTheirDistanceAndItDoubles) {
  AutomaticPolicy policy(10.0);
  const std::vector<double> times = starts(policy, constant(kOff, 2000));
  ASSERT_GE(times.size(), 5u);
  EXPECT_EQ(times[0], 102.0);
  EXPECT_EQ(times[1], 112.0);
  EXPECT_EQ(times[2], 132.0);
  EXPECT_EQ(times[3], 172.0);
  EXPECT_LE(times.back() - times[times.size() - 2], 320.0) << "it does not give up";
}

TEST(AutomaticPolicy, anExtrinsicThatFitsAgainEndsTheBackingOff) {
  AutomaticPolicy policy(10.0);
  starts(policy, constant(kOff, 80));  // the next one would be 80 s later
  starts(policy, constant(kFits, 100), 180.0);
  EXPECT_EQ(starts(policy, constant(kOff, 15), 280.0), (std::vector<double>{282.0, 292.0}));
}

TEST(AutomaticPolicy, jumpingVerdictsCannotMakeItOscillate) {
  AutomaticPolicy policy(60.0);
  std::vector<State> jumping;
  for (int i = 0; i < 600; ++i) jumping.push_back(i % 6 < 3 ? kFits : kOff);
  EXPECT_LE(starts(policy, jumping).size(), 600u / 60u);
}

TEST(AutomaticPolicy, afterARestoreItWaitsUntilTheExtrinsicFits) {
  AutomaticPolicy policy(10.0);
  policy.restored();
  EXPECT_TRUE(starts(policy, constant(kOff, 1000)).empty());
  EXPECT_TRUE(starts(policy, {kFits, kOff, kOff}, 1100.0).empty());
  EXPECT_EQ(starts(policy, {kOff}, 1103.0).size(), 1u);
}

TEST(AutomaticPolicy, knowsSinceWhenItDoubts) {
  AutomaticPolicy policy(10.0);
  policy.judge(kFits, 100.0);
  EXPECT_FALSE(policy.doubtfulSince());
  policy.judge(kDoubt, 101.0);
  policy.judge(kOff, 102.0);
  EXPECT_EQ(policy.doubtfulSince().value(), 101.0);
  policy.judge(kFits, 103.0);
  EXPECT_FALSE(policy.doubtfulSince());
  EXPECT_FALSE(policy.judge(State::kUnknown, 104.0));
  EXPECT_FALSE(policy.doubtfulSince()) << "nothing is known, so there is no doubt";
}

TEST(AutomaticPolicy, survivesABagThatStartsAgain) {
  AutomaticPolicy policy(10.0);
  EXPECT_EQ(starts(policy, constant(kOff, 3), 5000.0).size(), 1u);
  EXPECT_EQ(starts(policy, constant(kOff, 30), 100.0).size(), 1u)
      << "it does not wait for the old times to return";
  ASSERT_TRUE(policy.doubtfulSince());
  EXPECT_EQ(*policy.doubtfulSince(), 100.0);
}

}  // namespace
}  // namespace lidar_camera_recalibration

#include "lidar_camera_recalibration/drift_monitor.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {
namespace {

using State = DriftVerdict::State;

Eigen::Isometry3d truth() { return SyntheticScene::T_camera_lidar(); }

Eigen::Isometry3d movedBy(int axis, double amount) {
  Vector6d xi = Vector6d::Zero();
  xi[axis] = amount;
  return exp(xi) * truth();
}

class DriftMonitorTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    FrameConfig config;
    config.features.plane_min_points = 500;
    for (unsigned seed = 1; seed <= 4; ++seed) {
      const SyntheticScene scene(seed);
      frames().push_back(
          makeFrame(seed, scene.camera(), scene.image(), {scene.labels()}, scene.cloud(), truth(), config));
    }
  }
  static void TearDownTestSuite() { frames().clear(); }
  static Frames& frames() {
    static Frames frames;
    return frames;
  }

  static std::unique_ptr<Evaluator> evaluator(std::size_t frame,
                                              const char* objective = "consistency_edges") {
    ObjectiveConfig config;
    config.objective = objective;
    return makeObjective(config)->evaluator({frames()[frame]}, {});
  }

  /// Of all frames.
  static DriftVerdict verdictOn(const Eigen::Isometry3d& T, const DriftConfig& config = DriftConfig()) {
    DriftMonitor monitor(config);
    for (std::size_t i = 0; i < frames().size(); ++i) monitor.add(*evaluator(i), T);
    return monitor.window(T);
  }
};

TEST_F(DriftMonitorTest, TheTruthFits) {
  const DriftVerdict verdict = verdictOn(truth());
  EXPECT_EQ(verdict.frames, 4u);
  EXPECT_LT(verdict.probability, 0.2);
  EXPECT_EQ(verdict.state(), State::kFits);
}

TEST_F(DriftMonitorTest, ProbabilityRisesWithTheOffset) {
  constexpr double kSure = 0.95;  // where the scores around it are chance, it goes up and down a little
  for (const auto& [axis, step] : {std::pair(0, 0.25 * kDegree), {1, 0.25 * kDegree}, {3, 0.04}}) {
    for (const double side : {-1.0, 1.0}) {
      double before = verdictOn(truth()).probability;
      for (int i = 1; i <= 4; ++i) {
        const double probability = verdictOn(movedBy(axis, side * i * step)).probability;
        EXPECT_GT(probability, std::min(before, kSure)) << "axis " << axis << ", " << side * i << " steps";
        before = probability;
      }
      EXPECT_GT(before, kSure) << axis;
    }
  }
}

TEST_F(DriftMonitorTest, WhatIsOffDependsOnTheTolerance) {
  const Eigen::Isometry3d moved = movedBy(1, 0.15 * kDegree);
  EXPECT_EQ(verdictOn(moved).state(), State::kFits);
  DriftConfig strict;
  strict.rotation_tolerance_deg = 0.1;
  strict.translation_tolerance_m = 0.02;
  EXPECT_NE(verdictOn(moved, strict).state(), State::kFits);
}

TEST_F(DriftMonitorTest, TheWindowHoldsTheNewestFrames) {
  DriftConfig config;
  config.window = 2;
  DriftMonitor monitor(config);
  for (std::size_t i = 0; i < 4; ++i) monitor.add(*evaluator(i), truth());
  DriftMonitor only_newest(config);
  for (std::size_t i = 2; i < 4; ++i) only_newest.add(*evaluator(i), truth());
  EXPECT_EQ(monitor.window(truth()).frames, 2u);
  EXPECT_EQ(monitor.window(truth()).statistic, only_newest.window(truth()).statistic);
}

TEST_F(DriftMonitorTest, AFrameThatIsNotKeptIsJudgedAlone) {
  DriftMonitor monitor{DriftConfig()};
  monitor.add(*evaluator(0), truth());
  const double before = monitor.window(truth()).statistic;
  EXPECT_EQ(monitor.add(*evaluator(1), truth(), false).frames, 1u);
  EXPECT_EQ(monitor.window(truth()).frames, 1u);
  EXPECT_EQ(monitor.window(truth()).statistic, before);
}

TEST_F(DriftMonitorTest, OneFrameCountsForItself) {
  DriftMonitor monitor{DriftConfig()};
  const DriftVerdict first = monitor.add(*evaluator(0), truth());
  EXPECT_EQ(first.frames, 1u);
  EXPECT_EQ(first.probability, monitor.window(truth()).probability);
  const DriftVerdict second = monitor.add(*evaluator(1), truth());
  EXPECT_EQ(second.frames, 1u);
  EXPECT_EQ(monitor.window(truth()).frames, 2u);
}

TEST_F(DriftMonitorTest, BeginsAnewWhenTheExtrinsicChanges) {
  const Eigen::Isometry3d moved = movedBy(1, 0.01);
  DriftMonitor monitor{DriftConfig()};
  monitor.add(*evaluator(0), moved);
  monitor.add(*evaluator(1), moved);
  EXPECT_EQ(monitor.window(moved).state(), State::kUnknown) << "two frames are too few";
  monitor.add(*evaluator(3), moved);
  EXPECT_EQ(monitor.window(moved).state(), State::kOff);
  EXPECT_EQ(monitor.window(truth()).state(), State::kUnknown)
      << "its frames were seen under another extrinsic";
  monitor.add(*evaluator(2), truth());
  EXPECT_EQ(monitor.window(truth()).frames, 1u);
  EXPECT_EQ(monitor.window(moved).frames, 0u);
  monitor.reset();
  EXPECT_EQ(monitor.window(truth()).frames, 0u);
}

TEST_F(DriftMonitorTest, OtherObjectivesCannotTell) {
  DriftMonitor monitor{DriftConfig()};
  EXPECT_EQ(monitor.add(*evaluator(0, "paper"), truth()).state(), State::kUnknown);
  EXPECT_EQ(monitor.window(truth()).frames, 0u);
  EXPECT_EQ(describe(monitor.window(truth()), DriftConfig()),
            "too few frames have told yet whether the extrinsic fits");
}

TEST(DriftMonitor, RefusesNonsense) {
  for (int wrong = 0; wrong < 3; ++wrong) {
    DriftConfig config;
    if (wrong == 0) config.rotation_tolerance_deg = 0.0;
    if (wrong == 1) config.translation_tolerance_m = -1.0;
    if (wrong == 2) config.window = 0;
    EXPECT_THROW(DriftMonitor{config}, Error) << wrong;
  }
}

}  // namespace
}  // namespace lidar_camera_recalibration

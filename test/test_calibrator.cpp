#include <gtest/gtest.h>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {
namespace {

Frames makeFrames(int count, const Eigen::Isometry3d& guess) {
  Frames frames;
  FrameConfig config;
  config.features.plane_min_points = 500;
  for (int i = 0; i < count; ++i) {
    const SyntheticScene scene(static_cast<unsigned>(i + 1));
    frames.push_back(
        makeFrame(i, scene.camera(), scene.image(), {scene.labels()}, scene.cloud(), guess, config));
  }
  return frames;
}

Eigen::Isometry3d perturbed(double rotation_deg, double translation_m) {
  Vector6d xi;
  xi << Eigen::Vector3d(1, -1, 0.5).normalized() * rotation_deg * kDegree,
      Eigen::Vector3d(-1, 0.5, 1).normalized() * translation_m;
  return exp(xi) * SyntheticScene::T_camera_lidar();
}

CalibratorConfig quickConfig() {
  CalibratorConfig config;
  config.search.refine_evaluations = 1200;
  config.range.rotation_deg = 3.0;
  config.range.translation_m = 0.1;
  return config;
}

TEST(Calibrator, FindsTheExtrinsicOfAnExactScene) {
  const Eigen::Isometry3d start = perturbed(2.5, 0.1);
  const CalibrationOutcome result = calibrate(makeFrames(5, start), start, quickConfig());
  const ExtrinsicError before = extrinsicError(start, SyntheticScene::T_camera_lidar());
  const ExtrinsicError after = extrinsicError(result.T_camera_lidar, SyntheticScene::T_camera_lidar());
  EXPECT_TRUE(result.accepted) << result.reason;
  EXPECT_LT(after.angle(), before.angle() / 6.0);
  EXPECT_LT(after.distance(), before.distance());
  EXPECT_GT(result.after.total, result.before.total);
  EXPECT_GT(*result.unseen.distinctness, 10.0);
  EXPECT_GT(result.unseen.gain, 5.0 * result.unseen.gain_sigma);
  EXPECT_EQ(result.frames, 5u);
  EXPECT_GT(result.pixel_shift[0], 5.0);
  ASSERT_TRUE(result.covariance.has_value());
  EXPECT_TRUE((result.covariance->diagonal().array() > 0.0).all());
  EXPECT_LT(std::sqrt(result.covariance->diagonal().head<3>().maxCoeff()), 0.5 * kDegree);
}

TEST(Calibrator, LeavesAGoodExtrinsicAlone) {
  const Eigen::Isometry3d truth = SyntheticScene::T_camera_lidar();
  CalibratorConfig config = quickConfig();
  config.range.rotation_deg = 1.0;
  config.range.translation_m = 0.02;
  const Frames frames = makeFrames(3, truth);
  const CalibrationOutcome first = calibrate(frames, truth, config);
  EXPECT_LT(extrinsicError(first.T_camera_lidar, truth).angle() / kDegree, 0.3);
  const CalibrationOutcome second = calibrate(frames, first.T_camera_lidar, config);
  EXPECT_FALSE(second.accepted);
  EXPECT_NE(second.reason.find("the extrinsic in use is as good"), std::string::npos) << second.reason;
}

TEST(Calibrator, RefusesAResultOnTheBorderOfTheRange) {
  const Eigen::Isometry3d start = perturbed(2.0, 0.02);
  CalibratorConfig config = quickConfig();
  config.range.rotation_deg = 1.0;
  config.range.translation_m = 0.0;
  config.search.refine_evaluations = 0;
  const CalibrationOutcome result = calibrate(makeFrames(3, start), start, config);
  EXPECT_FALSE(result.accepted);
  EXPECT_NE(result.reason.find("border"), std::string::npos) << result.reason;
}

TEST(Calibrator, RefusesFramesWithoutCommonView) {
  Eigen::Isometry3d away = SyntheticScene::T_camera_lidar();
  const Frames frames = makeFrames(1, away);
  away = Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()) * away;
  const CalibrationOutcome result = calibrate(frames, away, quickConfig());
  EXPECT_FALSE(result.accepted);
  EXPECT_NE(result.reason.find("no LiDAR point"), std::string::npos) << result.reason;
}

TEST(Calibrator, CanBeCancelled) {
  const Eigen::Isometry3d start = perturbed(2.0, 0.05);
  const CalibrationOutcome result = calibrate(makeFrames(1, start), start, quickConfig(),
                                              [](double fraction, double) { return fraction < 0.2; });
  EXPECT_TRUE(result.cancelled);
  EXPECT_FALSE(result.accepted);
}

TEST(Calibrator, NeedsFrames) {
  EXPECT_THROW(calibrate({}, Eigen::Isometry3d::Identity(), quickConfig()), Error);
}

}  // namespace
}  // namespace lidar_camera_recalibration

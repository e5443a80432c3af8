#include "gate.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "strips.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {
namespace {

Vector6d correction() {
  Vector6d xi;
  xi << 1.0 * kDegree, -0.5 * kDegree, 0.2 * kDegree, 0.05, -0.03, 0.08;
  return xi;
}

/// 0.02 deg and 1 cm on each axis.
Matrix6d certain() {
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(0.02 * kDegree), Eigen::Vector3d::Constant(0.01);
  return sigma.cwiseAbs2().asDiagonal();
}

/// What passes.
CalibrationOutcome goodOutcome() {
  CalibrationOutcome outcome;
  outcome.start = SyntheticScene::T_camera_lidar();
  outcome.T_camera_lidar = exp(correction()) * outcome.start;
  outcome.covariance = certain();
  outcome.before.total = 0.5;
  outcome.after.total = 0.8;
  outcome.after.masks = 40;
  outcome.unseen.gain = 0.25;
  outcome.unseen.gain_sigma = 0.03;
  outcome.unseen.distinctness = 12.0;
  outcome.unseen.scatter = certain().diagonal().cwiseSqrt();
  outcome.frames = 6;
  return outcome;
}

/// Judges the good outcome after `spoil`, which must make it rejected, with these words in the reason.
template <typename Spoil>
void expectRefused(const char* words, const Spoil& spoil) {
  CalibrationOutcome outcome = goodOutcome();
  spoil(outcome);
  judge(outcome, CalibratorConfig());
  EXPECT_FALSE(outcome.accepted) << words;
  EXPECT_EQ(outcome.reason.rfind("rejected: ", 0), 0u) << outcome.reason;
  EXPECT_NE(outcome.reason.find(words), std::string::npos) << outcome.reason;
}

TEST(Gate, AcceptsWhatUnseenFramesConfirm) {
  CalibrationOutcome outcome = goodOutcome();
  judge(outcome, CalibratorConfig());
  EXPECT_TRUE(outcome.accepted) << outcome.reason;
  EXPECT_EQ(outcome.reason,
            "accepted: on frames that the search did not see the score rises by 0.2500 +- 0.0300");
}

TEST(Gate, SaysWhyItRefuses) {
  expectRefused("no LiDAR point falls into any mask", [](auto& outcome) { outcome.after.masks = 0; });
  expectRefused("stands out by only 2.5", [](auto& outcome) { outcome.unseen.distinctness = 2.5; });
  expectRefused("stands out by only", [](auto& outcome) { outcome.unseen.distinctness = std::nan(""); });
  expectRefused("rises by 0.2500 +- 0.2000", [](auto& outcome) { outcome.unseen.gain_sigma = 0.2; });
  expectRefused("rises by -0.1000 +- 0.0300", [](auto& outcome) { outcome.unseen.gain = -0.1; });
  expectRefused("rises by 0.0000 +- 0.0000",
                [](auto& outcome) { outcome.unseen.gain = outcome.unseen.gain_sigma = 0.0; });
  expectRefused("is as good", [](auto& outcome) { outcome.after.total = 0.4; });
  expectRefused("standard deviation of the rotation about y is 0.35 deg",
                [](auto& outcome) { outcome.unseen.scatter[1] = 0.35 * kDegree; });
  expectRefused("determine the rotation about z to only 0.40 deg (gate/max_rotation_sigma_deg is 0.30 deg)",
                [](auto& outcome) { (*outcome.covariance)(2, 2) = 0.16 * kDegree * kDegree; });
}

TEST(Gate, RefusesTheBorderOfTheSearchRange) {
  expectRefused("rotation about x is corrected by 5.30 deg, on the border of the search range of 5.00 deg",
                [](auto& outcome) {
                  Vector6d xi = Vector6d::Zero();
                  xi[0] = 5.3 * kDegree;
                  outcome.T_camera_lidar = exp(xi) * outcome.start;
                });
  const auto shifted = [](double metres) {
    return [metres](auto& outcome) {
      Vector6d xi = Vector6d::Zero();
      xi[3] = metres;
      outcome.T_camera_lidar = exp(xi) * outcome.start;
    };
  };
  expectRefused("translation along x is corrected by 0.240 m, on the border", shifted(0.24));
  CalibrationOutcome at_end = goodOutcome();
  shifted(0.22)(at_end);  // the range of 0.2 m and two standard deviations
  judge(at_end, CalibratorConfig());
  EXPECT_TRUE(at_end.accepted) << at_end.reason;
}

TEST(Gate, RefusesCorrectionsWithinTheirOwnNoise) {
  const auto moved = [](double deg, double metres) {
    return [=](auto& outcome) {
      Vector6d xi = Vector6d::Zero();
      xi[2] = deg * kDegree;
      xi[4] = metres;
      outcome.T_camera_lidar = exp(xi) * outcome.start;
    };
  };
  expectRefused("most is the rotation about z with 0.04 deg of 0.05 deg", moved(0.04, 0.0));
  expectRefused("most is the translation along y with 0.019 m of 0.020 m", moved(0.0, 0.019));
  expectRefused("0.08 deg of 0.20 deg", [&](auto& outcome) {
    outcome.covariance = 25.0 * certain();
    moved(0.08, 0.0)(outcome);
  });
  CalibrationOutcome enough = goodOutcome();
  moved(0.06, 0.0)(enough);
  judge(enough, CalibratorConfig());
  EXPECT_TRUE(enough.accepted) << enough.reason;
}

TEST(Gate, WithoutACovarianceTheSearchesOnPartsTell) {
  CalibrationOutcome outcome = goodOutcome();
  outcome.covariance.reset();
  outcome.unseen.distinctness.reset();  // as objective `paper`
  judge(outcome, CalibratorConfig());
  EXPECT_TRUE(outcome.accepted) << outcome.reason;
  outcome.unseen.scatter *= 40.0;
  judge(outcome, CalibratorConfig());
  EXPECT_FALSE(outcome.accepted) << outcome.reason;
}

TEST(Gate, KeepsNothingOfWhatIsDetermined) {
  const Eigen::Isometry3d start = SyntheticScene::T_camera_lidar(), result = exp(correction()) * start;
  const Determined determined = keepUndetermined(result, certain(), start, GateConfig());
  EXPECT_TRUE(determined.T_camera_lidar.isApprox(result, 1e-12));
  EXPECT_EQ(determined.covariance, certain());
  EXPECT_EQ(determined.kept, (std::array<bool, 6>{}));
}

TEST(Gate, AnUndeterminedAxisKeepsTheStartsValue) {
  const Eigen::Isometry3d start = SyntheticScene::T_camera_lidar(), result = exp(correction()) * start;
  Matrix6d covariance = certain();
  covariance(5, 5) = 0.3 * 0.3;
  const Determined determined = keepUndetermined(result, covariance, start, GateConfig());
  EXPECT_EQ(determined.kept, (std::array<bool, 6>{false, false, false, false, false, true}));
  Vector6d expected = correction();
  expected[5] = 0.0;
  EXPECT_LT((log(determined.T_camera_lidar * start.inverse()) - expected).norm(), 1e-12);
  EXPECT_NEAR(determined.covariance(5, 5), 0.3 * 0.3, 1e-15);

  CalibrationOutcome outcome = goodOutcome();
  outcome.T_camera_lidar = determined.T_camera_lidar;
  outcome.covariance = determined.covariance;
  outcome.kept = determined.kept;
  outcome.unseen.scatter[5] = 0.5;  // of an axis that is not corrected
  judge(outcome, CalibratorConfig());
  EXPECT_TRUE(outcome.accepted) << outcome.reason;
  EXPECT_NE(outcome.reason.find(
                "; kept as it was, as the frames do not determine it: translation along z (0.300 m)"),
            std::string::npos)
      << outcome.reason;
}

// Pitch and height move the image alike. Each alone is known to 0.5 deg and 10 cm, but given the one the
// other is known well: one of them keeps its value, and what it would have corrected goes to the other.
TEST(Gate, OfTwoAxesThatTheFramesCannotTellApartOneIsCorrected) {
  const Eigen::Isometry3d start = SyntheticScene::T_camera_lidar();
  Vector6d confused = Vector6d::Zero();
  confused[0] = 0.5 * kDegree;
  confused[4] = 0.12;
  const Matrix6d covariance = certain() + confused * confused.transpose();
  Vector6d truth = Vector6d::Zero();
  truth[0] = 1.0 * kDegree;
  const Eigen::Isometry3d result = exp(truth + 0.7 * confused) * start;  // the error that they allow
  const Determined determined = keepUndetermined(result, covariance, start, GateConfig());
  EXPECT_EQ(std::count(determined.kept.begin(), determined.kept.end(), true), 1);
  EXPECT_TRUE(determined.kept[4]) << "the rotation is always corrected";
  const Vector6d left = log(determined.T_camera_lidar * start.inverse());
  EXPECT_NEAR(left[4], 0.0, 1e-12);
  EXPECT_NEAR(left[0] / kDegree, 1.0, 0.05);
  EXPECT_LT(std::sqrt(determined.covariance(0, 0)), 0.05 * kDegree);
}

TEST(Strips, HoldAllOfAFrameOnce) {
  const SyntheticScene scene(3);
  const Eigen::Isometry3d T = SyntheticScene::T_camera_lidar();
  const FramePtr frame =
      makeFrame(1.0, scene.camera(), scene.image(), {scene.labels()}, scene.cloud(), T, FrameConfig());
  EXPECT_EQ(framesOrStrips({frame, frame}, T, 2).front(), frame);
  const Frames strips = framesOrStrips({frame, frame}, T, 5);
  ASSERT_EQ(strips.size(), 6u);
  std::size_t edges = 0, points = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    const Frame& strip = *strips[i];
    EXPECT_NEAR(double(strip.edges.size()), double(frame->edges.size()) / 3.0,
                0.02 * double(frame->edges.size()));
    EXPECT_EQ(strip.points.nx.size(), strip.points.size());
    EXPECT_EQ(strip.points.segment.size(), strip.points.size());
    EXPECT_EQ(strip.visible.size(), strip.points.size());
    EXPECT_EQ(strip.edges.kind.size(), strip.edges.size());
    EXPECT_EQ(strip.borders, frame->borders);
    edges += strip.edges.size();
    points += strip.points.size();
  }
  EXPECT_EQ(edges, frame->edges.size());
  EXPECT_EQ(points, frame->points.size());
}

}  // namespace
}  // namespace lidar_camera_recalibration

#include <gtest/gtest.h>

#include <filesystem>

#include "dataset.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "plain_scores.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {
namespace {

/// Frames and extrinsics around the right one.
struct Scene {
  Frames frames;
  std::vector<Eigen::Isometry3d> extrinsics;

  void addExtrinsics(const Eigen::Isometry3d& truth) {
    Vector6d near, far;
    near << 0.002, 0.001, -0.003, 0.02, -0.01, 0.03;
    far << -0.03, 0.04, 0.02, -0.1, 0.1, 0.1;
    extrinsics = {truth, exp(near) * truth, exp(far) * truth};
  }
};

Scene syntheticScene() {
  Scene scene;
  FrameConfig config;
  config.min_points = 200;
  config.min_masks = 2;
  config.features.plane_min_points = 300;
  for (const unsigned seed : {1u, 2u}) {
    const SyntheticScene world(seed);
    scene.frames.push_back(makeFrame(seed, SyntheticScene::camera(), world.image(), {world.labels()},
                                     world.cloud(), SyntheticScene::T_camera_lidar(), config));
  }
  scene.addExtrinsics(SyntheticScene::T_camera_lidar());
  return scene;
}

/// No frames if there is no data.
Scene realScene(std::size_t count) {
  Scene scene;
  const std::string folder = SHARED_DATA "/kitti_00";
  if (!std::filesystem::exists(folder)) return scene;
  const auto dataset = Dataset::open(folder);
  const Camera camera(dataset->intrinsics());
  const Eigen::Isometry3d& reference = dataset->reference().value();
  for (std::size_t i = 0; i < count; ++i) {
    scene.frames.push_back(
        makeFrame(0.0, camera, dataset->image(i), dataset->maskLayers(i), dataset->cloud(i), reference, {}));
  }
  scene.addExtrinsics(reference);
  return scene;
}

/// Scores in blocks of floats, by tables, bins and sorted points are those of the formulas.
void expectPlainScores(const Scene& scene) {
  ObjectiveConfig config;
  config.objective = "paper";
  const auto paper = makeObjective(config)->evaluator(scene.frames, {});
  const auto edges = makeObjective(ObjectiveConfig())->evaluator(scene.frames, {});
  const auto& steps = dynamic_cast<const ConsistencyEdgesEvaluator&>(*edges);
  for (const Eigen::Isometry3d& T : scene.extrinsics) {
    const Score plain = plainPaperScore(scene.frames, T, Eigen::Vector3d::Constant(1.0 / 3.0));
    const Score score = (*paper)(T);
    EXPECT_NEAR(score.total, plain.total, 1e-3);
    EXPECT_NEAR(score.reflectivity, plain.reflectivity, 1e-4);
    EXPECT_NEAR(score.normal, plain.normal, 4e-3) << "pairs of bins that straddle 90 deg";
    EXPECT_NEAR(score.segment, plain.segment, 1e-4);

    const double plain_region = plainRegionScore(scene.frames, T);
    const double plain_edges = plainEdgeScore(scene.frames, T, ConsistencyEdgesEvaluator::kScoreLevel);
    EXPECT_NEAR((*edges)(T).region, plain_region, 1e-4);
    EXPECT_NEAR((*edges)(T).total, plain_edges + plain_region, 1e-3);
    for (std::size_t level = 0; level < kScoreLevels; ++level) {
      EXPECT_NEAR(steps.edgeScore(T, level), plainEdgeScore(scene.frames, T, level), 1e-5) << level;
    }
    for (std::size_t level = 0; level < kBoundaryLevels; ++level) {
      const Linearisation step = steps.linearise(T, level),
                          expected = plainLinearisation(scene.frames, T, level);
      EXPECT_NEAR(step.cost, expected.cost, 1e-3 * expected.cost) << level;
      EXPECT_LT((step.H - expected.H).norm(), 1e-3 * expected.H.norm()) << level;
      // What an error of b moves the optimum by, in units of its standard deviation.
      const Vector6d error = step.b - expected.b;
      EXPECT_LT(std::sqrt(error.dot(Vector6d(expected.H.ldlt().solve(error)))), 0.05) << level;
    }
  }
}

TEST(Scores, OfSyntheticFramesAreThoseOfThePlainFormulas) { expectPlainScores(syntheticScene()); }

TEST(Scores, OfRealFramesAreThoseOfThePlainFormulas) {
  const Scene scene = realScene(3);
  if (scene.frames.empty()) GTEST_SKIP() << "no real frames in " << SHARED_DATA;
  expectPlainScores(scene);
}

}  // namespace
}  // namespace lidar_camera_recalibration

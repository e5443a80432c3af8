// The paper objective scores what the paper's formulas say, as benchmark/textbook writes them down.

#include <gtest/gtest.h>

#include <filesystem>
#include <random>

#include "dataset.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "synthetic_scene.hpp"
#include "textbook_frame.hpp"

namespace lidar_camera_recalibration {
namespace {

/// F_N in O(n) is a lower bound of the double loop; the rest is rounding.
constexpr double kTolerance = 1e-3;

ObjectiveConfig paper() {
  ObjectiveConfig config;
  config.objective = "paper";
  return config;
}

/// Largest difference of both scores at the extrinsic and around it.
double largestDifference(const Frames& frames, const Eigen::Isometry3d& T_camera_lidar) {
  std::vector<textbook::Frame> textbook_frames;
  for (const FramePtr& frame : frames) textbook_frames.push_back(performance::textbookFrame(*frame));
  const auto evaluator = makeObjective(paper())->evaluator(frames, {});
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  double largest = 0.0;
  for (int i = 0; i < 8; ++i) {
    Vector6d xi = Vector6d::Zero();
    for (int k = 0; i > 0 && k < 6; ++k) xi[k] = uniform(random) * (k < 3 ? 3.0 * kDegree : 0.2);
    const Eigen::Isometry3d T = exp(xi) * T_camera_lidar;
    const double score = (*evaluator)(T).total;
    EXPECT_GT(score, 0.1);
    largest = std::max(largest, std::abs(score - textbook::score(textbook_frames, performance::toOpenCv(T))));
  }
  return largest;
}

TEST(Textbook, ScoresTheSyntheticSceneAlike) {
  Frames frames;
  for (unsigned seed = 1; seed <= 2; ++seed) {
    const SyntheticScene other(seed);
    frames.push_back(makeFrame(0.0, SyntheticScene::camera(), {}, {other.labels()}, other.cloud(),
                               SyntheticScene::T_camera_lidar(), {}));
  }
  EXPECT_LT(largestDifference(frames, SyntheticScene::T_camera_lidar()), kTolerance);
}

TEST(Textbook, ScoresARealFrameAlike) {
  const std::string folder = SHARED_DATA "/kitti_00";
  if (!std::filesystem::is_directory(folder)) GTEST_SKIP() << folder << " is not there";
  const auto dataset = Dataset::open(folder);
  const FramePtr frame = makeFrame(0.0, Camera(dataset->intrinsics()), dataset->image(0),
                                   dataset->maskLayers(0), dataset->cloud(0), *dataset->reference(), {});
  EXPECT_LT(largestDifference({frame}, *dataset->reference()), kTolerance);
}

TEST(Textbook, SearchComesCloser) {
  const SyntheticScene scene;
  const FramePtr frame = makeFrame(0.0, SyntheticScene::camera(), {}, {scene.labels()}, scene.cloud(),
                                   SyntheticScene::T_camera_lidar(), {});
  Vector6d xi;
  xi << Eigen::Vector3d(2.0, -2.0, 0.0) * kDegree, Eigen::Vector3d::Zero();
  const Eigen::Isometry3d start = exp(xi) * SyntheticScene::T_camera_lidar();
  textbook::SearchLimits limits;
  limits.rotation_deg = limits.step_deg = 2.0;
  limits.random_candidates = 20;
  std::vector<textbook::Frame> frames{performance::textbookFrame(*frame)};
  auto& points = frames.front().points;
  for (std::size_t i = 0; 8 * i < points.size(); ++i) points[i] = points[8 * i];  // it is slow
  points.resize(points.size() / 8);
  const cv::Affine3d T_start = performance::toOpenCv(start);
  const textbook::SearchResult found = textbook::search(frames, T_start, limits);
  EXPECT_EQ(found.evaluations, 1 + 3 * 3 * 3 + 20);
  EXPECT_GT(found.score, textbook::score(frames, T_start));
  EXPECT_NEAR(found.score, textbook::score(frames, found.T_camera_lidar), 1e-12);
  const cv::Vec3d left =
      (found.T_camera_lidar * performance::toOpenCv(SyntheticScene::T_camera_lidar()).inv()).rvec();
  EXPECT_LT(cv::norm(left), 0.7 * xi.norm());
}

}  // namespace
}  // namespace lidar_camera_recalibration

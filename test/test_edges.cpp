#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <random>
#include <set>

#include "boundary_field.hpp"
#include "coarse_to_fine_search.hpp"
#include "dataset.hpp"
#include "edges_objective.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_edges.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {
namespace {

using Kind = EdgePoints::Kind;

constexpr int kRings = 32;
constexpr double kRingStep = 0.5 * kDegree, kAzimuthStep = 0.2 * kDegree;
// A board of 4 x 2 m at x = 8 m in front of a wall at 20 m; its left half is bright.
constexpr double kBoard = 8.0, kWall = 20.0, kHalfWidth = 2.0, kHalfHeight = 1.0;

PointCloud boardInFrontOfWall() {
  PointCloud cloud;
  for (int ring = 0; ring < kRings; ++ring) {
    const double elevation = (ring - 0.5 * (kRings - 1)) * kRingStep;
    for (int step = -150; step <= 150; ++step) {
      const double azimuth = (step + 0.3) * kAzimuthStep;
      const Eigen::Vector3d ray(1.0, std::tan(azimuth), std::tan(elevation) / std::cos(azimuth));
      const Eigen::Vector3d on_board = kBoard * ray;
      const bool hit = std::abs(on_board.y()) < kHalfWidth && std::abs(on_board.z()) < kHalfHeight;
      cloud.points.push_back((hit ? on_board : Eigen::Vector3d(kWall * ray)).cast<float>());
      cloud.reflectivity.push_back(hit && on_board.y() > 0.0 ? 0.9f : 0.3f);
      cloud.ring.push_back(static_cast<std::uint16_t>(ring));
    }
  }
  return cloud;
}

/// Segment 0 = wall, 1 = board; both face the LiDAR.
LidarFeatures featuresOf(const PointCloud& cloud) {
  LidarFeatures features;
  features.normals.assign(cloud.size(), Eigen::Vector3f(-1.0f, 0.0f, 0.0f));
  features.reflectivity = cloud.reflectivity;
  for (const auto& p : cloud.points) features.segment.push_back(p.x() < 10.0f);
  features.segment_count = 2;
  return features;
}

TEST(LidarEdges, LieOnTheOutlineOfTheNearerSurface) {
  const PointCloud cloud = boardInFrontOfWall();
  const EdgePoints edges = findLidarEdges(cloud, featuresOf(cloud), {});
  std::array<int, 3> count = {};
  for (std::size_t i = 0; i < edges.size(); ++i) {
    ++count[static_cast<std::size_t>(edges.kind[i])];
    EXPECT_NEAR(edges.x[i], kBoard, 0.05) << "on the board's side";
    if (edges.kind[i] == Kind::kAzimuthGap) {
      EXPECT_NEAR(std::abs(edges.y[i]), kHalfWidth, 0.5 * kBoard * kAzimuthStep * 1.2);
      EXPECT_FLOAT_EQ(edges.weight[i], 1.0f);
    } else if (edges.kind[i] == Kind::kRingGap) {
      EXPECT_NEAR(std::abs(edges.z[i]), kHalfHeight, 0.5 * kBoard * kRingStep * 1.2);
      EXPECT_FLOAT_EQ(edges.weight[i], 0.5f);
    } else {
      EXPECT_NEAR(edges.y[i], 0.0, 0.5 * kBoard * kAzimuthStep * 1.2);
    }
  }
  const int rings_on_board = 28, steps_on_board = 140;  // 2 atan(1/8) / 0.5 deg; 2 atan(1/4) / 0.2 deg
  EXPECT_NEAR(count[0], 2 * rings_on_board, 4);
  EXPECT_NEAR(count[1], 2 * steps_on_board, 6);
  EXPECT_NEAR(count[2], rings_on_board, 2);
}

TEST(LidarEdges, HiddenPointsHaveNone) {
  const PointCloud cloud = boardInFrontOfWall();
  EXPECT_EQ(findLidarEdges(cloud, featuresOf(cloud), std::vector<std::uint8_t>(cloud.size(), 0)).size(), 0u);
}

TEST(LidarEdges, WithoutRingsThereAreNone) {
  PointCloud cloud = boardInFrontOfWall();
  cloud.ring.clear();
  EXPECT_EQ(findLidarEdges(cloud, featuresOf(cloud), {}).size(), 0u);
}

/// Whether two numberings tell the same points apart, and how many there are.
void expectSameRings(const std::vector<std::uint16_t>& expected, const std::vector<std::uint16_t>& rings) {
  ASSERT_EQ(expected.size(), rings.size());
  std::map<std::uint16_t, std::map<std::uint16_t, int>> pairs;
  for (std::size_t i = 0; i < rings.size(); ++i) ++pairs[expected[i]][rings[i]];
  std::map<std::uint16_t, int> sizes;
  for (const std::uint16_t ring : rings) ++sizes[ring];
  const auto large =
      std::count_if(sizes.begin(), sizes.end(), [](const auto& ring) { return ring.second > 10; });
  EXPECT_EQ(static_cast<std::size_t>(large), pairs.size());
  int other = 0;
  for (const auto& [ring, found] : pairs) {
    int total = 0, most = 0;
    for (const auto& [number, points] : found) {
      total += points;
      most = std::max(most, points);
    }
    other += total - most;
  }
  EXPECT_LT(other, static_cast<int>(rings.size()) / 200);
}

TEST(Rings, AreFoundInCloudsRingByRingAndColumnByColumn) {
  PointCloud by_ring, by_column;
  std::vector<std::uint16_t> rings, rings_of_column;
  std::mt19937 random(1);
  std::uniform_real_distribution<double> noise(-1.0, 1.0);
  const auto add = [&](PointCloud& cloud, std::vector<std::uint16_t>& truth, int ring, int step) {
    // As KITTI: the turn begins ahead, at slightly different azimuths; far points are missing.
    const double elevation = (ring - 20.0 + 0.1 * noise(random)) * kRingStep;
    const double azimuth = step * kAzimuthStep * 2.0 + 0.1 * kDegree * noise(random);
    const double range = 10.0 + 8.0 * std::sin(7.0 * azimuth);
    if (range > 17.0) return;
    cloud.points.push_back(Eigen::Vector3d(range * std::cos(elevation) * std::cos(azimuth),
                                           range * std::cos(elevation) * std::sin(azimuth),
                                           range * std::sin(elevation))
                               .cast<float>());
    truth.push_back(static_cast<std::uint16_t>(ring));
  };
  for (int ring = 31; ring >= 0; --ring) {
    for (int step = 0; step < 900; ++step) add(by_ring, rings, ring, step);
  }
  for (int step = 0; step < 900; ++step) {
    for (int ring = 0; ring < 32; ++ring) add(by_column, rings_of_column, ring, step);
  }
  expectSameRings(rings, ringsOf(by_ring));
  expectSameRings(rings_of_column, ringsOf(by_column));
  by_ring.ring.assign(by_ring.size(), 7);
  EXPECT_EQ(ringsOf(by_ring), by_ring.ring) << "the sensor's own";
  EXPECT_TRUE(ringsOf(PointCloud()).empty());
}

FramePtr frameOf(const std::vector<cv::Mat>& layers, const cv::Mat& image, EdgePoints edges) {
  Intrinsics k;
  k.width = layers.front().cols;
  k.height = layers.front().rows;
  k.fx = k.fy = 300.0;
  k.cx = 0.5 * k.width;
  k.cy = 0.5 * k.height;
  return std::make_shared<Frame>(
      Frame{0.0, Camera(k), image, MaskSets::fromLayers(layers), FramePoints(), {}, std::move(edges)});
}

/// One mask, a rectangle from (60, 40) to (140, 100).
cv::Mat rectangleLabels() {
  cv::Mat labels = cv::Mat::zeros(160, 200, CV_32SC1);
  labels(cv::Rect(60, 40, 80, 60)).setTo(1);
  return labels;
}

TEST(BoundaryField, KeepsUprightAndLevelBordersApart) {
  const auto borders = maskBoundaries(*frameOf({rectangleLabels()}, cv::Mat(), {}));
  const cv::Mat& upright = borders[BoundaryField::kUpright];
  const cv::Mat& level = borders[BoundaryField::kLevel];
  for (int v = 50; v < 90; ++v) {
    EXPECT_EQ(upright.at<uchar>(v, 59), 255);
    EXPECT_EQ(upright.at<uchar>(v, 60), 255);
    EXPECT_EQ(upright.at<uchar>(v, 61), 0);
    EXPECT_EQ(level.at<uchar>(v, 60), 0);
  }
  for (int u = 70; u < 130; ++u) {
    EXPECT_EQ(level.at<uchar>(39, u), 255);
    EXPECT_EQ(level.at<uchar>(100, u), 255);
    EXPECT_EQ(upright.at<uchar>(100, u), 0);
  }
}

TEST(BoundaryField, BordersMoveToTheEdgesOfTheImage) {
  // The object really begins at u = 62; its right side has no contrast.
  cv::Mat image(160, 200, CV_8UC3, cv::Scalar::all(50));
  for (int u = 62; u < 200; ++u)
    image.col(u).setTo(cv::Scalar::all(u < 100 ? 200 : std::max(50, 200 - 3 * (u - 100))));
  const auto borders = maskBoundaries(*frameOf({rectangleLabels()}, image, {}));
  const cv::Mat& upright = borders[BoundaryField::kUpright];
  for (int v = 50; v < 90; ++v) {
    EXPECT_EQ(upright.at<uchar>(v, 61) | upright.at<uchar>(v, 62), 255);
    EXPECT_EQ(upright.at<uchar>(v, 59), 0);
    EXPECT_EQ(cv::countNonZero(upright.row(v).colRange(130, 150)), 0) << "no edge there";
  }
}

TEST(BoundaryField, DistanceAndCloseness) {
  cv::Mat upright = cv::Mat::zeros(160, 200, CV_8UC1);
  upright.col(100).setTo(255);
  const double fx = 300.0;
  const BoundaryField field({upright, cv::Mat::zeros(160, 200, CV_8UC1)}, fx);
  const auto d = field.distance(BoundaryField::kUpright, 93.25f, 80.5f);
  EXPECT_TRUE(d.inside);
  EXPECT_NEAR(d.value, 6.75, 0.01);
  EXPECT_NEAR(d.du, -1.0, 0.01);
  EXPECT_NEAR(d.dv, 0.0, 0.01);
  EXPECT_FALSE(field.distance(BoundaryField::kUpright, 199.5f, 80.0f).inside);
  EXPECT_FALSE(field.distance(BoundaryField::kLevel, 93.0f, 80.0f).inside) << "no border of this kind";
  // A line blurred over 5 sigma has 1 / sqrt(26) of its height left.
  const double sigma = fx * kBoundaryWidths[1] * kDegree, base = 1.0 / std::sqrt(26.0);
  EXPECT_NEAR(field.closeness(BoundaryField::kUpright, 1, 100.0f, 80.0f), 1.0 - base, 0.02);
  const double there =
      std::exp(-0.5 * 9.0 / (sigma * sigma)) - base * std::exp(-0.5 * 9.0 / (26.0 * sigma * sigma));
  EXPECT_NEAR(field.closeness(BoundaryField::kUpright, 1, 103.0f, 80.0f), there, 0.02);
  EXPECT_EQ(field.closeness(BoundaryField::kUpright, 1, -3.0f, 80.0f), 0.0f);
}

FramePtr syntheticFrame(unsigned seed, const Eigen::Isometry3d& guess) {
  FrameConfig config;
  config.min_points = 200;
  config.min_masks = 2;
  config.features.plane_min_points = 300;
  const SyntheticScene scene(seed);
  return makeFrame(seed, SyntheticScene::camera(), scene.image(), {scene.labels()}, scene.cloud(), guess,
                   config);
}

Frames syntheticFrames(int count, const Eigen::Isometry3d& guess) {
  Frames frames;
  for (int i = 1; i <= count; ++i) frames.push_back(syntheticFrame(static_cast<unsigned>(i), guess));
  return frames;
}

Eigen::Isometry3d start() {
  Vector6d xi;
  xi << 2.0 * kDegree, -1.7 * kDegree, 1.2 * kDegree, 0.06, -0.04, 0.05;
  return exp(xi) * SyntheticScene::T_camera_lidar();
}

std::unique_ptr<EdgeEvaluator> evaluatorOf(const EdgesObjective& objective, const Frames& frames) {
  std::unique_ptr<Evaluator> evaluator = objective.evaluator(frames, {});
  return std::unique_ptr<EdgeEvaluator>(dynamic_cast<EdgeEvaluator*>(evaluator.release()));
}

TEST(EdgesObjective, GradientIsThatOfTheCost) {
  const Frames frames = syntheticFrames(2, SyntheticScene::T_camera_lidar());
  const EdgesObjective objective;
  Vector6d offset;
  offset << 0.004, -0.003, 0.005, 0.02, 0.01, -0.03;
  const Eigen::Isometry3d T = exp(offset) * SyntheticScene::T_camera_lidar();
  for (int axis = 0; axis < 6; ++axis) {
    Vector6d xi = Vector6d::Zero();
    xi[axis] = axis < 3 ? 1e-4 : 1e-3;
    const Eigen::Isometry3d plus = exp(xi) * T, minus = exp(Vector6d(-xi)) * T;
    // Only edges that stay in the image: the cost jumps where one leaves it.
    const std::unique_ptr<Evaluator> evaluator = objective.evaluator(frames, {plus, minus});
    const auto& edges = dynamic_cast<const EdgeEvaluator&>(*evaluator);
    const Linearisation here = edges.linearise(T, 0);
    ASSERT_GT(here.cost, 0.0);
    const double slope = (edges.linearise(plus, 0).cost - edges.linearise(minus, 0).cost) / (2.0 * xi[axis]);
    EXPECT_NEAR(2.0 * here.b[axis], slope, 0.05 * 2.0 * here.b.segment<3>(axis < 3 ? 0 : 3).norm()) << axis;
    EXPECT_NEAR((here.H - here.H.transpose()).norm(), 0.0, 1e-9 * here.H.norm());
  }
}

TEST(EdgesObjective, HoldsNoFrameThatItsOwnersLetGo) {
  const EdgesObjective objective;
  FramePtr frame = syntheticFrame(1, SyntheticScene::T_camera_lidar());
  const std::weak_ptr<const Frame> trace = frame;
  (*objective.evaluator({frame}, {}))(SyntheticScene::T_camera_lidar());
  frame.reset();
  EXPECT_TRUE(trace.expired());
}

TEST(EdgesObjective, ScoreIsHighestAtTheTruth) {
  const EdgesObjective objective;
  const auto evaluator = evaluatorOf(objective, syntheticFrames(3, SyntheticScene::T_camera_lidar()));
  const Score score = (*evaluator)(SyntheticScene::T_camera_lidar());
  EXPECT_EQ(score.total, evaluator->score(SyntheticScene::T_camera_lidar(), 2));
  EXPECT_GT(score.points, 100u);
  EXPECT_GT(score.masks, 10u);
  EXPECT_GE(validityIndex(*evaluator, SyntheticScene::T_camera_lidar()), 0.9);
}

CalibratorConfig edgesConfig() {
  CalibratorConfig config;
  config.objective.objective = "edges";
  config.search.search = "coarse_to_fine";
  config.range.rotation_deg = 2.5;
  config.range.translation_m = 0.1;
  return config;
}

TEST(CoarseToFineSearch, FindsTheTruthAndIsAccepted) {
  const CalibrationOutcome outcome = calibrate(syntheticFrames(5, start()), start(), edgesConfig());
  const ExtrinsicError error = extrinsicError(outcome.T_camera_lidar, SyntheticScene::T_camera_lidar());
  // A pixel is 0.23 deg here, and pitch and height are hardly told apart: what counts is where points appear.
  EXPECT_LT(error.angle() / kDegree, 0.5) << error.rotation.transpose() / kDegree;
  EXPECT_LT(error.distance(), 0.06) << error.translation.transpose();
  const Intrinsics k = SyntheticScene::camera().intrinsics();
  EXPECT_LT(pixelShift(outcome.T_camera_lidar, SyntheticScene::T_camera_lidar(), 10.0, k.fx, k.width), 1.5);
  EXPECT_TRUE(outcome.accepted) << outcome.reason;
  EXPECT_TRUE(outcome.covariance.has_value());
}

TEST(CoarseToFineSearch, FiveRealFrames) {
  const std::string folder = SHARED_DATA "/kitti_00";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real frames in " << folder;
  const auto dataset = Dataset::open(folder);
  const Camera camera(dataset->intrinsics());
  const Eigen::Isometry3d& reference = dataset->reference().value();
  Vector6d xi;
  xi << -1.6 * kDegree, 1.5 * kDegree, 1.2 * kDegree, 0.06, 0.05, -0.06;  // 2.5 deg, 10 cm
  const Eigen::Isometry3d guess = exp(xi) * reference;
  Frames frames;
  for (const std::size_t i : {0, 4, 8, 12, 16}) {
    const PointCloud cloud = dataset->cloud(i);
    const std::vector<std::uint16_t> rings = ringsOf(cloud);
    EXPECT_EQ(std::set<std::uint16_t>(rings.begin(), rings.end()).size(), 64u) << dataset->name(i);
    frames.push_back(makeFrame(0.0, camera, dataset->image(i), dataset->maskLayers(i), cloud, guess, {}));
  }
  const CalibrationOutcome outcome = calibrate(frames, guess, edgesConfig());
  const ExtrinsicError error = extrinsicError(outcome.T_camera_lidar, reference);
  EXPECT_LT(error.angle() / kDegree, 0.2);
  EXPECT_LT(error.distance(), 0.06);
  EXPECT_TRUE(outcome.accepted) << outcome.reason;
}

TEST(CoarseToFineSearch, ResultDoesNotDependOnThreads) {
  const Frames frames = syntheticFrames(2, start());
  const EdgesObjective objective;
  SearchConfig config;
  config.search = "coarse_to_fine";
  std::vector<Eigen::Matrix4d> results;
  for (const int threads : {1, 2, 5}) {
    config.threads = threads;
    const SearchResult result = makeSearch(config)->run(objective, frames, start(), {2.5, 0.1}, nullptr);
    results.push_back(result.T_camera_lidar.matrix());
  }
  EXPECT_EQ(results[0], results[1]);
  EXPECT_EQ(results[0], results[2]);
}

TEST(CoarseToFineSearch, ReportsProgressAndCanBeCancelled) {
  const Frames frames = syntheticFrames(1, start());
  const EdgesObjective objective;
  const CoarseToFineSearch search{SearchConfig()};
  double last = 0.0;
  int calls = 0;
  const SearchResult whole = search.run(objective, frames, start(), {2.5, 0.1}, [&](double fraction, double) {
    EXPECT_GE(fraction, last);
    last = fraction;
    ++calls;
    return true;
  });
  EXPECT_NEAR(last, 1.0, 1e-9);
  EXPECT_GT(calls, 20);
  const SearchResult part = search.run(objective, frames, start(), {2.5, 0.1},
                                       [](double fraction, double) { return fraction < 0.1; });
  EXPECT_TRUE(part.cancelled);
  EXPECT_LT(part.evaluations, whole.evaluations);
}

TEST(CoarseToFineSearch, BadInputIsNamed) {
  const CoarseToFineSearch search{SearchConfig()};
  const EdgesObjective edges;
  const Frames frames = syntheticFrames(1, start());
  EXPECT_THROW(search.run(edges, {}, start(), SearchRange(), nullptr), Error);
  try {
    search.run(*makeObjective(ObjectiveConfig()), frames, start(), SearchRange(), nullptr);
    ADD_FAILURE() << "took objective paper";
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kParameter);
    EXPECT_NE(std::string(error.what()).find("edges"), std::string::npos);
  }
  try {
    search.run(edges, {frameOf({rectangleLabels()}, cv::Mat(), {})}, start(), SearchRange(), nullptr);
    ADD_FAILURE() << "took a frame without edges";
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kNotEnough);
  }
  SearchConfig config;
  config.threads = 0;
  EXPECT_THROW(CoarseToFineSearch{config}, Error);
}

}  // namespace
}  // namespace lidar_camera_recalibration

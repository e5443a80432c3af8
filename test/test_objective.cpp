#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "plain_scores.hpp"

namespace lidar_camera_recalibration {
namespace {

ObjectiveConfig paperConfig() {
  ObjectiveConfig config;
  config.objective = "paper";
  return config;
}

double binnedNormalConsistency(std::vector<Eigen::Vector3f> normals) {
  std::vector<Eigen::Vector3f> sums(NormalBins::kCount, Eigen::Vector3f::Zero());
  for (Eigen::Vector3f& n : normals) {
    const int bin = NormalBins::fold(n);
    sums[static_cast<std::size_t>(bin)] += n;
  }
  return NormalBins::consistency(sums.data(), static_cast<double>(normals.size()));
}

Eigen::Vector3f randomUnit(std::mt19937& random) {
  std::normal_distribution<float> gauss;
  const float x = gauss(random), y = gauss(random), z = gauss(random);
  return Eigen::Vector3f(x, y, z).normalized();
}

TEST(PaperObjective, ReflectivityConsistencyIsOneMinusStandardDeviation) {
  // 0.2, 0.4, 0.9: mean 0.5, variance (0.09 + 0.01 + 0.16) / 3
  EXPECT_NEAR(reflectivityConsistency(1.5, 0.04 + 0.16 + 0.81, 3), 1.0 - std::sqrt(0.26 / 3.0), 1e-12);
  EXPECT_NEAR(reflectivityConsistency(0.7, 0.49, 1), 1.0, 1e-7);
}

TEST(PaperObjective, SegmentConsistencyWeighsClassesBySize) {
  std::vector<std::uint32_t> counts = {2, 7, 1};
  EXPECT_NEAR(segmentConsistency(counts), (7.0 + 0.4 * 2.0 + 0.16 * 1.0) / 10.0, 1e-12);
  std::vector<std::uint32_t> one = {5}, none;
  EXPECT_DOUBLE_EQ(segmentConsistency(one), 1.0);
  EXPECT_DOUBLE_EQ(segmentConsistency(none), 0.0);
}

TEST(PaperObjective, AdjustingFunction) {
  EXPECT_NEAR(adjust(100.0), 1.0 - 1.5 * 0.15848931924611134, 1e-12);  // 100^-0.4 = 10^-0.8
  EXPECT_DOUBLE_EQ(adjust(1.0), 0.0);
  EXPECT_LT(adjust(10.0), adjust(11.0));
}

TEST(PaperObjective, NormalConsistencyOfOneDirectionIsExact) {
  const Eigen::Vector3f n = Eigen::Vector3f(0.3f, -0.5f, 0.8f).normalized();
  EXPECT_NEAR(binnedNormalConsistency({n, n, -n, n}), 1.0, 1e-6);
}

TEST(PaperObjective, NormalConsistencyIsCloseToTheDoubleLoop) {
  std::mt19937 random(3);
  double error_sum = 0.0;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    // A noisy plane, a noisy corner or a bush.
    std::vector<Eigen::Vector3f> normals;
    const Eigen::Vector3f a = randomUnit(random), b = randomUnit(random);
    const float noise = trial % 3 == 2 ? 3.0f : 0.1f;
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3f& mean = trial % 3 == 1 && i % 2 ? b : a;
      normals.push_back((mean + noise * randomUnit(random)).normalized() * (i % 5 ? 1.0f : -1.0f));
    }
    const double error = plainNormalConsistency(normals) - binnedNormalConsistency(normals);
    EXPECT_GE(error, -1e-5) << "the bins are a lower bound";
    EXPECT_LT(error, 2e-2);
    error_sum += error;
  }
  EXPECT_LT(error_sum / kTrials, 2e-3);
}

/// A random frame in front of a small camera: overlapping masks, several classes, some points without class,
/// normal or outside of the image.
struct RandomFrame {
  static constexpr int kWidth = 64, kHeight = 48;
  std::vector<cv::Mat> layers;
  std::shared_ptr<Frame> frame;

  explicit RandomFrame(unsigned seed, bool reflectivity = true) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<float> uniform(0.0f, 1.0f);
    for (int l = 0; l < 2; ++l) {
      cv::Mat layer = cv::Mat::zeros(kHeight, kWidth, CV_32SC1);
      for (int k = 0; k < 5; ++k) {
        const int x = static_cast<int>(uniform(random) * 40), y = static_cast<int>(uniform(random) * 30);
        layer(cv::Rect(x, y, 20, 15)).setTo(1000 * l + 7 * k + 1);
      }
      layers.push_back(layer);
    }
    Intrinsics intrinsics;
    intrinsics.width = kWidth;
    intrinsics.height = kHeight;
    intrinsics.fx = intrinsics.fy = 50.0;
    intrinsics.cx = 32.0;
    intrinsics.cy = 24.0;
    frame = std::make_shared<Frame>(
        Frame{0.0, Camera(intrinsics), cv::Mat(), MaskSets::fromLayers(layers), FramePoints(), {}});
    FramePoints& p = frame->points;
    p.segment_count = 4;
    for (int i = 0; i < 1500; ++i) {
      p.x.push_back(20.0f * uniform(random) - 10.0f);
      p.y.push_back(14.0f * uniform(random) - 7.0f);
      p.z.push_back(10.0f * uniform(random));
      const Eigen::Vector3f n = i % 11 ? randomUnit(random) : Eigen::Vector3f(Eigen::Vector3f::Zero());
      p.nx.push_back(n.x());
      p.ny.push_back(n.y());
      p.nz.push_back(n.z());
      if (reflectivity) p.reflectivity.push_back(uniform(random));
      p.segment.push_back(i % 7 ? static_cast<std::int32_t>(uniform(random) * 4.0f) % 4
                                : LidarFeatures::kNoSegment);
    }
    frame->visible.assign(p.size(), 1);
  }
};

Score plainScore(const std::vector<RandomFrame>& frames, const Eigen::Isometry3d& T,
                 const Eigen::Vector3d& weights) {
  Frames all;
  for (const RandomFrame& f : frames) all.push_back(f.frame);
  return plainPaperScore(all, T, weights);
}

void expectNear(const Score& a, const Score& b, double normal_tolerance) {
  EXPECT_EQ(a.points, b.points);
  EXPECT_EQ(a.masks, b.masks);
  EXPECT_NEAR(a.reflectivity, b.reflectivity, 1e-5);
  EXPECT_NEAR(a.segment, b.segment, 1e-9);
  EXPECT_NEAR(a.normal, b.normal, normal_tolerance);
  EXPECT_NEAR(a.total, b.total, normal_tolerance);
}

Eigen::Isometry3d tilt(double angle) {
  Vector6d xi;
  xi << angle, -angle, 2.0 * angle, 0.1, -0.1, 0.5;
  return exp(xi);
}

TEST(PaperObjective, ScoreMatchesThePlainFormulas) {
  const std::vector<RandomFrame> frames = {RandomFrame(1), RandomFrame(2)};
  ObjectiveConfig config = paperConfig();
  config.weight_reflectivity = 0.5;
  config.weight_normal = 0.2;
  config.weight_segment = 0.3;
  const auto evaluator = makeObjective(config)->evaluator({frames[0].frame, frames[1].frame}, {});
  for (const double angle : {0.0, 0.03, -0.1}) {
    const Score plain = plainScore(frames, tilt(angle), {0.5, 0.2, 0.3});
    ASSERT_GT(plain.points, 200u);
    expectNear((*evaluator)(tilt(angle)), plain, 5e-3);
  }
}

TEST(PaperObjective, WithoutReflectivityItsWeightIsSharedOut) {
  const std::vector<RandomFrame> frames = {RandomFrame(4, false)};
  const auto evaluator = makeObjective(paperConfig())->evaluator({frames[0].frame}, {});
  expectNear((*evaluator)(tilt(0.02)), plainScore(frames, tilt(0.02), Eigen::Vector3d::Constant(1.0 / 3.0)),
             5e-3);
}

TEST(PaperObjective, NothingInViewScoresZero) {
  const RandomFrame f(5);
  const auto evaluator = makeObjective(paperConfig())->evaluator({f.frame}, {});
  const Score score = (*evaluator)(Eigen::Isometry3d(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY())));
  EXPECT_EQ(score.points, 0u);
  EXPECT_EQ(score.total, 0.0);
}

TEST(PaperObjective, ScoresOnlyPointsInViewUnderAllGivenExtrinsics) {
  const std::vector<RandomFrame> frames = {RandomFrame(6)};
  std::vector<RandomFrame> expected = frames;
  // By hand: keep the points whose pixel is well inside under both extrinsics.
  const auto inside = [&](const Eigen::Isometry3d& T, const Eigen::Vector3d& point) {
    const auto pixel = frames[0].frame->camera.project(T * point);
    const double margin = 0.06 * RandomFrame::kHeight - 0.5;  // pixel centres are at integers
    return pixel && pixel->x() >= margin && pixel->y() >= margin &&
           pixel->x() < RandomFrame::kWidth - 1.0 - margin &&
           pixel->y() < RandomFrame::kHeight - 1.0 - margin;
  };
  const FramePoints& all = frames[0].frame->points;
  FramePoints kept;
  kept.segment_count = all.segment_count;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Eigen::Vector3d point(all.x[i], all.y[i], all.z[i]);
    if (!inside(tilt(0.1), point) || !inside(tilt(-0.1), point)) continue;
    kept.x.push_back(all.x[i]);
    kept.y.push_back(all.y[i]);
    kept.z.push_back(all.z[i]);
    kept.nx.push_back(all.nx[i]);
    kept.ny.push_back(all.ny[i]);
    kept.nz.push_back(all.nz[i]);
    kept.reflectivity.push_back(all.reflectivity[i]);
    kept.segment.push_back(all.segment[i]);
  }
  ASSERT_LT(kept.size(), all.size() - 20);
  expected[0].frame = std::make_shared<Frame>(*frames[0].frame);
  expected[0].frame->points = kept;
  const auto evaluator = makeObjective(paperConfig())->evaluator({frames[0].frame}, {tilt(0.1), tilt(-0.1)});
  expectNear((*evaluator)(tilt(0.0)), plainScore(expected, tilt(0.0), Eigen::Vector3d::Constant(1.0 / 3.0)),
             5e-3);
}

TEST(PaperObjective, BadConfigurationIsNamed) {
  ObjectiveConfig config = paperConfig();
  config.objective = "magic";
  EXPECT_THROW(makeObjective(config), Error);
  config = paperConfig();
  config.weight_normal = -1.0;
  EXPECT_THROW(makeObjective(config), Error);
  config.weight_reflectivity = config.weight_normal = config.weight_segment = 0.0;
  EXPECT_THROW(makeObjective(config), Error);
}

}  // namespace
}  // namespace lidar_camera_recalibration

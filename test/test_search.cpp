#include <gtest/gtest.h>

#include <cmath>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {
namespace {

SearchConfig paperConfig() {
  SearchConfig config;
  config.search = "paper";
  return config;
}

/// A smooth hill with a known summit: what a search must climb, whatever the frames are.
class Hill : public Objective {
 public:
  explicit Hill(const Eigen::Isometry3d& summit) : summit_(summit) {}
  std::unique_ptr<Evaluator> evaluator(const Frames&, const Views&) const override {
    return std::make_unique<Climber>(summit_);
  }

 private:
  class Climber : public Evaluator {
   public:
    explicit Climber(const Eigen::Isometry3d& summit) : summit_(summit) {}
    Score operator()(const Eigen::Isometry3d& T) override {
      const ExtrinsicError error = extrinsicError(T, summit_);
      Score score;
      score.total =
          std::exp(-std::pow(error.angle() / (3.0 * kDegree), 2) - std::pow(error.distance() / 0.2, 2));
      return score;
    }

   private:
    Eigen::Isometry3d summit_;
  };
  Eigen::Isometry3d summit_;
};

Frames oneFrame() {
  Intrinsics intrinsics;
  intrinsics.width = intrinsics.height = 10;
  intrinsics.fx = intrinsics.fy = 10.0;
  return {std::make_shared<Frame>(Frame{0.0, Camera(intrinsics), cv::Mat(), MaskSets(), FramePoints(), {}})};
}

Eigen::Isometry3d summit() {
  Vector6d xi;
  xi << 2.3 * kDegree, -1.6 * kDegree, 0.7 * kDegree, 0.05, -0.08, 0.1;
  return exp(xi);
}

TEST(PaperSearch, ClimbsToTheSummit) {
  const auto search = makeSearch(paperConfig());
  const SearchResult result =
      search->run(Hill(summit()), oneFrame(), Eigen::Isometry3d::Identity(), SearchRange(), nullptr);
  const ExtrinsicError error = extrinsicError(result.T_camera_lidar, summit());
  EXPECT_LT(error.angle() / kDegree, 0.1);
  EXPECT_LT(error.distance(), 0.01);
  EXPECT_EQ(result.evaluations, 11u * 11u * 11u + 4000u);
  EXPECT_FALSE(result.cancelled);
}

TEST(PaperSearch, ResultDoesNotDependOnThreadsButOnTheSeed) {
  SearchConfig config = paperConfig();
  config.refine_evaluations = 500;
  std::vector<Eigen::Matrix4d> results;
  for (const int threads : {1, 2, 5}) {
    config.threads = threads;
    results.push_back(
        makeSearch(config)
            ->run(Hill(summit()), oneFrame(), Eigen::Isometry3d::Identity(), SearchRange(), nullptr)
            .T_camera_lidar.matrix());
  }
  EXPECT_EQ(results[0], results[1]);
  EXPECT_EQ(results[0], results[2]);
  config.seed = 77;
  EXPECT_NE(results[0],
            makeSearch(config)
                ->run(Hill(summit()), oneFrame(), Eigen::Isometry3d::Identity(), SearchRange(), nullptr)
                .T_camera_lidar.matrix());
}

TEST(PaperSearch, StaysWithinTheTranslationRange) {
  Vector6d far = Vector6d::Zero();
  far[3] = 1.0;
  SearchRange range;
  range.rotation_deg = 1.0;
  range.translation_m = 0.1;
  const SearchResult result =
      makeSearch(paperConfig())
          ->run(Hill(exp(far)), oneFrame(), Eigen::Isometry3d::Identity(), range, nullptr);
  EXPECT_NEAR(result.T_camera_lidar.translation().x(), 0.1, 1e-9);
}

TEST(PaperSearch, ReportsProgressAndCanBeCancelled) {
  double last = 0.0;
  int calls = 0;
  const auto search = makeSearch(paperConfig());
  const SearchResult whole = search->run(Hill(summit()), oneFrame(), Eigen::Isometry3d::Identity(),
                                         SearchRange(), [&](double fraction, double) {
                                           EXPECT_GE(fraction, last);
                                           last = fraction;
                                           ++calls;
                                           return true;
                                         });
  EXPECT_DOUBLE_EQ(last, 1.0);
  EXPECT_GT(calls, 20);
  const SearchResult part =
      search->run(Hill(summit()), oneFrame(), Eigen::Isometry3d::Identity(), SearchRange(),
                  [](double fraction, double) { return fraction < 0.1; });
  EXPECT_TRUE(part.cancelled);
  EXPECT_LT(part.evaluations, whole.evaluations / 5);
}

TEST(PaperSearch, BadInputIsNamed) {
  SearchConfig config = paperConfig();
  config.search = "magic";
  EXPECT_THROW(makeSearch(config), Error);
  config = paperConfig();
  config.threads = 0;
  EXPECT_THROW(makeSearch(config), Error);
  config = paperConfig();
  config.grid_step_deg = 0.0;
  EXPECT_THROW(makeSearch(config), Error);
  EXPECT_THROW(makeSearch(paperConfig())
                   ->run(Hill(summit()), {}, Eigen::Isometry3d::Identity(), SearchRange(), nullptr),
               Error);
}

}  // namespace
}  // namespace lidar_camera_recalibration

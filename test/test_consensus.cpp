#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <numeric>
#include <random>
#include <stdexcept>

#include "confidence.hpp"
#include "consensus.hpp"
#include "dataset.hpp"
#include "edges_config.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "parallel.hpp"
#include "synthetic_scene.hpp"

namespace lidar_camera_recalibration {
namespace {

using Indices = std::vector<std::size_t>;

// --- opinions ---

Opinion opinion(double rx_deg, double tx, double contrast, double own_contrast) {
  Opinion result;
  result.wish[0] = rx_deg * kDegree;
  result.wish[3] = tx;
  result.contrast = contrast;
  result.own_contrast = own_contrast;
  return result;
}

std::vector<Opinion> agreeing(std::size_t count) {
  std::vector<Opinion> opinions;
  for (std::size_t i = 0; i < count; ++i) {
    const double sign = i % 2 == 0 ? 1.0 : -1.0;
    opinions.push_back(opinion(0.1 * sign, -0.03 * sign, 0.08 + 0.02 * sign, 0.09 + 0.02 * sign));
  }
  return opinions;
}

TEST(Contradicting, NobodyWhenAllAgree) {
  for (std::size_t count = 1; count <= 12; ++count) EXPECT_EQ(contradicting(agreeing(count)), Indices());
}

TEST(Contradicting, AFrameThatSeesNothing) {
  std::vector<Opinion> opinions = agreeing(6);
  opinions[4].contrast = 0.01;
  EXPECT_EQ(contradicting(opinions), Indices{4});
  opinions[4].contrast = 0.03;  // little to see is no contradiction
  EXPECT_EQ(contradicting(opinions), Indices());
}

TEST(Contradicting, AFrameWithAnotherExtrinsic) {
  std::vector<Opinion> opinions = agreeing(6);
  opinions[2] = opinion(1.0, 0.0, 0.04, 0.1);
  EXPECT_EQ(contradicting(opinions), Indices{2});
  opinions[2] = opinion(0.0, 0.3, 0.04, 0.1);
  EXPECT_EQ(contradicting(opinions), Indices{2});
  opinions[2] = opinion(1.0, 0.0, 0.09, 0.1);
  EXPECT_EQ(contradicting(opinions), Indices()) << "it fits the others' extrinsic as well";
  opinions[2] = opinion(0.2, 0.0, 0.04, 0.1);
  EXPECT_EQ(contradicting(opinions), Indices()) << "its optimum is where those of the others are";
}

TEST(Contradicting, TheWorstFirst) {
  std::vector<Opinion> opinions = agreeing(9);
  opinions[1].contrast = 0.01;
  opinions[7].contrast = -0.02;
  EXPECT_EQ(contradicting(opinions), (Indices{7, 1}));
}

TEST(Contradicting, NeedsFourFramesAndAnOptimum) {
  std::vector<Opinion> opinions = agreeing(3);
  opinions[0].contrast = -0.1;
  EXPECT_EQ(contradicting(opinions), Indices());
  opinions = agreeing(6);
  for (Opinion& each : opinions) each.contrast -= 0.2;
  EXPECT_EQ(contradicting(opinions), Indices());
}

// --- a world in which each frame's optimum is known ---

using Wishes = std::map<const Frame*, Vector6d>;

/// Rotations of 0.5 deg and translations of 25 cm count alike.
double squaredDistance(const Vector6d& a, const Vector6d& b) {
  const Vector6d d = a - b;
  return (d.head<3>() / (0.5 * kDegree)).squaredNorm() + (d.tail<3>() / 0.25).squaredNorm();
}

/// Each frame's score is a bell around its optimum.
class BellObjective : public Objective {
 public:
  explicit BellObjective(const Wishes& wishes) : wishes_(wishes) {}

  std::unique_ptr<Evaluator> evaluator(const Frames& frames, const Views&) const override {
    class Bells : public Evaluator {
     public:
      explicit Bells(std::vector<Vector6d> centres) : centres_(std::move(centres)) {}
      Score operator()(const Eigen::Isometry3d& T) override {
        Score score;
        for (const Vector6d& centre : centres_) {
          score.total += std::exp(-0.5 * squaredDistance(log(T), centre)) / double(centres_.size());
        }
        return score;
      }

     private:
      std::vector<Vector6d> centres_;
    };
    std::vector<Vector6d> centres;
    for (const FramePtr& frame : frames) centres.push_back(wishes_.at(frame.get()));
    return std::make_unique<Bells>(std::move(centres));
  }

 private:
  const Wishes& wishes_;
};

/// Climbs the bells by mean shift.
class BellSearch : public Search {
 public:
  explicit BellSearch(const Wishes& wishes) : wishes_(wishes) {}

  SearchResult run(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start,
                   const SearchRange&, const Progress& progress) const override {
    return refine(objective, frames, start, progress);
  }

  SearchResult refine(const Objective&, const Frames& frames, const Eigen::Isometry3d& start,
                      const Progress& progress) const override {
    Vector6d place = log(start);
    for (int step = 0; step < 100; ++step) {
      Vector6d sum = Vector6d::Zero();
      double weights = 0.0;
      for (const FramePtr& frame : frames) {
        const Vector6d& centre = wishes_.at(frame.get());
        // Heavier tails than the bell's, so that a far frame alone finds its way.
        const double weight = 1.0 / (1.0 + squaredDistance(place, centre));
        sum += weight * centre;
        weights += weight;
      }
      place = sum / weights;
    }
    SearchResult result;
    result.T_camera_lidar = exp(place);
    result.evaluations = 100;
    result.cancelled = progress && !progress(1.0, 0.0);
    return result;
  }

 private:
  const Wishes& wishes_;
};

/// So many pixels that a tenth of one is nothing.
const Camera kSharp = SyntheticScene::camera(32000, 24000);

class BellWorld : public testing::Test {
 protected:
  void add(const Vector6d& wish) {
    frames.push_back(std::make_shared<Frame>(Frame{double(frames.size()), kSharp, {}, {}, {}, {}}));
    wishes[frames.back().get()] = wish;
  }

  /// Frames whose optima scatter by 0.1 deg and 3 cm.
  void addGood(int count) {
    for (int i = 0; i < count; ++i) {
      Vector6d wish;
      for (int axis = 0; axis < 6; ++axis) wish[axis] = normal(random) * (axis < 3 ? 0.1 * kDegree : 0.03);
      add(wish);
    }
  }

  void addBad(double ry_deg) {
    Vector6d wish = Vector6d::Zero();
    wish[1] = ry_deg * kDegree;
    add(wish);
  }

  Eigen::Isometry3d joint() const { return search.refine(objective, frames, start, nullptr).T_camera_lidar; }
  Consensus consensus() const { return findConsensus(search, objective, frames, joint(), 1, nullptr); }

  std::mt19937 random{3};
  std::normal_distribution<double> normal;
  Frames frames;
  Wishes wishes;
  BellObjective objective{wishes};
  BellSearch search{wishes};
  Eigen::Isometry3d start = Eigen::Isometry3d::Identity();
};

TEST_F(BellWorld, TheResultIsThatOfTheFramesThatAgree) {
  addGood(4);
  addBad(2.0);
  addGood(4);
  const Consensus found = consensus();
  EXPECT_EQ(found.left_out, Indices{4});
  EXPECT_EQ(found.contradicting, 1u);
  EXPECT_GT(found.evaluations, 0u);
  const Eigen::Isometry3d good =
      search.refine(objective, without(frames, {4}), start, nullptr).T_camera_lidar;
  EXPECT_LT(log(found.T_camera_lidar * good.inverse()).norm(), 1e-6);
  EXPECT_GT(log(joint() * good.inverse()).norm(), 1e-4) << "the bad frame had a say";
}

TEST_F(BellWorld, NobodyIsLeftOutWhenAllAgree) {
  addGood(10);
  const Consensus found = consensus();
  EXPECT_EQ(found.left_out, Indices());
  EXPECT_EQ(found.contradicting, 0u);
  EXPECT_EQ(found.T_camera_lidar.matrix(), joint().matrix()) << "not touched";
}

TEST_F(BellWorld, AtMostAThirdIsLeftOut) {
  addGood(6);
  for (const double angle : {3.0, -3.0, 4.0}) addBad(angle);
  EXPECT_EQ(consensus().left_out, (Indices{6, 7, 8}));
  addBad(-4.0);
  const Consensus found = consensus();
  EXPECT_EQ(found.left_out.size(), 3u);
  EXPECT_EQ(found.contradicting, 4u) << "what the gate refuses";
}

TEST_F(BellWorld, ThreeFramesAreTooFewToOverruleOne) {
  addGood(2);
  addBad(3.0);
  const Consensus found = consensus();
  EXPECT_EQ(found.left_out, Indices());
  EXPECT_EQ(found.evaluations, 0u);
  addGood(1);
  EXPECT_EQ(consensus().left_out, Indices{2}) << "four are enough";
}

TEST_F(BellWorld, ProgressRisesAndCancels) {
  addGood(5);
  addBad(2.0);
  const Eigen::Isometry3d from = joint();
  double last = 0.0;
  int calls = 0;
  findConsensus(search, objective, frames, from, 1, [&](double fraction, double) {
    EXPECT_GE(fraction, last);
    EXPECT_LE(fraction, 1.0);
    last = fraction;
    ++calls;
    return true;
  });
  EXPECT_EQ(calls, 6 + 1 + 6);  // each asked, refined, each asked again
  for (int stop = 1; stop <= calls; ++stop) {
    int count = 0;
    const Consensus cancelled =
        findConsensus(search, objective, frames, from, 1, [&](double, double) { return ++count < stop; });
    EXPECT_TRUE(cancelled.cancelled);
    EXPECT_EQ(count, stop) << "nothing is done after it";
  }
}

TEST_F(BellWorld, ThreadsDoNotChangeTheResult) {
  addGood(9);
  addBad(2.0);
  const Consensus one = findConsensus(search, objective, frames, joint(), 1, nullptr);
  const Resampling sure = resample(search, objective, frames, joint(), 1, nullptr);
  for (const int threads : {2, 5, 50}) {
    const Consensus several = findConsensus(search, objective, frames, joint(), threads, nullptr);
    EXPECT_EQ(several.T_camera_lidar.matrix(), one.T_camera_lidar.matrix()) << threads;
    EXPECT_EQ(several.left_out, one.left_out) << threads;
    EXPECT_EQ(several.evaluations, one.evaluations) << threads;
    const Resampling uncertainty = resample(search, objective, frames, joint(), threads, nullptr);
    EXPECT_EQ(*uncertainty.covariance, *sure.covariance) << threads;
    EXPECT_EQ(uncertainty.evaluations, sure.evaluations) << threads;
  }
}

TEST_F(BellWorld, SeveralThreadsCanBeCancelled) {
  addGood(40);
  for (int stop = 1; stop <= 3; ++stop) {
    int count = 0;
    const Progress progress = [&](double, double) { return ++count < stop; };
    if (!resample(search, objective, frames, joint(), 3, progress).cancelled) {
      EXPECT_LT(count, stop) << "the other threads were so fast that the caller's was not asked again";
    }
  }
}

TEST(ParallelFor, ThrowsTheFailureOfTheLowestIndex) {
  for (const std::size_t workers : {1u, 2u, 7u}) {
    std::vector<int> done(100, 0);
    try {
      parallelFor(done.size(), workers, [&](std::size_t, std::size_t i) {
        done[i] = 1;
        if (i >= 20) throw std::runtime_error(std::to_string(i));
      });
      ADD_FAILURE() << "nothing thrown";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "20");
    }
    EXPECT_EQ(std::accumulate(done.begin(), done.begin() + 20, 0), 20);
    EXPECT_LE(std::accumulate(done.begin(), done.end(), 0), 20 + static_cast<int>(workers)) << "work ends";
  }
}

// --- covariance ---

/// Its refinements count as inexact.
class RandomSearch : public BellSearch {
 public:
  using BellSearch::BellSearch;
  bool refinesExactly() const override { return false; }
};

struct Case {
  int frames;
  bool exact;
};

class Covariance : public BellWorld, public testing::WithParamInterface<Case> {
 protected:
  Resampling estimate(const Progress& progress = nullptr) const {
    const Search& chosen = GetParam().exact ? search : random_search;
    return resample(chosen, objective, frames, joint(), 1, progress);
  }

  RandomSearch random_search{wishes};
};

TEST_P(Covariance, IsThatOfResultsOfOtherFrames) {
  Vector6d errors = Vector6d::Zero(), variances = Vector6d::Zero();
  for (int seed = 0; seed < 200; ++seed) {
    frames.clear();
    wishes.clear();
    addGood(GetParam().frames);
    const Resampling uncertainty = estimate();
    ASSERT_TRUE(uncertainty.covariance);
    errors += log(joint()).cwiseAbs2();
    variances += uncertainty.covariance->diagonal();
  }
  // 200 sets tell a variance to about 10 %.
  for (int axis = 0; axis < 6; ++axis)
    EXPECT_NEAR(std::sqrt(errors[axis] / variances[axis]), 1.0, 0.2) << axis;
}

TEST_P(Covariance, CostsABoundedNumberOfRefinements) {
  addGood(GetParam().frames);
  const int expected = GetParam().exact ? 20 : std::min(GetParam().frames, 6);
  double last = 0.0;
  int calls = 0;
  const Resampling whole = estimate([&](double fraction, double) {
    EXPECT_GT(fraction, last);
    last = fraction;
    ++calls;
    return true;
  });
  EXPECT_EQ(calls, expected);
  EXPECT_EQ(whole.evaluations, 100u * static_cast<unsigned>(expected));
  EXPECT_DOUBLE_EQ(last, 1.0);
  int left = 3;
  const Resampling cancelled = estimate([&](double, double) { return --left > 0; });
  EXPECT_TRUE(cancelled.cancelled);
  EXPECT_FALSE(cancelled.covariance);
  EXPECT_EQ(cancelled.evaluations, 300u);
}

TEST_P(Covariance, MeanOfRefinementsIsTheResultWhereTheyAreExact) {
  addGood(GetParam().frames);
  const Eigen::Isometry3d mean = estimate().T_camera_lidar;
  const ExtrinsicError moved = extrinsicError(mean, joint());
  if (GetParam().exact) {
    // Each frame is drawn as often as any other; what is left is that the optimum is not quite linear in
    // them.
    EXPECT_LT(moved.angle(), 0.005 * kDegree);
    EXPECT_LT(moved.distance(), 0.0015);
  } else {
    EXPECT_EQ(mean.matrix(), joint().matrix());
  }
}

INSTANTIATE_TEST_SUITE_P(Frames, Covariance,
                         testing::Values(Case{5, true}, Case{10, true}, Case{20, true}, Case{30, true},
                                         Case{45, true}, Case{5, false}, Case{12, false}));

TEST_F(BellWorld, AnOptimumStandsOutAndASlopeDoesNot) {
  addGood(3);
  const std::unique_ptr<Evaluator> evaluator = objective.evaluator(frames, {});
  EXPECT_GT(distinctness(*evaluator, joint()), 10.0);
  Vector6d beside = Vector6d::Zero();
  beside[1] = 3.0 * kDegree;
  EXPECT_LT(distinctness(*evaluator, exp(beside)), 0.5);
}

// --- calibrate() on scenes and on real frames ---

Eigen::Isometry3d wrongStart(const Eigen::Isometry3d& truth) {
  Vector6d xi;
  xi << 1.6 * kDegree, -1.4 * kDegree, 1.0 * kDegree, 0.05, -0.04, 0.05;
  return exp(xi) * truth;
}

/// @param masks  seed of the scene that the camera sees, @param cloud  of the one that the LiDAR sees
/// @param moved  what the LiDAR's points are moved by, in its frame
FramePtr sceneFrame(unsigned masks, unsigned cloud, const Eigen::Isometry3d& moved) {
  FrameConfig config;
  config.min_points = 200;
  config.min_masks = 2;
  config.features.plane_min_points = 300;
  const SyntheticScene seen(masks), measured(cloud);
  PointCloud points = measured.cloud();
  for (Eigen::Vector3f& point : points.points) point = (moved * point.cast<double>()).cast<float>();
  return makeFrame(1317046450.0 + masks, SyntheticScene::camera(), seen.image(), {seen.labels()}, points,
                   wrongStart(SyntheticScene::T_camera_lidar()), config);
}

Frames scenes(unsigned first, unsigned last) {
  Frames frames;
  for (unsigned i = first; i <= last; ++i) frames.push_back(sceneFrame(i, i, Eigen::Isometry3d::Identity()));
  return frames;
}

CalibrationOutcome calibrateScenes(const Frames& frames, const Progress& progress = nullptr) {
  return calibrate(frames, wrongStart(SyntheticScene::T_camera_lidar()), edgesConfig(), progress);
}

void expectSame(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double rotation_deg,
                double distance) {
  const ExtrinsicError difference = extrinsicError(a, b);
  EXPECT_LT(difference.angle() / kDegree, rotation_deg);
  EXPECT_LT(difference.distance(), distance);
}

TEST(CalibrateWithABadFrame, CloudOfAnotherPlace) {
  Frames frames = scenes(1, 6);
  const CalibrationOutcome good = calibrateScenes(frames);
  EXPECT_EQ(good.left_out, Indices()) << good.reason;
  EXPECT_EQ(good.reason.find("left out"), std::string::npos) << good.reason;
  frames.insert(frames.begin() + 2, sceneFrame(7, 31, Eigen::Isometry3d::Identity()));
  const CalibrationOutcome robust = calibrateScenes(frames);
  EXPECT_EQ(robust.left_out, Indices{2});
  EXPECT_EQ(robust.left_out_stamps, std::vector<double>{1317046457.0});
  EXPECT_EQ(robust.frames, 6u);
  EXPECT_TRUE(robust.accepted) << robust.reason;
  EXPECT_NE(robust.reason.find(
                "; 1 of 7 frames was left out because it contradicts the others (stamp 1317046457.00)"),
            std::string::npos)
      << robust.reason;
  expectSame(robust.T_camera_lidar, good.T_camera_lidar, 0.1, 0.03);
}

TEST(CalibrateGate, SaysWhatIsTooUncertain) {
  const Frames frames = scenes(1, 5);
  const Eigen::Isometry3d start = wrongStart(SyntheticScene::T_camera_lidar());
  CalibratorConfig config = edgesConfig();
  config.gate.max_rotation_sigma_deg = 0.0;
  config.gate.max_translation_sigma_m = 0.0;
  const CalibrationOutcome uncertain = calibrate(frames, start, config);
  EXPECT_FALSE(uncertain.accepted);
  EXPECT_NE(uncertain.reason.find("gate/max_rotation_sigma_deg"), std::string::npos) << uncertain.reason;
  config.gate.min_distinctness = 100.0;
  const CalibrationOutcome hidden = calibrate(frames, start, config);
  EXPECT_FALSE(hidden.accepted);
  EXPECT_NE(hidden.reason.find("gate/min_distinctness is 100.0"), std::string::npos) << hidden.reason;
}

TEST(CalibrateWithABadFrame, AnotherExtrinsic) {
  Frames frames = scenes(1, 6);
  const CalibrationOutcome good = calibrateScenes(frames);
  const Eigen::Isometry3d turned(Eigen::AngleAxisd(2.0 * kDegree, Eigen::Vector3d(0, 1, 1).normalized()));
  frames.push_back(sceneFrame(7, 7, turned));
  const CalibrationOutcome robust = calibrateScenes(frames);
  EXPECT_EQ(robust.left_out, Indices{6}) << robust.reason;
  expectSame(robust.T_camera_lidar, good.T_camera_lidar, 0.1, 0.03);
}

TEST(CalibrateWithABadFrame, CanBeCancelledInEachStage) {
  Frames frames = scenes(1, 5);
  frames.push_back(sceneFrame(7, 31, Eigen::Isometry3d::Identity()));
  // In the search, while frames are asked, while they are drawn, and in a search without some of them.
  for (const double stop : {0.2, 0.42, 0.52, 0.8}) {
    double last = 0.0;
    const CalibrationOutcome cancelled = calibrateScenes(frames, [&](double fraction, double) {
      last = fraction;
      return fraction < stop;
    });
    EXPECT_GE(last, stop);
    EXPECT_LT(last, stop + 0.2);
    EXPECT_TRUE(cancelled.cancelled) << stop;
    EXPECT_FALSE(cancelled.accepted);
    EXPECT_EQ(cancelled.reason, "cancelled");
  }
}

TEST(CalibrateWithABadFrame, RealFramesOneWithMasksOfAnother) {
  const std::string folder = SHARED_DATA "/kitti_00";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real frames in " << folder;
  const auto dataset = Dataset::open(folder);
  const Camera camera(dataset->intrinsics());
  const Eigen::Isometry3d reference = dataset->reference().value(), guess = wrongStart(reference);
  const auto frame = [&](std::size_t masks, std::size_t cloud) {
    return makeFrame(double(cloud), camera, dataset->image(masks), dataset->maskLayers(masks),
                     dataset->cloud(cloud), guess, {});
  };
  Frames frames;
  for (const std::size_t i : {0, 5, 10, 15, 20}) frames.push_back(frame(i, i));
  const CalibrationOutcome good = calibrate(frames, guess, edgesConfig());
  EXPECT_EQ(good.left_out, Indices()) << good.reason;
  frames.push_back(frame(12, 23));
  const CalibrationOutcome robust = calibrate(frames, guess, edgesConfig());
  EXPECT_EQ(robust.left_out, Indices{5}) << robust.reason;
  EXPECT_TRUE(robust.accepted) << robust.reason;
  expectSame(robust.T_camera_lidar, good.T_camera_lidar, 0.05, 0.02);
  expectSame(robust.T_camera_lidar, reference, 0.3, 0.08);
}

}  // namespace
}  // namespace lidar_camera_recalibration

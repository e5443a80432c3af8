// What evaluate is made of; the program itself is called in test_offline_tools.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "evaluation/figures.hpp"
#include "evaluation/inputs.hpp"
#include "evaluation/methods.hpp"
#include "evaluation/output.hpp"
#include "evaluation/starts.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration::evaluation {
namespace {

/// The message of the Error(kParameter) that an action must throw.
template <typename Action>
std::string refusal(const Action& action) {
  try {
    action();
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kParameter) << error.what();
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

void expectContains(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

Eigen::Isometry3d someExtrinsic() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  T.translation() << 0.5, -0.3, 1.2;
  return T;
}

// --- methods ---

TEST(Methods, AreObjectiveAndSearch) {
  const ServerConfig paper = parseMethod("paper", {}).config,
                     edges = parseMethod("consistency_edges", {}).config;
  EXPECT_EQ(paper.calibrator.objective.objective, "paper");
  EXPECT_EQ(paper.calibrator.search.search, "paper");
  EXPECT_EQ(edges.calibrator.search.search, "coarse_to_fine");
  EXPECT_NE(edges.calibrator.objective.objective, "paper");
}

TEST(Methods, VariantsHaveTheLastWord) {
  const CommonParameters common = {"", {"gate/min_significance=0.25", "gate/min_distinctness=0.25"}};
  const Method method = parseMethod(
      "paper:gate/min_significance=0.5,initial/T_camera_lidar=[0,-1,0,1, 0,0,-1,2, 1,0,0,3, 0,0,0,1]",
      common);
  EXPECT_EQ(method.name, "paper");
  EXPECT_EQ(method.config.calibrator.search.search, "paper");
  EXPECT_EQ(method.config.calibrator.gate.min_significance, 0.5);
  EXPECT_EQ(method.config.calibrator.gate.min_distinctness, 0.25);
  ASSERT_TRUE(method.config.initial_T_camera_lidar);
  EXPECT_EQ(method.config.initial_T_camera_lidar->translation(), Eigen::Vector3d(1, 2, 3));
  const Method variant = parseMethod("no_culling:frame/cull_hidden=false", common);
  EXPECT_EQ(variant.name, "no_culling");
  EXPECT_EQ(variant.config.calibrator.search.search, "coarse_to_fine");
  EXPECT_FALSE(variant.config.frame.cull_hidden);
}

TEST(Methods, WrongOnesAreNamed) {
  expectContains(refusal([] { parseMethod("magic", {}); }), "--method magic: must be one of paper, ");
  expectContains(refusal([] { parseMethod("a:gate/min_significanse=1", {}); }), "gate/min_significance");
  expectContains(refusal([] { parseMethod("a:frame", {}); }), "--method a:frame");
}

// --- starts ---

TEST(Starts, NamesAndNumbers) {
  EXPECT_DOUBLE_EQ(parseStart("E1").range().rotation_deg, 1.0);
  EXPECT_DOUBLE_EQ(parseStart("E3").range().translation_m, 0.2);
  const Start two = parseStart("0 0.3");
  EXPECT_EQ(two.range().rotation_deg, 0.0);
  EXPECT_DOUBLE_EQ(two.range().translation_m, 0.3);
  for (const char* word : {"", "E4", "1", "1 2 3", "-1 0.1", "46 0.1", "1 6", "1 x", "rx", "rx=", "rx=-1",
                           "rx=50", "tx=6", "r=1", "nan 1", "rx=1 2"}) {
    expectContains(refusal([word] { parseStart(word); }), std::string("--start ") + word + ": must be E1");
  }
}

TEST(Starts, AreUniformOnEachAxis) {
  const Eigen::Isometry3d T = someExtrinsic();
  const Start start = parseStart("2.5 0.2");
  std::mt19937_64 random(3);
  constexpr int kCount = 20000;
  Vector6d sum = Vector6d::Zero(), squares = Vector6d::Zero(), largest = Vector6d::Zero();
  for (int i = 0; i < kCount; ++i) {
    const Vector6d xi = log(start.draw(T, random) * T.inverse());
    sum += xi;
    squares += xi.cwiseAbs2();
    largest = largest.cwiseMax(xi.cwiseAbs());
  }
  for (int axis = 0; axis < 6; ++axis) {
    const double limit = axis < 3 ? 2.5 * kDegree : 0.2;
    EXPECT_LE(largest[axis], limit * (1 + 1e-9));
    EXPECT_GT(largest[axis], 0.99 * limit);
    EXPECT_NEAR(sum[axis] / kCount / limit, 0.0, 0.02);  // standard error .004
    EXPECT_NEAR(squares[axis] / kCount / (limit * limit), 1.0 / 3.0,
                0.02);  // variance of a uniform distribution
  }
}

TEST(Starts, OneAxisIsFixed) {
  const Eigen::Isometry3d T = someExtrinsic();
  const Start start = parseStart("ry=12");
  EXPECT_GT(start.range().rotation_deg, 12.5);  // with room: a truth on the border is refused
  EXPECT_LT(start.range().rotation_deg, 14.0);
  EXPECT_LT(start.range().translation_m, 0.06);
  std::mt19937_64 random(3), same(3);
  std::set<bool> signs;
  for (int i = 0; i < 100; ++i) {
    const Vector6d xi = log(start.draw(T, random) * T.inverse());
    const Vector6d of_e1 = log(parseStart("E1").draw(T, same) * T.inverse());
    EXPECT_NEAR(std::abs(xi[1]), 12.0 * kDegree, 1e-9);
    signs.insert(xi[1] > 0.0);
    for (const int axis : {0, 2, 3, 4, 5}) EXPECT_NEAR(xi[axis], of_e1[axis], 1e-9) << axis;
  }
  EXPECT_EQ(signs.size(), 2u);
}

// --- rings ---

/// Rings numbered from above, as some sensors do, and one point of each in turn.
PointCloud eightRings() {
  PointCloud cloud;
  for (int column = 0; column < 50; ++column) {
    for (int ring = 0; ring < 8; ++ring) {
      const double elevation = (3.5 - ring) * kDegree, azimuth = column * kDegree;
      cloud.points.push_back(Eigen::Vector3d(10 * std::cos(elevation) * std::cos(azimuth),
                                             10 * std::cos(elevation) * std::sin(azimuth),
                                             10 * std::sin(elevation))
                                 .cast<float>());
      cloud.reflectivity.push_back(static_cast<float>(ring));
      cloud.ring.push_back(static_cast<std::uint16_t>(ring));
    }
  }
  return cloud;
}

TEST(Rings, EachNthStaysFromBelow) {
  const PointCloud cloud = eightRings(), kept = keepEveryRing(cloud, 4);
  ASSERT_EQ(kept.size(), 100u);
  ASSERT_EQ(kept.ring.size(), 100u);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const int ring = static_cast<int>(kept.reflectivity[i]);  // its number before
    EXPECT_EQ(ring, i % 2 == 0 ? 3 : 7);
    EXPECT_EQ(kept.ring[i], ring == 7 ? 0 : 1);
    EXPECT_NEAR(std::asin(kept.points[i].z() / kept.points[i].norm()), (3.5 - ring) * kDegree, 1e-5);
  }
  const PointCloud whole = keepEveryRing(cloud, 1);
  EXPECT_EQ(whole.points, cloud.points);
  EXPECT_EQ(whole.ring, cloud.ring);
}

TEST(Rings, CloudsWithoutAreRefused) {
  PointCloud cloud;
  cloud.points = {{1, 2, 3}, {3, 1, 2}};
  try {
    keepEveryRing(cloud, 2);
    ADD_FAILURE() << "nothing was thrown";
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kCloud);
    expectContains(error.what(), "--every-ring");
  }
}

TEST(Rings, OfARealCloud) {
  const std::filesystem::path folder = std::filesystem::path(SHARED_DATA) / "kitti_00";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no real data: " << folder;
  const PointCloud cloud = Dataset::open(folder.string())->cloud(0), half = keepEveryRing(cloud, 2);
  const std::set<std::uint16_t> rings(half.ring.begin(), half.ring.end());
  EXPECT_EQ(*rings.rbegin() + 1u, rings.size());  // numbered without gaps
  EXPECT_NEAR(double(rings.size()), 32.0, 1.0);
  EXPECT_NEAR(double(half.size()), 0.5 * double(cloud.size()), 0.05 * double(cloud.size()));
}

// --- figures ---

/// Off by `degrees` about x and by `metres` along z.
Trial trialOf(double degrees, double metres, bool accepted, double start_shift, double result_shift) {
  Trial trial;
  trial.result = {Eigen::Vector3d(degrees * kDegree, 0, 0), Eigen::Vector3d(0, 0, metres)};
  trial.start = {Eigen::Vector3d(0, 2 * kDegree, 0), Eigen::Vector3d(0.1, 0, 0)};
  trial.start_shift = start_shift;
  trial.result_shift = result_shift;
  Run run;
  run.frames = {"000000"};
  run.outcome.accepted = accepted;
  run.outcome.reason = "because, as \"they\" say";
  run.outcome.evaluations = 10;
  run.preparation_seconds = 1.0;
  run.calibration_seconds = 2.0;
  trial.runs = {run};
  return trial;
}

Cell someCell() {
  return {
      "paper",
      kAllFrames,
      parseStart("E1"),
      {trialOf(0.1, -0.04, true, 3, 1), trialOf(-0.2, 0.02, true, 1, 3), trialOf(0.9, 0.03, false, 1, 3)}};
}

TEST(Figures, OfACell) {
  const CellFigures figures = figuresOf(someCell());
  EXPECT_NEAR(figures.rotation.start_mean, 2.0, 1e-9);
  EXPECT_NEAR(figures.rotation.mean, 0.4, 1e-9);
  EXPECT_NEAR(figures.rotation.median, 0.2, 1e-9);
  EXPECT_NEAR(figures.rotation.p90, 0.2 + 0.8 * 0.7, 1e-9);
  EXPECT_NEAR(figures.rotation.axis_mean[0], 0.8 / 3, 1e-9);
  EXPECT_NEAR(figures.rotation.axis_mean_absolute[0], 0.4, 1e-9);
  EXPECT_EQ(figures.rotation.axis_mean_absolute[1], 0.0);
  EXPECT_NEAR(figures.translation.median, 0.03, 1e-12);
  EXPECT_NEAR(figures.translation.axis_mean[2], 0.01 / 3, 1e-12);
  EXPECT_NEAR(figures.success, 2.0 / 3, 1e-12);
  EXPECT_NEAR(figures.accepted, 2.0 / 3, 1e-12);
  EXPECT_NEAR(figures.spoilt, 1.0 / 3, 1e-12);  // the refused one does no harm
  EXPECT_EQ(figures.evaluations, 10.0);
  EXPECT_EQ(figures.cpu_seconds, 3.0);
  EXPECT_EQ(figures.preparation_seconds, 1.0);
}

TEST(Figures, SuccessNeedsBoth) {
  Cell cell = someCell();
  cell.trials = {trialOf(0.29, 0.049, true, 1, 1), trialOf(0.31, 0.0, true, 1, 1),
                 trialOf(0.0, 0.051, true, 1, 1)};
  EXPECT_NEAR(figuresOf(cell).success, 1.0 / 3, 1e-12);
}

TEST(Figures, NormalisedErrorsNeedCovariances) {
  Cell cell = someCell();
  EXPECT_FALSE(figuresOf(cell).normalised_error);
  cell.trials = {trialOf(0.4, 0.0, true, 1, 1), trialOf(-0.2, 0.0, true, 1, 1),
                 trialOf(9.0, 0.0, true, 1, 1)};
  for (const std::size_t i : {0, 1}) {
    Matrix6d covariance = Matrix6d::Identity();
    covariance(0, 0) = 0.04 * kDegree * kDegree;
    cell.trials[i].runs[0].outcome.covariance = covariance;
  }
  cell.trials[0].runs[0].outcome.left_out = {2, 5, 6};
  CellFigures figures = figuresOf(cell);
  ASSERT_TRUE(figures.normalised_error);
  EXPECT_NEAR((*figures.normalised_error)[0], std::sqrt((4.0 + 1.0) / 2.0), 1e-9);
  EXPECT_NEAR(figures.left_out, 1.0, 1e-12);
  // Of two runs the variances add up, and one without makes the sum unknown.
  cell.trials[0].runs.push_back(cell.trials[0].runs[0]);
  cell.trials[1].runs.push_back(cell.trials[2].runs[0]);
  figures = figuresOf(cell);
  EXPECT_NEAR((*figures.normalised_error)[0], std::sqrt(4.0 / 2.0), 1e-9);
}

TEST(Output, CsvHasALineForEachTrial) {
  const std::string csv = toCsv({someCell()});
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 4);
  EXPECT_EQ(csv.rfind("method,frames,start,trial,frame_names,", 0), 0u);
  expectContains(csv, "\n\"paper\",all,\"E1\",1,\"000000\",0,");
  expectContains(csv, "\"because, as \"\"they\"\" say\",1,2\n");
}

}  // namespace
}  // namespace lidar_camera_recalibration::evaluation

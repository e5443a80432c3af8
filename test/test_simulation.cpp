#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <opencv2/core.hpp>
#include <set>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/lidar_sensor.hpp"
#include "simulation/mask_model.hpp"
#include "simulation/rig.hpp"
#include "simulation/street.hpp"

namespace lidar_camera_recalibration::simulation {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

Camera smallCamera() {
  Intrinsics intrinsics;
  intrinsics.width = 420;
  intrinsics.height = 160;
  intrinsics.fx = intrinsics.fy = 240.0;
  intrinsics.cx = 206.0;
  intrinsics.cy = 77.0;
  intrinsics.model = DistortionModel::kPlumbBob;
  intrinsics.distortion = {-0.19, 0.05, 0.0006, -0.0009, 0.0};
  return Camera(intrinsics);
}

LidarConfig exactLidar() {
  LidarConfig config;
  config.range_noise = 0.0;
  config.dropouts = false;
  config.azimuth_step_deg = 0.4;
  return config;
}

/// A wall across the x axis, and if wanted a box in front of it that moves along x.
World wallWorld(double wall_x) {
  World world;
  world.parts.resize(3);
  world.parts[1].kind = PartKind::kFacade;
  world.parts[1].reflectivity = 0.5F;
  world.parts[2].kind = PartKind::kBody;
  world.parts[2].reflectivity = 0.5F;
  const auto x = static_cast<float>(wall_x);
  MeshBuilder(world.ground_and_buildings, Eigen::Isometry3f::Identity())
      .quad({x, -200, -50}, {x, 200, -50}, {x, 200, 50}, {x, -200, 50}, 1);
  return world;
}

Trajectory straight(double speed) {
  return [speed](double t) { return Isometry3d(Eigen::Translation3d(speed * t, 0, 0)); };
}

// --- LiDAR ---

TEST(Lidar, beamTablesAreThoseOfTheSensors) {
  const std::map<int, std::pair<double, double>> ends = {
      {16, {-15, 15}}, {32, {-30.67, 10.67}}, {64, {-24.8, 2}}};
  for (const auto& [beams, range] : ends) {
    const std::vector<double> elevations = beamElevations(beams);
    ASSERT_EQ(elevations.size(), static_cast<std::size_t>(beams));
    EXPECT_NEAR(elevations.front() / kDegree, range.first, 1e-9);
    EXPECT_NEAR(elevations.back() / kDegree, range.second, 1e-9);
    for (std::size_t i = 1; i < elevations.size(); ++i) EXPECT_GT(elevations[i], elevations[i - 1]);
  }
  const std::vector<double> two_blocks = beamElevations(64);
  EXPECT_NEAR((two_blocks[1] - two_blocks[0]) / kDegree, 0.515, 0.01);
  EXPECT_NEAR((two_blocks[63] - two_blocks[62]) / kDegree, 0.333, 0.01);
  EXPECT_THROW(beamElevations(20), Error);
}

TEST(Lidar, pointsOfAMovingSensorAreAsFiredUntilCompensated) {
  const World world = wallWorld(30.0);
  Scene scene(world);
  scene.setInterval(-0.05, 0.05);
  std::vector<LidarReturn> sweep = LidarSensor(exactLidar()).sweep(scene, straight(10.0), 0.0, 1);
  ASSERT_GT(sweep.size(), 1000u);
  float first = 1, last = -1;
  for (const LidarReturn& r : sweep) {
    EXPECT_NEAR(r.point.x(), 30.0 - 10.0 * static_cast<double>(r.time), 1e-3);
    // Clockwise seen from above, forward in the middle of the sweep: the left is seen before.
    EXPECT_NEAR(std::atan2(r.point.y(), r.point.x()), -2 * M_PI * static_cast<double>(r.time) / 0.1, 1e-3);
    first = std::min(first, r.time), last = std::max(last, r.time);
  }
  EXPECT_LT(first, -0.02F);
  EXPECT_GT(last, 0.02F);
  motionCompensate(sweep, straight(10.0), 0.0);
  for (const LidarReturn& r : sweep) EXPECT_NEAR(r.point.x(), 30.0, 1e-3);
}

TEST(Lidar, turningSensorSeesAStraightWallAfterCompensation) {
  const World world = wallWorld(20.0);
  Scene scene(world);
  scene.setInterval(0.95, 1.05);
  const Trajectory turning = [](double t) {
    return Isometry3d(Eigen::Translation3d(5 * t, 1, 0) *
                      Eigen::AngleAxisd(0.4 * (t - 1.0), Vector3d::UnitZ()));
  };
  std::vector<LidarReturn> sweep = LidarSensor(exactLidar()).sweep(scene, turning, 1.0, 1);
  double largest = 0;
  for (const LidarReturn& r : sweep)
    largest = std::max(largest, std::abs(static_cast<double>(r.point.x()) - 15.0));
  EXPECT_GT(largest, 0.2);  // 20 mrad at some 20 m sideways, and 12 cm forward
  motionCompensate(sweep, turning, 1.0);
  for (const LidarReturn& r : sweep) EXPECT_NEAR(r.point.x(), 15.0, 2e-3);
}

TEST(Lidar, movingObjectsAreMetWhereTheyAreAtThatMoment) {
  World world = wallWorld(60.0);
  MovingObject box;
  MeshBuilder(box.mesh, Eigen::Isometry3f::Identity()).box({0, -15, -2}, {2, 15, 2}, 2);
  box.pose = [](double t) { return Isometry3d(Eigen::Translation3d(20 + 15 * t, 0, 0)); };
  world.moving.push_back(box);
  Scene scene(world);
  scene.setInterval(1.95, 2.05);
  const auto sweep = LidarSensor(exactLidar()).sweep(scene, straight(0.0), 2.0, 1);
  std::size_t on_box = 0;
  for (const LidarReturn& r : sweep) {
    if (r.part != 2) continue;
    ++on_box;
    EXPECT_NEAR(r.point.x(), 50.0 + 15.0 * static_cast<double>(r.time), 1e-3);
  }
  EXPECT_GT(on_box, 100u);
}

TEST(Lidar, noiseLossesAndReflectors) {
  World world = wallWorld(20.0);
  Scene scene(world);
  scene.setInterval(-0.05, 0.05);
  LidarConfig config = exactLidar();
  config.azimuth_step_deg = 0.1728;
  const auto exact = LidarSensor(config).sweep(scene, straight(0.0), 0.0, 1);
  config.range_noise = 0.015;
  const auto noisy = LidarSensor(config).sweep(scene, straight(0.0), 0.0, 1);
  ASSERT_EQ(exact.size(), noisy.size());
  double sum = 0, square = 0, brightness = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    const double error =
        static_cast<double>(noisy[i].point.norm()) - static_cast<double>(exact[i].point.norm());
    sum += error, square += error * error;
    brightness = std::max(brightness, static_cast<double>(noisy[i].intensity));
  }
  const double n = static_cast<double>(exact.size());
  EXPECT_NEAR(sum / n, 0.0, 5 * 0.015 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(square / n), 0.015, 0.0005);
  EXPECT_LT(brightness, 80.0);  // half of a white target and noise

  config.dropouts = true;
  const auto with_losses = LidarSensor(config).sweep(scene, straight(0.0), 0.0, 1);
  EXPECT_LT(with_losses.size(), exact.size());
  const auto count_within = [](const std::vector<LidarReturn>& sweep, float low, float high) {
    return static_cast<double>(std::count_if(sweep.begin(), sweep.end(), [&](const LidarReturn& r) {
      return r.point.norm() >= low && r.point.norm() < high;
    }));
  };
  const double near = count_within(with_losses, 19, 30) / count_within(exact, 19, 30);
  const double far = count_within(with_losses, 80, 99) / count_within(exact, 80, 99);
  EXPECT_GT(near, 0.97);
  EXPECT_LT(far, 0.9);

  world.parts[1].retro_reflective = true;
  for (const LidarReturn& r : LidarSensor(config).sweep(scene, straight(0.0), 0.0, 1))
    EXPECT_EQ(r.intensity, 255.0F);
}

// --- the rig ---

TEST(Rig, errorsHaveExactlyTheSizeAsked) {
  std::set<double> directions;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Isometry3d truth = makeRig(seed).T_camera_lidar;
    const ExtrinsicError error = extrinsicError(disturbed(truth, 3 * kDegree, 0.1, seed), truth);
    EXPECT_NEAR(error.angle() / kDegree, 3.0, 1e-9);
    EXPECT_NEAR(error.distance(), 0.1, 1e-12);
    directions.insert(error.rotation.x());
    EXPECT_TRUE(disturbed(truth, 0, 0, seed).isApprox(truth, 1e-14));
    // Parallax between the sensors as on cars: LiDAR above and behind the camera.
    EXPECT_NEAR(truth.translation().y(), -0.28, 0.05);
    EXPECT_NEAR(truth.translation().z(), -0.30, 0.05);
    // Forward for the LiDAR is forward for the camera, to 2 deg.
    EXPECT_GT((truth.linear() * Vector3d::UnitX()).z(), std::cos(2 * kDegree));
  }
  EXPECT_EQ(directions.size(), 20u);
}

// --- the street ---

/// One moment of a small drive, made once.
struct Moment {
  explicit Moment(std::uint64_t seed, int threads = 2)
      : street(seed, 40.0, 8.0), scene(street.world()), camera(smallCamera()) {
    scene.setInterval(kTime - 0.05, kTime + 0.05);
    picture = CameraSensor(camera, threads).take(scene, T_world_camera(), kTime, seed);
  }
  Trajectory T_world_lidar() const {
    return [this](double t) { return street.egoPose(t) * rig.T_base_lidar; };
  }
  Isometry3d T_world_camera() const { return T_world_lidar()(kTime) * rig.T_camera_lidar.inverse(); }

  static constexpr double kTime = 2.0;
  Street street;
  Scene scene;
  Rig rig = makeRig(5);
  Camera camera;
  Picture picture;
};

std::set<std::uint32_t> movingParts(const World& world) {
  std::set<std::uint32_t> parts;
  for (const MovingObject& object : world.moving)
    parts.insert(object.mesh.parts.begin(), object.mesh.parts.end());
  return parts;
}

/// All nine pixels around show the same part.
bool inside(const cv::Mat& part, int u, int v) {
  if (u < 1 || v < 1 || u + 1 >= part.cols || v + 1 >= part.rows) return false;
  return cv::countNonZero(part(cv::Rect(u - 1, v - 1, 3, 3)) != part.at<int>(v, u)) == 0;
}

TEST(Street, lidarPointsFallOnTheirPartInThePicture) {
  for (const std::uint64_t seed : {3, 4}) {
    const Moment moment(seed);
    auto sweep = LidarSensor(exactLidar()).sweep(moment.scene, moment.T_world_lidar(), Moment::kTime, seed);
    motionCompensate(sweep, moment.T_world_lidar(), Moment::kTime);
    const std::set<std::uint32_t> moving = movingParts(moment.street.world());
    const Isometry3d T_world_camera = moment.T_world_camera();
    const Eigen::Vector3f eye = T_world_camera.translation().cast<float>();
    std::size_t compared = 0, equal = 0;
    std::set<std::uint32_t> parts;
    for (const LidarReturn& r : sweep) {
      const Vector3d point = moment.rig.T_camera_lidar * r.point.cast<double>();
      const auto pixel = moment.camera.project(point);
      if (!pixel || moving.count(r.part)) continue;
      const int u = cvRound((*pixel)[0]), v = cvRound((*pixel)[1]);
      if (!inside(moment.picture.part, u, v)) continue;
      // What the LiDAR sees past an edge the camera may not see.
      const Eigen::Vector3f to_point = (T_world_camera.linear() * point).cast<float>();
      if (moment.scene.blocked(eye, to_point.normalized(), to_point.norm() - 0.02F, Moment::kTime)) continue;
      ++compared;
      equal += static_cast<std::uint32_t>(moment.picture.part.at<int>(v, u)) == r.part;
      parts.insert(r.part);
    }
    ASSERT_GT(compared, 3000u);
    EXPECT_GT(parts.size(), 30u);
    EXPECT_GE(static_cast<double>(equal), 0.99 * static_cast<double>(compared));
  }
}

TEST(Street, sameSeedSameDriveForAnyNumberOfThreads) {
  const Moment one(7, 1), three(7, 3), other(8);
  EXPECT_EQ(cv::norm(one.picture.image, three.picture.image, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(one.picture.part, three.picture.part, cv::NORM_INF), 0);
  EXPECT_EQ(cv::norm(one.picture.shadow, three.picture.shadow, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(one.picture.image, other.picture.image, cv::NORM_L1), 1e5);

  LidarConfig config;
  config.azimuth_step_deg = 1.0;
  config.threads = 1;
  const auto a = LidarSensor(config).sweep(one.scene, one.T_world_lidar(), Moment::kTime, 7);
  config.threads = 3;
  const auto b = LidarSensor(config).sweep(three.scene, three.T_world_lidar(), Moment::kTime, 7);
  ASSERT_EQ(a.size(), b.size());
  ASSERT_GT(a.size(), 5000u);
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(a[i].point, b[i].point);
    ASSERT_EQ(a[i].intensity, b[i].intensity);
  }
  const auto masks_a = simulateMasks(one.picture, one.street.world().parts, MaskConfig(), 7);
  const auto masks_b = simulateMasks(three.picture, three.street.world().parts, MaskConfig(), 7);
  ASSERT_EQ(masks_a.size(), masks_b.size());
  for (std::size_t i = 0; i < masks_a.size(); ++i)
    EXPECT_EQ(cv::norm(masks_a[i], masks_b[i], cv::NORM_INF), 0);
}

TEST(Street, vehicleDrivesSmoothlyAndTurns) {
  const Street street(2, 160.0, 8.0);
  double sharpest = 0;
  for (double t = 0; t < 20; t += 0.037) {
    const Isometry3d step = street.egoPose(t).inverse() * street.egoPose(t + 0.01);
    // The inner lane of a bend is shorter, the outer longer: 1.65 m of some 60 m.
    EXPECT_NEAR(step.translation().norm() / 0.01, 8.0, 0.35) << t;
    EXPECT_LT(std::abs(step.translation().y()), 0.002) << t;
    const double yaw_rate = std::atan2(step.linear()(1, 0), step.linear()(0, 0)) / 0.01;
    EXPECT_LT(std::abs(yaw_rate), 0.16);
    sharpest = std::max(sharpest, std::abs(yaw_rate));
  }
  EXPECT_GT(sharpest, 0.03);
}

TEST(Street, holdsWhatAStreetHolds) {
  const Street street(11, 80.0, 8.0);
  std::set<PartKind> kinds;
  std::size_t reflectors = 0;
  for (const Part& part : street.world().parts) {
    kinds.insert(part.kind);
    reflectors += part.kind == PartKind::kSignFace && part.retro_reflective;
  }
  EXPECT_EQ(kinds.size(), static_cast<std::size_t>(PartKind::kFence) + 1);
  EXPECT_GT(reflectors, 5u);
  EXPECT_GT(street.world().moving.size(), 5u);
  EXPECT_THROW(Street(1, 1e6, 8.0), Error);
  EXPECT_THROW(Street(1, std::nan(""), 8.0), Error);
}

// --- masks ---

/// A picture of parts without any light.
Picture partsPicture(const cv::Mat& part) {
  Picture picture;
  picture.part = part;
  picture.shadow = cv::Mat::zeros(part.size(), CV_8UC1);
  return picture;
}

MaskConfig calmMasks() {
  MaskConfig config;
  config.missing = config.split = config.merge = 0.0;
  config.min_masks = 0;
  return config;
}

TEST(Masks, bordersAreOneToTwoPixelsOff) {
  cv::Mat part(600, 400, CV_32SC1, cv::Scalar(1));
  part.colRange(200, 400) = 2;
  std::vector<Part> parts(3);
  parts[1].kind = parts[2].kind = PartKind::kBody;
  double sum = 0, largest = 0;
  int rows = 0;
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const cv::Mat mask = simulateMasks(partsPicture(part), parts, calmMasks(), seed).front();
    const int left = mask.at<int>(300, 50);
    ASSERT_NE(left, 0);
    for (int v = 0; v < mask.rows; ++v) {
      const double border = cv::countNonZero(mask.row(v) == left);
      sum += std::abs(border - 200.0);
      largest = std::max(largest, std::abs(border - 200.0));
      ++rows;
    }
  }
  // Gaussian with 1.4 px: mean of the magnitude 1.4 * sqrt(2 / pi) = 1.1, and gaps of a pixel.
  EXPECT_GT(sum / rows, 0.8);
  EXPECT_LT(sum / rows, 2.0);
  EXPECT_LT(largest, 9.0);
}

TEST(Masks, smallRegionsAndAboutATenthAreMissing) {
  cv::Mat part(400, 800, CV_32SC1);
  std::vector<Part> parts(401);
  for (Part& p : parts) p.kind = PartKind::kBody;
  for (int i = 0; i < 200; ++i) {
    part(cv::Rect(40 * (i % 20), 40 * (i / 20), 40, 40)) = i + 1;
    // A speck of 81 px, too small for a mask of its own.
    part(cv::Rect(40 * (i % 20) + 16, 40 * (i / 20) + 16, 9, 9)) = 201 + i;
  }
  MaskConfig config = calmMasks();
  config.missing = 0.1;
  config.max_masks = 1000;
  const cv::Mat mask = simulateMasks(partsPicture(part), parts, config, 1).front();
  int present = 0, specks = 0;
  for (int i = 0; i < 200; ++i) {
    present += mask.at<int>(40 * (i / 20) + 8, 40 * (i % 20) + 8) != 0;
    specks += mask.at<int>(40 * (i / 20) + 20, 40 * (i % 20) + 20) != 0;
  }
  EXPECT_GE(present, 165);  // 180 +- 3.5 sigma
  EXPECT_LE(present, 195);
  EXPECT_LE(specks, 4);  // where the displacement exceeds 4 px

  config.missing = 0.0;
  const cv::Mat again = simulateMasks(partsPicture(part), parts, config, 2).front();
  int same = 0;
  for (int i = 0; i < 200; ++i) {
    const cv::Point p(40 * (i % 20) + 8, 40 * (i / 20) + 8);
    same += mask.at<int>(p) != 0 && mask.at<int>(p) == again.at<int>(p);
  }
  EXPECT_LE(same, 2);  // ids mean nothing from one picture to the next
}

TEST(Masks, splitsJoinsAndWholeThings) {
  cv::Mat part(200, 300, CV_32SC1, cv::Scalar(1));
  part(cv::Rect(100, 50, 100, 50)) = 2;
  part(cv::Rect(100, 100, 100, 50)) = 3;
  std::vector<Part> parts(4);
  parts[1].kind = PartKind::kBody;
  parts[2].kind = parts[3].kind = PartKind::kBody;
  parts[2].object = parts[3].object = 9;
  MaskConfig config = calmMasks();
  config.whole = 1.0;
  auto layers = simulateMasks(partsPicture(part), parts, config, 1);
  ASSERT_EQ(layers.size(), 2u);
  const int upper = layers[0].at<int>(75, 150), lower = layers[0].at<int>(125, 150),
            whole = layers[1].at<int>(75, 150);
  EXPECT_NE(upper, lower);
  EXPECT_NE(whole, 0);
  EXPECT_EQ(whole, layers[1].at<int>(125, 150));
  EXPECT_EQ(layers[1].at<int>(20, 20), 0);
  EXPECT_TRUE(whole != upper && whole != lower);

  config.merge = 1.0;
  layers = simulateMasks(partsPicture(part), parts, config, 1);
  EXPECT_EQ(layers[0].at<int>(75, 150), layers[0].at<int>(125, 150));

  config.merge = 0.0;
  config.split = 1.0;
  layers = simulateMasks(partsPicture(part), parts, config, 1);
  std::set<int> ids(layers[0].begin<int>(), layers[0].end<int>());
  ids.erase(0);
  EXPECT_EQ(ids.size(), 6u);  // each of three parts in two pieces
}

TEST(Masks, ofAStreetCoverAndOverlapAsThoseOfASegmenter) {
  double covered = 0, overlapping = 0;
  const std::vector<std::uint64_t> seeds = {1, 2, 3, 4};
  MaskConfig config;
  config.min_region = 14;  // 100 px of a picture of the usual size
  for (const std::uint64_t seed : seeds) {
    const Moment moment(seed);
    const auto layers = simulateMasks(moment.picture, moment.street.world().parts, config, seed);
    ASSERT_EQ(layers.size(), 2u);
    std::set<int> ids(layers[0].begin<int>(), layers[0].end<int>());
    ids.insert(layers[1].begin<int>(), layers[1].end<int>());
    EXPECT_GE(ids.size(), 50u);
    EXPECT_LE(ids.size(), 111u);
    const double pixels = static_cast<double>(layers[0].total());
    covered += cv::countNonZero((layers[0] != 0) | (layers[1] != 0)) / pixels;
    overlapping += cv::countNonZero((layers[0] != 0) & (layers[1] != 0)) / pixels;
  }
  EXPECT_GT(covered / static_cast<double>(seeds.size()), 0.82);
  EXPECT_LT(covered / static_cast<double>(seeds.size()), 0.97);
  EXPECT_GT(overlapping / static_cast<double>(seeds.size()), 0.1);
}

}  // namespace
}  // namespace lidar_camera_recalibration::simulation

#include "lidar_camera_recalibration/frame.hpp"

#include <gtest/gtest.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iostream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <set>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

using Points = std::vector<Eigen::Vector3f>;
using Eigen::Vector3d;

// A camera at `place` in the LiDAR frame that looks along the LiDAR's x.
Eigen::Isometry3d cameraAt(const Vector3d& place) {
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R;
  T.translation() = -R * place;
  return T;
}

struct Box {
  Vector3d low, high;
};

// Ground, a wall across the road, and boxes in front of it. All hits are exact.
struct Scene {
  double ground = -1.8;  // z [m]
  double wall = 30.0;    // x [m]
  std::vector<Box> boxes;

  // Distance along a unit ray to the first surface [m].
  double hit(const Vector3d& from, const Vector3d& ray) const {
    double nearest = std::numeric_limits<double>::infinity();
    if (ray.z() < 0) nearest = std::min(nearest, (ground - from.z()) / ray.z());
    if (ray.x() > 0) nearest = std::min(nearest, (wall - from.x()) / ray.x());
    for (const Box& box : boxes) {
      double enter = 0.0, leave = std::numeric_limits<double>::infinity();
      for (int k = 0; k < 3; ++k) {
        const double a = (box.low[k] - from[k]) / ray[k], b = (box.high[k] - from[k]) / ray[k];
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
      }
      if (enter < leave) nearest = std::min(nearest, enter);
    }
    return nearest;
  }
};

// Parked cars with their cabins, a van, a post and a low wall.
Scene street() {
  Scene scene;
  scene.boxes = {{{6, 2, -1.8}, {10, 3.7, -0.9}},   {{7, 2.1, -0.9}, {9.2, 3.6, -0.4}},
                 {{8, -4, -1.8}, {12, -2.3, -0.9}}, {{9, -3.9, -0.9}, {11.2, -2.4, -0.4}},
                 {{14, 1.5, -1.8}, {19, 3.5, 0.5}}, {{5, -1.6, -1.8}, {5.3, -1.3, 2.0}},
                 {{13, -9, -1.8}, {13.3, -5, 0.2}}};
  return scene;
}

// The scene as a spinning LiDAR at the origin sees it, with 1 cm of range noise.
Points scan(const Scene& scene, int beams, double lowest_deg, double highest_deg) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0.0, 0.01);
  Points points;
  for (int beam = 0; beam < beams; ++beam) {
    const double elevation = (lowest_deg + (highest_deg - lowest_deg) * beam / (beams - 1)) * kDegree;
    for (double azimuth = -55 * kDegree; azimuth < 55 * kDegree; azimuth += 0.2 * kDegree) {
      const Vector3d ray(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                         std::sin(elevation));
      const double range = scene.hit(Vector3d::Zero(), ray);
      if (range < 100.0) points.push_back(((range + noise(random)) * ray).cast<float>());
    }
  }
  return points;
}

struct Shares {
  int hidden = 0, found = 0, seen = 0, lost = 0;
};

// Against exact visibility. Points that stand less than 1 m (6 %) behind what hides them count as neither.
Shares cullingShares(const Scene& scene, const Points& points, const Vector3d& place) {
  const auto visible = visiblePoints(points, cameraAt(place));
  Shares shares;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vector3d to_point = points[i].cast<double>() - place;
    const double distance = to_point.norm();
    const double gap = distance - scene.hit(place, to_point / distance);
    if (gap > std::max(1.0, 0.06 * distance)) {
      ++shares.hidden;
      shares.found += !visible[i];
    } else if (gap < 0.1) {
      ++shares.seen;
      shares.lost += !visible[i];
    }
  }
  return shares;
}

// At least `found_share` of the hidden points is found, and at most 2 % of the visible ones are lost.
void expectGoodCulling(int beams, double lowest_deg, double highest_deg, const Vector3d& place,
                       double found_share) {
  const Scene scene = street();
  const Shares s = cullingShares(scene, scan(scene, beams, lowest_deg, highest_deg), place);
  std::cout << beams << " beams, camera at " << place.transpose() << ": " << s.found << " of " << s.hidden
            << " hidden points found, " << s.lost << " of " << s.seen << " visible ones lost\n";
  EXPECT_GT(s.hidden, beams * 5);
  EXPECT_GE(s.found, found_share * s.hidden);
  EXPECT_LE(s.lost, 0.02 * s.seen);
}

TEST(VisiblePoints, StreetWith64Beams) {
  for (const Vector3d& place : {Vector3d(0, 0, -0.5), Vector3d(0, -0.5, 0), Vector3d(0.3, 0.4, -0.5)}) {
    expectGoodCulling(64, -24.8, 2.0, place, 0.8);
  }
  expectGoodCulling(64, -24.8, 2.0, {0, 0, -1.2}, 0.8);
}

// Beams 2 deg apart tell the upper end of a thing only that roughly. From a camera below the LiDAR, much of
// what things hide appears in that uncertain strip, and stays.
TEST(VisiblePoints, StreetWith16Beams) {
  expectGoodCulling(16, -15.0, 15.0, {0, -0.5, 0}, 0.8);
  expectGoodCulling(16, -15.0, 15.0, {0.3, 0.4, -0.5}, 0.6);
  expectGoodCulling(16, -15.0, 15.0, {0, 0, -0.5}, 0.3);
  expectGoodCulling(16, -15.0, 15.0, {0, 0, -1.2}, 0.5);
}

// A panel at x = 5, |y| <= 1; seen from the camera at y = -0.5 its left edge lies in the direction (5, 1.5).
// The LiDAR sees points behind it from y = 0.2 x on.
TEST(VisiblePoints, SilhouetteIsSharpAndNotWidened) {
  Points points;
  for (int row = -20; row <= 20; ++row) {
    for (int i = -50; i <= 50; ++i) points.emplace_back(5.0f, 0.02f * i, 0.02f * row);
  }
  const std::size_t panel = points.size();
  std::vector<double> past_edge_deg;
  for (int row = -20; row <= 20; ++row) {
    for (double past = -2.0; past < 1.0; past += 0.02) {
      const double direction = std::atan2(1.5, 5.0) + past * kDegree;
      points.push_back(Vector3d(20.0, -0.5 + 20.0 * std::tan(direction), 0.05 * row).cast<float>());
      past_edge_deg.push_back(past);
    }
  }
  const auto visible = visiblePoints(points, cameraAt({0, -0.5, 0}));
  for (std::size_t i = 0; i < panel; ++i) EXPECT_TRUE(visible[i]);
  for (std::size_t i = panel; i < points.size(); ++i) {
    const double past = past_edge_deg[i - panel];
    if (past > 0.01) {
      EXPECT_TRUE(visible[i]) << past;
    } else if (past < -0.25) {
      EXPECT_FALSE(visible[i]) << past;
    }
  }
}

TEST(VisiblePoints, NothingIsHiddenFromTheLidarsOwnPlace) {
  const Points points = scan(street(), 32, -25.0, 10.0);
  const auto visible = visiblePoints(points, cameraAt({0, 0, 0}));
  EXPECT_EQ(std::count(visible.begin(), visible.end(), 0), 0);
}

TEST(VisiblePoints, DoesNotDependOnTheCamerasOrientation) {
  const Points points = scan(street(), 32, -25.0, 10.0);
  const Eigen::Isometry3d T = cameraAt({0, 0.4, -0.5});
  Vector6d turn = Vector6d::Zero();
  turn.head<3>() << 0.3, -0.5, 0.2;
  EXPECT_EQ(visiblePoints(points, exp(turn) * T), visiblePoints(points, T));
}

TEST(VisiblePoints, DoesNotDependOnTheOrderOfThePoints) {
  const Points points = scan(street(), 32, -25.0, 10.0);
  const Eigen::Isometry3d T = cameraAt({0, 0.4, -0.5});
  const auto visible = visiblePoints(points, T);
  ASSERT_GT(std::count(visible.begin(), visible.end(), 0), 50);
  auto reversed = visiblePoints(Points(points.rbegin(), points.rend()), T);
  std::reverse(reversed.begin(), reversed.end());
  EXPECT_EQ(reversed, visible);
}

TEST(VisiblePoints, FewOrDegeneratePointsAreVisible) {
  const Eigen::Isometry3d T = cameraAt({0, 0, -0.5});
  EXPECT_TRUE(visiblePoints({}, T).empty());
  for (const Points& points :
       {Points{{5, 0, 0}}, Points(3, {5, 0, 0}), Points{{5, 0, 0}, {6, 0, 0}, {7, 0, 0}},
        Points{{5, 0, 0}, {5, 1, 0}, {5, 2, 0}, {0, 0, -0.5f}}}) {
    EXPECT_EQ(visiblePoints(points, T), std::vector<std::uint8_t>(points.size(), 1));
  }
}

Intrinsics pinhole(int width, int height, double focal) {
  Intrinsics k;
  k.width = width;
  k.height = height;
  k.fx = k.fy = focal;
  k.cx = (width - 1) / 2.0;
  k.cy = (height - 1) / 2.0;
  return k;
}

// Label image of cells of 40 x 40 px.
cv::Mat chequered(int width, int height) {
  cv::Mat labels(height, width, CV_32SC1);
  for (int v = 0; v < height; ++v) {
    for (int u = 0; u < width; ++u) labels.at<int>(v, u) = 1 + u / 40 + 100 * (v / 40);
  }
  return labels;
}

// Everything that makeFrame needs; tests spoil one thing at a time.
struct Input {
  Intrinsics intrinsics = pinhole(640, 480, 500);
  cv::Mat image = cv::Mat(480, 640, CV_8UC3, cv::Scalar(10, 20, 30));
  std::vector<cv::Mat> layers{chequered(640, 480)};
  PointCloud cloud;
  Eigen::Isometry3d guess = cameraAt({0.3, 0.4, -0.5});
  FrameConfig config;

  Input() {
    cloud.points = scan(street(), 32, -25.0, 10.0);
    for (std::size_t i = 0; i < cloud.size(); ++i) cloud.reflectivity.push_back(static_cast<float>(i % 50));
  }

  FramePtr frame() const { return makeFrame(12.5, Camera(intrinsics), image, layers, cloud, guess, config); }
};

void expectError(const Input& input, ErrorCause cause, const std::vector<std::string>& words) {
  try {
    input.frame();
    ADD_FAILURE() << "accepted";
  } catch (const Error& error) {
    EXPECT_EQ(static_cast<int>(error.cause()), static_cast<int>(cause)) << error.what();
    for (const std::string& word : words) {
      EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what() << " lacks " << word;
    }
  }
}

TEST(MakeFrame, KeepsEverythingInStep) {
  Input input;
  const FramePtr frame = input.frame();
  const FramePoints& p = frame->points;
  EXPECT_EQ(frame->stamp, 12.5);
  EXPECT_EQ(frame->masks.maskCount(), 16u * 12u);
  ASSERT_GT(p.size(), 500u);
  ASSERT_LT(p.size(), input.cloud.size());
  for (const auto* column : {&p.y, &p.z, &p.nx, &p.ny, &p.nz, &p.reflectivity})
    EXPECT_EQ(column->size(), p.size());
  EXPECT_EQ(p.segment.size(), p.size());
  EXPECT_EQ(frame->visible, std::vector<std::uint8_t>(p.size(), 1));
  EXPECT_LT(*std::max_element(p.segment.begin(), p.segment.end()), p.segment_count);

  // Each point still has its own reflectivity: 49 is the value at the quantile.
  std::size_t k = 0;
  for (std::size_t i = 0; i < p.size(); ++i, ++k) {
    while (k < input.cloud.size() && input.cloud.points[k] != Eigen::Vector3f(p.x[i], p.y[i], p.z[i])) ++k;
    ASSERT_LT(k, input.cloud.size());
    EXPECT_FLOAT_EQ(p.reflectivity[i], static_cast<float>(k % 50) / 49.0f);
  }
  // The road's normals point up.
  for (std::size_t i = 0; i < p.size(); ++i) {
    const bool road = p.z[i] < -1.75f && p.x[i] < 9.0f && std::abs(p.y[i]) < 1.0f;
    if (road) {
      EXPECT_GT(p.nz[i], 0.98f);
    }
  }
}

TEST(MakeFrame, HiddenPointsGoOnlyIfAskedTo) {
  Input input;
  const FramePtr culled = input.frame();
  input.config.cull_hidden = false;
  const FramePtr whole = input.frame();
  const auto seen = std::count(whole->visible.begin(), whole->visible.end(), 1);
  EXPECT_EQ(whole->visible.size(), whole->points.size());
  EXPECT_LT(seen, static_cast<long>(whole->points.size()));
  EXPECT_EQ(culled->points.size(), static_cast<std::size_t>(seen));
  std::vector<float> seen_x;
  for (std::size_t i = 0; i < whole->points.size(); ++i) {
    if (whole->visible[i]) seen_x.push_back(whole->points.x[i]);
  }
  EXPECT_EQ(culled->points.x, seen_x);
}

TEST(MakeFrame, RangeLimits) {
  Input input;
  input.config.min_range = 8.0;
  input.config.max_range = 25.0;
  const FramePtr frame = input.frame();
  for (std::size_t i = 0; i < frame->points.size(); ++i) {
    const double range = Vector3d(frame->points.x[i], frame->points.y[i], frame->points.z[i]).norm();
    EXPECT_GE(range, 8.0);
    EXPECT_LE(range, 25.0);
  }
}

// Directions all around; a point must stay exactly if one of many rotations by the margin brings it into the
// image.
void expectExactCrop(const Intrinsics& intrinsics, double margin_deg) {
  Input input;
  input.intrinsics = intrinsics;
  input.image = cv::Mat();
  input.layers = {chequered(intrinsics.width, intrinsics.height)};
  input.cloud = PointCloud();
  input.config.crop_margin_deg = margin_deg;
  input.config.cull_hidden = false;
  input.config.min_points = 1;
  constexpr int kCount = 2000;
  for (int i = 0; i < kCount; ++i) {  // Fibonacci sphere around the camera
    const double z = 1.0 - (2.0 * i + 1.0) / kCount, phi = i * 2.399963229728653, r = std::sqrt(1.0 - z * z);
    const Vector3d in_camera = 20.0 * Vector3d(r * std::cos(phi), r * std::sin(phi), z);
    input.cloud.points.push_back((input.guess.inverse() * in_camera).cast<float>());
  }
  std::set<std::array<float, 3>> kept;
  const FramePtr frame = input.frame();
  for (std::size_t i = 0; i < frame->points.size(); ++i) {
    kept.insert({frame->points.x[i], frame->points.y[i], frame->points.z[i]});
  }

  // Rays through a dense net of pixels of the border, and the inside, give the angle to the image
  // independently.
  std::vector<Vector3d> border;
  const auto addRay = [&](double u, double v) {
    border.push_back(
        Vector3d((u - intrinsics.cx) / intrinsics.fx, (v - intrinsics.cy) / intrinsics.fy, 1.0).normalized());
  };
  for (double u = 0; u < intrinsics.width; u += 0.5) addRay(u, -0.5), addRay(u, intrinsics.height - 0.5);
  for (double v = 0; v < intrinsics.height; v += 0.5) addRay(-0.5, v), addRay(intrinsics.width - 0.5, v);
  int inside_count = 0, margin_count = 0;
  for (const auto& point : input.cloud.points) {
    const Vector3d d = (input.guess * point.cast<double>()).normalized();
    const double u = intrinsics.fx * d.x() / d.z() + intrinsics.cx;
    const double v = intrinsics.fy * d.y() / d.z() + intrinsics.cy;
    const bool inside =
        d.z() > 0 && u > -0.5 && v > -0.5 && u < intrinsics.width - 0.5 && v < intrinsics.height - 0.5;
    double angle = M_PI;
    for (const auto& ray : border) angle = std::min(angle, std::acos(std::min(1.0, d.dot(ray))));
    if (std::abs(angle - margin_deg * kDegree) < 0.1 * kDegree) continue;  // too close to call
    const bool expected = inside || angle < margin_deg * kDegree;
    EXPECT_EQ(kept.count({point.x(), point.y(), point.z()}) > 0, expected) << d.transpose();
    inside_count += inside;
    margin_count += expected && !inside;
  }
  EXPECT_GT(inside_count, 20);
  EXPECT_GT(margin_count, 20);
}

TEST(MakeFrame, CropIsExactForANarrowView) { expectExactCrop(pinhole(640, 480, 500), 12.0); }

TEST(MakeFrame, CropIsExactForAWideViewAndReachesBehindTheCamera) {
  // 150 deg wide: with a margin of 25 deg points up to 100 deg off the axis stay.
  expectExactCrop(pinhole(1000, 600, 500 / std::tan(75 * kDegree)), 25.0);
}

TEST(MakeFrame, GreyImageBecomesColourAndPixelsAreCopied) {
  Input input;
  input.image = cv::Mat(480, 640, CV_8UC1, cv::Scalar(77));
  const FramePtr frame = input.frame();
  input.image.setTo(0);
  EXPECT_EQ(frame->image.type(), CV_8UC3);
  EXPECT_EQ(frame->image.at<cv::Vec3b>(100, 100), cv::Vec3b(77, 77, 77));
  input.image = cv::Mat();
  EXPECT_TRUE(input.frame()->image.empty());
}

TEST(MakeFrame, MasksOfADistortedImageAreBroughtIntoTheIdealImage) {
  Input input;
  input.intrinsics.model = DistortionModel::kPlumbBob;
  input.intrinsics.distortion = {-0.2, 0.05, 0.001, -0.001, 0.0};
  const Camera camera(input.intrinsics);
  const FramePtr frame = input.frame();
  const MaskSets expected = MaskSets::fromLayers({camera.toIdeal(input.layers[0], cv::INTER_NEAREST)});
  const MaskSets untouched = MaskSets::fromLayers(input.layers);
  EXPECT_EQ(cv::norm(frame->masks.setOfPixel(), expected.setOfPixel(), cv::NORM_INF), 0.0);
  EXPECT_GT(cv::norm(frame->masks.setOfPixel(), untouched.setOfPixel(), cv::NORM_INF), 0.0);
}

TEST(MakeFrame, CloudsThatCannotBeUsed) {
  Input input;
  input.cloud = PointCloud();
  expectError(input, ErrorCause::kCloud, {"empty"});
  input = Input();
  input.cloud.reflectivity.pop_back();
  expectError(input, ErrorCause::kCloud, {std::to_string(input.cloud.size()), "reflectivity"});
  input = Input();
  input.guess =
      input.guess * Eigen::AngleAxisd(M_PI, Vector3d::UnitZ());  // looks backwards, where nothing is
  expectError(input, ErrorCause::kNotEnough,
              {"Only 0 of", std::to_string(input.cloud.size()), "min_points", "500"});
}

TEST(MakeFrame, MasksThatCannotBeUsed) {
  Input input;
  input.layers.push_back(chequered(320, 240));
  expectError(input, ErrorCause::kMasks, {"320x240", "640x480"});
  input = Input();
  input.layers.clear();
  expectError(input, ErrorCause::kMasks, {"layer"});
  input = Input();
  input.layers[0].convertTo(input.layers[0], CV_16U);
  expectError(input, ErrorCause::kMasks, {"CV_16UC1", "CV_32SC1"});
  input = Input();
  input.layers[0].setTo(0);
  expectError(input, ErrorCause::kMasks, {});
  input.layers[0](cv::Rect(0, 0, 9, 9)).setTo(1);
  input.layers[0](cv::Rect(20, 0, 9, 9)).setTo(2);
  expectError(input, ErrorCause::kNotEnough, {"2 masks", "min_masks", "5"});
}

TEST(MakeFrame, ImagesThatCannotBeUsed) {
  Input input;
  input.image = cv::Mat(100, 200, CV_8UC3, cv::Scalar::all(0));
  expectError(input, ErrorCause::kImage, {"200x100", "640x480"});
  input.image = cv::Mat(480, 640, CV_16UC1, cv::Scalar::all(0));
  expectError(input, ErrorCause::kImage, {"CV_16UC1", "bgr8"});
}

TEST(MakeFrame, CloudWithoutReflectivity) {
  Input input;
  input.cloud.reflectivity.clear();
  EXPECT_FALSE(input.frame()->points.hasReflectivity());
}

TEST(MakeFrame, SameInputSameFrame) {
  const Input input;
  const FramePtr a = input.frame(), b = input.frame();
  EXPECT_EQ(a->points.x, b->points.x);
  EXPECT_EQ(a->points.nz, b->points.nz);
  EXPECT_EQ(a->points.segment, b->points.segment);
}

TEST(MemoryUse, CountsColumnsAndImages) {
  Input input;
  input.config.edges = false;
  const FramePtr frame = input.frame();
  // Seven float columns, one of int32, one flag; a BGR image; a 16-bit image of sets.
  const std::size_t least = frame->points.size() * (7 * 4 + 4 + 1) + 640 * 480 * (3 + 2);
  EXPECT_GE(memoryUse(*frame), least);
  EXPECT_LE(memoryUse(*frame), 2 * least);
  input.image = cv::Mat();
  EXPECT_EQ(memoryUse(*frame) - memoryUse(*input.frame()), 640u * 480u * 3u);
}

TEST(MakeFrame, RealStreet) {
  const std::string folder = SHARED_DATA "/kitti_00";
  if (!std::ifstream(folder + "/calib.json")) GTEST_SKIP() << "no real data: " << folder << " is not there";
  Input input;
  pcl::PointCloud<pcl::PointXYZI> raw;
  ASSERT_EQ(pcl::io::loadPCDFile(folder + "/pc/000000.pcd", raw), 0);
  input.cloud = PointCloud();
  for (const auto& p : raw) {
    input.cloud.points.emplace_back(p.x, p.y, p.z);
    input.cloud.reflectivity.push_back(p.intensity);
  }
  input.image = cv::imread(folder + "/images/000000.png");
  ASSERT_FALSE(input.image.empty());
  input.intrinsics = pinhole(input.image.cols, input.image.rows, 718.856);
  input.intrinsics.cx = 607.1928;
  input.intrinsics.cy = 185.2157;
  std::vector<cv::Mat> masks;
  std::vector<std::string> files;
  cv::glob(folder + "/masks/000000/*.png", files);
  for (const auto& file : files) masks.push_back(cv::imread(file, cv::IMREAD_GRAYSCALE));
  input.layers = layersFromBinaryMasks(masks);
  input.guess = cameraAt({0.29, -0.05, -0.06});  // within centimetres and a degree of the reference

  const FramePtr frame = input.frame();
  EXPECT_GT(frame->points.size(), 20000u);
  EXPECT_LT(frame->points.size(), raw.size() / 2);
  EXPECT_GE(frame->masks.maskCount(), files.size() / 2);
  // Camera and LiDAR are 0.3 m apart: some points are hidden, few of them.
  input.config.cull_hidden = false;
  const FramePtr whole = input.frame();
  const auto hidden = std::count(whole->visible.begin(), whole->visible.end(), 0);
  EXPECT_GT(hidden, 20);
  EXPECT_LT(hidden, static_cast<long>(whole->points.size() / 50));
}

}  // namespace
}  // namespace lidar_camera_recalibration

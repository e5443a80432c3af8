#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <random>
#include <set>

#include "boundary_field.hpp"
#include "coarse_to_fine_search.hpp"
#include "consistency_edges_objective.hpp"
#include "dataset.hpp"
#include "edge_weights.hpp"
#include "edges_config.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_edges.hpp"
#include "mask_borders.hpp"
#include "region_information.hpp"
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

/// Ten edges of one kind behind the LiDAR, a hundredth of a degree apart across the seam of the azimuth; one
/// of another kind among them, and one far away.
EdgePoints crowdAndTwoAlone() {
  EdgePoints edges;
  const auto add = [&](double azimuth_deg, Kind kind) {
    edges.x.push_back(static_cast<float>(20.0 * std::cos(azimuth_deg * kDegree)));
    edges.y.push_back(static_cast<float>(20.0 * std::sin(azimuth_deg * kDegree)));
    edges.z.push_back(-1.0f);
    edges.weight.push_back(1.0f);
    edges.kind.push_back(kind);
  };
  for (int i = 0; i < 10; ++i) add(179.955 + 0.01 * i, Kind::kAzimuthGap);
  add(180.0, Kind::kReflectivity);
  add(150.0, Kind::kAzimuthGap);
  return edges;
}

TEST(EdgeWeights, ACrowdOfEdgesIsWorthAFewSingleOnes) {
  EdgePoints edges = crowdAndTwoAlone();
  shareWeights(edges);
  ASSERT_EQ(12u, edges.weight.size());
  for (int i = 0; i < 10; ++i) EXPECT_FLOAT_EQ(1.0f / 6.0f, edges.weight[i]);
  EXPECT_FLOAT_EQ(1.0f / 1.5f, edges.weight[10]) << "another kind";
  EXPECT_FLOAT_EQ(1.0f / 1.5f, edges.weight[11]) << "far away";
  EdgePoints none;
  shareWeights(none);
  EXPECT_EQ(0u, none.size());
}

TEST(LidarEdges, LieOnTheOutlineOfTheNearerSurface) {
  const PointCloud cloud = boardInFrontOfWall();
  const EdgePoints edges = findLidarEdges(cloud, featuresOf(cloud), {});
  std::array<int, EdgePoints::kKinds> count = {};
  double gap_weight = 0.0;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    ++count[static_cast<std::size_t>(edges.kind[i])];
    EXPECT_NEAR(edges.x[i], kBoard, 0.05) << "on the board's side";
    if (edges.kind[i] == Kind::kAzimuthGap) {
      EXPECT_NEAR(std::abs(edges.y[i]), kHalfWidth, 0.5 * kBoard * kAzimuthStep * 1.2);
      EXPECT_FLOAT_EQ(edges.weight[i], 1.0f);
    } else if (edges.kind[i] == Kind::kRingGap) {
      EXPECT_NEAR(std::abs(edges.z[i]), kHalfHeight, kBoard * kRingStep * 1.2);
      gap_weight += edges.weight[i];
    } else {
      EXPECT_NEAR(edges.y[i], 0.0, 1.5 * kBoard * kAzimuthStep) << "or a point beside it";
    }
  }
  const int rings_on_board = 28, steps_on_board = 140;  // 2 atan(1/8) / 0.5 deg; 2 atan(1/4) / 0.2 deg
  EXPECT_NEAR(count[0], 2 * rings_on_board, 4);
  EXPECT_NEAR(gap_weight, 0.6 * 2 * steps_on_board, 6)
      << "the samples of a gap of 0.5 deg together count as 0.6 of an edge";
  EXPECT_NEAR(count[1], 5 * 2 * steps_on_board, 0.1 * count[1]) << "0.5 deg in steps of 0.1 deg";
  EXPECT_GE(count[2], rings_on_board - 2);
  EXPECT_LE(count[2], 3 * rings_on_board) << "at most the step and a point to either side";
}

// The upper edge of the board is somewhere in the gap; wherever it is, the samples of the gap surround it.
TEST(LidarEdges, RingGapsAreSampledOverTheWholeGap) {
  const PointCloud cloud = boardInFrontOfWall();
  const EdgePoints edges = findLidarEdges(cloud, featuresOf(cloud), {});
  float lowest = 100.0f, highest = 0.0f;
  for (std::size_t i = 0; i < edges.size(); ++i) {
    if (edges.kind[i] != Kind::kRingGap || edges.z[i] < 0.0f || std::abs(edges.y[i]) > 0.5f) continue;
    lowest = std::min(lowest, edges.z[i]);
    highest = std::max(highest, edges.z[i]);
  }
  EXPECT_LT(lowest, kHalfHeight);
  EXPECT_GT(highest, kHalfHeight);
  EXPECT_NEAR(highest - lowest, 0.8 * kBoard * kRingStep, 0.15 * kBoard * kRingStep);
}

// A surface that leans back goes on in its own plane, so the edge is further away than its last point.
TEST(LidarEdges, SurfacesGoOnIntoTheGap) {
  PointCloud cloud = boardInFrontOfWall();
  LidarFeatures features = featuresOf(cloud);
  const Eigen::Vector3f leaning = Eigen::Vector3f(-1.0f, 0.0f, 1.0f).normalized();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.points[i].x() < 10.0f) features.normals[i] = leaning;
  }
  const EdgePoints edges = findLidarEdges(cloud, features, {});
  for (std::size_t i = 0; i < edges.size(); ++i) {
    if (edges.kind[i] != Kind::kRingGap) continue;
    EXPECT_GT((edges.x[i] - kBoard) * edges.z[i], 0.0) << "further away above, nearer below";
  }
}

// A beam as wide as a step of the azimuth sees a bit of both sides of a step of the reflectivity.
TEST(LidarEdges, ReflectivityStepsAreFoundBetweenTheBeams) {
  for (const double place : {0.0, 0.2, 0.4, 0.6, 0.8}) {  // of a step of the azimuth
    PointCloud cloud;
    for (int ring = 0; ring < 8; ++ring) {
      for (int step = -50; step <= 50; ++step) {
        const double azimuth = step * kAzimuthStep, elevation = ring * kRingStep;
        const Eigen::Vector3d ray(1.0, std::tan(azimuth), std::tan(elevation) / std::cos(azimuth));
        cloud.points.push_back((kBoard * ray).cast<float>());
        const double share = std::clamp(step - place + 0.5, 0.0, 1.0);
        cloud.reflectivity.push_back(static_cast<float>(0.3 + 0.4 * share));
        cloud.ring.push_back(static_cast<std::uint16_t>(ring));
      }
    }
    const EdgePoints edges = findLidarEdges(cloud, featuresOf(cloud), {});
    EXPECT_GE(edges.size(), 8u) << "one a ring at least";
    double mean = 0.0;  // [steps]; a step is found from up to three windows, the outer ones less exactly
    for (std::size_t i = 0; i < edges.size(); ++i) {
      EXPECT_EQ(edges.kind[i], Kind::kReflectivity);
      const double found = std::atan2(edges.y[i], edges.x[i]) / kAzimuthStep;
      EXPECT_NEAR(found, place, 0.4);
      mean += found / static_cast<double>(edges.size());
    }
    EXPECT_NEAR(mean, place, 0.12);
  }
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
  for (std::size_t i = 0; i < by_ring.size(); ++i) by_ring.ring.push_back(static_cast<std::uint16_t>(i % 4));
  EXPECT_EQ(ringsOf(by_ring), by_ring.ring) << "the sensor's own";
  by_ring.ring.assign(by_ring.size(), 0);
  expectSameRings(rings, ringsOf(by_ring));  // a column that the driver did not fill
  EXPECT_TRUE(ringsOf(PointCloud()).empty());
}

/// One mask, a rectangle from (60, 40) to (140, 100), as set image.
MaskSets rectangle() {
  cv::Mat labels = cv::Mat::zeros(160, 200, CV_32SC1);
  labels(cv::Rect(60, 40, 80, 60)).setTo(1);
  return MaskSets::fromLayers({labels});
}

TEST(MaskBorders, RunBetweenThePixelsOfTheMasks) {
  int upright = 0, level = 0;
  for (const Border& border : maskBorders(rectangle().setOfPixel(), cv::Mat())) {
    if (border.v > 50.0f && border.v < 90.0f) {
      EXPECT_TRUE(border.upright && !border.level);
      EXPECT_NEAR(std::min(std::abs(border.u - 59.5f), std::abs(border.u - 139.5f)), 0.0f, 1e-5f);
      EXPECT_NEAR(std::abs(border.nu), 1.0f, 1e-5f);
      ++upright;
    }
    if (border.u > 70.0f && border.u < 130.0f) {
      EXPECT_TRUE(border.level && !border.upright);
      EXPECT_NEAR(std::min(std::abs(border.v - 39.5f), std::abs(border.v - 99.5f)), 0.0f, 1e-5f);
      EXPECT_NEAR(std::abs(border.nv), 1.0f, 1e-5f);
      ++level;
    }
  }
  EXPECT_EQ(upright, 4 * 39) << "both pixels at both borders";
  EXPECT_EQ(level, 4 * 59);
}

TEST(MaskBorders, SlantedOnesAreForBothKindsOfEdges) {
  cv::Mat labels = cv::Mat::zeros(160, 200, CV_32SC1);
  for (int v = 0; v < 160; ++v) {
    for (int u = 0; u < 200; ++u) labels.at<int>(v, u) = u + v > 180 ? 1 : 2;
  }
  for (const Border& border : maskBorders(MaskSets::fromLayers({labels}).setOfPixel(), cv::Mat())) {
    if (border.u < 40.0f || border.u > 160.0f) continue;
    EXPECT_TRUE(border.upright && border.level);
    EXPECT_NEAR(border.u + border.v, 180.5f, 0.51f);
    EXPECT_NEAR(border.nu * border.nv, 0.5f, 0.05f);
  }
}

// A blurred step at any place between two pixels is found to a tenth of a pixel.
TEST(MaskBorders, MoveToTheEdgesOfTheImage) {
  for (const float place : {61.5f, 61.75f, 62.0f, 62.3f}) {
    cv::Mat image(160, 200, CV_8UC3);
    for (int u = 0; u < 200; ++u) {
      // The object begins at `place`; its right side has no contrast.
      const float left = 125.0f + 75.0f * std::erf((static_cast<float>(u) - place) / 1.2f);
      image.col(u).setTo(
          cv::Scalar::all(std::max(50.0f, left - (u > 100 ? 3.0f * static_cast<float>(u - 100) : 0.0f))));
    }
    int found = 0;
    for (const Border& border : maskBorders(rectangle().setOfPixel(), image)) {
      if (border.v < 50.0f || border.v > 90.0f) continue;
      EXPECT_NEAR(border.u, place, 0.1f) << "the right side has no edge";
      EXPECT_NEAR(std::abs(border.nu), 1.0f, 0.02f);
      EXPECT_TRUE(border.upright);
      ++found;
    }
    EXPECT_GE(found, 38);
  }
}

// Red of the same brightness as the green beside it.
TEST(MaskBorders, MoveToEdgesOfTheColour) {
  cv::Mat image(160, 200, CV_8UC3, cv::Scalar(0, 100, 0)), grey;
  image.colRange(61, 200).setTo(cv::Scalar(0, 0, 196));
  cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
  ASSERT_NEAR(grey.at<std::uint8_t>(80, 60), grey.at<std::uint8_t>(80, 61), 1);
  int found = 0;
  for (const Border& border : maskBorders(rectangle().setOfPixel(), image)) {
    if (border.v < 50.0f || border.v > 90.0f) continue;
    EXPECT_NEAR(border.u, 60.5f, 0.1f);
    ++found;
  }
  EXPECT_GE(found, 38);
}

TEST(MaskBorders, ThereAreNoneWithoutMasks) {
  const cv::Mat none = cv::Mat::zeros(160, 200, CV_16UC1);
  cv::Mat image(160, 200, CV_8UC3, cv::Scalar::all(50));
  image.colRange(100, 200).setTo(cv::Scalar::all(200));
  EXPECT_TRUE(maskBorders(none, image).empty());
  EXPECT_TRUE(maskBorders(none, cv::Mat()).empty());
}

std::vector<Border> uprightLine(float u) {
  std::vector<Border> borders;
  for (int v = 0; v < 160; ++v) {
    Border border;
    border.u = u;
    border.v = static_cast<float>(v);
    border.pixel = {static_cast<int>(u + 0.5f), v};
    border.upright = true;
    borders.push_back(border);
  }
  return borders;
}

PixelBlock onePixel(float u, float v) {
  PixelBlock pixels;
  pixels.u[0] = u;
  pixels.v[0] = v;
  return pixels;
}

float closenessAt(const BoundaryField& field, BoundaryField::Direction direction, std::size_t level, float u,
                  float v) {
  Block<float> result;
  field.closeness(direction, level, onePixel(u, v), 1, result);
  return result[0];
}

const BoundaryField::Line* nearestTo(const BoundaryField& field, BoundaryField::Direction direction, float u,
                                     float v) {
  Block<std::int32_t> result;
  field.nearest(direction, onePixel(u, v), 1, result);
  return result[0] < 0 ? nullptr : &field.lines(direction)[static_cast<std::size_t>(result[0])];
}

TEST(BoundaryField, NearestAndCloseness) {
  const double fx = 300.0;
  const BoundaryField field(uprightLine(100.25f), {200, 160}, fx);
  const BoundaryField::Line* nearest = nearestTo(field, BoundaryField::kUpright, 93.25f, 80.3f);
  ASSERT_NE(nearest, nullptr);
  EXPECT_FLOAT_EQ(nearest->u, 100.25f);
  EXPECT_FLOAT_EQ(nearest->v, 80.0f);
  EXPECT_EQ(nearestTo(field, BoundaryField::kUpright, 199.5f, 80.0f), nullptr) << "outside";
  EXPECT_EQ(nearestTo(field, BoundaryField::kUpright, std::nanf(""), 80.0f), nullptr);
  EXPECT_EQ(nearestTo(field, BoundaryField::kLevel, 93.0f, 80.0f), nullptr) << "no border of this kind";
  EXPECT_EQ(closenessAt(field, BoundaryField::kLevel, 1, 93.0f, 80.0f), 0.0f);
  // A line blurred over 5 sigma has 1 / sqrt(26) of its height left.
  for (std::size_t level = 0; level < kScoreLevels; ++level) {
    const double sigma = fx * kBoundaryWidths[level] * kDegree, base = 1.0 / std::sqrt(26.0);
    for (const double d : {0.0, 3.0, -7.0}) {
      const double expected =
          std::exp(-0.5 * d * d / (sigma * sigma)) - base * std::exp(-0.5 * d * d / (26.0 * sigma * sigma));
      EXPECT_NEAR(closenessAt(field, BoundaryField::kUpright, level, static_cast<float>(100.25 + d), 80.0f),
                  expected, 0.08)
          << level << ", " << d;
    }
    EXPECT_EQ(closenessAt(field, BoundaryField::kUpright, level, -3.0f, 80.0f), 0.0f);
  }
}

// Long focal lengths have wide borders, which are kept on smaller images: same places, same values.
TEST(BoundaryField, SmallerImagesOfWideBordersAreInPlace) {
  const double fx = 1200.0;
  const BoundaryField field(uprightLine(100.25f), {203, 161}, fx);
  for (std::size_t level = 0; level < kScoreLevels; ++level) {
    for (const float d : {2.0f, 5.0f, 9.0f}) {
      EXPECT_NEAR(closenessAt(field, BoundaryField::kUpright, level, 100.25f + d, 80.0f),
                  closenessAt(field, BoundaryField::kUpright, level, 100.25f - d, 80.0f), 0.03)
          << level << ", " << d;
    }
  }
  EXPECT_LT(field.bytes(), 203u * 161u * 5u + 161u * sizeof(Border) + sizeof(BoundaryField) + 1000u);
}

// More borders than a 16-bit index can name.
TEST(BoundaryField, ManyBorders) {
  std::vector<Border> borders;
  for (int v = 0; v < 300; ++v) {
    for (int u = 0; u < 300; ++u) {
      Border border;
      border.u = static_cast<float>(u);
      border.v = static_cast<float>(v);
      border.pixel = {u, v};
      border.upright = true;
      borders.push_back(border);
    }
  }
  const BoundaryField field(borders, {300, 300}, 300.0);
  const BoundaryField::Line* nearest = nearestTo(field, BoundaryField::kUpright, 298.8f, 299.0f);
  ASSERT_NE(nearest, nullptr);
  EXPECT_EQ(nearest->u, 299.0f);
  EXPECT_EQ(nearest->v, 299.0f);
}

// Masks and classes that are the same thing tell everything about each other; shifted ones less, and masks
// that have nothing to do with the classes nothing.
TEST(RegionInformation, IsOneForTheSameAndNoneForUnrelatedRegions) {
  const auto frameWith = [](const cv::Mat& labels) {
    Intrinsics k;
    k.width = labels.cols;
    k.height = labels.rows;
    k.fx = k.fy = 100.0;
    k.cx = k.cy = 50.0;
    Frame frame{0.0, Camera(k), cv::Mat(), MaskSets::fromLayers({labels}), FramePoints(), {}};
    for (int v = 0; v < 100; v += 2) {
      for (int u = 0; u < 100; u += 2) {
        frame.points.x.push_back(0.1f * static_cast<float>(u - 50));
        frame.points.y.push_back(0.1f * static_cast<float>(v - 50));
        frame.points.z.push_back(10.0f);
        frame.points.segment.push_back(u < 50 ? LidarFeatures::kNoSegment : 0);
      }
    }
    frame.points.segment_count = 1;
    return frame;
  };
  std::vector<std::uint32_t> all(2500);
  std::iota(all.begin(), all.end(), 0u);
  const auto information = [&](const cv::Mat& labels) {
    std::size_t used = 0;
    const Frame frame = frameWith(labels);
    const Projection project(frame.camera.intrinsics(), Eigen::Isometry3d::Identity());
    const double result =
        RegionInformation()(frame.masks, ClassifiedPoints(frame.points, all), project, used);
    EXPECT_EQ(used, all.size());
    return result;
  };
  cv::Mat same = cv::Mat::zeros(100, 100, CV_32SC1), shifted = same.clone(), unrelated = same.clone();
  same.colRange(50, 100).setTo(7);
  shifted.colRange(60, 100).setTo(7);
  unrelated.rowRange(50, 100).setTo(7);
  EXPECT_NEAR(information(same), 1.0, 1e-9);
  EXPECT_GT(information(same), information(shifted) + 0.2);
  EXPECT_GT(information(shifted), information(unrelated) + 0.2);
  EXPECT_NEAR(information(unrelated), 0.0, 1e-9);
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

using EdgesEvaluator = ConsistencyEdgesEvaluator;

std::unique_ptr<EdgesEvaluator> evaluatorOf(const ConsistencyEdgesObjective& objective,
                                            const Frames& frames) {
  std::unique_ptr<Evaluator> evaluator = objective.evaluator(frames, {});
  return std::unique_ptr<EdgesEvaluator>(dynamic_cast<EdgesEvaluator*>(evaluator.release()));
}

/// Random edges around one straight border of each direction: then the nearest line never changes.
FramePtr frameWithTwoLines() {
  Intrinsics k;
  k.width = 200;
  k.height = 160;
  k.fx = k.fy = 300.0;
  k.cx = 100.0;
  k.cy = 80.0;
  std::vector<Border> borders = uprightLine(100.25f);
  for (int u = 0; u < 200; ++u) {
    Border border;
    border.u = static_cast<float>(u);
    border.v = 80.5f;
    border.nu = 0.0f;
    border.nv = 1.0f;
    border.pixel = {u, 81};
    border.level = true;
    borders.push_back(border);
  }
  auto frame = std::make_shared<Frame>(Frame{0.0, Camera(k), cv::Mat(), rectangle(), FramePoints(), {}});
  frame->borders = std::make_shared<const BoundaryField>(borders, cv::Size(200, 160), k.fx);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> place(-0.8f, 0.8f), depth(5.0f, 20.0f);
  for (int i = 0; i < 200; ++i) {
    frame->edges.x.push_back(place(random));
    frame->edges.y.push_back(place(random));
    frame->edges.z.push_back(depth(random));
    frame->edges.weight.push_back(0.5f);
    frame->edges.kind.push_back(i % 2 == 0 ? Kind::kAzimuthGap : Kind::kRingGap);
  }
  return frame;
}

TEST(ConsistencyEdgesEvaluator, GradientIsThatOfTheCost) {
  const auto edges = evaluatorOf(ConsistencyEdgesObjective{ObjectiveConfig()}, {frameWithTwoLines()});
  ASSERT_EQ(edges->edgeCount(), 200u);
  Vector6d offset;
  offset << 0.004, -0.003, 0.005, 0.02, 0.01, -0.03;
  const Eigen::Isometry3d T = exp(offset);
  const Linearisation here = edges->linearise(T, 0);
  ASSERT_GT(here.cost, 0.0);
  EXPECT_NEAR((here.H - here.H.transpose()).norm(), 0.0, 1e-9 * here.H.norm());
  for (int axis = 0; axis < 6; ++axis) {
    Vector6d xi = Vector6d::Zero();
    xi[axis] = axis < 3 ? 1e-4 : 1e-3;
    const double plus = edges->linearise(exp(xi) * T, 0).cost;
    const double minus = edges->linearise(exp(Vector6d(-xi)) * T, 0).cost;
    const double slope = (plus - minus) / (2.0 * xi[axis]);
    EXPECT_NEAR(2.0 * here.b[axis], slope, 0.02 * 2.0 * here.b.segment<3>(axis < 3 ? 0 : 3).norm()) << axis;
  }
}

TEST(ConsistencyEdgesObjective, HoldsNoFrameThatItsOwnersLetGo) {
  const ConsistencyEdgesObjective objective{ObjectiveConfig()};
  FramePtr frame = syntheticFrame(1, SyntheticScene::T_camera_lidar());
  const std::weak_ptr<const Frame> trace = frame;
  (*objective.evaluator({frame}, {}))(SyntheticScene::T_camera_lidar());
  frame.reset();
  EXPECT_TRUE(trace.expired());
}

TEST(ConsistencyEdgesObjective, ScoreIsHighestAtTheTruth) {
  const ConsistencyEdgesObjective objective{ObjectiveConfig()};
  const auto evaluator = evaluatorOf(objective, syntheticFrames(3, SyntheticScene::T_camera_lidar()));
  const Score score = (*evaluator)(SyntheticScene::T_camera_lidar());
  EXPECT_EQ(score.edges, evaluator->edgeScore(SyntheticScene::T_camera_lidar(), 2));
  EXPECT_GT(score.region, 0.1);
  EXPECT_DOUBLE_EQ(score.total, score.edges + score.region);
  EXPECT_GT(score.points, 100u);
  EXPECT_GT(score.masks, 10u);
  EXPECT_GE(validityIndex(*evaluator, SyntheticScene::T_camera_lidar()), 0.9);
}

TEST(ConsistencyEdgesObjective, TermsCanBeLeftOut) {
  const Frames frames = syntheticFrames(1, SyntheticScene::T_camera_lidar());
  const auto edgesWith = [&](double azimuth, double ring, double reflectivity) {
    ObjectiveConfig config;
    config.weight_azimuth_gap = azimuth;
    config.weight_ring_gap = ring;
    config.weight_reflectivity_step = reflectivity;
    return evaluatorOf(ConsistencyEdgesObjective(config), frames)->edgeCount();
  };
  const EdgePoints& edges = frames.front()->edges;
  const auto count = [&](Kind kind) {
    return static_cast<std::size_t>(std::count(edges.kind.begin(), edges.kind.end(), kind));
  };
  EXPECT_EQ(edgesWith(1, 0, 0), count(Kind::kAzimuthGap));
  EXPECT_EQ(edgesWith(0, 1, 0), count(Kind::kRingGap));
  EXPECT_EQ(edgesWith(0, 0, 1), count(Kind::kReflectivity));
  EXPECT_THROW(edgesWith(0, 0, 0), Error);
  EXPECT_THROW(edgesWith(-1, 1, 1), Error);
  ObjectiveConfig config;
  config.weight_region = 0.0;
  const Score score =
      (*evaluatorOf(ConsistencyEdgesObjective(config), frames))(SyntheticScene::T_camera_lidar());
  EXPECT_EQ(score.total, score.edges);
}

TEST(ConsistencyEdgesObjective, FramesMadeWithoutEdgesAreRefused) {
  FrameConfig config;
  config.edges = false;
  config.min_points = 200;
  config.min_masks = 2;
  const SyntheticScene scene(1);
  const FramePtr frame = makeFrame(1.0, SyntheticScene::camera(), scene.image(), {scene.labels()},
                                   scene.cloud(), SyntheticScene::T_camera_lidar(), config);
  EXPECT_EQ(frame->edges.size(), 0u);
  EXPECT_EQ(frame->borders, nullptr);
  EXPECT_THROW(ConsistencyEdgesObjective{ObjectiveConfig()}.evaluator({frame}, {}), Error);
  EXPECT_GT(memoryUse(*syntheticFrame(1, SyntheticScene::T_camera_lidar())), memoryUse(*frame)) << "counted";
}

TEST(ConsistencyEdgesEvaluator, ThinnedKeepsAnEvenShare) {
  const auto evaluator = evaluatorOf(ConsistencyEdgesObjective{ObjectiveConfig()},
                                     syntheticFrames(2, SyntheticScene::T_camera_lidar()));
  const EdgesEvaluator thin = evaluator->thinned(evaluator->edgeCount() / 4);
  EXPECT_NEAR(static_cast<double>(thin.edgeCount()), 0.25 * static_cast<double>(evaluator->edgeCount()), 2.0);
  EXPECT_EQ(evaluator->thinned(1000000).edgeCount(), evaluator->edgeCount());
  EXPECT_NEAR(thin.edgeScore(SyntheticScene::T_camera_lidar(), 0),
              evaluator->edgeScore(SyntheticScene::T_camera_lidar(), 0), 0.1);
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
  EXPECT_LT(error.angle() / kDegree, 0.12);
  EXPECT_LT(error.distance(), 0.04);
  EXPECT_TRUE(outcome.accepted) << outcome.reason;
}

TEST(CoarseToFineSearch, ResultDoesNotDependOnThreads) {
  const Frames frames = syntheticFrames(2, start());
  const ConsistencyEdgesObjective objective{ObjectiveConfig()};
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
  const ConsistencyEdgesObjective objective{ObjectiveConfig()};
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
  const ConsistencyEdgesObjective edges{ObjectiveConfig()};
  const Frames frames = syntheticFrames(1, start());
  EXPECT_THROW(search.run(edges, {}, start(), SearchRange(), nullptr), Error);
  try {
    ObjectiveConfig paper;
    paper.objective = "paper";
    search.run(*makeObjective(paper), frames, start(), SearchRange(), nullptr);
    ADD_FAILURE() << "took objective paper";
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kParameter);
    EXPECT_NE(std::string(error.what()).find("edges"), std::string::npos);
  }
  try {
    Frame without = *frames.front();
    without.edges = EdgePoints();
    search.run(edges, {std::make_shared<const Frame>(without)}, start(), SearchRange(), nullptr);
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

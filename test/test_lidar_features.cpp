#include "lidar_camera_recalibration/lidar_features.hpp"

#include <gtest/gtest.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <fstream>
#include <map>
#include <numeric>
#include <random>
#include <set>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

using Points = std::vector<Eigen::Vector3f>;
constexpr std::int32_t kNone = LidarFeatures::kNoSegment;

// A grid of points from `corner` along the two edges.
void addRectangle(Points& points, const Eigen::Vector3f& corner, const Eigen::Vector3f& edge_a,
                  const Eigen::Vector3f& edge_b, float step) {
  const int count_a = static_cast<int>(edge_a.norm() / step);
  const int count_b = static_cast<int>(edge_b.norm() / step);
  for (int a = 0; a <= count_a; ++a) {
    for (int b = 0; b <= count_b; ++b) {
      points.push_back(corner + edge_a * (static_cast<float>(a) / count_a) +
                       edge_b * (static_cast<float>(b) / count_b));
    }
  }
}

// The faces of an axis-parallel box that a LiDAR at the origin sees: front and top.
void addBox(Points& points, const Eigen::Vector3f& lowest, const Eigen::Vector3f& size, float step) {
  const Eigen::Vector3f y(0, size.y(), 0), z(0, 0, size.z()), x(size.x(), 0, 0);
  addRectangle(points, lowest, y, z, step);
  addRectangle(points, lowest + z, x, y, step);
}

// Ground 1.7 m below the sensor.
void addGround(Points& points, float step = 0.15f) {
  addRectangle(points, {3, -8, -1.7f}, {16, 0, 0}, {0, 16, 0}, step);
}

Points randomPoints(int count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> x(-20, 20);
  Points points;
  for (int i = 0; i < count; ++i) points.emplace_back(x(random), x(random), x(random));
  return points;
}

// The partition without its numbering: which points share a class, and which have none.
std::set<std::set<std::size_t>> partition(const std::vector<std::int32_t>& segments,
                                          const std::vector<std::size_t>& original) {
  std::map<std::int32_t, std::set<std::size_t>> groups;
  for (std::size_t i = 0; i < segments.size(); ++i) groups[segments[i]].insert(original[i]);
  std::set<std::set<std::size_t>> result;
  for (auto& group : groups) result.insert(std::move(group.second));
  return result;
}

std::vector<std::size_t> identity(std::size_t size) {
  std::vector<std::size_t> indices(size);
  std::iota(indices.begin(), indices.end(), std::size_t{0});
  return indices;
}

LidarFeatures segmented(const Points& points, const LidarFeatureConfig& config) {
  LidarFeatures features;
  segment(points, config, features);
  return features;
}

LidarFeatureConfig onlyClusters() {
  LidarFeatureConfig config;
  config.plane_max_count = 0;
  return config;
}

std::vector<std::int32_t> classesOf(const LidarFeatures& features, std::size_t begin, std::size_t end) {
  std::set<std::int32_t> found(features.segment.begin() + begin, features.segment.begin() + end);
  return {found.begin(), found.end()};
}

TEST(Normals, TiltedPlaneFarFromTheOrigin) {
  const Eigen::Vector3f normal = Eigen::Vector3f(-0.6f, 0.48f, 0.64f);  // a unit vector
  const Eigen::Vector3f a = normal.unitOrthogonal(), b = normal.cross(a);
  Points points;
  addRectangle(points, Eigen::Vector3f(80, -40, 5), a * 4, b * 4, 0.2f);
  const float side = normal.dot(points.front()) > 0 ? -1.0f : 1.0f;
  for (const auto& n : estimateNormals(points, 30)) EXPECT_NEAR(n.dot(side * normal), 1.0f, 1e-5f);
}

TEST(Normals, SphereSeenFromOutside) {
  const Eigen::Vector3f centre(12, 3, 1);
  constexpr int kCount = 4000;
  Points points;
  for (int i = 0; i < kCount; ++i) {  // Fibonacci sphere of radius 2
    const double z = 1.0 - (2.0 * i + 1.0) / kCount, phi = i * 2.399963229728653;
    const double r = std::sqrt(1.0 - z * z);
    points.push_back(centre + 2.0f * Eigen::Vector3d(r * std::cos(phi), r * std::sin(phi), z).cast<float>());
  }
  const auto normals = estimateNormals(points, 12);
  for (int i = 0; i < kCount; ++i) {
    const Eigen::Vector3f radial = (points[i] - centre) / 2.0f;
    EXPECT_GT(std::abs(normals[i].dot(radial)), 0.998f);
    EXPECT_LE(normals[i].dot(points[i]), 0.0f);  // facing the sensor, also on the far side
  }
}

TEST(Normals, FacesOfACornerKeepTheirDirections) {
  Points points;
  addRectangle(points, {5, -2, -1}, {0, 4, 0}, {0, 0, 2}, 0.1f);  // faces -x
  const std::size_t wall = points.size();
  addRectangle(points, {2, -2, -1.05f}, {2.9f, 0, 0}, {0, 4, 0}, 0.1f);  // faces +z
  const auto normals = estimateNormals(points, 9);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const bool near_edge = i < wall ? points[i].z() < -0.7f : points[i].x() > 4.6f;
    if (near_edge) continue;
    const Eigen::Vector3f expected = i < wall ? Eigen::Vector3f(-1, 0, 0) : Eigen::Vector3f(0, 0, 1);
    EXPECT_GT(normals[i].dot(expected), 0.99999f) << points[i].transpose();
  }
}

// Against a fit to neighbours that are found by sorting all points.
void expectNormalsOfNearest(const Points& points, int neighbours) {
  const auto normals = estimateNormals(points, neighbours);
  for (std::size_t i = 0; i < points.size(); ++i) {
    auto nearest = identity(points.size());
    std::sort(nearest.begin(), nearest.end(), [&](std::size_t a, std::size_t b) {
      return (points[a] - points[i]).squaredNorm() < (points[b] - points[i]).squaredNorm();
    });
    Eigen::MatrixXd rows(neighbours, 3);
    for (int k = 0; k < neighbours; ++k) rows.row(k) = points[nearest[k]].cast<double>();
    rows.rowwise() -= rows.colwise().mean().eval();
    const Eigen::JacobiSVD<Eigen::MatrixXd> svd(rows, Eigen::ComputeFullV);
    const Eigen::Vector3d expected = svd.matrixV().col(2);
    EXPECT_NEAR(std::abs(normals[i].cast<double>().dot(expected)), 1.0, 1e-5);
    EXPECT_NEAR(normals[i].norm(), 1.0f, 1e-5f);
    EXPECT_LE(normals[i].dot(points[i]), 0.0f);
  }
}

TEST(Normals, AgreeWithABruteForceFit) {
  expectNormalsOfNearest(randomPoints(400, 3), 10);
  // Most points far apart, some close together and far from the origin.
  Points points = randomPoints(500, 4);
  for (const auto& p : randomPoints(300, 5)) points.push_back(Eigen::Vector3f(60, -40, 3) + 0.02f * p);
  expectNormalsOfNearest(points, 30);
}

TEST(Normals, AreZeroWhereNoPlaneFits) {
  const Eigen::Vector3f zero = Eigen::Vector3f::Zero();
  EXPECT_TRUE(estimateNormals({}, 30).empty());
  EXPECT_EQ(estimateNormals({{1, 2, 3}, {4, 5, 6}}, 30), Points(2, zero));
  EXPECT_EQ(estimateNormals(Points(40, {1, 2, 3}), 30), Points(40, zero));
  Points line;
  for (int i = 0; i < 50; ++i) line.emplace_back(5 + 0.1f * i, 3 - 0.2f * i, 1);
  EXPECT_EQ(estimateNormals(line, 30), Points(50, zero));
  // Fewer points than neighbours asked for are still a plane.
  EXPECT_NEAR(estimateNormals({{5, 0, 0}, {5, 1, 0}, {5, 0, 1}}, 30)[0].x(), -1.0f, 1e-6f);
}

// 30 neighbours lie on one ring, which with its noise fits planes of any tilt around it.
TEST(Normals, GroundInRingsFarApart) {
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0.0f, 0.01f);
  Points points;
  for (const float radius : {5.0f, 5.6f, 6.3f, 7.0f}) {
    for (float azimuth = -0.5f; azimuth < 0.5f; azimuth += 0.0035f) {
      const float r = radius + noise(random);
      points.emplace_back(r * std::cos(azimuth), r * std::sin(azimuth), -1.7f + noise(random));
    }
  }
  int up = 0;
  for (const auto& n : estimateNormals(points, 30)) up += n.z() > 0.98f;
  EXPECT_GT(up, 0.97 * static_cast<double>(points.size()));
}

TEST(Reflectivity, OneRetroReflectorDoesNotFlattenTheRest) {
  std::vector<float> values(1000);
  for (int i = 0; i < 1000; ++i) values[i] = static_cast<float>(i % 100);  // 0..99
  values[500] = 1e6f;
  const auto scaled = normaliseReflectivity(values, 0.99);
  // Sorted, index round(0.99 * 999) = 989 holds 99 (ten values of each number, one of them replaced).
  EXPECT_FLOAT_EQ(scaled[50], 50.0f / 99.0f);
  EXPECT_FLOAT_EQ(scaled[99], 1.0f);
  EXPECT_FLOAT_EQ(scaled[500], 1.0f);
  EXPECT_FLOAT_EQ(scaled[0], 0.0f);
}

TEST(Reflectivity, OddInput) {
  EXPECT_TRUE(normaliseReflectivity({}, 0.99).empty());
  EXPECT_EQ(normaliseReflectivity({0, 0, 0}, 0.99), std::vector<float>({0, 0, 0}));
  EXPECT_EQ(normaliseReflectivity({7, 7, 7}, 0.99), std::vector<float>({1, 1, 1}));
  std::vector<float> nearly_black(1000, 0.0f);
  nearly_black[3] = 8.0f;
  nearly_black[4] = 2.0f;
  const auto scaled = normaliseReflectivity(nearly_black, 0.99);
  EXPECT_FLOAT_EQ(scaled[3], 1.0f);
  EXPECT_FLOAT_EQ(scaled[4], 0.25f);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(normaliseReflectivity({nan, -5, 4, 2}, 1.0), std::vector<float>({0, 0, 1, 0.5f}));
}

TEST(Segment, GroundWallAndBoxes) {
  Points points;
  const std::size_t box_begin = 0;
  addBox(points, {6, -3, -1.3f}, {1.5f, 1.5f, 1.2f}, 0.1f);
  const std::size_t small_begin = points.size();
  addBox(points, {9, 2, -1.3f}, {0.6f, 0.6f, 0.6f}, 0.1f);
  const std::size_t ground_begin = points.size();
  addGround(points);
  const std::size_t wall_begin = points.size();
  addRectangle(points, {19.5f, -8, -1.3f}, {0, 16, 0}, {0, 0, 5}, 0.15f);
  const std::size_t lone = points.size();
  for (int i = 0; i < 5; ++i) points.emplace_back(15 + 0.05f * i, 0, 6);

  const LidarFeatures features = segmented(points, LidarFeatureConfig{});
  EXPECT_EQ(features.plane_count, 2);
  EXPECT_EQ(features.segment_count, 4);
  EXPECT_EQ(classesOf(features, ground_begin, wall_begin),
            std::vector<std::int32_t>({0}));  // the most points
  EXPECT_EQ(classesOf(features, wall_begin, lone), std::vector<std::int32_t>({1}));
  EXPECT_EQ(classesOf(features, box_begin, small_begin), std::vector<std::int32_t>({2}));
  EXPECT_EQ(classesOf(features, small_begin, ground_begin), std::vector<std::int32_t>({3}));
  EXPECT_EQ(classesOf(features, lone, points.size()),
            std::vector<std::int32_t>({kNone}));  // below cluster_min_points
}

TEST(Segment, ClustersEvenIfNoPlaneIsLargeEnough) {
  Points points;
  addBox(points, {6, -3, -1.3f}, {1.5f, 1.5f, 1.2f}, 0.1f);
  const std::size_t second = points.size();
  addBox(points, {9, 2, -1.3f}, {0.6f, 0.6f, 0.6f}, 0.1f);
  const LidarFeatures features = segmented(points, LidarFeatureConfig{});
  EXPECT_EQ(features.plane_count, 0);
  EXPECT_EQ(features.segment_count, 2);
  EXPECT_EQ(classesOf(features, 0, second), std::vector<std::int32_t>({0}));
  EXPECT_EQ(classesOf(features, second, points.size()), std::vector<std::int32_t>({1}));
}

TEST(Segment, PlaneThresholdCountsPoints) {
  Points points;
  addRectangle(points, {10, -2, -1}, {0, 4, 0}, {0, 0, 2}, 0.1f);  // 41 x 21 = 861 points
  LidarFeatureConfig config;
  config.plane_min_points = 861;
  EXPECT_EQ(segmented(points, config).plane_count, 1);
  config.plane_min_points = 862;
  EXPECT_EQ(segmented(points, config).plane_count, 0);
  EXPECT_EQ(segmented(points, config).segment_count, 1);
}

TEST(Segment, NoLevelSlabThroughUprightThings) {
  // Thin posts everywhere: any level slab holds far more points than plane_min_points, yet there is no such
  // surface.
  Points points;
  for (int post = 0; post < 60; ++post) {
    const float angle = -1.0f + post / 30.0f, range = 8.0f + static_cast<float>(post * 7 % 13);
    for (int k = 0; k < 16; ++k) {
      const float turn = static_cast<float>(k) * 0.3927f;
      for (int h = 0; h < 40; ++h) {
        points.emplace_back(range * std::cos(angle) + 0.3f * std::cos(turn),
                            range * std::sin(angle) + 0.3f * std::sin(turn),
                            -1.0f + 0.05f * static_cast<float>(h));
      }
    }
  }
  const auto in_slab = std::count_if(points.begin(), points.end(), [](const Eigen::Vector3f& p) {
    return std::abs(p.z()) <= LidarFeatureConfig{}.plane_distance;
  });
  ASSERT_GT(in_slab, LidarFeatureConfig{}.plane_min_points);
  EXPECT_EQ(segmented(points, LidarFeatureConfig{}).plane_count, 0);
}

// Upward normals, each off by the angle of this slope into a random direction.
Points coarseNormals(std::size_t count, float slope) {
  std::mt19937 random(2);
  std::uniform_real_distribution<float> turn(0.0f, 6.2832f);
  Points normals;
  for (std::size_t i = 0; i < count; ++i) {
    const float phi = turn(random);
    normals.push_back(Eigen::Vector3f(slope * std::cos(phi), slope * std::sin(phi), 1.0f).normalized());
  }
  return normals;
}

// No single normal is good enough for a street of 80 m, all of them are off by 10 deg.
TEST(Segment, CoarseNormalsStillGiveTheWholePlane) {
  Points points;
  addRectangle(points, {2, -10, -1.7f}, {80, 0, 0}, {0, 20, 0}, 0.4f);
  LidarFeatures features;
  features.normals = coarseNormals(points.size(), 0.1763f);
  segment(points, LidarFeatureConfig{}, features);
  EXPECT_EQ(features.plane_count, 1);
  EXPECT_EQ(classesOf(features, 0, points.size()), std::vector<std::int32_t>({0}));
}

// A plane between their heights holds more points within plane_distance than either.
TEST(Segment, RoadAndPavementsAreTwoPlanes) {
  Points points;
  addRectangle(points, {4, -4, -1.7f}, {20, 0, 0}, {0, 8, 0}, 0.1f);
  const std::size_t pavement = points.size();
  addRectangle(points, {4, 4.2f, -1.42f}, {20, 0, 0}, {0, 2.5f, 0}, 0.1f);
  addRectangle(points, {4, -6.7f, -1.42f}, {20, 0, 0}, {0, 2.5f, 0}, 0.1f);
  LidarFeatures features;
  features.normals = coarseNormals(points.size(), 0.02f);
  segment(points, LidarFeatureConfig{}, features);
  EXPECT_EQ(features.plane_count, 2);
  const auto share = [&](std::size_t begin, std::size_t end, std::int32_t id) {
    const auto first = features.segment.begin();
    return static_cast<double>(std::count(first + begin, first + end, id)) / static_cast<double>(end - begin);
  };
  EXPECT_GT(share(0, pavement, 0), 0.98);
  EXPECT_GT(share(pavement, points.size(), 1), 0.98);
}

TEST(Segment, OnlyAgreeingNormalsSupportAPlane) {
  Points points;
  addRectangle(points, {10, -5, -1}, {0, 10, 0}, {0, 0, 4}, 0.1f);
  const auto planesWith = [&](const std::vector<Eigen::Vector3f>& turns) {
    LidarFeatures features;
    for (std::size_t i = 0; i < points.size(); ++i) features.normals.push_back(turns[i % turns.size()]);
    segment(points, LidarFeatureConfig{}, features);
    return features.plane_count;
  };
  const auto turned = [](float degrees) {
    const float angle = degrees * 0.0174533f;
    return Eigen::Vector3f(-std::cos(angle), std::sin(angle), 0);
  };
  EXPECT_EQ(planesWith({turned(15)}), 1);
  EXPECT_EQ(planesWith({turned(15), -turned(15)}), 1);  // either side
  EXPECT_EQ(planesWith({turned(90)}), 0);
  EXPECT_EQ(planesWith({Eigen::Vector3f::Zero()}), 0);
}

TEST(Segment, PlaneOfFewPointsAmongClutter) {
  Points points;
  addRectangle(points, {20, -5, -1}, {0, 10, 0}, {0, 0, 5}, 0.15f);  // 2211 points, 7 % of all
  const std::size_t clutter = points.size();
  std::mt19937 random(4);
  std::uniform_real_distribution<float> place(-15.0f, 15.0f);
  std::normal_distribution<float> side;
  LidarFeatures features;
  features.normals.assign(clutter, -Eigen::Vector3f::UnitX());
  for (int i = 0; i < 30000; ++i) {
    points.emplace_back(20 + place(random), place(random), place(random));
    features.normals.push_back(Eigen::Vector3f(side(random), side(random), side(random)).normalized());
  }
  segment(points, LidarFeatureConfig{}, features);
  EXPECT_EQ(features.plane_count, 1);
  EXPECT_EQ(classesOf(features, 0, clutter), std::vector<std::int32_t>({0}));
}

TEST(Segment, ToleranceGrowsWithRange) {
  // Two pairs of small boards, 0.5 m apart. At 10 m the tolerance is 0.3 m, at 50 m it is 0.75 m.
  const auto addPair = [](Points& points, float x) {
    addRectangle(points, {x, 0, 0}, {0, 1, 0}, {0, 0, 1}, 0.2f);
    addRectangle(points, {x, 1.5f, 0}, {0, 1, 0}, {0, 0, 1}, 0.2f);
  };
  Points near, far;
  addPair(near, 10);
  addPair(far, 50);
  EXPECT_EQ(segmented(near, onlyClusters()).segment_count, 2);
  EXPECT_EQ(segmented(far, onlyClusters()).segment_count, 1);
}

// A line of single points whose gaps equal the tolerance only for the farther point of each pair: the smaller
// range decides, from whichever end the search starts.
TEST(Segment, JoiningIsSymmetric) {
  LidarFeatureConfig config = onlyClusters();
  config.cluster_tolerance = 0.1;
  config.cluster_tolerance_slope = 0.1;
  config.cluster_min_points = 1;
  const Points apart{{10, 0, 0}, {11.05f, 0, 0}};     // gap 1.05 > 0.1 * 10
  const Points together{{10, 0, 0}, {10.95f, 0, 0}};  // gap 0.95 < 0.1 * 10
  for (const bool reverse : {false, true}) {
    for (const Points* pair : {&apart, &together}) {
      Points points = *pair;
      if (reverse) std::reverse(points.begin(), points.end());
      EXPECT_EQ(segmented(points, config).segment_count, pair == &apart ? 2 : 1);
    }
  }
}

// Components of the joining relation found by a naive O(n^3) closure.
TEST(Segment, ClustersAgreeWithANaiveClosure) {
  LidarFeatureConfig config = onlyClusters();
  config.cluster_tolerance = 1.0;
  config.cluster_tolerance_slope = 0.15;
  config.cluster_min_points = 3;
  const Points points = randomPoints(500, 11);
  std::vector<std::size_t> label = identity(points.size());
  for (bool changed = true; changed;) {
    changed = false;
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (std::size_t j = 0; j < points.size(); ++j) {
        const double limit = std::max(1.0, 0.15 * std::min(points[i].norm(), points[j].norm()));
        if (label[j] >= label[i] || (points[i] - points[j]).norm() > limit) continue;
        label[i] = label[j];
        changed = true;
      }
    }
  }
  std::map<std::size_t, int> sizes;
  for (const std::size_t l : label) ++sizes[l];
  std::vector<std::int32_t> expected;
  for (const std::size_t l : label) expected.push_back(sizes[l] < 3 ? kNone : static_cast<std::int32_t>(l));
  const LidarFeatures features = segmented(points, config);
  ASSERT_GT(features.segment_count, 10);
  EXPECT_EQ(partition(features.segment, identity(points.size())),
            partition(expected, identity(points.size())));
}

TEST(Segment, DoesNotDependOnTheOrderOfThePoints) {
  Points points;
  addGround(points);
  addRectangle(points, {19.5f, -8, -1.3f}, {0, 16, 0}, {0, 0, 5}, 0.15f);
  addBox(points, {6, -3, -1.3f}, {1.5f, 1.5f, 1.2f}, 0.1f);
  addBox(points, {9, 2, -1.3f}, {0.6f, 0.6f, 0.6f}, 0.1f);
  const LidarFeatures features = segmented(points, LidarFeatureConfig{});
  ASSERT_EQ(features.segment_count, 4);

  auto order = identity(points.size());
  std::shuffle(order.begin(), order.end(), std::mt19937(5));
  Points shuffled;
  for (const std::size_t i : order) shuffled.push_back(points[i]);
  EXPECT_EQ(partition(segmented(shuffled, LidarFeatureConfig{}).segment, order),
            partition(features.segment, identity(points.size())));
}

TEST(Features, EmptyAndInconsistentClouds) {
  try {
    computeLidarFeatures(PointCloud{}, LidarFeatureConfig{});
    FAIL() << "an empty cloud was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kCloud);
    EXPECT_NE(std::string(error.what()).find("empty"), std::string::npos);
  }
  PointCloud cloud;
  cloud.points = {{1, 2, 3}, {2, 3, 4}};
  cloud.reflectivity = {1};
  EXPECT_THROW(computeLidarFeatures(cloud, LidarFeatureConfig{}), Error);
}

TEST(Features, ColumnsAreAsLongAsTheCloud) {
  PointCloud cloud;
  cloud.points = randomPoints(50, 1);
  LidarFeatures features = computeLidarFeatures(cloud, LidarFeatureConfig{});
  EXPECT_EQ(features.normals.size(), 50u);
  EXPECT_EQ(features.segment.size(), 50u);
  EXPECT_TRUE(features.reflectivity.empty());
  cloud.reflectivity.assign(50, 3.0f);
  features = computeLidarFeatures(cloud, LidarFeatureConfig{});
  EXPECT_EQ(features.reflectivity, std::vector<float>(50, 1.0f));
}

TEST(Features, RealStreet) {
  const std::string file = SHARED_DATA "/kitti_00/pc/000000.pcd";
  if (!std::ifstream(file)) GTEST_SKIP() << "no real data: " << file << " is not there";
  pcl::PointCloud<pcl::PointXYZI> raw;
  ASSERT_EQ(pcl::io::loadPCDFile(file, raw), 0);
  PointCloud cloud;
  for (const auto& p : raw) {  // a 90 deg sector ahead
    if (p.x < std::abs(p.y) || p.x < 2.0f) continue;
    cloud.points.emplace_back(p.x, p.y, p.z);
    cloud.reflectivity.push_back(p.intensity);
  }
  const LidarFeatures features = computeLidarFeatures(cloud, LidarFeatureConfig{});
  ASSERT_GE(features.plane_count, 1);
  EXPECT_GT(features.segment_count - features.plane_count, 10);

  // The largest plane is the road, 1.73 m below the sensor.
  Eigen::Vector3f mean_normal = Eigen::Vector3f::Zero();
  int ground = 0, near_ground = 0, upright = 0;
  double height = 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    EXPECT_GE(features.reflectivity[i], 0.0f);
    EXPECT_LE(features.reflectivity[i], 1.0f);
    if (features.segment[i] != 0) continue;
    mean_normal += features.normals[i];
    ++ground;
    if (cloud.points[i].norm() > 20.0f) continue;
    ++near_ground;
    height += cloud.points[i].z();
    upright += features.normals[i].z() > 0.9f;
  }
  EXPECT_GT(ground, 0.3 * static_cast<double>(cloud.size()));
  EXPECT_NEAR(height / near_ground, -1.73, 0.15);
  EXPECT_GT(mean_normal.normalized().z(), 0.99f);
  EXPECT_GT(upright, 0.85 * near_ground);

  const LidarFeatures again = computeLidarFeatures(cloud, LidarFeatureConfig{});
  EXPECT_EQ(again.segment, features.segment);
  EXPECT_EQ(again.normals, features.normals);
}

}  // namespace
}  // namespace lidar_camera_recalibration

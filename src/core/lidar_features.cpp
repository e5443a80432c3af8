#include "lidar_camera_recalibration/lidar_features.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "clusters.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "planes.hpp"

namespace lidar_camera_recalibration {
namespace {

using Indices = std::vector<int>;

void numberBySize(std::vector<Indices> groups, LidarFeatures& features) {
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Indices& a, const Indices& b) { return a.size() > b.size(); });
  for (const Indices& group : groups) {
    for (const int i : group) features.segment[i] = features.segment_count;
    ++features.segment_count;
  }
}

}  // namespace

std::vector<float> normaliseReflectivity(const std::vector<float>& reflectivity, double quantile) {
  if (reflectivity.empty()) return {};
  std::vector<float> result(reflectivity);
  for (float& r : result) r = std::isfinite(r) ? std::max(r, 0.0f) : 0.0f;

  std::vector<float> sorted(result);
  const double rank = std::min(std::max(quantile, 0.0), 1.0) * static_cast<double>(sorted.size() - 1);
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(std::lround(rank));
  std::nth_element(sorted.begin(), nth, sorted.end());
  // Nearly all points may be black; then the largest value is the only scale there is.
  const float scale = *nth > 0.0f ? *nth : *std::max_element(nth, sorted.end());
  if (scale == 0.0f) return result;
  for (float& r : result) r = std::min(r / scale, 1.0f);
  return result;
}

void segment(const std::vector<Eigen::Vector3f>& points, const LidarFeatureConfig& config,
             LidarFeatures& features) {
  features.segment.assign(points.size(), LidarFeatures::kNoSegment);
  features.plane_count = 0;
  features.segment_count = 0;
  if (features.normals.size() != points.size()) {
    features.normals = estimateNormals(points, config.normal_neighbours);
  }
  Indices remaining(points.size());
  std::iota(remaining.begin(), remaining.end(), 0);

  numberBySize(takePlanes(points, features.normals, config, remaining), features);
  features.plane_count = features.segment_count;
  numberBySize(findClusters(points, config, remaining), features);
}

void checkCloud(const PointCloud& cloud) {
  if (cloud.points.empty()) {
    throw Error(ErrorCause::kCloud,
                "The point cloud is empty: check that the LiDAR driver publishes points.");
  }
  if (cloud.hasReflectivity() && cloud.reflectivity.size() != cloud.size()) {
    throw Error(ErrorCause::kCloud, "The point cloud has " + std::to_string(cloud.size()) + " points but " +
                                        std::to_string(cloud.reflectivity.size()) +
                                        " reflectivity values: give one for each point, or none.");
  }
}

LidarFeatures computeLidarFeatures(const PointCloud& cloud, const LidarFeatureConfig& config) {
  checkCloud(cloud);
  LidarFeatures features;
  features.normals = estimateNormals(cloud.points, config.normal_neighbours);
  features.reflectivity = normaliseReflectivity(cloud.reflectivity, config.reflectivity_quantile);
  segment(cloud.points, config, features);
  return features;
}

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Preparation of a cloud, paper section III-B ("Data Preprocessing").
struct LidarFeatureConfig {
  int normal_neighbours = 30;              ///< k of the k-NN plane fit, the point itself included
  double reflectivity_quantile = 0.99;     ///< this quantile becomes 1, all above is clamped to 1
  double plane_distance = 0.15;            ///< RANSAC inlier distance [m]
  int plane_min_points = 1500;             ///< a plane needs so many inliers whose normals agree
  int plane_max_count = 8;                 ///< stop after so many planes
  double cluster_tolerance = 0.3;          ///< smallest gap between two clusters [m] ...
  double cluster_tolerance_slope = 0.015;  ///< ... growing with range: max(tolerance, slope * range) [m/m]
  int cluster_min_points = 10;             ///< smaller groups stay without a class
};

/// Attributes of each point: p = {x, y, z, n, r, c}, paper eq. (1). All columns are as long as the cloud.
struct LidarFeatures {
  static constexpr std::int32_t kNoSegment = -1;

  /// Unit vectors facing the sensor; zero where no plane fits (fewer than 3 points, or all on a line).
  std::vector<Eigen::Vector3f> normals;
  std::vector<float> reflectivity;  ///< 0..1; empty if the cloud has none
  /// Class id 0..segment_count-1 (planes first), kNoSegment for isolated points.
  std::vector<std::int32_t> segment;
  std::int32_t plane_count = 0;
  std::int32_t segment_count = 0;
};

/// k-NN PCA normals, oriented towards the sensor at the origin. Where the neighbours form a line, as those of
/// one ring of a sparse LiDAR do, up to four times as many are taken.
std::vector<Eigen::Vector3f> estimateNormals(const std::vector<Eigen::Vector3f>& points, int neighbours);

/// Scales reflectivity by one factor, a high quantile instead of the maximum: a single retro-reflector must
/// not flatten the rest.
std::vector<float> normaliseReflectivity(const std::vector<float>& reflectivity, double quantile);

/// Large planes by RANSAC, then Euclidean clusters of *all* remaining points.
/// Points support a plane if their normals agree with it; features.normals are estimated if they are not
/// there yet. Deterministic. Planes are numbered first, in the order of their size.
void segment(const std::vector<Eigen::Vector3f>& points, const LidarFeatureConfig& config,
             LidarFeatures& features);

/// @throw Error(kCloud) if the cloud is empty or has another number of reflectivity values than of points.
void checkCloud(const PointCloud& cloud);

/// All of the above.
LidarFeatures computeLidarFeatures(const PointCloud& cloud, const LidarFeatureConfig& config);

}  // namespace lidar_camera_recalibration

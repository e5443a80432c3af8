#pragma once

#include <Eigen/Core>
#include <vector>

#include "lidar_camera_recalibration/lidar_features.hpp"

namespace lidar_camera_recalibration {

/// Connected components of the graph that joins p and q if |p - q| <= max(tolerance, slope * min(range_p,
/// range_q)). The smaller range makes the relation symmetric, so the components do not depend on the order of
/// the points. Components below cluster_min_points are left out.
/// @return indices into `points`, ascending
std::vector<std::vector<int>> findClusters(const std::vector<Eigen::Vector3f>& points,
                                           const LidarFeatureConfig& config, const std::vector<int>& members);

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"
#include "lidar_camera_recalibration/lidar_features.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Which laser each point of a whole cloud is from: the cloud's own column if it tells at least four apart,
/// else the turns of the azimuth where the points come ring by ring (KITTI), else the steps of the elevation.
/// The numbers follow no order. Empty if no rings can be told apart.
std::vector<std::uint16_t> ringsOf(const PointCloud& cloud);

/// Places where a camera should see an edge, each a point on the *nearer* side, so that nothing hides it:
/// steps of the range along a ring and from ring to ring, and steps of the reflectivity along a ring.
/// @param cloud     with rings; without, there are no edges
/// @param features  of the same cloud
/// @param visible   edges of points with flag 0 are left out; empty: all are visible
EdgePoints findLidarEdges(const PointCloud& cloud, const LidarFeatures& features,
                          const std::vector<std::uint8_t>& visible);

}  // namespace lidar_camera_recalibration

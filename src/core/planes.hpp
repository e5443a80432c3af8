#pragma once

#include <Eigen/Core>
#include <vector>

#include "lidar_camera_recalibration/lidar_features.hpp"

namespace lidar_camera_recalibration {

/// Takes planes out of `remaining`, each with all points near it, whatever their normals: where the plane is
/// sampled thinly or ends, normals are poor.
std::vector<std::vector<int>> takePlanes(const std::vector<Eigen::Vector3f>& points,
                                         const std::vector<Eigen::Vector3f>& normals,
                                         const LidarFeatureConfig& config, std::vector<int>& remaining);

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace lidar_camera_recalibration {

/// A cloud as a sensor delivers it, in the LiDAR frame; only finite points away from the origin.
/// The optional columns are either empty or as long as `points`.
struct PointCloud {
  std::vector<Eigen::Vector3f> points;  ///< [m]
  std::vector<float> reflectivity;      ///< in the sensor's own unit; empty if the sensor gives none
  std::vector<std::uint16_t> ring;      ///< index of the laser; empty if unknown
  std::vector<float> time;  ///< when it was taken, after the stamp of the cloud [s]; empty if unknown

  std::size_t size() const { return points.size(); }
  bool hasReflectivity() const { return !reflectivity.empty(); }
};

}  // namespace lidar_camera_recalibration

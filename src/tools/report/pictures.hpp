#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// A frame before and after, as sources of <img>.
struct BeforeAfter {
  double stamp = 0.0;            ///< of the image [s]
  double near = 0.0, far = 0.0;  ///< depth of the LiDAR edges in a zoom [m]
  std::string before, after;
};

/// Points over the whole image of up to `count` frames, spread over the drive. Frames without image are left
/// out.
std::vector<BeforeAfter> overlays(const Frames& frames, const Eigen::Isometry3d& start,
                                  const Eigen::Isometry3d& result, std::size_t count);

/// Magnified places with many LiDAR edges, drawn as the search takes them: half of them near, half of them
/// far. None if the frames have no edges.
std::vector<BeforeAfter> zooms(const Frames& frames, const Eigen::Isometry3d& start,
                               const Eigen::Isometry3d& result, std::size_t count);

/// The depth's colours as a CSS gradient, logarithmic from 2.5 to 80 m.
std::string depthGradient();

}  // namespace lidar_camera_recalibration

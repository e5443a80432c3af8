#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// What masks and classes of LiDAR points tell about each other: NMI = I(mask; class) / H(mask, class) over
/// the points in the image, 0 = nothing, 1 = each determines the other. The paper's idea, that points in one
/// mask agree in their class, counted in both directions: one mask around everything is as useless as a mask
/// for each point.
///
/// Wide and smooth, but not sharp: it tells good optima of the edges from bad ones.
/// @param points  of frame.points, to be counted
/// @param used    grows by the number of points in the image
double regionInformation(const Frame& frame, const std::vector<std::uint32_t>& points,
                         const Eigen::Isometry3d& T_camera_lidar, std::size_t& used);

}  // namespace lidar_camera_recalibration

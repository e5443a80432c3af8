#pragma once

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// Lowers the weights of edges in a crowd. Edges within half a degree of each other mostly lie on one border
/// and share its error, be it that of the mask, of the snapping or of the surface's rounding: the mean of n
/// of them has a variance of about s^2 (1 / n + share), not s^2 / n, and is worth n / (1 + share n) single
/// ones. Directions are seen from the LiDAR; kinds of edges do not crowd each other.
void shareWeights(EdgePoints& edges);

}  // namespace lidar_camera_recalibration

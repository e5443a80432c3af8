#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "simulation/camera_sensor.hpp"
#include "simulation/mesh.hpp"

namespace lidar_camera_recalibration::simulation {

/// How far masks are from the exact parts; the defaults imitate Segment Anything.
struct MaskConfig {
  double border_sigma = 1.4;       ///< displacement of the borders along each image axis [px]
  double border_smoothness = 7.0;  ///< distance over which it changes [px]
  int min_region = 100;            ///< smaller regions get no mask [px]
  int min_masks = 60;              ///< large regions are split until there are so many
  int max_masks = 110;    ///< per picture a limit between 3/4 of it and it; the smallest are left out
  double missing = 0.10;  ///< share of masks that are not there
  double split = 0.20;    ///< chance of a large region to be split
  double merge = 0.07;    ///< chance of a small region to be joined with its neighbour
  double whole = 0.5;     ///< chance of a thing of several parts to get a mask of its own, above theirs
};

/// Layers of label images CV_32SC1, 0 = no mask: the first holds parts, the second whole things (a car with
/// its windows and wheels). Ids are random, below 65536, and mean nothing in the next picture.
std::vector<cv::Mat> simulateMasks(const Picture& picture, const std::vector<Part>& parts,
                                   const MaskConfig& config, std::uint64_t seed);

}  // namespace lidar_camera_recalibration::simulation

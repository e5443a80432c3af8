#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/inputs.hpp"
#include "evaluation/methods.hpp"
#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration::evaluation {

/// What the drift monitor says about extrinsics that are off by a known amount, or not at all: of each, so
/// many windows of random frames for each number of frames. Frames are prepared once, around the reference.
/// CSV, a line for each window: offset (`none`, `rotation` by an exact angle about x, y, z and random axes,
/// `sideways` along x by an exact distance, or `random`), rotation [deg], translation [m], frames, statistic,
/// probability.
/// @param frame_counts  more than there are means all
/// @throw Error(kNotEnough) if no frame can be used
std::string driftWindows(const Method& method, const std::vector<Input>& inputs, const Camera& camera,
                         const Eigen::Isometry3d& reference, const std::vector<int>& frame_counts,
                         int windows, std::uint64_t seed);

}  // namespace lidar_camera_recalibration::evaluation

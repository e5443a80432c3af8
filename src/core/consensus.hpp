#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <vector>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

/// What one frame says about an extrinsic that was found on several.
struct Opinion {
  Vector6d wish = Vector6d::Zero();  ///< from the joint extrinsic to the frame's own optimum [rad, m]
  double contrast = 0.0;      ///< its score at the joint extrinsic, above that a degree or two beside it
  double own_contrast = 0.0;  ///< the same at its own optimum
};

/// Indices of the frames that contradict the others, the worst first. Such a frame finds nothing at the joint
/// extrinsic where the others do (masks of another image, a cloud of another time), or its own optimum lies
/// far from theirs and fits it clearly better (another extrinsic). Empty for less than 4 frames.
std::vector<std::size_t> contradicting(const std::vector<Opinion>& opinions);

struct Consensus {
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  std::vector<std::size_t> left_out;  ///< indices, ascending; at most a third of the frames
  std::size_t contradicting = 0;      ///< frames that contradict T_camera_lidar, those left out included
  std::size_t evaluations = 0;
  bool cancelled = false;  ///< then T_camera_lidar is the last one that was refined
};

/// Asks each frame about the joint extrinsic, leaves out those that contradict the others, refines on the
/// rest, and asks all again, those left out too, until nothing changes. Without a contradiction the joint
/// extrinsic is the result as it is.
/// @param joint    found on all frames
/// @param threads  do not change the result
Consensus findConsensus(const Search& search, const Objective& objective, const Frames& frames,
                        const Eigen::Isometry3d& joint, int threads, const Progress& progress);

/// The frames but those with these indices.
Frames without(const Frames& frames, const std::vector<std::size_t>& left_out);

}  // namespace lidar_camera_recalibration

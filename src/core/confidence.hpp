#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

struct Uncertainty {
  std::optional<Matrix6d> covariance;  ///< of the perturbation xi [rad^2, m^2]
  std::size_t evaluations = 0;
  bool cancelled = false;
};

/// How far the result would move with other frames of the same kind. Blind to an error that all frames share.
/// No covariance below 5 frames, where it was measured to be several times too small.
///
/// With a search that refines exactly: delete-one jackknife, the result is refined again and again with one
/// frame missing; with more than 20 frames one of 20 groups. It would multiply the scatter of a random
/// search, and cost more than the search itself: there the scatter of refinements on up to 6 disjoint groups.
/// @param result   found on these frames
/// @param threads  do not change the result
Uncertainty estimateUncertainty(const Search& search, const Objective& objective, const Frames& frames,
                                const Eigen::Isometry3d& result, int threads, const Progress& progress);

}  // namespace lidar_camera_recalibration

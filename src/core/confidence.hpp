#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

struct Resampling {
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  std::optional<Matrix6d> covariance;  ///< of the perturbation xi [rad^2, m^2]
  std::size_t evaluations = 0;
  bool cancelled = false;
};

/// How far the result would move with other frames of the same kind, and the mean over such sets of frames,
/// which scatters less than the result itself. Blind to an error that all frames share, but for what the
/// borders of masks are known to. Below 5 frames the result stays as it is, and strips of the frames are
/// drawn in place of frames; with a random search there is no covariance then.
///
/// With a search that refines exactly: bootstrap, the result is refined on 20 sets of as many frames, drawn
/// with replacement; each frame is drawn as often as any other. T_camera_lidar is the mean of the
/// refinements, the covariance is their scatter. With a random search, whose own scatter that would be,
/// refinements on up to 6 disjoint groups of the frames; the result stays.
/// @param result  found on these frames
Resampling resample(const Search& search, const Objective& objective, const Frames& frames,
                    const Eigen::Isometry3d& result, int threads, const Progress& progress);

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <functional>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

struct CrossValidation {
  UnseenEvidence evidence;
  std::size_t evaluations = 0;
  bool cancelled = false;
};

using Applied = std::function<Eigen::Isometry3d(const Eigen::Isometry3d&)>;

/// Searches again from the start, on a part of the frames each time, and measures what was found on the
/// others, until each frame has been one of the others. Each search keeps at least 4 frames: 2 searches on
/// halves from 8 frames on, 5 searches on 4 frames for 5. Fewer than 5 frames are cut into upright strips of
/// the image, which take the place of frames: less independent, but the search has not seen them either.
/// @param result  found on all frames
/// @param threads  do not change the result
/// @param applied  what of a search's result would be used: its undetermined axes keep the start's values
CrossValidation crossValidate(const Search& search, const Objective& objective, const Frames& frames,
                              const Eigen::Isometry3d& start, const SearchRange& range,
                              const Eigen::Isometry3d& result, const Applied& applied, int threads,
                              const Progress& progress);

}  // namespace lidar_camera_recalibration

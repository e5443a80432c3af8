#pragma once

#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

/// For a step that is the part from `begin` to `end` (0..1) of the whole. `progress` must outlive it and may
/// be empty.
inline Progress partOf(const Progress& progress, double begin, double end) {
  return [&progress, begin, end](double fraction, double best) {
    return !progress || progress(begin + (end - begin) * fraction, best);
  };
}

}  // namespace lidar_camera_recalibration

#pragma once

#include <vector>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// What the LiDAR sees in the image, coarsely: a mean distance for each few degrees. Tells whether two frames
/// show the same scene from the same place, whatever the light.
class FrameView {
 public:
  explicit FrameView(const Frame& frame);

  /// Share of the view in which the distances differ by more than a few percent, 0..1. A road that looks the
  /// same everywhere does not count as a new view, and tells nothing new.
  double changeFrom(const FrameView& other) const;

 private:
  struct Cell {
    float mean_log_range = 0.0F;  ///< of the range in m
    int points = 0;
  };
  std::vector<Cell> cells_;
};

}  // namespace lidar_camera_recalibration

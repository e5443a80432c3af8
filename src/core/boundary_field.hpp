#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// Widths of the boundary fields [deg], from coarse to fine.
constexpr std::array<double, 4> kBoundaryWidths = {0.8, 0.4, 0.2, 0.1};
constexpr std::size_t kBoundaryLevels = kBoundaryWidths.size();

/// The borders of an image's masks as something that edges can be drawn towards. Borders that run upright and
/// borders that run level are kept apart, since the LiDAR's edges are of one of the two kinds.
///
/// About 6 MB for an image of KITTI.
class BoundaryField {
 public:
  enum Direction { kUpright = 0, kLevel = 1, kDirections = 2 };

  explicit BoundaryField(const Frame& frame);
  /// @param boundaries  of each direction, CV_8UC1 of one size, not 0 = border
  /// @param fx  focal length [px]
  BoundaryField(const std::array<cv::Mat, kDirections>& boundaries, double fx);

  /// B = exp(-D^2 / 2 sigma^2) minus its own blur over 5 sigma, D the distance to the nearest border: near 1
  /// on a lonely border, about 0 where borders are dense or far. Bilinear; 0 outside.
  /// @param level  of kBoundaryWidths
  float closeness(Direction direction, std::size_t level, float u, float v) const;

  struct Distance {
    float value = 0.0f;          ///< D [px]
    float du = 0.0f, dv = 0.0f;  ///< its derivatives
    bool inside = false;
  };
  Distance distance(Direction direction, float u, float v) const;

 private:
  std::array<cv::Mat, kDirections> distance_;  ///< CV_16UC1 [px / kDistanceScale]
  std::array<std::array<cv::Mat, kBoundaryLevels>, kDirections> closeness_;  ///< CV_8SC1 [1 / 127]
};

/// The borders of the frame's masks in the ideal image, upright and level ones apart, CV_8UC1, 255 on
/// borders. Where there is an image they are moved to its intensity edges within 3 px and left out where it
/// has none: a segmenter's borders are off by a pixel or two, and systematically.
std::array<cv::Mat, BoundaryField::kDirections> maskBoundaries(const Frame& frame);

}  // namespace lidar_camera_recalibration

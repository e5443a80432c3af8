#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <vector>

#include "mask_borders.hpp"
#include "projection.hpp"

namespace lidar_camera_recalibration {

/// Widths of borders [deg], from coarse to fine. Scores are made with the first kScoreLevels of them; the
/// finest is for the last steps of a fit.
constexpr std::array<double, 4> kBoundaryWidths = {0.8, 0.4, 0.2, 0.1};
constexpr std::size_t kBoundaryLevels = kBoundaryWidths.size(), kScoreLevels = 3;

/// The borders of an image's masks as something that edges can be drawn towards. Borders that run upright and
/// borders that run level are kept apart, since the LiDAR's edges are of one of the two kinds.
///
/// About 3.5 MB for an image of KITTI.
class BoundaryField {
 public:
  enum Direction { kUpright = 0, kLevel = 1, kDirections = 2 };

  /// @param size  of the image
  /// @param fx    focal length [px]
  BoundaryField(const std::vector<Border>& borders, const cv::Size& size, double fx);

  /// B = exp(-D^2 / 2 sigma^2) minus its own blur over 5 sigma, D the distance to the nearest border: near 1
  /// on a lonely border, about 0 where borders are dense or far. Bilinear; 0 outside.
  /// @param level  of kBoundaryWidths, below kScoreLevels
  /// @param count  of pixels, at most kBlock
  void closeness(Direction direction, std::size_t level, const PixelBlock& pixels, std::size_t count,
                 Block<float>& result) const;

  /// The line that a border follows at some place.
  struct Line {
    float u, v;    ///< the place [px]
    float nu, nv;  ///< unit vector across it
  };

  /// The border nearest to each pixel, as index into lines(direction); -1 outside of the image and where
  /// there is no border of this direction.
  void nearest(Direction direction, const PixelBlock& pixels, std::size_t count,
               Block<std::int32_t>& result) const;

  const std::vector<Line>& lines(Direction direction) const { return channels_[direction].lines; }

  std::size_t bytes() const;

 private:
  /// The borders of one direction.
  struct Channel {
    std::vector<Line> lines;
    cv::Mat nearest;                              ///< index into `lines` of each pixel, CV_16UC1 or CV_32SC1
    std::array<cv::Mat, kScoreLevels> closeness;  ///< CV_8SC1 [1 / 127], wide ones on smaller images
  };

  static Channel makeChannel(std::vector<Border> borders, const cv::Size& size, double fx);

  cv::Size size_;
  std::array<float, kScoreLevels> shrink_;  ///< pixels of the image in one of a closeness image
  std::array<Channel, kDirections> channels_;
};

}  // namespace lidar_camera_recalibration

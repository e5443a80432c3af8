#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace lidar_camera_recalibration {

/// A piece of a border between masks, about one pixel long.
struct Border {
  float u = 0.0f, v = 0.0f;    ///< a place on it [px], better than a pixel
  float nu = 1.0f, nv = 0.0f;  ///< unit vector across it
  cv::Point pixel;             ///< in which it was found
  bool upright = false;        ///< steep enough to be crossed by the rings of a LiDAR
  bool level = false;          ///< flat enough to lie between two rings; many borders are both
};

/// The borders of masks in the ideal image. Where there is an image they are moved to its intensity edges
/// within 3 px and left out where it has none: a segmenter's borders are off by a pixel or two, and
/// systematically.
/// @param sets   MaskSets::setOfPixel(), CV_16UC1
/// @param image  CV_8UC3 of the same size; may be empty
std::vector<Border> maskBorders(const cv::Mat& sets, const cv::Mat& image);

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <string>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

enum class OverlayColor { kDepth, kReflectivity, kNormal, kSegment, kMask };

/// `depth`, `reflectivity`, `normal`, `segment` or `mask`. @throw Error(kParameter) naming the value.
OverlayColor overlayColorFromName(const std::string& name);

/// BGR of a depth [m] in overlays: near is red, far is blue, logarithmic from 2.5 to 80 m.
cv::Vec3b depthColor(double depth);

/// The frame's points drawn over its image as it was taken (BGR), nearest on top, hidden points left out,
/// with a legend and a title.
/// @throw Error(kImage) if the frame has no image.
cv::Mat drawOverlay(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar, OverlayColor color,
                    const std::string& title = "");

/// Before above after, for comparison.
cv::Mat drawBeforeAfter(const Frame& frame, const Eigen::Isometry3d& before, const Eigen::Isometry3d& after,
                        OverlayColor color);

}  // namespace lidar_camera_recalibration

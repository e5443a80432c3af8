#pragma once

#include <Eigen/Geometry>
#include <cstdint>

#include "lidar_camera_recalibration/frame.hpp"
#include "projection.hpp"

namespace lidar_camera_recalibration::performance {

using Points = Places;

/// The points of a frame that an objective scores when this extrinsic bounds the view (see
/// Objective::evaluator): those well inside the image.
Points pointsInView(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar);

/// What cannot be done in less time, though it scores nothing: all points to the image, the pixels summed up
/// so that the compiler leaves nothing out. Branchless, in the vector units of the machine.
std::int64_t projectAll(const Points& points, const Intrinsics& camera,
                        const Eigen::Isometry3d& T_camera_lidar);

/// The same, and the mask label of each pixel is read.
/// @param labels  CV_16UC1
std::int64_t projectAllAndLookUp(const Points& points, const Intrinsics& camera,
                                 const Eigen::Isometry3d& T_camera_lidar, const cv::Mat& labels);

}  // namespace lidar_camera_recalibration::performance

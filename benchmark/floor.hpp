#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration::performance {

/// Points as structure of arrays, LiDAR frame [m].
struct Points {
  std::vector<float> x, y, z;

  std::size_t size() const { return x.size(); }
  void add(float px, float py, float pz) {
    x.push_back(px);
    y.push_back(py);
    z.push_back(pz);
  }
};

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

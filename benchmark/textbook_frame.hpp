#pragma once

#include <Eigen/Geometry>

#include "lidar_camera_recalibration/frame.hpp"
#include "textbook/textbook.hpp"

namespace lidar_camera_recalibration::performance {

/// A prepared frame as the textbook wants it: a binary image for each mask, a struct for each point.
textbook::Frame textbookFrame(const Frame& frame);

inline cv::Affine3d toOpenCv(const Eigen::Isometry3d& T) {
  cv::Matx44d matrix;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) matrix(row, column) = T(row, column);
  }
  return cv::Affine3d(matrix);
}

}  // namespace lidar_camera_recalibration::performance

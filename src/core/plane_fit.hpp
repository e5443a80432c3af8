#pragma once

#include <Eigen/Core>

namespace lidar_camera_recalibration {

/// Least-squares plane of some points.
struct PlaneFit {
  Eigen::Vector3d mean;
  Eigen::Vector3d normal;  ///< direction of least variance; zero where no plane fits
  double elongation;       ///< second principal variance over the first one; 0 = a line, 1 = as wide as long
};

/// @param count     of the points
/// @param sum       of the points, from an origin near them: the distance from the sensor costs digits
/// @param products  sum of point * point^T
PlaneFit fitPlane(double count, const Eigen::Vector3d& sum, const Eigen::Matrix3d& products);

}  // namespace lidar_camera_recalibration

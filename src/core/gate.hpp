#pragma once

#include <Eigen/Geometry>
#include <array>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {

struct Determined {
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  Matrix6d covariance = Matrix6d::Zero();  ///< of kept axes: that of the result, which was not used
  std::array<bool, 6> kept = {};
};

/// The result with the start's values on the axes of the translation whose standard deviation is too large,
/// worst first; the others are what is most likely with these values. So the frames correct what they know,
/// and no more. A rotation that is not known is another matter: the start's value in its place would spoil
/// all the rest.
Determined keepUndetermined(const Eigen::Isometry3d& result, const Matrix6d& covariance,
                            const Eigen::Isometry3d& start, const GateConfig& config);

/// Sets accepted and reason, from all the rest.
void judge(CalibrationOutcome& result, const CalibratorConfig& config);

}  // namespace lidar_camera_recalibration

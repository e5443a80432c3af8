#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration {

/// Numbers and rotations as calibration files write them.

/// The shortest decimal that reads back as the same double, whatever the process's locale.
std::string number(double value);

/// Separated by a blank or what is given.
template <typename Vector>
std::string numbers(const Vector& values, const char* separator = " ") {
  std::string text;
  for (Eigen::Index i = 0; i < static_cast<Eigen::Index>(values.size()); ++i) {
    text += (i == 0 ? "" : separator) + number(values[i]);
  }
  return text;
}

/// @throw std::runtime_error naming the word that is no finite number.
std::vector<double> numbersFrom(const std::string& words);

/// Roll, pitch, yaw about fixed axes as in URDF: R = Rz(yaw) * Ry(pitch) * Rx(roll).
Eigen::Vector3d rollPitchYaw(const Eigen::Matrix3d& R);

/// x y z w, with w >= 0
Eigen::Vector4d quaternion(const Eigen::Matrix3d& R);

/// The pose of a child in its parent, T_parent_child. @throw Error(kExtrinsic) if a number is not finite.
Eigen::Isometry3d poseFromRpy(const Eigen::Vector3d& xyz, const Eigen::Vector3d& rpy);

/// @param q  x y z w. @throw Error(kExtrinsic) if a number is not finite or the norm is further than 1e-3
/// from 1.
Eigen::Isometry3d poseFromQuaternion(const Eigen::Vector3d& xyz, const Eigen::Vector4d& q);

/// The pinhole's 3x3 matrix.
Eigen::Matrix3d cameraMatrix(const Intrinsics& intrinsics);

/// OpenCV's order of coefficients tells plumb_bob (4, 5) from rational_polynomial (8, 12, 14); none are none.
/// @throw Error(kCamera) for another number of them.
void setOpenCvDistortion(const std::vector<double>& coefficients, Intrinsics& intrinsics);

}  // namespace lidar_camera_recalibration

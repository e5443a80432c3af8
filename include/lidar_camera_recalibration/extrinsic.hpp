#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>

namespace lidar_camera_recalibration {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// The extrinsic of this package is always `T_camera_lidar`: it maps points of the LiDAR frame into the
/// camera's *optical* frame (z forward, x right, y down; REP 103).
///
/// A perturbation xi = (rx, ry, rz, tx, ty, tz) [rad, m] acts on the camera side:
/// T = exp(xi) * T_camera_lidar, so its axes are those of the optical frame. exp is the exponential map of
/// SE(3).
Eigen::Isometry3d exp(const Vector6d& xi);

/// Inverse of exp() for rotations below pi.
Vector6d log(const Eigen::Isometry3d& T);

/// Difference between an extrinsic and a reference, in the axes of the optical frame.
struct ExtrinsicError {
  Eigen::Vector3d rotation;                               ///< rotation vector of R * R_reference^T [rad]
  Eigen::Vector3d translation;                            ///< t - t_reference [m]
  double angle() const { return rotation.norm(); }        ///< geodesic rotation angle [rad]
  double distance() const { return translation.norm(); }  ///< [m]
};
ExtrinsicError extrinsicError(const Eigen::Isometry3d& T_camera_lidar, const Eigen::Isometry3d& reference);

/// Makes an isometry from a 4x4 that may carry rounding errors of a text file.
/// @throw Error(kExtrinsic) if it is not finite or its rotation part is further than 1e-3 from orthonormal.
Eigen::Isometry3d isometryFromMatrix(const Eigen::Matrix4d& matrix);

/// Largest displacement [px] of the projection of points at a distance [m] straight ahead and at the left and
/// right image border when the extrinsic changes from `a` to `b`: what a user sees in the overlay. Infinite
/// if one of them comes to lie behind the camera.
/// @param fx,width  focal length and image width of the ideal image [px]
double pixelShift(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double distance, double fx,
                  int width);

constexpr double kDegree = 0.017453292519943295;  ///< [rad]

}  // namespace lidar_camera_recalibration

#include "lidar_camera_recalibration/extrinsic.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr double kMaxNonOrthonormality = 1e-3;

// Below this angle [rad] the closed forms lose digits to cancellation, and the series is exact to double
// precision.
constexpr double kSmallAngle = 1e-3;

Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d matrix;
  matrix << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return matrix;
}

/// (1 - cos a) / a^2
double versineCoefficient(double angle) {
  if (angle < kSmallAngle) return 0.5 - angle * angle / 24.0;
  const double s = std::sin(0.5 * angle);
  return 2.0 * s * s / (angle * angle);
}

/// (a - sin a) / a^3
double sineRestCoefficient(double angle) {
  if (angle < kSmallAngle) return 1.0 / 6.0 - angle * angle / 120.0;
  return (angle - std::sin(angle)) / (angle * angle * angle);
}

/// Left Jacobian of SO(3): translation = J * (tx, ty, tz).
Eigen::Matrix3d leftJacobian(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  const Eigen::Matrix3d W = skew(rotation);
  return Eigen::Matrix3d::Identity() + versineCoefficient(angle) * W + sineRestCoefficient(angle) * W * W;
}

Eigen::Matrix3d inverseLeftJacobian(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  const Eigen::Matrix3d W = skew(rotation);
  const double coefficient = angle < kSmallAngle
                                 ? 1.0 / 12.0 + angle * angle / 720.0
                                 : (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / (angle * angle);
  return Eigen::Matrix3d::Identity() - 0.5 * W + coefficient * W * W;
}

Eigen::Matrix3d rotationFromVector(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  const Eigen::Matrix3d W = skew(rotation);
  const double sinc = angle < kSmallAngle ? 1.0 - angle * angle / 6.0 : std::sin(angle) / angle;
  return Eigen::Matrix3d::Identity() + sinc * W + versineCoefficient(angle) * W * W;
}

Eigen::Vector3d vectorFromRotation(const Eigen::Matrix3d& rotation) {
  const Eigen::AngleAxisd angle_axis(rotation);
  return angle_axis.angle() * angle_axis.axis();
}

}  // namespace

Eigen::Isometry3d exp(const Vector6d& xi) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = rotationFromVector(xi.head<3>());
  T.translation() = leftJacobian(xi.head<3>()) * xi.tail<3>();
  return T;
}

Vector6d log(const Eigen::Isometry3d& T) {
  Vector6d xi;
  xi.head<3>() = vectorFromRotation(T.linear());
  xi.tail<3>() = inverseLeftJacobian(xi.head<3>()) * T.translation();
  return xi;
}

ExtrinsicError extrinsicError(const Eigen::Isometry3d& T_camera_lidar, const Eigen::Isometry3d& reference) {
  return {vectorFromRotation(T_camera_lidar.linear() * reference.linear().transpose()),
          T_camera_lidar.translation() - reference.translation()};
}

Eigen::Isometry3d isometryFromMatrix(const Eigen::Matrix4d& matrix) {
  const auto refuse = [&matrix](const std::string& why) -> Error {
    std::ostringstream message;
    message << "the extrinsic is not a rigid transform: " << why << "; matrix:\n"
            << matrix << "\nIt must be a 4x4 of a rotation and a translation [m].";
    return Error(ErrorCause::kExtrinsic, message.str());
  };
  if (!matrix.allFinite()) throw refuse("it holds NaN or infinity");
  if ((matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > kMaxNonOrthonormality) {
    throw refuse("its last row is not 0 0 0 1");
  }
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  const Eigen::Matrix3d deviation = linear.transpose() * linear - Eigen::Matrix3d::Identity();
  if (!(deviation.cwiseAbs().maxCoeff() <= kMaxNonOrthonormality)) {
    throw refuse("its rotation part is not orthonormal");
  }
  if (linear.determinant() < 0.0) throw refuse("its rotation part mirrors");

  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(linear, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = svd.matrixU() * svd.matrixV().transpose();
  T.translation() = matrix.topRightCorner<3, 1>();
  return T;
}

double pixelShift(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b, double distance, double fx,
                  int width) {
  const Eigen::Isometry3d T_b_a = b * a.inverse();
  const double border = 0.5 * width / fx;
  double largest = 0.0;
  for (const double x : {0.0, -border, border}) {
    const Eigen::Vector3d in_a = distance * Eigen::Vector3d(x, 0.0, 1.0).normalized();
    const Eigen::Vector3d in_b = T_b_a * in_a;
    if (in_b.z() <= 0.0) return std::numeric_limits<double>::infinity();
    const Eigen::Vector2d shift = in_b.head<2>() / in_b.z() - in_a.head<2>() / in_a.z();
    largest = std::max(largest, fx * shift.norm());
  }
  return largest;
}

}  // namespace lidar_camera_recalibration

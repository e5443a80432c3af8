#include "text.hpp"

#include <cmath>
#include <locale>
#include <sstream>
#include <stdexcept>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

std::string number(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
  for (int digits = 15;; ++digits) {
    std::ostringstream out;
    out.imbue(std::locale::classic());
    out.precision(digits);
    out << value;
    std::istringstream in(out.str());
    in.imbue(std::locale::classic());
    double back = 0.0;
    // A denormal fails to read although it was parsed, so the value alone counts.
    in >> back;
    if (back != value && digits < 17) continue;
    std::string text = out.str();
    const std::size_t exponent = text.find('e');
    // YAML 1.1 readers such as Python's take 1e-05 for a string.
    if (exponent != std::string::npos && text.find('.') == std::string::npos) text.insert(exponent, ".0");
    return text;
  }
}

std::vector<double> numbersFrom(const std::string& words) {
  std::vector<double> values;
  std::istringstream stream(words);
  for (std::string word; stream >> word;) {
    std::istringstream in(word);
    in.imbue(std::locale::classic());
    double value = 0.0;
    in >> value;
    if (!in || !in.eof() || !std::isfinite(value))
      throw std::runtime_error("'" + word + "' is no finite number");
    values.push_back(value);
  }
  return values;
}

Eigen::Vector3d rollPitchYaw(const Eigen::Matrix3d& R) {
  const double cos_pitch = std::hypot(R(0, 0), R(1, 0));
  const double pitch = std::atan2(-R(2, 0), cos_pitch);
  if (cos_pitch < 1e-9) return {0.0, pitch, std::atan2(-R(0, 1), R(1, 1))};  // only roll -+ yaw is defined
  return {std::atan2(R(2, 1), R(2, 2)), pitch, std::atan2(R(1, 0), R(0, 0))};
}

Eigen::Vector4d quaternion(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond q(R);
  q.normalize();
  return q.w() < 0.0 ? Eigen::Vector4d(-q.coeffs()) : Eigen::Vector4d(q.coeffs());
}

Eigen::Isometry3d poseFromRpy(const Eigen::Vector3d& xyz, const Eigen::Vector3d& rpy) {
  if (!xyz.allFinite() || !rpy.allFinite())
    throw Error(ErrorCause::kExtrinsic, "the pose holds NaN or infinity");
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = (Eigen::AngleAxisd(rpy.z(), Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(rpy.y(), Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(rpy.x(), Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = xyz;
  return T;
}

Eigen::Isometry3d poseFromQuaternion(const Eigen::Vector3d& xyz, const Eigen::Vector4d& q) {
  constexpr double kMaxDeviation = 1e-3;
  if (!xyz.allFinite() || !q.allFinite())
    throw Error(ErrorCause::kExtrinsic, "the pose holds NaN or infinity");
  if (std::abs(q.norm() - 1.0) > kMaxDeviation)
    throw Error(ErrorCause::kExtrinsic, "the norm of the quaternion is " + number(q.norm()) + ", not 1");
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized().toRotationMatrix();
  T.translation() = xyz;
  return T;
}

Eigen::Matrix3d cameraMatrix(const Intrinsics& intrinsics) {
  Eigen::Matrix3d K;
  K << intrinsics.fx, 0.0, intrinsics.cx, 0.0, intrinsics.fy, intrinsics.cy, 0.0, 0.0, 1.0;
  return K;
}

void setOpenCvDistortion(const std::vector<double>& coefficients, Intrinsics& intrinsics) {
  switch (coefficients.size()) {
    case 0:
      intrinsics.model = DistortionModel::kNone;
      break;
    case 4:
    case 5:
      intrinsics.model = DistortionModel::kPlumbBob;
      break;
    case 8:
    case 12:
    case 14:
      intrinsics.model = DistortionModel::kRationalPolynomial;
      break;
    default:
      throw Error(ErrorCause::kCamera, std::to_string(coefficients.size()) +
                                           " distortion coefficients; 0, 4 or 5 (plumb_bob) or 8 "
                                           "(rational_polynomial) are known");
  }
  intrinsics.distortion = coefficients;
}

}  // namespace lidar_camera_recalibration

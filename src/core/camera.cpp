#include "lidar_camera_recalibration/camera.hpp"

#include <algorithm>
#include <boost/math/tools/roots.hpp>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <unsupported/Eigen/Polynomials>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kMinDepth = 1e-6;       // [m]; nearer points have no usable direction
constexpr double kMaxUndistorted = 1e3;  // tan of 89.94 deg, where the search for a ray gives up
constexpr int kMaxSize = 32766;          // [px]; cv::remap() keeps coordinates in 16 bits
constexpr float kOutside = -1000.0F;     // a raw pixel that no image has

Error cameraError(const std::string& what) { return Error(ErrorCause::kCamera, what); }

/// Coefficients of `plumb_bob` and `rational_polynomial` in ROS order; missing ones are zero.
struct Polynomial {
  double k1, k2, p1, p2, k3, k4, k5, k6;

  explicit Polynomial(const std::vector<double>& d) {
    const auto at = [&d](std::size_t i) { return i < d.size() ? d[i] : 0.0; };
    k1 = at(0), k2 = at(1), p1 = at(2), p2 = at(3), k3 = at(4), k4 = at(5), k5 = at(6), k6 = at(7);
  }

  double radialFactor(double s) const {  // s = r^2
    return (1.0 + s * (k1 + s * (k2 + s * k3))) / (1.0 + s * (k4 + s * (k5 + s * k6)));
  }
  Eigen::Vector2d tangential(const Eigen::Vector2d& n) const {
    const double s = n.squaredNorm();
    const double xy = n.x() * n.y();
    return {2.0 * p1 * xy + p2 * (s + 2.0 * n.x() * n.x()), p1 * (s + 2.0 * n.y() * n.y()) + 2.0 * p2 * xy};
  }
};

/// Distorted angle of `equidistant`.
double equidistantAngle(const std::vector<double>& k, double angle) {
  const double s = angle * angle;
  return angle * (1.0 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3]))));
}

Eigen::VectorXd product(const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  Eigen::VectorXd c = Eigen::VectorXd::Zero(a.size() + b.size() - 1);
  for (Eigen::Index i = 0; i < a.size(); ++i) c.segment(i, b.size()) += a[i] * b;
  return c;
}

/// Of sum_i c_i s^i; infinite if there is none.
double smallestPositiveRoot(const Eigen::VectorXd& coefficients) {
  Eigen::Index size = coefficients.size();
  while (size > 1 && std::abs(coefficients[size - 1]) < 1e-15) --size;
  if (size < 2) return kInfinity;
  const Eigen::PolynomialSolver<double, Eigen::Dynamic> solver(Eigen::VectorXd(coefficients.head(size)));
  std::vector<double> roots;
  solver.realRoots(roots, 1e-8);
  double smallest = kInfinity;
  for (const double root : roots) {
    if (root > 0.0) smallest = std::min(smallest, root);
  }
  return smallest;
}

/// Where the derivative of the distorted radius (equidistant: angle) first becomes zero, or the radius has a
/// pole.
double foldBackRadius(const Intrinsics& intrinsics) {
  const std::vector<double>& d = intrinsics.distortion;
  if (intrinsics.model == DistortionModel::kNone) return kInfinity;
  if (intrinsics.model == DistortionModel::kEquidistant) {
    Eigen::VectorXd derivative(5);
    derivative << 1.0, 3.0 * d[0], 5.0 * d[1], 7.0 * d[2], 9.0 * d[3];
    return std::min(M_PI / 2.0, std::sqrt(smallestPositiveRoot(derivative)));
  }
  // d/dr of r N(s) / D(s) with s = r^2 is ((N + 2 s N') D - 2 s N D') / D^2.
  const Polynomial p(d);
  const Eigen::VectorXd N = Eigen::Vector4d(1.0, p.k1, p.k2, p.k3);
  const Eigen::VectorXd D = Eigen::Vector4d(1.0, p.k4, p.k5, p.k6);
  const Eigen::VectorXd slope = Eigen::Vector4d(1.0, 3.0 * p.k1, 5.0 * p.k2, 7.0 * p.k3);
  const Eigen::VectorXd sD = Eigen::Vector4d(0.0, p.k4, 2.0 * p.k5, 3.0 * p.k6);
  const double fold = smallestPositiveRoot(product(slope, D) - 2.0 * product(N, sD));
  return std::sqrt(std::min(fold, smallestPositiveRoot(D)));
}

/// x in [0, limit] with function(x) = value, for a function that rises from 0; `limit` if it does not reach
/// the value.
template <typename Function>
double invertRising(const Function& function, double value, double limit) {
  if (value <= 0.0) return 0.0;
  double high = std::min(limit, std::max(1.0, value));
  while (high < limit && function(high) < value) high = std::min(limit, 2.0 * high);
  if (function(high) <= value) return high;
  const auto bracket = [&](double x) { return function(x) - value; };
  std::uintmax_t iterations = 100;
  const auto root =
      boost::math::tools::toms748_solve(bracket, 0.0, high, -value, function(high) - value,
                                        boost::math::tools::eps_tolerance<double>(52), iterations);
  return 0.5 * (root.first + root.second);
}

void checkSize(const Intrinsics& i) {
  if (i.width <= 0 || i.height <= 0 || i.width > kMaxSize || i.height > kMaxSize) {
    std::ostringstream message;
    message << "image size " << i.width << "x" << i.height << " of the camera is not within 1.." << kMaxSize
            << " px; check width and height of camera_info";
    throw cameraError(message.str());
  }
}

void checkMatrix(const Intrinsics& i) {
  std::ostringstream values;
  values << "fx=" << i.fx << " fy=" << i.fy << " cx=" << i.cx << " cy=" << i.cy;
  if (i.fx == 0.0 && i.fy == 0.0) {
    throw cameraError("the camera matrix K is all zero (" + values.str() +
                      "), as an uncalibrated driver sends it; load the camera's calibration into its driver");
  }
  const bool finite =
      std::isfinite(i.fx) && std::isfinite(i.fy) && std::isfinite(i.cx) && std::isfinite(i.cy);
  if (!finite || i.fx <= 0.0 || i.fy <= 0.0) {
    throw cameraError("the camera matrix K describes no camera (" + values.str() +
                      "); fx and fy must be positive, all four finite; check K of camera_info");
  }
}

std::size_t modelledCoefficients(DistortionModel model) {
  switch (model) {
    case DistortionModel::kPlumbBob:
      return 5;
    case DistortionModel::kRationalPolynomial:
      return 8;
    case DistortionModel::kEquidistant:
      return 4;
    case DistortionModel::kNone:
      break;
  }
  return 0;
}

bool countAllowed(DistortionModel model, std::size_t count) {
  switch (model) {
    case DistortionModel::kPlumbBob:
      return count == 0 || count == 4 || count == 5;
    case DistortionModel::kRationalPolynomial:
      return count == 0 || count == 4 || count == 5 || count == 8 || count == 12 || count == 14;
    case DistortionModel::kEquidistant:
      return count == 4;
    case DistortionModel::kNone:
      break;
  }
  return true;
}

const char* countHelp(DistortionModel model) {
  switch (model) {
    case DistortionModel::kPlumbBob:
      return "it takes 4 or 5 (k1 k2 p1 p2 k3); with 8, name the model rational_polynomial";
    case DistortionModel::kRationalPolynomial:
      return "it takes 4, 5 or 8 (k1 k2 p1 p2 k3 k4 k5 k6)";
    case DistortionModel::kEquidistant:
      return "it takes 4 (k1 k2 k3 k4); for a rectified image leave the model empty";
    case DistortionModel::kNone:
      break;
  }
  return "";
}

bool allZero(std::vector<double>::const_iterator begin, std::vector<double>::const_iterator end) {
  return std::all_of(begin, end, [](double value) { return value == 0.0; });
}

/// Checks the coefficients and brings them to the model's own number.
void normaliseDistortion(Intrinsics& i) {
  std::vector<double>& d = i.distortion;
  const std::string who = "distortion model '" + std::string(name(i.model)) + "'";
  for (std::size_t k = 0; k < d.size(); ++k) {
    if (!std::isfinite(d[k])) {
      throw cameraError(who + ": coefficient D[" + std::to_string(k) +
                        "] is not finite; check D of camera_info");
    }
  }
  if (!countAllowed(i.model, d.size())) {
    throw cameraError(who + " with " + std::to_string(d.size()) + " coefficients: " + countHelp(i.model));
  }
  const std::size_t count = modelledCoefficients(i.model);
  if (d.size() > count && !allZero(d.begin() + count, d.end())) {
    throw cameraError(
        i.model == DistortionModel::kNone
            ? std::string("distortion coefficients are given, but no distortion model; name it, or "
                          "set them to zero if the image is rectified")
            : who +
                  ": the coefficients after the first 8 (thin prism, tilt) are not zero and not "
                  "supported; calibrate the camera with 8 coefficients");
  }
  d.resize(count, 0.0);
  // Rectified images often name the model of their raw image with zeros. For `equidistant` zeros are a
  // fisheye lens.
  if (i.model != DistortionModel::kEquidistant && allZero(d.begin(), d.end())) {
    i.model = DistortionModel::kNone;
    d.clear();
  }
}

}  // namespace

DistortionModel distortionModelFromName(const std::string& name) {
  if (name.empty() || name == "none") return DistortionModel::kNone;
  if (name == "plumb_bob") return DistortionModel::kPlumbBob;
  if (name == "rational_polynomial") return DistortionModel::kRationalPolynomial;
  if (name == "equidistant" || name == "fisheye") return DistortionModel::kEquidistant;
  throw cameraError(
      "unknown distortion model '" + name +
      "'; known are plumb_bob, rational_polynomial, equidistant and, for a rectified image, an empty name");
}

const char* name(DistortionModel model) {
  switch (model) {
    case DistortionModel::kPlumbBob:
      return "plumb_bob";
    case DistortionModel::kRationalPolynomial:
      return "rational_polynomial";
    case DistortionModel::kEquidistant:
      return "equidistant";
    case DistortionModel::kNone:
      break;
  }
  return "none";
}

Camera::Camera(const Intrinsics& intrinsics) : intrinsics_(intrinsics) {
  checkSize(intrinsics_);
  checkMatrix(intrinsics_);
  normaliseDistortion(intrinsics_);
  max_radius_ = foldBackRadius(intrinsics_);
  if (distorted()) makeMaps();
}

void Camera::makeMaps() {
  const Intrinsics& i = intrinsics_;
  const cv::Matx33d K(i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0);
  const cv::Size size(i.width, i.height);
  if (i.model == DistortionModel::kEquidistant) {
    cv::fisheye::initUndistortRectifyMap(K, i.distortion, cv::noArray(), K, size, CV_32FC1, map_x_, map_y_);
  } else {
    cv::initUndistortRectifyMap(K, i.distortion, cv::noArray(), K, size, CV_32FC1, map_x_, map_y_);
  }
  // OpenCV follows the polynomial past its fold and would show the image's rim a second time.
  for (int v = 0; v < i.height; ++v) {
    for (int u = 0; u < i.width; ++u) {
      if (reaches({(u - i.cx) / i.fx, (v - i.cy) / i.fy})) continue;
      map_x_.at<float>(v, u) = kOutside;
      map_y_.at<float>(v, u) = kOutside;
    }
  }
}

bool Camera::reaches(const Eigen::Vector2d& normalised) const {
  const double radius = normalised.norm();
  return (intrinsics_.model == DistortionModel::kEquidistant ? std::atan(radius) : radius) <= max_radius_;
}

Eigen::Vector2d Camera::distort(const Eigen::Vector2d& normalised) const {
  if (intrinsics_.model == DistortionModel::kNone) return normalised;
  if (intrinsics_.model == DistortionModel::kEquidistant) {
    const double radius = normalised.norm();
    if (radius < 1e-12) return normalised;
    return equidistantAngle(intrinsics_.distortion, std::atan(radius)) / radius * normalised;
  }
  const Polynomial p(intrinsics_.distortion);
  return p.radialFactor(normalised.squaredNorm()) * normalised + p.tangential(normalised);
}

std::optional<Eigen::Vector2d> Camera::project(const Eigen::Vector3d& point) const {
  if (!(point.z() > kMinDepth)) return std::nullopt;
  const Eigen::Vector2d normalised = point.head<2>() / point.z();
  if (!reaches(normalised)) return std::nullopt;
  const Eigen::Vector2d d = distort(normalised);
  return Eigen::Vector2d(intrinsics_.fx * d.x() + intrinsics_.cx, intrinsics_.fy * d.y() + intrinsics_.cy);
}

Eigen::Vector3d Camera::ray(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d d((pixel.x() - intrinsics_.cx) / intrinsics_.fx,
                          (pixel.y() - intrinsics_.cy) / intrinsics_.fy);
  const double radius = d.norm();
  if (intrinsics_.model == DistortionModel::kNone || radius < 1e-12) return d.homogeneous().normalized();
  if (intrinsics_.model == DistortionModel::kEquidistant) {
    const auto distorted_angle = [this](double angle) {
      return equidistantAngle(intrinsics_.distortion, angle);
    };
    const double angle = invertRising(distorted_angle, radius, max_radius_);
    return (Eigen::Vector3d() << std::sin(angle) / radius * d, std::cos(angle)).finished();
  }

  const Polynomial p(intrinsics_.distortion);
  const auto distorted_radius = [&p](double r) { return r * p.radialFactor(r * r); };
  const double limit = std::min(max_radius_, kMaxUndistorted);
  // The radial part is inverted exactly; the tangential part is small and found by repetition.
  Eigen::Vector2d n = Eigen::Vector2d::Zero();
  for (int iteration = 0; iteration < 50; ++iteration) {
    const Eigen::Vector2d radial = d - p.tangential(n);
    const Eigen::Vector2d next = invertRising(distorted_radius, radial.norm(), limit) * radial.normalized();
    const bool converged = (next - n).norm() < 1e-13;
    n = next;
    if (converged) break;
  }
  return n.homogeneous().normalized();
}

cv::Mat Camera::toIdeal(const cv::Mat& image, int interpolation) const {
  if (image.cols != intrinsics_.width || image.rows != intrinsics_.height) {
    std::ostringstream message;
    message << "image is " << image.cols << "x" << image.rows << " px, but the camera is "
            << intrinsics_.width << "x" << intrinsics_.height
            << " px; image and camera_info must belong together";
    throw Error(ErrorCause::kImage, message.str());
  }
  if (!distorted()) return image.clone();
  cv::Mat ideal;
  cv::remap(image, ideal, map_x_, map_y_, interpolation, cv::BORDER_CONSTANT, cv::Scalar());
  return ideal;
}

}  // namespace lidar_camera_recalibration

#include "floor.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

// A build for the vector units of today's machines beside that for any x86-64, chosen when the program
// starts.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define FOR_THIS_MACHINE __attribute__((target_clones("arch=haswell", "default")))
#else
#define FOR_THIS_MACHINE
#endif

/// K * T as one matrix: homogeneous pixels of points in the LiDAR frame.
using Rows = Eigen::Matrix<float, 3, 4>;

Rows projectionMatrix(const Intrinsics& camera, const Eigen::Isometry3d& T_camera_lidar) {
  Eigen::Matrix3d K;
  K << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
  return (K * T_camera_lidar.matrix().topRows<3>()).cast<float>();
}

}  // namespace

// Not in the nameless namespace: compilers choose among builds of visible functions only.
FOR_THIS_MACHINE
std::int64_t sumOfPixels(const float* x, const float* y, const float* z, std::size_t count, const float* m) {
  std::int32_t sum = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const float scale = 1.0f / (m[2] * x[i] + m[5] * y[i] + m[8] * z[i] + m[11]);
    const float u = (m[0] * x[i] + m[3] * y[i] + m[6] * z[i] + m[9]) * scale;
    const float v = (m[1] * x[i] + m[4] * y[i] + m[7] * z[i] + m[10]) * scale;
    sum ^= static_cast<std::int32_t>(u) + static_cast<std::int32_t>(v);
  }
  return sum;
}

Points pointsInView(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar) {
  constexpr double kMargin = 0.06;  // of the image's height
  const Intrinsics& camera = frame.camera.intrinsics();
  const double margin = kMargin * camera.height;
  const FramePoints& points = frame.points;
  Points result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = T_camera_lidar * Eigen::Vector3d(points.x[i], points.y[i], points.z[i]);
    const double u = camera.fx * p.x() / p.z() + camera.cx + 0.5,
                 v = camera.fy * p.y() / p.z() + camera.cy + 0.5;
    if (p.z() > 0.1 && u >= margin && u < camera.width - margin && v >= margin &&
        v < camera.height - margin) {
      result.add(points.x[i], points.y[i], points.z[i]);
    }
  }
  return result;
}

std::int64_t projectAll(const Points& points, const Intrinsics& camera,
                        const Eigen::Isometry3d& T_camera_lidar) {
  const Rows m = projectionMatrix(camera, T_camera_lidar);
  return sumOfPixels(points.x.data(), points.y.data(), points.z.data(), points.size(), m.data());
}

std::int64_t projectAllAndLookUp(const Points& points, const Intrinsics& camera,
                                 const Eigen::Isometry3d& T_camera_lidar, const cv::Mat& labels) {
  const Rows m = projectionMatrix(camera, T_camera_lidar);
  const auto* const label = labels.ptr<std::uint16_t>();
  const std::size_t stride = labels.step1();
  const auto width = static_cast<float>(camera.width), height = static_cast<float>(camera.height);
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f p =
        m.leftCols<3>() * Eigen::Vector3f(points.x[i], points.y[i], points.z[i]) + m.col(3);
    const float u = p.x() / p.z() + 0.5f, v = p.y() / p.z() + 0.5f;
    if (!(p.z() > 0.0f && u >= 0.0f && u < width && v >= 0.0f && v < height)) continue;
    sum += label[static_cast<std::size_t>(v) * stride + static_cast<std::size_t>(u)];
  }
  return sum;
}

}  // namespace lidar_camera_recalibration::performance

#pragma once

#include <Eigen/Geometry>

#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration {

/// Paper eq. (2): pixels of the ideal image, centres at integer coordinates. In float: off by about 1e-3 px,
/// where masks are good to 1 px.
class Projection {
 public:
  Projection(const Intrinsics& camera, const Eigen::Isometry3d& T_camera_lidar)
      : fx_(static_cast<float>(camera.fx)),
        fy_(static_cast<float>(camera.fy)),
        cx_(static_cast<float>(camera.cx)),
        cy_(static_cast<float>(camera.cy)),
        width_(static_cast<float>(camera.width)),
        height_(static_cast<float>(camera.height)),
        R_(T_camera_lidar.linear().cast<float>()),
        t_(T_camera_lidar.translation().cast<float>()) {}

  struct Pixel {
    float u = -1.0f, v = -1.0f;
    bool ahead = false;  ///< of the camera; without, u and v mean nothing
  };

  /// From the LiDAR frame into the optical frame [m].
  Eigen::Vector3f toCamera(float x, float y, float z) const {
    return {R_(0, 0) * x + R_(0, 1) * y + R_(0, 2) * z + t_.x(),
            R_(1, 0) * x + R_(1, 1) * y + R_(1, 2) * z + t_.y(),
            R_(2, 0) * x + R_(2, 1) * y + R_(2, 2) * z + t_.z()};
  }

  Pixel operator()(const Eigen::Vector3f& in_camera) const {
    constexpr float kMinDepth = 0.1f;  // [m]
    if (!(in_camera.z() > kMinDepth)) return {};
    const float scale = 1.0f / in_camera.z();
    return {fx_ * in_camera.x() * scale + cx_, fy_ * in_camera.y() * scale + cy_, true};
  }

  Pixel operator()(float x, float y, float z) const { return (*this)(toCamera(x, y, z)); }

  /// The nearest pixel. @return false if it is not in the image
  bool nearest(float x, float y, float z, std::size_t& u, std::size_t& v) const {
    const Pixel pixel = (*this)(x, y, z);
    const float up = pixel.u + 0.5f, vp = pixel.v + 0.5f;  // then truncation rounds
    if (!pixel.ahead || !(up >= 0.0f && up < width_ && vp >= 0.0f && vp < height_)) return false;
    u = static_cast<std::size_t>(up);
    v = static_cast<std::size_t>(vp);
    return true;
  }

  /// In the image, and not nearer to its border than `margin` [px].
  bool wellInside(float x, float y, float z, float margin) const {
    const Pixel pixel = (*this)(x, y, z);
    const float up = pixel.u + 0.5f, vp = pixel.v + 0.5f;
    return pixel.ahead && up >= margin && up < width_ - margin && vp >= margin && vp < height_ - margin;
  }

 private:
  float fx_, fy_, cx_, cy_, width_, height_;
  Eigen::Matrix3f R_;
  Eigen::Vector3f t_;
};

/// Share of the image's height by which points must lie inside to be scored (see Objective::evaluator):
/// candidates near the one that bounds the view then lose no point over the border either.
constexpr float kViewMargin = 0.06f;

}  // namespace lidar_camera_recalibration

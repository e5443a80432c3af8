#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <opencv2/core.hpp>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration {

/// Places in the LiDAR frame [m] as structure of arrays.
struct Places {
  std::vector<float> x, y, z;

  std::size_t size() const { return x.size(); }
  void add(float px, float py, float pz) {
    x.push_back(px);
    y.push_back(py);
    z.push_back(pz);
  }
};

/// So many places are worked on at a time: what is between one loop and the next stays in the L1 cache.
constexpr std::size_t kBlock = 256;
template <typename T>
using Block = std::array<T, kBlock>;

/// Where a block of places appears, as Projection::Pixel.
struct PixelBlock {
  Block<float> u, v;           ///< [px]
  Block<float> inverse_depth;  ///< [1/m]
};

/// Paper eq. (2): pixels of the ideal image, centres at integer coordinates. Made in double, used in float:
/// off by about 1e-3 px, where masks are good to 1 px.
class Projection {
 public:
  Projection(const Intrinsics& camera, const Eigen::Isometry3d& T_camera_lidar)
      : width_(static_cast<float>(camera.width)), height_(static_cast<float>(camera.height)) {
    Eigen::Matrix3d K;
    K << camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0;
    const Eigen::Matrix<double, 3, 4> M = K * T_camera_lidar.matrix().topRows<3>();
    for (Eigen::Index row = 0; row < 3; ++row) {
      for (Eigen::Index column = 0; column < 4; ++column)
        m_[row][column] = static_cast<float>(M(row, column));
    }
  }

  struct Pixel {
    float u, v;           ///< [px]
    float inverse_depth;  ///< [1/m]; like u and v not a number for what is not ahead of the camera
  };

  Pixel operator()(float x, float y, float z) const {
    constexpr float kMinDepth = 0.1f;  // [m]
    const float depth = m_[2][0] * x + m_[2][1] * y + m_[2][2] * z + m_[2][3];
    const float scale = depth > kMinDepth ? 1.0f / depth : std::numeric_limits<float>::quiet_NaN();
    return {(m_[0][0] * x + m_[0][1] * y + m_[0][2] * z + m_[0][3]) * scale,
            (m_[1][0] * x + m_[1][1] * y + m_[1][2] * z + m_[1][3]) * scale, scale};
  }

  /// Of `count` <= kBlock places from `first` on.
  void project(const Places& places, std::size_t first, std::size_t count, PixelBlock& pixels) const;

  /// The value of each one's nearest pixel; `outside` for what is outside of the image.
  /// @param image  CV_16UC1, of the camera's size
  void lookUp(const cv::Mat& image, const Places& places, std::size_t first, std::size_t count,
              std::uint32_t outside, Block<std::uint32_t>& values) const;

  /// In the image, and not nearer to its border than `margin` [px].
  bool wellInside(float x, float y, float z, float margin) const {
    const Pixel pixel = (*this)(x, y, z);
    const float up = pixel.u + 0.5f, vp = pixel.v + 0.5f;
    return up >= margin && up < width_ - margin && vp >= margin && vp < height_ - margin;
  }

 private:
  float width_, height_;
  float m_[3][4];  // K * T_camera_lidar
};

/// Share of the image's height by which points must lie inside to be scored (see Objective::evaluator):
/// candidates near the one that bounds the view then lose no point over the border either.
constexpr float kViewMargin = 0.06f;

}  // namespace lidar_camera_recalibration

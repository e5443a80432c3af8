#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "simulation/scene.hpp"

namespace lidar_camera_recalibration::simulation {

struct Picture {
  cv::Mat image;   ///< CV_8UC3, BGR, distorted, with noise
  cv::Mat part;    ///< CV_32SC1, index of the part at the pixel's centre, exact; 0 = sky
  cv::Mat shadow;  ///< CV_8UC1, 255 where the sun does not reach
};

/// A camera with a global shutter.
class CameraSensor {
 public:
  CameraSensor(const Camera& camera, int threads);

  /// @param T_world_camera  pose of the optical frame at `time`, which must lie in the scene's interval
  Picture take(const Scene& scene, const Eigen::Isometry3d& T_world_camera, double time,
               std::uint64_t seed) const;

 private:
  struct Sample {
    Eigen::Vector3f color = Eigen::Vector3f::Zero();
    std::uint32_t part = 0;
    bool shadow = false;
  };
  Sample sample(const Scene& scene, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
                double time) const;
  template <typename Work>
  void forEachRow(const Work& work) const;
  Eigen::Vector3f rayAt(float u, float v) const;
  void smoothBorders(const Scene& scene, const Eigen::Isometry3f& pose, double time, const cv::Mat& part,
                     cv::Mat& color) const;

  int width_, height_, threads_;
  float pixel_angle_;                  ///< [rad]
  std::vector<Eigen::Vector3f> rays_;  ///< unit rays of the pixel centres, optical frame
};

}  // namespace lidar_camera_recalibration::simulation

#pragma once

#include <Eigen/Geometry>
#include <limits>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// A small exact world for tests: boxes of different reflectivity on a ground in front of a wall, seen by a
/// camera and a LiDAR whose extrinsic is known. Everything is traced in the camera's optical frame.
class SyntheticScene {
 public:
  explicit SyntheticScene(unsigned seed = 1, int boxes = 9) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    constexpr double kGround = 1.5;
    for (int i = 0; i < boxes; ++i) {
      const double z = 6.0 + 9.0 * uniform(random), width = 0.8 + uniform(random),
                   height = 0.8 + 1.6 * uniform(random);
      const double x = (-0.5 + (i + 0.5) / boxes) * 1.2 * z;
      boxes_.push_back({{x - width / 2, kGround - height, z},
                        {x + width / 2, kGround, z + width},
                        static_cast<float>(20.0 + 200.0 * uniform(random))});
    }
    boxes_.push_back({{-50.0, kGround, 0.0}, {50.0, kGround + 1.0, 60.0}, 60.0f});  // ground
    boxes_.push_back({{-50.0, -20.0, 20.0}, {50.0, 20.0, 21.0}, 120.0f});           // wall
  }

  static Camera camera(int width = 320, int height = 240) {
    Intrinsics intrinsics;
    intrinsics.width = width;
    intrinsics.height = height;
    intrinsics.fx = intrinsics.fy = 250.0 / 320.0 * width;
    intrinsics.cx = 0.5 * width;
    intrinsics.cy = 0.5 * height;
    return Camera(intrinsics);
  }

  /// LiDAR: x forward, y left, z up, 30 cm above and 20 cm behind the camera.
  static Eigen::Isometry3d T_camera_lidar() {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
    T.translation() << 0.05, -0.3, -0.2;
    return T;
  }

  /// CV_32SC1: one id per box face that differs in direction (a segmenter separates them by shading), 0 for
  /// nothing.
  cv::Mat labels(const Camera& camera = SyntheticScene::camera()) const {
    cv::Mat labels = cv::Mat::zeros(camera.intrinsics().height, camera.intrinsics().width, CV_32SC1);
    for (int v = 0; v < labels.rows; ++v) {
      for (int u = 0; u < labels.cols; ++u) {
        const Hit hit = trace(Eigen::Vector3d::Zero(), camera.ray({u, v}));
        if (hit.box >= 0) labels.at<int>(v, u) = 1 + 3 * hit.box + hit.axis;
      }
    }
    return labels;
  }

  cv::Mat image() const { return image(labels()); }

  /// The scene in colours, one per id of the labels.
  static cv::Mat image(const cv::Mat& ids) {
    cv::Mat image(ids.size(), CV_8UC3);
    for (int v = 0; v < ids.rows; ++v) {
      for (int u = 0; u < ids.cols; ++u) {
        const int id = ids.at<int>(v, u);
        image.at<cv::Vec3b>(v, u) =
            cv::Vec3b(static_cast<uchar>(37 * id), static_cast<uchar>(91 * id), static_cast<uchar>(53 * id));
      }
    }
    return image;
  }

  /// In the LiDAR frame, 64 rings to the given side of straight ahead [rad].
  PointCloud cloud(double side = 0.75, double step = 0.0045) const {
    const Eigen::Isometry3d T = T_camera_lidar();
    PointCloud cloud;
    for (int ring = 0; ring < 64; ++ring) {
      const double elevation = (-22.0 + 32.0 * ring / 63.0) * M_PI / 180.0;
      for (double azimuth = -side; azimuth < side; azimuth += step) {
        const Eigen::Vector3d direction(std::cos(elevation) * std::cos(azimuth),
                                        std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
        const Hit hit = trace(T.translation(), T.linear() * direction);
        if (hit.box < 0) continue;
        cloud.points.push_back((hit.distance * direction).cast<float>());
        cloud.reflectivity.push_back(boxes_[static_cast<std::size_t>(hit.box)].reflectivity);
        cloud.ring.push_back(static_cast<std::uint16_t>(ring));
      }
    }
    return cloud;
  }

 private:
  struct Box {
    Eigen::Vector3d low, high;
    float reflectivity;
  };
  struct Hit {
    double distance = std::numeric_limits<double>::infinity();
    int box = -1, axis = 0;
  };

  Hit trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
    Hit nearest;
    for (std::size_t b = 0; b < boxes_.size(); ++b) {
      double enter = 0.0, leave = std::numeric_limits<double>::infinity();
      int axis = 0;
      for (int k = 0; k < 3; ++k) {
        double t0 = (boxes_[b].low[k] - origin[k]) / direction[k],
               t1 = (boxes_[b].high[k] - origin[k]) / direction[k];
        if (t0 > t1) std::swap(t0, t1);
        if (t0 > enter) {
          enter = t0;
          axis = k;
        }
        leave = std::min(leave, t1);
      }
      if (enter > 0.0 && enter < leave && enter < nearest.distance)
        nearest = {enter, static_cast<int>(b), axis};
    }
    return nearest;
  }

  std::vector<Box> boxes_;
};

}  // namespace lidar_camera_recalibration

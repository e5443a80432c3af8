#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration::performance {

/// A frame as the sensors deliver it.
struct RawFrame {
  cv::Mat image;
  std::vector<cv::Mat> layers;  ///< label images of the masks
  PointCloud cloud;
};

/// Where frames come from. All are seen by one camera, the extrinsic is known.
class Source {
 public:
  virtual ~Source() = default;
  virtual const Camera& camera() const = 0;
  virtual const Eigen::Isometry3d& T_camera_lidar() const = 0;
  virtual std::size_t size() const = 0;
  virtual RawFrame frame(std::size_t index) const = 0;  ///< read or made anew at each call
};

/// A dataset on disk. @throw Error(kFile) if there is none, or none with a reference
std::unique_ptr<Source> openFolder(const std::string& folder);

/// How much the sensors of a simulated vehicle deliver.
struct SensorSizes {
  int width = 1241, height = 376;    ///< of the image [px]
  int beams = 64;                    ///< 16, 32 or 64
  double azimuth_step_deg = 0.1728;  ///< of the LiDAR; smaller means more points
  int masks = 100;                   ///< about so many; large regions are split, small ones left out
};

/// One frame of a simulated street. Sizes change nothing but what the sensors deliver of it.
std::unique_ptr<Source> simulateFrame(const SensorSizes& sizes);

}  // namespace lidar_camera_recalibration::performance

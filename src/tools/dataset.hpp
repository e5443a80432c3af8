#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// A folder of frames on disk: CalibAnything's layout, KITTI raw (`..._sync`) or KITTI odometry.
///
/// Masks are optional in the KITTI layouts: `masks/NAME/*.png` (binary, one mask a file) or `masks/NAME.png`
/// (label image, 8 or 16 bit, up to four layers as channels).
class Dataset {
 public:
  virtual ~Dataset() = default;

  /// Recognises the layout. @throw Error(kFile) saying which files were expected.
  static std::unique_ptr<Dataset> open(const std::string& folder);

  virtual std::string layout() const = 0;  ///< for people
  virtual std::size_t size() const = 0;    ///< number of frames
  virtual std::string name(std::size_t frame) const = 0;
  virtual double stamp(std::size_t frame) const = 0;  ///< [s]; made up at 1 Hz where the layout has none
  virtual const Intrinsics& intrinsics() const = 0;
  virtual const std::optional<Eigen::Isometry3d>& reference() const = 0;  ///< T_camera_lidar

  // Read from disk at each call. @throw Error(kFile) naming the file and what is wrong with it.
  virtual cv::Mat image(std::size_t frame) const = 0;  ///< CV_8UC3
  virtual PointCloud cloud(std::size_t frame) const = 0;
  virtual std::vector<cv::Mat> maskLayers(std::size_t frame) const = 0;  ///< CV_32SC1; empty without masks
};

}  // namespace lidar_camera_recalibration

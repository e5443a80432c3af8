#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Writes frames as a folder in CalibAnything's layout, to be read by Dataset: calib.json, images/, pc/,
/// masks/. The folder becomes a dataset when it is complete: calib.json is written last.
class DatasetWriter {
 public:
  /// @throw Error(kFile) if the folder cannot be made or already holds a dataset,
  ///        Error(kCamera) for a distortion that the layout does not know.
  DatasetWriter(const std::string& folder, const Intrinsics& intrinsics);

  /// Frames are named by their number, 000000 first.
  /// @param image   CV_8UC3, BGR
  /// @param layers  label images CV_32SC1 with ids of 16 bits, at most four; empty: a frame without masks
  /// @throw Error(kFile, kMasks)
  void add(const cv::Mat& image, const std::vector<cv::Mat>& layers, const PointCloud& cloud);

  /// @param note  where the frames are from, for people
  void finish(const Eigen::Isometry3d& T_camera_lidar, const std::string& note);

 private:
  std::filesystem::path folder_;
  Intrinsics intrinsics_;
  std::vector<std::string> names_;
};

}  // namespace lidar_camera_recalibration

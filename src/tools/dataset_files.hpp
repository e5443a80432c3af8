#pragma once

#include <cstddef>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

/// Readers of the single files of a dataset. All throw Error(kFile) naming the file and what is wrong with
/// it.

/// The whole text of a calibration or time file, at most 16 MB.
std::string readText(const std::filesystem::path& file);

/// One number a line, seconds (KITTI odometry), or one UTC date and time a line (KITTI raw). [s]
std::vector<double> readTimes(const std::filesystem::path& file);

/// CV_8UC3, BGR.
cv::Mat readImage(const std::filesystem::path& file);

/// A `.pcd` with any numeric fields, or a KITTI `.bin` (float x y z reflectance).
PointCloud readCloud(const std::filesystem::path& file);

/// `base/` with one binary mask a file, or `base.png` as label image; empty if there is neither.
std::vector<cv::Mat> readMaskLayers(const std::filesystem::path& base);

/// Names without extension, sorted, of the files with this extension. Empty if there is no such folder.
std::vector<std::string> stems(const std::filesystem::path& folder, const std::string& extension);

}  // namespace lidar_camera_recalibration

#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/files.hpp"

namespace lidar_camera_recalibration {

/// What is kept of a calibration on disk.
struct StoredCalibration {
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  std::string camera_frame;  ///< optical frame
  std::string lidar_frame;
  std::optional<Matrix6d> covariance;
  double score_before = 0.0, score_after = 0.0;
  bool accepted = true;
  std::string reason;
  std::size_t frames = 0;           ///< used
  std::size_t frames_left_out = 0;  ///< that contradicted the others
  double stamp = 0.0;               ///< when it was calibrated: stamp of the newest frame [s]
  std::string source;               ///< provenance: node name or bag files
};

/// YAML text: the 4x4, quaternion, xyz/rpy, a ready static_transform_publisher line, a URDF <origin>,
/// covariance and provenance.
std::string toYaml(const StoredCalibration& calibration);

/// T_camera_lidar as ROS wants it, the pose of the camera's optical frame (child) in the LiDAR frame
/// (parent): a line for a shell, and a URDF <origin>.
std::string staticTransformPublisher(const StoredCalibration& calibration);
std::string urdfOrigin(const StoredCalibration& calibration);

/// Reads T_camera_lidar and whatever else is there; other projects' files are read by readCalibrationFile().
/// @throw Error(kFile) naming the file and what is wrong with it.
StoredCalibration readCalibration(const std::string& path);

/// Whole or not at all, see writeFileAtomically(). @throw Error(kFile)
void writeCalibration(const std::string& path, const StoredCalibration& calibration);

}  // namespace lidar_camera_recalibration

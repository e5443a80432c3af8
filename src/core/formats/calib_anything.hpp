#pragma once

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration {

/// CalibAnything's calib.json. Conventions from its readConfig() (OpenCalib/CalibAnything,
/// src/run_lidar2camera.cpp): matrices by rows, T_lidar_to_cam maps LiDAR points into the optical frame [m],
/// cam_dist in OpenCV's order, of the image as it was taken. It has no image size.
struct CalibAnythingFile {
  Eigen::Isometry3d T_camera_lidar;        ///< to start from
  std::optional<Eigen::Isometry3d> truth;  ///< if the file says that it has one
  std::optional<Intrinsics> intrinsics;    ///< without cam_K none
};

/// @throw std::runtime_error or Error naming the key.
CalibAnythingFile readCalibAnything(const nlohmann::json& root);

/// `{rows, cols, data}`
nlohmann::json calibAnythingMatrix(const Eigen::MatrixXd& matrix);

/// Sets cam_K and cam_dist. @throw Error(kCamera) for models that the format has no room for.
void setCalibAnythingCamera(const Intrinsics& intrinsics, nlohmann::json& root);

}  // namespace lidar_camera_recalibration

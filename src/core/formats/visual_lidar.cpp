// calib.json of direct_visual_lidar_calibration (koide3). Conventions from its docs/calibration.md and
// src/camera/create_camera.cpp: results/T_lidar_camera is [x y z qx qy qz qw] and maps points of the camera's
// optical frame into the LiDAR frame, the inverse of T_camera_lidar; init_T_lidar_camera (by hand) and
// init_T_lidar_camera_auto are guesses of the same kind; camera/intrinsics is [fx fy cx cy], of the image as
// taken.

#include <stdexcept>

#include "format.hpp"
#include "json.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

using nlohmann::json;

Intrinsics intrinsicsOf(const json& root) {
  const json& camera = jsonMember(root, "camera");
  const auto values = jsonValue<std::vector<double>>(camera, "intrinsics", "camera");
  if (values.size() != 4)
    throw std::runtime_error("camera/intrinsics has " + std::to_string(values.size()) +
                             " numbers, not 4 (fx fy cx cy)");
  Intrinsics intrinsics;
  intrinsics.fx = values[0];
  intrinsics.fy = values[1];
  intrinsics.cx = values[2];
  intrinsics.cy = values[3];
  // Its own names are those of ROS; a model without its like here (atan, omnidir, equirectangular) is
  // refused.
  intrinsics.model = distortionModelFromName(jsonValue<std::string>(camera, "camera_model", "camera"));
  intrinsics.distortion = jsonValue<std::vector<double>>(camera, "distortion_coeffs", "camera");
  return intrinsics;
}

/// The result, else the guesses in the order in which its `calibrate` takes them.
Eigen::Isometry3d extrinsicOf(const json& root) {
  const json& results = jsonMember(root, "results");
  for (const char* key : {"T_lidar_camera", "init_T_lidar_camera", "init_T_lidar_camera_auto"}) {
    if (results.count(key) == 0) continue;
    const auto values = jsonValue<std::vector<double>>(results, key, "results");
    if (values.size() != 7)
      throw std::runtime_error(std::string("results/") + key + " has " + std::to_string(values.size()) +
                               " numbers, not 7 (x y z qx qy qz qw)");
    return poseFromQuaternion(Eigen::Map<const Eigen::Vector3d>(values.data()),
                              Eigen::Map<const Eigen::Vector4d>(values.data() + 3))
        .inverse();
  }
  throw std::runtime_error(
      "results holds none of T_lidar_camera, init_T_lidar_camera and init_T_lidar_camera_auto");
}

CalibrationContents read(const FormatSource& source) {
  const json root = json::parse(source.text);
  CalibrationContents contents;
  contents.intrinsics = intrinsicsOf(root);
  if (root.count("results") == 0) return contents;  // only preprocessed
  contents.calibration.emplace();
  contents.calibration->T_camera_lidar = extrinsicOf(root);
  return contents;
}

std::string write(const CalibrationContents& contents, const FormatTarget& target) {
  json root = target.existing.empty() ? json::object() : json::parse(target.existing);
  if (contents.intrinsics || target.existing.empty()) {
    const Intrinsics& intrinsics = requireIntrinsics(contents);
    const bool equidistant = intrinsics.model == DistortionModel::kEquidistant;
    if (intrinsics.model == DistortionModel::kRationalPolynomial)
      throw std::runtime_error("the format has no rational_polynomial distortion");
    root["camera"] = {{"camera_model", equidistant ? "fisheye" : "plumb_bob"},
                      {"intrinsics", {intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy}},
                      {"distortion_coeffs", intrinsics.distortion}};
    if (intrinsics.distortion.empty()) root["camera"]["distortion_coeffs"] = std::vector<double>(5, 0.0);
  }
  const Eigen::Isometry3d T_lidar_camera = requireCalibration(contents).T_camera_lidar.inverse();
  const Eigen::Vector3d t = T_lidar_camera.translation();
  const Eigen::Vector4d q = quaternion(T_lidar_camera.linear());
  root["results"]["T_lidar_camera"] = {t[0], t[1], t[2], q[0], q[1], q[2], q[3]};
  return root.dump(2) + "\n";
}

bool recognises(const std::string& text) {
  if (!isJsonObjectWith(text, {"camera"})) return false;
  const json root = json::parse(text);
  return root["camera"].is_object() && root["camera"].count("camera_model") > 0;
}

}  // namespace

const Format kVisualLidar = {"visual_lidar",
                             "calib.json of direct_visual_lidar_calibration",
                             {true, true},
                             recognises,
                             [](const std::string&) { return false; },  // calib.json is also CalibAnything's
                             read,
                             write};

}  // namespace lidar_camera_recalibration

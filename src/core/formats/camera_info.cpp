// The YAML file that ROS's camera_calibration writes and camera_info_manager reads
// (camera_calibration_parsers): the fields of sensor_msgs/CameraInfo. camera_matrix K and
// distortion_coefficients D are of the image as it was taken, projection_matrix P of the rectified one. Its
// fourth column is left out: the extrinsic is that of this camera.

#include <yaml-cpp/yaml.h>

#include <stdexcept>

#include "format.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

YAML::Node member(const YAML::Node& root, const std::string& key) {
  if (!root[key]) throw std::runtime_error("the key " + key + " is missing");
  return root[key];
}

std::vector<double> data(const YAML::Node& root, const std::string& key) {
  const YAML::Node matrix = member(root, key);
  try {
    if (matrix.IsMap() && matrix["data"]) return matrix["data"].as<std::vector<double>>();
  } catch (const YAML::Exception&) {
  }
  throw std::runtime_error(key + " has no list `data` of numbers");
}

std::vector<double> data(const YAML::Node& root, const std::string& key, std::size_t count) {
  const std::vector<double> values = data(root, key);
  if (values.size() != count)
    throw std::runtime_error(key + " holds " + std::to_string(values.size()) + " numbers, not " +
                             std::to_string(count));
  return values;
}

int size(const YAML::Node& root, const std::string& key) {
  try {
    return member(root, key).as<int>();
  } catch (const YAML::Exception&) {
    throw std::runtime_error(key + " is no whole number");
  }
}

CalibrationContents read(const FormatSource& source) {
  const YAML::Node root = YAML::Load(source.text);
  Intrinsics intrinsics;
  intrinsics.width = size(root, "image_width");
  intrinsics.height = size(root, "image_height");
  CalibrationContents contents;
  if (root["projection_matrix"]) {
    const std::vector<double> P = data(root, "projection_matrix", 12);
    contents.rectified = intrinsics;
    contents.rectified->fx = P[0];
    contents.rectified->fy = P[5];
    contents.rectified->cx = P[2];
    contents.rectified->cy = P[6];
  }
  const std::vector<double> K = data(root, "camera_matrix", 9);
  intrinsics.fx = K[0];
  intrinsics.fy = K[4];
  intrinsics.cx = K[2];
  intrinsics.cy = K[5];
  intrinsics.distortion = data(root, "distortion_coefficients");
  intrinsics.model = distortionModelFromName(member(root, "distortion_model").as<std::string>());
  contents.intrinsics = intrinsics;
  return contents;
}

std::string matrix(const char* key, int rows, int cols, const std::vector<double>& values) {
  return std::string(key) + ":\n  rows: " + std::to_string(rows) + "\n  cols: " + std::to_string(cols) +
         "\n  data: [" + numbers(values, ", ") + "]\n";
}

std::string write(const CalibrationContents& contents, const FormatTarget& target) {
  const Intrinsics& i = requireSizedIntrinsics(contents);
  const Intrinsics& r = contents.rectified ? *contents.rectified : i;
  std::string name = "camera";
  if (!target.existing.empty()) name = YAML::Load(target.existing)["camera_name"].as<std::string>(name);
  const bool none = i.model == DistortionModel::kNone;
  const std::vector<double> D = none ? std::vector<double>(5, 0.0) : i.distortion;
  YAML::Emitter quoted;
  quoted << name;
  return "image_width: " + std::to_string(i.width) + "\nimage_height: " + std::to_string(i.height) +
         "\ncamera_name: " + quoted.c_str() + "\n" +
         matrix("camera_matrix", 3, 3, {i.fx, 0.0, i.cx, 0.0, i.fy, i.cy, 0.0, 0.0, 1.0}) +
         "distortion_model: " + (none ? "plumb_bob" : lidar_camera_recalibration::name(i.model)) + "\n" +
         matrix("distortion_coefficients", 1, static_cast<int>(D.size()), D) +
         matrix("rectification_matrix", 3, 3, {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}) +
         matrix("projection_matrix", 3, 4, {r.fx, 0.0, r.cx, 0.0, 0.0, r.fy, r.cy, 0.0, 0.0, 0.0, 1.0, 0.0});
}

}  // namespace

const Format kCameraInfo = {
    "camera_info",
    "ROS camera_info YAML, as camera_calibration writes it",
    {false, true},
    [](const std::string& text) {
      return isYamlMapWith(text, {"camera_matrix", "image_width"});
    },
    [](const std::string& name) {
      return name.find("camera_info") != std::string::npos && hasEnding(name, {".yaml", ".yml"});
    },
    read,
    write};

}  // namespace lidar_camera_recalibration

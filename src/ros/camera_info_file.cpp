#include "camera_info_file.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <vector>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace {

class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path) {
    try {
      root_ = YAML::LoadFile(path);
    } catch (const std::exception& error) {
      refuse(std::string("cannot be read: ") + error.what());
    }
    if (!root_.IsMap()) refuse("holds no `name: value` pairs");
  }

  bool has(const char* key) const { return static_cast<bool>(root_[key]); }

  template <class T>
  T value(const char* key) const {
    try {
      return root_[key].as<T>();
    } catch (const YAML::Exception&) {
      refuse(std::string(key) + " is missing or of the wrong kind");
    }
  }

  /// A matrix as OpenCV writes it: only `data` counts.
  std::vector<double> numbers(const char* key) const {
    try {
      return root_[key]["data"].as<std::vector<double>>();
    } catch (const YAML::Exception&) {
      refuse(std::string(key) + ": data must be a list of numbers");
    }
  }

  template <class Array>
  void read(const char* key, Array& target) const {
    if (!has(key)) return;
    const std::vector<double> data = numbers(key);
    if (data.size() != target.size()) {
      refuse(std::string(key) + ": data has " + std::to_string(data.size()) + " numbers instead of " +
             std::to_string(target.size()));
    }
    std::copy(data.begin(), data.end(), target.begin());
  }

  [[noreturn]] void refuse(const std::string& what) const {
    throw Error(ErrorCause::kFile, "camera_info file " + path_ + ": " + what);
  }

 private:
  std::string path_;
  YAML::Node root_;
};

}  // namespace

sensor_msgs::CameraInfo readCameraInfoFile(const std::string& path) {
  const Reader reader(path);
  sensor_msgs::CameraInfo info;
  info.width = reader.value<std::uint32_t>("image_width");
  info.height = reader.value<std::uint32_t>("image_height");
  if (!reader.has("camera_matrix") && !reader.has("projection_matrix"))
    reader.refuse("there is neither camera_matrix nor projection_matrix");
  reader.read("camera_matrix", info.K);
  reader.read("rectification_matrix", info.R);
  reader.read("projection_matrix", info.P);
  if (reader.has("distortion_coefficients")) {
    info.distortion_model = reader.value<std::string>("distortion_model");
    info.D = reader.numbers("distortion_coefficients");
  }
  return info;
}

}  // namespace lidar_camera_recalibration

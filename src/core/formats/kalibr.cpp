// Kalibr's camchain.yaml, intrinsics only. Conventions from its wiki (yaml-formats, supported-models):
// intrinsics of `pinhole` are [fu fv pu pv] with pixel centres at integers, `radtan` is [k1 k2 p1 p2] as in
// ROS's plumb_bob, `equidistant` [k1 k2 k3 k4], resolution [width height], of the image as it was taken.

#include <yaml-cpp/yaml.h>

#include <stdexcept>

#include "format.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

const std::string& cameraName(const FormatOptions& options) {
  static const std::string first = "cam0";
  return options.camera.empty() ? first : options.camera;
}

template <typename Value>
Value value(const YAML::Node& camera, const char* key) {
  if (!camera[key]) throw std::runtime_error(std::string("the key ") + key + " is missing");
  try {
    return camera[key].as<Value>();
  } catch (const YAML::Exception&) {
    throw std::runtime_error(std::string("the key ") + key + " has an unsuitable value");
  }
}

template <typename Value>
std::vector<Value> list(const YAML::Node& camera, const char* key, std::size_t count) {
  const auto values = value<std::vector<Value>>(camera, key);
  if (values.size() != count)
    throw std::runtime_error(std::string(key) + " has " + std::to_string(values.size()) + " numbers, not " +
                             std::to_string(count));
  return values;
}

DistortionModel distortionModel(const std::string& name) {
  if (name == "radtan") return DistortionModel::kPlumbBob;
  if (name == "equidistant") return DistortionModel::kEquidistant;
  if (name == "none") return DistortionModel::kNone;
  throw std::runtime_error("the distortion model '" + name + "' is none of radtan, equidistant, none");
}

CalibrationContents read(const FormatSource& source) {
  const YAML::Node root = YAML::Load(source.text);
  const std::string& name = cameraName(source.options);
  const YAML::Node camera = root[name];
  if (!camera || !camera.IsMap()) throw std::runtime_error("there is no camera '" + name + "'; name another");
  const std::string model = value<std::string>(camera, "camera_model");
  if (model != "pinhole") throw std::runtime_error("the camera model '" + model + "' is not pinhole");
  Intrinsics intrinsics;
  const std::vector<double> pinhole = list<double>(camera, "intrinsics", 4);
  intrinsics.fx = pinhole[0];
  intrinsics.fy = pinhole[1];
  intrinsics.cx = pinhole[2];
  intrinsics.cy = pinhole[3];
  const std::vector<int> size = list<int>(camera, "resolution", 2);
  intrinsics.width = size[0];
  intrinsics.height = size[1];
  intrinsics.model = distortionModel(value<std::string>(camera, "distortion_model"));
  if (intrinsics.model != DistortionModel::kNone)
    intrinsics.distortion = list<double>(camera, "distortion_coeffs", 4);
  CalibrationContents contents;
  contents.intrinsics = intrinsics;
  return contents;
}

std::string write(const CalibrationContents& contents, const FormatTarget& target) {
  const Intrinsics& intrinsics = requireSizedIntrinsics(contents);
  std::vector<double> distortion = intrinsics.distortion;
  if (intrinsics.model == DistortionModel::kPlumbBob && distortion.size() == 5 && distortion[4] == 0.0)
    distortion.pop_back();
  if (intrinsics.model == DistortionModel::kRationalPolynomial ||
      (intrinsics.model == DistortionModel::kPlumbBob && distortion.size() > 4))
    throw std::runtime_error("Kalibr's radtan has four coefficients, k1 k2 p1 p2; the camera has more");
  if (distortion.empty()) distortion.assign(4, 0.0);
  const bool equidistant = intrinsics.model == DistortionModel::kEquidistant;
  const auto flow = [](YAML::Node node) {
    node.SetStyle(YAML::EmitterStyle::Flow);
    return node;
  };
  const auto numberList = [&flow](const std::vector<double>& values) {
    YAML::Node node;
    for (const double entry : values) node.push_back(number(entry));
    return flow(node);
  };
  YAML::Node root = YAML::Load(target.existing.empty() ? "{}" : target.existing);
  root.SetStyle(YAML::EmitterStyle::Block);
  YAML::Node camera = root[cameraName(target.options)];
  camera["camera_model"] = "pinhole";
  camera["intrinsics"] = numberList({intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy});
  camera["distortion_model"] = equidistant ? "equidistant" : "radtan";
  camera["distortion_coeffs"] = numberList(distortion);
  YAML::Node size;
  size.push_back(intrinsics.width);
  size.push_back(intrinsics.height);
  camera["resolution"] = flow(size);
  return YAML::Dump(root) + "\n";
}

}  // namespace

const Format kKalibr = {"kalibr",
                        "Kalibr's camchain.yaml",
                        {false, true},
                        [](const std::string& text) {
                          if (!isYamlMapWith(text, {"cam0"})) return false;
                          const YAML::Node camera = YAML::Load(text)["cam0"];
                          return camera.IsMap() && camera["camera_model"];
                        },
                        [](const std::string& name) {
                          return name.find("camchain") != std::string::npos && hasEnding(name, {".yaml"});
                        },
                        read,
                        write};

}  // namespace lidar_camera_recalibration

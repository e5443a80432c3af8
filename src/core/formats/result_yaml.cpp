#include "lidar_camera_recalibration/result_file.hpp"

#include <yaml-cpp/yaml.h>

#include "format.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr const char* kHeader =
    R"(# Extrinsic calibration of a LiDAR and a camera.
#
# T_camera_lidar maps points of the LiDAR frame into the camera's optical frame (z forward, x right, y down):
#   p_camera = T_camera_lidar * p_lidar      [m]
# translation, quaternion (x y z w) and rpy [rad] say the same in other words.
#
# static_transform_publisher and urdf_origin hold the inverse, as ROS wants it: the pose of the camera's optical
# frame (child) in the LiDAR frame (parent). Paste them as they are.
)";

// --- writing ---

template <typename Vector>
void emitList(YAML::Emitter& out, const Vector& values) {
  out << YAML::Flow << YAML::BeginSeq;
  for (Eigen::Index i = 0; i < values.size(); ++i) out << number(values[i]);
  out << YAML::EndSeq;
}

template <typename Matrix>
void emitRows(YAML::Emitter& out, const Matrix& matrix) {
  out << YAML::Block << YAML::BeginSeq;
  for (Eigen::Index row = 0; row < matrix.rows(); ++row) emitList(out, matrix.row(row));
  out << YAML::EndSeq;
}

void emitTransforms(YAML::Emitter& out, const StoredCalibration& c) {
  out << YAML::Key << "T_camera_lidar" << YAML::Value;
  emitRows(out, c.T_camera_lidar.matrix());
  out << YAML::Key << "camera_frame" << YAML::Value << c.camera_frame;
  out << YAML::Key << "lidar_frame" << YAML::Value << c.lidar_frame;
  out << YAML::Key << "translation" << YAML::Value;
  emitList(out, c.T_camera_lidar.translation());
  out << YAML::Key << "quaternion" << YAML::Value;
  emitList(out, quaternion(c.T_camera_lidar.linear()));
  out << YAML::Key << "rpy" << YAML::Value;
  emitList(out, rollPitchYaw(c.T_camera_lidar.linear()));
  out << YAML::Newline << YAML::Newline;
  out << YAML::Key << "static_transform_publisher" << YAML::Value << staticTransformPublisher(c);
  out << YAML::Key << "urdf_origin" << YAML::Value << YAML::SingleQuoted << urdfOrigin(c);
  out << YAML::Newline << YAML::Newline;
}

// --- reading ---

/// One level of lists is flattened, so 16 numbers and 4 rows of 4 read alike.
std::vector<double> readNumbers(const YAML::Node& node) {
  std::vector<double> values;
  for (const YAML::Node& item : node) {
    if (!item.IsSequence()) {
      values.push_back(item.as<double>());
      continue;
    }
    for (const YAML::Node& value : item) values.push_back(value.as<double>());
  }
  return values;
}

template <int size>
Eigen::Matrix<double, size, size> readSquare(const std::string& key, YAML::Node node) {
  using RowMajor = Eigen::Matrix<double, size, size, Eigen::RowMajor>;
  if (node.IsMap() && node["data"]) node.reset(node["data"]);  // rows, cols, data
  const std::vector<double> values = readNumbers(node);
  if (values.size() != size * size) {
    throw std::runtime_error(key + " holds " + std::to_string(values.size()) + " numbers, not " +
                             std::to_string(size * size) + " (rows of " + std::to_string(size) + ")");
  }
  return Eigen::Map<const RowMajor>(values.data());
}

template <typename Value>
void readOptional(const YAML::Node& root, const char* key, Value& value) {
  const YAML::Node node = root[key];
  if (!node || node.IsNull()) return;
  try {
    value = node.as<Value>();
  } catch (const YAML::Exception&) {
    throw std::runtime_error(std::string(key) + " has an unsuitable value");
  }
}

/// 0 where it is missing, as in files of older versions.
std::size_t readCount(const YAML::Node& root, const char* key) {
  std::int64_t count = 0;
  readOptional(root, key, count);
  if (count < 0) throw std::runtime_error(std::string(key) + " is negative");
  return static_cast<std::size_t>(count);
}

StoredCalibration parse(const std::string& text) {
  const YAML::Node root = YAML::Load(text);
  if (!root.IsMap()) throw std::runtime_error("is not a list of `key: value`");
  StoredCalibration c;
  if (!root["T_camera_lidar"]) throw std::runtime_error("holds no T_camera_lidar (4 rows of 4 numbers)");
  c.T_camera_lidar = isometryFromMatrix(readSquare<4>("T_camera_lidar", root["T_camera_lidar"]));
  if (root["covariance"]) {
    c.covariance = readSquare<6>("covariance", root["covariance"]);
    if (!c.covariance->allFinite()) throw std::runtime_error("covariance holds NaN or infinity");
  }
  readOptional(root, "camera_frame", c.camera_frame);
  readOptional(root, "lidar_frame", c.lidar_frame);
  readOptional(root, "score_before", c.score_before);
  readOptional(root, "score_after", c.score_after);
  readOptional(root, "accepted", c.accepted);
  readOptional(root, "reason", c.reason);
  readOptional(root, "stamp", c.stamp);
  readOptional(root, "source", c.source);
  c.frames = readCount(root, "frames");
  c.frames_left_out = readCount(root, "frames_left_out");
  return c;
}

// --- the format ---

CalibrationContents read(const FormatSource& source) {
  CalibrationContents contents;
  contents.calibration = parse(source.text);
  return contents;
}

std::string write(const CalibrationContents& contents, const FormatTarget&) {
  return toYaml(requireCalibration(contents));
}

}  // namespace

const Format kResultYaml = {"yaml",
                            "this package's result file: extrinsic, covariance, scores",
                            {true, false},
                            [](const std::string& text) { return isYamlMapWith(text, {"T_camera_lidar"}); },
                            [](const std::string& name) {
                              return hasEnding(name, {".yaml", ".yml"});
                            },
                            read,
                            write};

std::string staticTransformPublisher(const StoredCalibration& calibration) {
  const Eigen::Isometry3d T_lidar_camera = calibration.T_camera_lidar.inverse();
  return "rosrun tf2_ros static_transform_publisher " + numbers(T_lidar_camera.translation()) + " " +
         numbers(quaternion(T_lidar_camera.linear())) + " " + calibration.lidar_frame + " " +
         calibration.camera_frame;
}

std::string urdfOrigin(const StoredCalibration& calibration) {
  const Eigen::Isometry3d T_lidar_camera = calibration.T_camera_lidar.inverse();
  return "<origin xyz=\"" + numbers(T_lidar_camera.translation()) + "\" rpy=\"" +
         numbers(rollPitchYaw(T_lidar_camera.linear())) + "\"/>";
}

std::string toYaml(const StoredCalibration& c) {
  YAML::Emitter out;
  out << YAML::BeginMap;
  emitTransforms(out, c);
  if (c.covariance) {
    out << YAML::Comment(
               "of the perturbation (rx, ry, rz, tx, ty, tz) in the camera's optical frame [rad^2, m^2]")
        << YAML::Newline;
    out << YAML::Key << "covariance" << YAML::Value;
    emitRows(out, *c.covariance);
    out << YAML::Newline << YAML::Newline;
  }
  out << YAML::Key << "score_before" << YAML::Value << number(c.score_before);
  out << YAML::Key << "score_after" << YAML::Value << number(c.score_after);
  out << YAML::Key << "accepted" << YAML::Value << c.accepted;
  out << YAML::Key << "reason" << YAML::Value << c.reason;
  out << YAML::Key << "frames" << YAML::Value << std::to_string(c.frames);
  out << YAML::Key << "frames_left_out" << YAML::Value << std::to_string(c.frames_left_out);
  out << YAML::Key << "stamp" << YAML::Value << number(c.stamp);
  out << YAML::Key << "source" << YAML::Value << c.source;
  out << YAML::Key << "package_version" << YAML::Value << PACKAGE_VERSION;
  out << YAML::EndMap;
  return std::string(kHeader) + out.c_str() + "\n";
}

StoredCalibration readCalibration(const std::string& path) {
  const std::string text = readCalibrationText(path);
  try {
    return parse(text);
  } catch (const std::exception& error) {  // of yaml-cpp, of isometryFromMatrix() and our own
    throw Error(ErrorCause::kFile, "calibration file '" + path + "': " + error.what());
  }
}

void writeCalibration(const std::string& path, const StoredCalibration& calibration) {
  writeFileAtomically(path, toYaml(calibration));
}

}  // namespace lidar_camera_recalibration

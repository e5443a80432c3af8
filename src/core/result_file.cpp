#include "lidar_camera_recalibration/result_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <locale>
#include <sstream>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMaxFileSize = 1024 * 1024;  // [bytes]; a calibration has about 3 KB

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

/// The shortest decimal that reads back as the same double, whatever the process's locale.
std::string number(double value) {
  if (std::isnan(value)) return ".nan";
  if (std::isinf(value)) return value > 0.0 ? ".inf" : "-.inf";
  for (int digits = 15;; ++digits) {
    std::ostringstream out;
    out.imbue(std::locale::classic());
    out.precision(digits);
    out << value;
    std::istringstream in(out.str());
    in.imbue(std::locale::classic());
    double back = 0.0;
    // A denormal fails to read although it was parsed, so the value alone counts.
    in >> back;
    if (back != value && digits < 17) continue;
    std::string text = out.str();
    const std::size_t exponent = text.find('e');
    // YAML 1.1 readers such as Python's take 1e-05 for a string.
    if (exponent != std::string::npos && text.find('.') == std::string::npos) text.insert(exponent, ".0");
    return text;
  }
}

template <typename Vector>
std::string numbers(const Vector& values) {
  std::string text;
  for (Eigen::Index i = 0; i < values.size(); ++i) text += (i == 0 ? "" : " ") + number(values[i]);
  return text;
}

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

/// Roll, pitch, yaw about fixed axes as in URDF: R = Rz(yaw) * Ry(pitch) * Rx(roll).
Eigen::Vector3d rollPitchYaw(const Eigen::Matrix3d& R) {
  const double cos_pitch = std::hypot(R(0, 0), R(1, 0));
  const double pitch = std::atan2(-R(2, 0), cos_pitch);
  if (cos_pitch < 1e-9) return {0.0, pitch, std::atan2(-R(0, 1), R(1, 1))};  // only roll -+ yaw is defined
  return {std::atan2(R(2, 1), R(2, 2)), pitch, std::atan2(R(1, 0), R(0, 0))};
}

/// x y z w, with w >= 0
Eigen::Vector4d quaternion(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond q(R);
  q.normalize();
  return q.w() < 0.0 ? Eigen::Vector4d(-q.coeffs()) : Eigen::Vector4d(q.coeffs());
}

void emitTransforms(YAML::Emitter& out, const StoredCalibration& c) {
  const Eigen::Isometry3d T_lidar_camera = c.T_camera_lidar.inverse();
  const std::string publisher =
      "rosrun tf2_ros static_transform_publisher " + numbers(T_lidar_camera.translation()) + " " +
      numbers(quaternion(T_lidar_camera.linear())) + " " + c.lidar_frame + " " + c.camera_frame;
  const std::string origin = "<origin xyz=\"" + numbers(T_lidar_camera.translation()) + "\" rpy=\"" +
                             numbers(rollPitchYaw(T_lidar_camera.linear())) + "\"/>";
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
  out << YAML::Key << "static_transform_publisher" << YAML::Value << publisher;
  out << YAML::Key << "urdf_origin" << YAML::Value << YAML::SingleQuoted << origin;
  out << YAML::Newline << YAML::Newline;
}

// --- reading ---

Error fileError(const std::string& path, const std::string& what) {
  return Error(ErrorCause::kFile, "calibration file '" + path + "': " + what);
}

std::string readText(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) throw fileError(path, std::strerror(errno));
  if (!S_ISREG(status.st_mode)) throw fileError(path, "is not a regular file");
  if (static_cast<std::size_t>(status.st_size) > kMaxFileSize) {
    throw fileError(path,
                    "has " + std::to_string(status.st_size) + " bytes; a calibration has less than 1 MB");
  }
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file.is_open() || file.bad()) throw fileError(path, std::strerror(errno));
  return text;
}

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

Eigen::Isometry3d readExtrinsic(const YAML::Node& root) {
  for (const char* key : {"T_camera_lidar", "T_lidar_to_cam"}) {
    if (root[key]) return isometryFromMatrix(readSquare<4>(key, root[key]));
  }
  throw std::runtime_error(
      "holds neither T_camera_lidar (4 rows of 4 numbers) nor CalibAnything's T_lidar_to_cam");
}

StoredCalibration parse(const std::string& text) {
  const YAML::Node root = YAML::Load(text);
  if (!root.IsMap()) throw std::runtime_error("is not a list of `key: value`");
  StoredCalibration c;
  c.T_camera_lidar = readExtrinsic(root);
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

// --- files ---

bool writeAll(int file, const std::string& text) {
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t count = ::write(file, text.data() + done, text.size() - done);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    done += static_cast<std::size_t>(count);
  }
  return true;
}

/// Not even a power cut may leave the new name without its content, hence fsync before the rename.
bool writeAndRename(int file, const std::string& temporary, const std::string& path,
                    const std::string& text) {
  const bool written = writeAll(file, text) && ::fsync(file) == 0;
  const int error = errno;
  const bool closed = ::close(file) == 0;
  if (!written) errno = error;
  return written && closed && ::rename(temporary.c_str(), path.c_str()) == 0;
}

}  // namespace

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
  const std::string text = readText(path);
  try {
    return parse(text);
  } catch (const std::exception& error) {  // of yaml-cpp, of isometryFromMatrix() and our own
    throw fileError(path, error.what());
  }
}

void writeCalibration(const std::string& path, const StoredCalibration& calibration) {
  writeFileAtomically(path, toYaml(calibration));
}

void writeFileAtomically(const std::string& path, const std::string& text) {
  static std::atomic<unsigned> counter{0};
  const std::string temporary =
      path + "." + std::to_string(::getpid()) + "." + std::to_string(counter++) + ".tmp";
  const auto fail = [&path](int error) {
    return Error(ErrorCause::kFile, "cannot write '" + path + "': " + std::strerror(error) +
                                        "; give a file in an existing, writable folder with free space");
  };
  const int file = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (file < 0) throw fail(errno);
  if (!writeAndRename(file, temporary, path, text)) {
    const int error = errno;
    ::unlink(temporary.c_str());
    throw fail(error);
  }
}

}  // namespace lidar_camera_recalibration

// KITTI's text files. Conventions from the development kits' readme.txt of the raw data and of the odometry
// benchmark (Geiger et al., 2013): a pixel of the rectified camera N is P_rect_0N * R_rect_00 * [R T] *
// p_lidar for raw data and PN * Tr * p_lidar for odometry. [R T] leads into the camera 0 before
// rectification, Tr into the rectified camera 0. P = K [I | t]: t is the way from the rectified camera 0 to
// camera N, which belongs to the extrinsic of camera N.

#include <array>
#include <map>
#include <sstream>
#include <stdexcept>

#include "format.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

constexpr const char* kCamToCam = "calib_cam_to_cam.txt";

/// `KEY: number number ...` a line; lines whose values are no numbers (dates) are left out.
using Lines = std::map<std::string, std::vector<double>>;

Lines linesOf(const std::string& text) {
  Lines lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    const std::size_t colon = line.find(':');
    if (colon == std::string::npos) continue;
    const std::string key = line.substr(0, colon);
    try {
      const std::vector<double> values = numbersFrom(line.substr(colon + 1));
      if (!values.empty()) lines[key] = values;
    } catch (const std::runtime_error& error) {
      if (key != "calib_time") throw std::runtime_error("\"" + key + ":\" " + error.what());
    }
  }
  return lines;
}

const std::vector<double>& numbersOf(const Lines& lines, const std::string& key, std::size_t count) {
  const auto found = lines.find(key);
  if (found == lines.end()) throw std::runtime_error("has no line \"" + key + ":\" with numbers");
  if (found->second.size() != count)
    throw std::runtime_error("\"" + key + ":\" has " + std::to_string(found->second.size()) + " numbers, " +
                             std::to_string(count) + " are expected");
  return found->second;
}

Eigen::Isometry3d rotation(const std::vector<double>& R) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data());
  return isometryFromMatrix(matrix);
}

Eigen::Isometry3d rigid3x4(const std::vector<double>& numbers) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topRows<3>() = Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
  return isometryFromMatrix(matrix);
}

/// What P = K [I | t] of a rectified camera tells.
struct Projection {
  Intrinsics intrinsics;
  Eigen::Isometry3d T_camera_camera0;  ///< both rectified
};

Projection projection(const std::vector<double>& numbers) {
  const Eigen::Matrix<double, 3, 4> P =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
  Projection result;
  result.intrinsics.fx = P(0, 0);
  result.intrinsics.fy = P(1, 1);
  result.intrinsics.cx = P(0, 2);
  result.intrinsics.cy = P(1, 2);
  if (!(result.intrinsics.fx > 0.0 && result.intrinsics.fy > 0.0))
    throw std::runtime_error("the focal lengths of the projection matrix are not positive");
  result.T_camera_camera0 = Eigen::Isometry3d::Identity();
  result.T_camera_camera0.translation() = cameraMatrix(result.intrinsics).inverse() * P.col(3);
  return result;
}

/// 0 to 3, from "2", "02" or "image_02".
char cameraDigit(const FormatOptions& options) {
  if (options.camera.empty()) return '2';
  const char digit = options.camera.back();
  if (digit < '0' || digit > '3')
    throw std::runtime_error("the camera '" + options.camera + "' is none of KITTI's 0, 1, 2, 3");
  return digit;
}

CalibrationContents contentsOf(const Eigen::Isometry3d& T_camera_lidar) {
  CalibrationContents contents;
  contents.calibration.emplace();
  contents.calibration->T_camera_lidar = T_camera_lidar;
  return contents;
}

// --- raw data ---

struct Rectification {
  Projection projection;
  Eigen::Isometry3d T_camera_unrectified0;
};

/// Of the file beside it; nothing if there is none.
std::optional<Rectification> rectification(const fs::path& lidar_file, const FormatOptions& options) {
  const fs::path file = lidar_file.parent_path() / kCamToCam;
  if (lidar_file.empty() || !fs::exists(file)) return std::nullopt;
  const Lines lines = linesOf(readCalibrationText(file.string()));
  const std::string camera = std::string("0") + cameraDigit(options);
  try {
    Rectification result;
    result.projection = projection(numbersOf(lines, "P_rect_" + camera, 12));
    const std::vector<double>& size = numbersOf(lines, "S_rect_" + camera, 2);
    result.projection.intrinsics.width = static_cast<int>(size[0]);
    result.projection.intrinsics.height = static_cast<int>(size[1]);
    result.T_camera_unrectified0 =
        result.projection.T_camera_camera0 * rotation(numbersOf(lines, "R_rect_00", 9));
    return result;
  } catch (const std::exception& error) {
    throw std::runtime_error("the file " + file.string() + " beside it: " + error.what());
  }
}

CalibrationContents readRaw(const FormatSource& source) {
  const Lines lines = linesOf(source.text);
  const Eigen::Vector3d T = Eigen::Map<const Eigen::Vector3d>(numbersOf(lines, "T", 3).data());
  const Eigen::Isometry3d T_camera0_lidar = Eigen::Translation3d(T) * rotation(numbersOf(lines, "R", 9));
  const std::optional<Rectification> rectified = rectification(source.path, source.options);
  CalibrationContents contents =
      contentsOf(rectified ? rectified->T_camera_unrectified0 * T_camera0_lidar : T_camera0_lidar);
  if (rectified) {
    contents.intrinsics = rectified->projection.intrinsics;
  } else {
    contents.notes.push_back(
        std::string("there is no ") + kCamToCam +
        " beside it, so R and T are taken to lead to this camera itself, without rectification");
  }
  return contents;
}

std::string writeRaw(const CalibrationContents& contents, const FormatTarget& target) {
  const std::optional<Rectification> rectified = rectification(target.path, target.options);
  Eigen::Isometry3d T = requireCalibration(contents).T_camera_lidar;
  if (rectified) T = rectified->T_camera_unrectified0.inverse() * T;
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> R = T.linear();
  std::string text;
  // What the file says besides (calib_time of other sensors, delta_f and delta_c) stays.
  std::istringstream existing(target.existing);
  for (std::string line; std::getline(existing, line);) {
    if (line.rfind("R:", 0) != 0 && line.rfind("T:", 0) != 0) text += line + "\n";
  }
  return text + "R: " + numbers(Eigen::Map<const Eigen::Matrix<double, 9, 1>>(R.data())) +
         "\nT: " + numbers(T.translation()) + "\n";
}

// --- odometry ---

CalibrationContents readOdometry(const FormatSource& source) {
  const Lines lines = linesOf(source.text);
  const std::string key = std::string("P") + cameraDigit(source.options);
  const Projection camera = projection(numbersOf(lines, key, 12));
  const std::vector<double>& Tr = numbersOf(lines, "Tr", 12);
  try {
    CalibrationContents contents = contentsOf(camera.T_camera_camera0 * rigid3x4(Tr));
    contents.intrinsics = camera.intrinsics;
    return contents;
  } catch (const std::exception& error) {
    throw std::runtime_error(key + " and Tr: " + error.what());
  }
}

std::string line3x4(const std::string& key, const Eigen::Matrix4d& matrix) {
  const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> rows = matrix.topRows<3>();
  return key + ": " + numbers(Eigen::Map<const Eigen::Matrix<double, 12, 1>>(rows.data())) + "\n";
}

std::string writeOdometry(const CalibrationContents& contents, const FormatTarget& target) {
  const Eigen::Isometry3d& T = requireCalibration(contents).T_camera_lidar;
  if (target.existing.empty()) {
    const Intrinsics& intrinsics = requireIntrinsics(contents);
    if (intrinsics.model != DistortionModel::kNone)
      throw std::runtime_error("the format is for rectified images, but the camera has distortion");
    // Its readers want four cameras; here they are one.
    Eigen::Matrix4d P = Eigen::Matrix4d::Identity();
    P.topLeftCorner<3, 3>() = cameraMatrix(intrinsics);
    std::string text;
    for (const char* key : {"P0", "P1", "P2", "P3"}) text += line3x4(key, P);
    return text + line3x4("Tr", T.matrix());
  }
  const std::string key = std::string("P") + cameraDigit(target.options);
  const Projection camera = projection(numbersOf(linesOf(target.existing), key, 12));
  std::string text;
  std::istringstream existing(target.existing);
  for (std::string line; std::getline(existing, line);) {
    if (line.rfind("Tr:", 0) != 0) text += line + "\n";
  }
  return text + line3x4("Tr", (camera.T_camera_camera0.inverse() * T).matrix());
}

bool hasLines(const std::string& text, std::initializer_list<const char*> keys) {
  for (const char* key : keys) {
    if (text.rfind(key, 0) != 0 && text.find(std::string("\n") + key) == std::string::npos) return false;
  }
  return true;
}

}  // namespace

const Format kKittiRaw = {"kitti_raw",
                          "KITTI raw data, calib_velo_to_cam.txt (with calib_cam_to_cam.txt beside it)",
                          {true, true},
                          [](const std::string& text) {
                            return hasLines(text, {"R:", "T:"});
                          },
                          [](const std::string& name) { return name == "calib_velo_to_cam.txt"; },
                          readRaw,
                          writeRaw};

const Format kKittiOdometry = {
    "kitti_odometry",
    "KITTI odometry, calib.txt",
    {true, true},
    [](const std::string& text) { return hasLines(text, {"Tr:"}) || hasLines(text, {"P2:"}); },
    [](const std::string& name) { return name == "calib.txt"; },
    readOdometry,
    writeOdometry};

}  // namespace lidar_camera_recalibration

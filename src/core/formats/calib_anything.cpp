#include "calib_anything.hpp"

#include <stdexcept>

#include "format.hpp"
#include "json.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "text.hpp"

namespace lidar_camera_recalibration {
namespace {

using nlohmann::json;

Eigen::MatrixXd matrixOf(const json& root, const char* key, std::size_t rows, std::size_t cols) {
  const auto data = jsonValue<std::vector<std::vector<double>>>(jsonMember(root, key), "data", key);
  Eigen::MatrixXd matrix(rows, cols);
  bool right_size = data.size() == rows;
  for (std::size_t r = 0; right_size && r < rows; ++r) {
    right_size = data[r].size() == cols;
    for (std::size_t c = 0; right_size && c < cols; ++c) matrix(r, c) = data[r][c];
  }
  if (!right_size)
    throw std::runtime_error(std::string(key) + " is not " + std::to_string(rows) + "x" +
                             std::to_string(cols));
  return matrix;
}

Eigen::Isometry3d extrinsicOf(const json& root, const char* key) {
  try {
    return isometryFromMatrix(matrixOf(root, key, 4, 4));
  } catch (const Error& error) {
    throw Error(error.cause(), std::string(key) + ": " + error.what());
  }
}

CalibrationContents read(const FormatSource& source) {
  const CalibAnythingFile file = readCalibAnything(json::parse(source.text));
  CalibrationContents contents;
  contents.calibration.emplace();
  contents.calibration->T_camera_lidar = file.T_camera_lidar;
  contents.intrinsics = file.intrinsics;
  return contents;
}

std::string write(const CalibrationContents& contents, const FormatTarget& target) {
  json root = target.existing.empty() ? json::object() : json::parse(target.existing);
  root["T_lidar_to_cam"] = calibAnythingMatrix(requireCalibration(contents).T_camera_lidar.matrix());
  if (contents.intrinsics || target.existing.empty())
    setCalibAnythingCamera(requireIntrinsics(contents), root);
  if (target.existing.empty()) {
    // The program reads these in any case; the names are those of its example.
    root["T_lidar_to_cam_gt"] = {{"available", false}, {"rows", 0}, {"cols", 0}, {"data", json::array()}};
    root["img_folder"] = "images";
    root["img_format"] = ".png";
    root["mask_folder"] = "processed_masks";
    root["pc_folder"] = "pc";
    root["pc_format"] = ".pcd";
    root["file_name"] = json::array();
  }
  return root.dump(2) + "\n";
}

}  // namespace

CalibAnythingFile readCalibAnything(const json& root) {
  CalibAnythingFile file;
  file.T_camera_lidar = extrinsicOf(root, "T_lidar_to_cam");
  const auto truth = root.find("T_lidar_to_cam_gt");
  if (truth != root.end() && truth->is_object() && truth->value("available", false))
    file.truth = extrinsicOf(root, "T_lidar_to_cam_gt");
  if (root.count("cam_K") == 0) return file;
  const Eigen::MatrixXd K = matrixOf(root, "cam_K", 3, 3);
  file.intrinsics.emplace();
  file.intrinsics->fx = K(0, 0);
  file.intrinsics->fy = K(1, 1);
  file.intrinsics->cx = K(0, 2);
  file.intrinsics->cy = K(1, 2);
  if (root.count("cam_dist") == 0) return file;
  try {
    setOpenCvDistortion(jsonValue<std::vector<double>>(root["cam_dist"], "data", "cam_dist"),
                        *file.intrinsics);
  } catch (const Error& error) {
    throw Error(error.cause(), std::string("cam_dist: ") + error.what());
  }
  return file;
}

json calibAnythingMatrix(const Eigen::MatrixXd& matrix) {
  json data = json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    json row = json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    data.push_back(row);
  }
  return {{"rows", matrix.rows()}, {"cols", matrix.cols()}, {"data", data}};
}

void setCalibAnythingCamera(const Intrinsics& intrinsics, json& root) {
  // The format names no model, so its readers take the number of coefficients for it.
  Intrinsics understood;
  const bool pinhole = intrinsics.model != DistortionModel::kEquidistant;
  if (pinhole) setOpenCvDistortion(intrinsics.distortion, understood);
  if (!pinhole || understood.model != intrinsics.model)
    throw Error(ErrorCause::kCamera,
                "CalibAnything's calib.json can hold plumb_bob and rational_polynomial only");
  root["cam_K"] = calibAnythingMatrix(cameraMatrix(intrinsics));
  root["cam_dist"] = {{"cols", intrinsics.distortion.size()}, {"data", intrinsics.distortion}};
}

const Format kCalibAnything = {
    "calib_anything",
    "CalibAnything's calib.json",
    {true, true},
    [](const std::string& text) {
      return isJsonObjectWith(text, {"T_lidar_to_cam", "cam_K"});
    },
    [](const std::string&) { return false; },  // calib.json is also direct_visual_lidar_calibration's
    read,
    write};

}  // namespace lidar_camera_recalibration

#include "dataset_writing.hpp"

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "calib_anything.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/result_file.hpp"

namespace lidar_camera_recalibration {

namespace fs = std::filesystem;

namespace {

/// Column by column what PCL and CalibAnything read.
std::string toPcd(const PointCloud& cloud) {
  const bool has_ring = !cloud.ring.empty();
  std::ostringstream out;
  out << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
      << "FIELDS x y z intensity" << (has_ring ? " ring" : "") << "\nSIZE 4 4 4 4" << (has_ring ? " 2" : "")
      << "\nTYPE F F F F" << (has_ring ? " U" : "") << "\nCOUNT 1 1 1 1" << (has_ring ? " 1" : "")
      << "\nWIDTH " << cloud.size() << "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << cloud.size()
      << "\nDATA binary\n";
  const auto put = [&out](const auto& value) {
    out.write(reinterpret_cast<const char*>(&value), sizeof value);
  };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    for (const float coordinate : cloud.points[i]) put(coordinate);
    put(cloud.hasReflectivity() ? cloud.reflectivity[i] : 0.0F);
    if (has_ring) put(cloud.ring[i]);
  }
  return out.str();
}

/// Layers as channels of one image of 16 bits. PNG has no images of two channels: those get an empty third.
cv::Mat labelImage(const std::vector<cv::Mat>& layers) {
  if (layers.size() > 4) {
    throw Error(ErrorCause::kMasks,
                std::to_string(layers.size()) + " layers of masks; a label image has at most four");
  }
  std::vector<cv::Mat> channels;
  for (const cv::Mat& layer : layers) {
    double least = 0.0, most = 0.0;
    cv::minMaxLoc(layer, &least, &most);
    if (least < 0.0 || most > std::numeric_limits<std::uint16_t>::max())
      throw Error(ErrorCause::kMasks, "ids of masks must fit into 16 bits to become a label image");
    channels.emplace_back();
    layer.convertTo(channels.back(), CV_16U);
  }
  if (channels.size() == 2) channels.push_back(cv::Mat::zeros(channels.front().size(), CV_16UC1));
  cv::Mat image;
  cv::merge(channels, image);
  return image;
}

void writePng(const fs::path& file, const cv::Mat& image) {
  if (!cv::imwrite(file.string(), image))
    throw Error(ErrorCause::kFile, "\"" + file.string() + "\": cannot be written");
}

std::string toCalibJson(const Intrinsics& intrinsics, const Eigen::Isometry3d& T_camera_lidar,
                        const std::vector<std::string>& names, const std::string& note) {
  nlohmann::json root;
  root["note"] = note;
  setCalibAnythingCamera(intrinsics, root);
  root["T_lidar_to_cam"] = root["T_lidar_to_cam_gt"] = calibAnythingMatrix(T_camera_lidar.matrix());
  root["T_lidar_to_cam_gt"]["available"] = true;
  root["img_folder"] = "images";
  root["img_format"] = ".png";
  root["pc_folder"] = "pc";
  root["pc_format"] = ".pcd";
  root["mask_folder"] = "masks";
  root["file_name"] = names;
  return root.dump(2);
}

}  // namespace

DatasetWriter::DatasetWriter(const std::string& folder, const Intrinsics& intrinsics)
    : folder_(folder), intrinsics_(intrinsics) {
  nlohmann::json camera;
  setCalibAnythingCamera(intrinsics, camera);  // whether it can hold this one
  const fs::path calib = folder_ / "calib.json";
  if (fs::exists(calib))
    throw Error(ErrorCause::kFile, "\"" + folder + "\" already holds a dataset; remove it or name another");
  try {
    for (const char* part : {"images", "pc", "masks"}) fs::create_directories(folder_ / part);
  } catch (const fs::filesystem_error& error) {
    throw Error(ErrorCause::kFile, "\"" + folder + "\": cannot be made: " + error.code().message());
  }
}

void DatasetWriter::add(const cv::Mat& image, const std::vector<cv::Mat>& layers, const PointCloud& cloud) {
  char name[16];
  std::snprintf(name, sizeof name, "%06zu", names_.size());
  writePng(folder_ / "images" / (std::string(name) + ".png"), image);
  if (!layers.empty()) writePng(folder_ / "masks" / (std::string(name) + ".png"), labelImage(layers));
  writeFileAtomically((folder_ / "pc" / (std::string(name) + ".pcd")).string(), toPcd(cloud));
  names_.emplace_back(name);
}

void DatasetWriter::finish(const Eigen::Isometry3d& T_camera_lidar, const std::string& note) {
  writeFileAtomically((folder_ / "calib.json").string(),
                      toCalibJson(intrinsics_, T_camera_lidar, names_, note) + "\n");
}

}  // namespace lidar_camera_recalibration

#include "dataset.hpp"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "dataset_files.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {

namespace fs = std::filesystem;

namespace {

struct FrameFiles {
  std::string name;
  double stamp;  ///< [s]
  fs::path image, cloud;
  fs::path masks;  ///< folder of binary masks, or label image without its .png
};

/// What the three layouts come down to.
struct Index {
  std::string layout;
  std::vector<FrameFiles> frames;
  Intrinsics intrinsics;
  std::optional<Eigen::Isometry3d> reference;
};

[[noreturn]] void refuse(const fs::path& file, const std::string& what) {
  throw Error(ErrorCause::kFile, "\"" + file.string() + "\": " + what);
}

/// Layouts without times get one frame a second, as they are selections, not films. Not from 0: that stamp
/// means "no time" in ROS.
double madeUpStamp(std::size_t index) { return 1000.0 + static_cast<double>(index); }

void setSizeFromFirstImage(Index& index, const fs::path& folder) {
  if (index.frames.empty()) refuse(folder, index.layout + ": no image has a cloud of the same name");
  const cv::Mat image = readImage(index.frames.front().image);
  index.intrinsics.width = image.cols;
  index.intrinsics.height = image.rows;
}

Eigen::Isometry3d checkedIsometry(const Eigen::Matrix4d& matrix, const fs::path& file,
                                  const std::string& name) {
  try {
    return isometryFromMatrix(matrix);
  } catch (const Error& error) {
    refuse(file, name + ": " + error.what());
  }
}

// --- CalibAnything ---

/// A name from calib.json as part of a path; one that leads out of the dataset is refused.
fs::path inside(const fs::path& file, const std::string& key, const std::string& name) {
  const fs::path path(name);
  const bool climbs = std::find(path.begin(), path.end(), fs::path("..")) != path.end();
  if (name.empty() || path.is_absolute() || climbs) {
    refuse(file, key + ": \"" + name + "\" does not name something inside of the dataset");
  }
  return path;
}

YAML::Node required(const YAML::Node& node, const std::string& key) {
  if (!node.IsMap() || !node[key]) throw Error(ErrorCause::kFile, "the key " + key + " is missing");
  return node[key];
}

Eigen::MatrixXd matrixOf(const YAML::Node& calib, const std::string& key, int rows, int cols) {
  const auto data = required(required(calib, key), "data").as<std::vector<std::vector<double>>>();
  const bool right_size =
      int(data.size()) == rows &&
      std::all_of(data.begin(), data.end(), [cols](const auto& row) { return int(row.size()) == cols; });
  if (!right_size) {
    throw Error(ErrorCause::kFile, key + " is not " + std::to_string(rows) + "x" + std::to_string(cols));
  }
  Eigen::MatrixXd matrix(rows, cols);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < cols; ++c) matrix(r, c) = data[r][c];
  }
  return matrix;
}

Intrinsics calibAnythingIntrinsics(const YAML::Node& calib) {
  const Eigen::MatrixXd K = matrixOf(calib, "cam_K", 3, 3);
  Intrinsics intrinsics;
  intrinsics.fx = K(0, 0);
  intrinsics.fy = K(1, 1);
  intrinsics.cx = K(0, 2);
  intrinsics.cy = K(1, 2);
  if (!calib["cam_dist"]) return intrinsics;
  const auto distortion = required(calib["cam_dist"], "data").as<std::vector<double>>();
  switch (distortion.size()) {
    case 0:
      break;
    case 4:
    case 5:
      intrinsics.model = DistortionModel::kPlumbBob;
      break;
    case 8:
      intrinsics.model = DistortionModel::kRationalPolynomial;
      break;
    default:
      throw Error(ErrorCause::kFile,
                  "cam_dist has " + std::to_string(distortion.size()) +
                      " coefficients; 0, 4 or 5 (plumb_bob) or 8 (rational_polynomial) are known");
  }
  intrinsics.distortion = distortion;
  return intrinsics;
}

/// The ground truth if the file says that it has one, otherwise the matrix it starts from.
Eigen::Isometry3d calibAnythingReference(const YAML::Node& calib, const fs::path& file) {
  const YAML::Node truth = calib["T_lidar_to_cam_gt"];
  const bool available =
      truth && truth.IsMap() && truth["data"] && truth["available"] && truth["available"].as<bool>();
  const std::string key = available ? "T_lidar_to_cam_gt" : "T_lidar_to_cam";
  return checkedIsometry(matrixOf(calib, key, 4, 4), file, key);
}

Index indexCalibAnything(const fs::path& folder) {
  const fs::path file = folder / "calib.json";
  Index index;
  index.layout = "CalibAnything";
  try {
    const YAML::Node calib = YAML::Load(readText(file));  // JSON is YAML
    index.intrinsics = calibAnythingIntrinsics(calib);
    index.reference = calibAnythingReference(calib, file);
    const auto text = [&](const std::string& key, const std::string& fallback) {
      return inside(file, key, calib[key] ? calib[key].as<std::string>() : fallback);
    };
    const fs::path images = folder / text("img_folder", "images");
    const fs::path clouds = folder / text("pc_folder", "pc");
    const fs::path masks = folder / text("mask_folder", "masks");
    const std::string image_format = text("img_format", ".png"), cloud_format = text("pc_format", ".pcd");
    for (const std::string& name : required(calib, "file_name").as<std::vector<std::string>>()) {
      inside(file, "file_name", name);
      index.frames.push_back({name, madeUpStamp(index.frames.size()), images / (name + image_format),
                              clouds / (name + cloud_format), masks / name});
    }
  } catch (const YAML::Exception& error) {
    refuse(file, error.what());
  } catch (const Error& error) {
    const std::string what = error.what();
    if (what.rfind('"' + file.string(), 0) == 0) throw;
    refuse(file, what);
  }
  setSizeFromFirstImage(index, folder);
  return index;
}

// --- KITTI ---

/// `R` (3x3) and `t` as 4x4, numbers in row-major order.
Eigen::Matrix4d homogeneous(const std::vector<double>& R, const std::vector<double>& t) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(R.data());
  if (!t.empty()) matrix.topRightCorner<3, 1>() = Eigen::Map<const Eigen::Vector3d>(t.data());
  return matrix;
}

/// Splits P = K [I | t] of a rectified camera into intrinsics and the offset of the camera from the rectified
/// origin.
Eigen::Matrix4d useProjection(const std::vector<double>& numbers, Intrinsics& intrinsics) {
  const Eigen::Matrix<double, 3, 4> P =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
  intrinsics.fx = P(0, 0);
  intrinsics.fy = P(1, 1);
  intrinsics.cx = P(0, 2);
  intrinsics.cy = P(1, 2);
  Eigen::Matrix4d offset = Eigen::Matrix4d::Identity();
  offset.topRightCorner<3, 1>() = P.leftCols<3>().inverse() * P.col(3);
  return offset;
}

/// Frames whose image and cloud both exist: KITTI's drives miss a cloud here and there.
/// A frame's number is its line in the file of times.
void addKittiFrames(Index& index, const fs::path& folder, const fs::path& images, const fs::path& clouds,
                    const fs::path& times_file) {
  const std::vector<double> times = fs::exists(times_file) ? readTimes(times_file) : std::vector<double>();
  const std::vector<std::string> cloud_names = stems(clouds, ".bin");
  for (const std::string& name : stems(images, ".png")) {
    if (!std::binary_search(cloud_names.begin(), cloud_names.end(), name)) continue;
    double stamp = madeUpStamp(index.frames.size());
    if (!times.empty()) {
      const bool number = name.size() < 10 + 1 && name.find_first_not_of("0123456789") == std::string::npos;
      const std::size_t line = number ? std::stoul(name) : times.size();
      if (line >= times.size()) refuse(times_file, "has no line for the frame " + name);
      // Odometry's times begin at 0, which means "no time" in ROS.
      stamp = times[line] < 1e6 ? madeUpStamp(0) + times[line] : times[line];
    }
    index.frames.push_back(
        {name, stamp, images / (name + ".png"), clouds / (name + ".bin"), folder / "masks" / name});
  }
  setSizeFromFirstImage(index, folder);
}

Index indexKittiOdometry(const fs::path& folder) {
  const fs::path file = folder / "calib.txt";
  const auto calibration = readKittiCalibration(file);
  Index index;
  index.layout = "KITTI odometry";
  const Eigen::Matrix4d offset = useProjection(numbersOf(calibration, "P2", 12, file), index.intrinsics);
  // Tr leads into the rectified frame of camera 0.
  Eigen::Matrix4d Tr = Eigen::Matrix4d::Identity();
  Tr.topRows<3>() = Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(
      numbersOf(calibration, "Tr", 12, file).data());
  index.reference = checkedIsometry(offset * Tr, file, "P2 and Tr");
  addKittiFrames(index, folder, folder / "image_2", folder / "velodyne", folder / "times.txt");
  return index;
}

Index indexKittiRaw(const fs::path& folder) {
  const fs::path parent = fs::absolute(folder / "").parent_path().parent_path();
  const fs::path camera_file = parent / "calib_cam_to_cam.txt", lidar_file = parent / "calib_velo_to_cam.txt";
  const auto camera = readKittiCalibration(camera_file);
  const auto lidar = readKittiCalibration(lidar_file);
  Index index;
  index.layout = "KITTI raw";
  const Eigen::Matrix4d offset =
      useProjection(numbersOf(camera, "P_rect_02", 12, camera_file), index.intrinsics);
  const Eigen::Matrix4d R_rect = homogeneous(numbersOf(camera, "R_rect_00", 9, camera_file), {});
  const Eigen::Matrix4d Tr =
      homogeneous(numbersOf(lidar, "R", 9, lidar_file), numbersOf(lidar, "T", 3, lidar_file));
  index.reference = checkedIsometry(offset * R_rect * Tr, lidar_file, "extrinsic");
  addKittiFrames(index, folder, folder / "image_02" / "data", folder / "velodyne_points" / "data",
                 folder / "image_02" / "timestamps.txt");
  const std::vector<double>& size = numbersOf(camera, "S_rect_02", 2, camera_file);
  if (size[0] != index.intrinsics.width || size[1] != index.intrinsics.height) {
    refuse(folder,
           "the images are not of the size S_rect_02 of calib_cam_to_cam.txt; only the rectified drives"
           " (..._sync) can be read");
  }
  return index;
}

Index indexFolder(const fs::path& folder) {
  if (!fs::is_directory(folder)) refuse(folder, "there is no such folder");
  if (fs::exists(folder / "calib.json")) return indexCalibAnything(folder);
  if (fs::is_directory(folder / "velodyne_points")) return indexKittiRaw(folder);
  if (fs::is_directory(folder / "velodyne")) return indexKittiOdometry(folder);
  refuse(folder,
         "not a known dataset; expected calib.json (CalibAnything), image_02/data and velodyne_points/data "
         "(KITTI raw,"
         " calib_cam_to_cam.txt and calib_velo_to_cam.txt in the folder above), or image_2, velodyne and "
         "calib.txt"
         " (KITTI odometry)");
}

// ----------------------------------------------------------------------------------------------------------------

class FolderDataset : public Dataset {
 public:
  explicit FolderDataset(Index index) : index_(std::move(index)) {}

  std::string layout() const override { return index_.layout; }
  std::size_t size() const override { return index_.frames.size(); }
  std::string name(std::size_t frame) const override { return files(frame).name; }
  double stamp(std::size_t frame) const override { return files(frame).stamp; }
  const Intrinsics& intrinsics() const override { return index_.intrinsics; }
  const std::optional<Eigen::Isometry3d>& reference() const override { return index_.reference; }

  cv::Mat image(std::size_t frame) const override {
    cv::Mat image = readImage(files(frame).image);
    checkSize(files(frame).image, image);
    return image;
  }

  PointCloud cloud(std::size_t frame) const override { return readCloud(files(frame).cloud); }

  std::vector<cv::Mat> maskLayers(std::size_t frame) const override {
    std::vector<cv::Mat> layers = readMaskLayers(files(frame).masks);
    if (!layers.empty()) checkSize(files(frame).masks, layers.front());
    return layers;
  }

 private:
  const FrameFiles& files(std::size_t frame) const {
    if (frame >= index_.frames.size()) {
      throw Error(ErrorCause::kParameter, "frame " + std::to_string(frame) + " of a dataset that has " +
                                              std::to_string(index_.frames.size()));
    }
    return index_.frames[frame];
  }

  void checkSize(const fs::path& file, const cv::Mat& image) const {
    if (image.cols == index_.intrinsics.width && image.rows == index_.intrinsics.height) return;
    refuse(file, "is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                     ", the first image is " + std::to_string(index_.intrinsics.width) + "x" +
                     std::to_string(index_.intrinsics.height));
  }

  Index index_;
};

}  // namespace

std::unique_ptr<Dataset> Dataset::open(const std::string& folder) {
  return std::make_unique<FolderDataset>(indexFolder(folder));
}

}  // namespace lidar_camera_recalibration

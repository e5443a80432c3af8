#include "dataset.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "calib_anything.hpp"
#include "dataset_files.hpp"
#include "json.hpp"
#include "lidar_camera_recalibration/calibration_formats.hpp"
#include "lidar_camera_recalibration/error.hpp"

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

Index indexCalibAnything(const fs::path& folder) {
  const fs::path file = folder / "calib.json";
  Index index;
  index.layout = "CalibAnything";
  try {
    const nlohmann::json root = nlohmann::json::parse(readText(file));
    const CalibAnythingFile calib = readCalibAnything(root);
    if (!calib.intrinsics) throw std::runtime_error("the key cam_K is missing");
    index.intrinsics = *calib.intrinsics;
    index.reference = calib.truth ? *calib.truth : calib.T_camera_lidar;
    const auto text = [&](const std::string& key, const std::string& fallback) {
      return inside(file, key, root.value(key, fallback));
    };
    const fs::path images = folder / text("img_folder", "images");
    const fs::path clouds = folder / text("pc_folder", "pc");
    const fs::path masks = folder / text("mask_folder", "masks");
    const std::string image_format = text("img_format", ".png"), cloud_format = text("pc_format", ".pcd");
    for (const auto& name : jsonValue<std::vector<std::string>>(root, "file_name", "")) {
      inside(file, "file_name", name);
      index.frames.push_back({name, madeUpStamp(index.frames.size()), images / (name + image_format),
                              clouds / (name + cloud_format), masks / name});
    }
  } catch (const std::exception& error) {  // of the JSON library, of the format and our own
    const std::string what = error.what();
    if (what.rfind('"' + file.string(), 0) == 0) throw;
    refuse(file, what);
  }
  setSizeFromFirstImage(index, folder);
  return index;
}

// --- KITTI ---

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

FormatOptions formatOf(const char* name) {
  FormatOptions options;
  options.format = name;
  return options;
}

Index indexKittiOdometry(const fs::path& folder) {
  const CalibrationContents calib =
      readCalibrationFile((folder / "calib.txt").string(), formatOf("kitti_odometry"));
  Index index;
  index.layout = "KITTI odometry";
  index.intrinsics = *calib.intrinsics;
  index.reference = calib.calibration->T_camera_lidar;
  addKittiFrames(index, folder, folder / "image_2", folder / "velodyne", folder / "times.txt");
  return index;
}

Index indexKittiRaw(const fs::path& folder) {
  const fs::path parent = fs::absolute(folder / "").parent_path().parent_path();
  const fs::path lidar_file = parent / "calib_velo_to_cam.txt";
  const CalibrationContents calib = readCalibrationFile(lidar_file.string(), formatOf("kitti_raw"));
  if (!calib.intrinsics) refuse(parent / "calib_cam_to_cam.txt", "there is no such file");
  Index index;
  index.layout = "KITTI raw";
  index.intrinsics = *calib.intrinsics;
  index.reference = calib.calibration->T_camera_lidar;
  addKittiFrames(index, folder, folder / "image_02" / "data", folder / "velodyne_points" / "data",
                 folder / "image_02" / "timestamps.txt");
  if (calib.intrinsics->width != index.intrinsics.width ||
      calib.intrinsics->height != index.intrinsics.height) {
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

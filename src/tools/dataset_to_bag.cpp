// Turns a dataset folder into a bag with the topics that the node subscribes to.

#include <rosbag/bag.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <filesystem>
#include <iostream>
#include <optional>
#include <sstream>

#include "bag_writing.hpp"
#include "command_line.hpp"
#include "conversions.hpp"
#include "dataset.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "perturbation.hpp"
#include "result_messages.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

constexpr char kCameraFrame[] = "camera_optical_frame";
constexpr char kLidarFrame[] = "lidar";
constexpr double kMaskDelay =
    0.4;  ///< masks are recorded so much later than their image: they never come at once [s]

struct Options {
  std::string folder, out, frames;
  int every = 1, max = 0;             ///< max 0: all
  std::optional<NumberPair> perturb;  ///< [deg], [m]
  std::uint64_t seed = 1;
  double rate = 0.0;
  bool lz4 = false;
};

std::vector<std::size_t> selectedFrames(const Options& options, std::size_t size) {
  std::vector<std::size_t> frames;
  if (options.frames.empty()) {
    for (std::size_t i = 0; i < size; i += static_cast<std::size_t>(options.every)) frames.push_back(i);
  } else {
    std::istringstream words(options.frames);
    for (std::string word; std::getline(words, word, ',');) {
      const bool number =
          !word.empty() && word.size() < 10 && word.find_first_not_of("0123456789") == std::string::npos;
      if (!number || std::stoul(word) >= size) {
        throw Error(ErrorCause::kParameter,
                    "--frames: \"" + word + "\" is no frame; there are 0 to " + std::to_string(size - 1));
      }
      frames.push_back(std::stoul(word));
    }
  }
  if (options.max > 0) frames.resize(std::min(frames.size(), static_cast<std::size_t>(options.max)));
  return frames;
}

template <typename T>
void addField(sensor_msgs::PointCloud2& cloud, const std::string& name, std::uint8_t type) {
  sensor_msgs::PointField field;
  field.name = name;
  field.offset = cloud.point_step;
  field.datatype = type;
  field.count = 1;
  cloud.fields.push_back(field);
  cloud.point_step += sizeof(T);
}

sensor_msgs::PointCloud2 cloudMessage(const PointCloud& cloud) {
  using Field = sensor_msgs::PointField;
  sensor_msgs::PointCloud2 message;
  for (const char* axis : {"x", "y", "z"}) addField<float>(message, axis, Field::FLOAT32);
  if (cloud.hasReflectivity()) addField<float>(message, "intensity", Field::FLOAT32);
  if (!cloud.ring.empty()) addField<std::uint16_t>(message, "ring", Field::UINT16);
  sensor_msgs::PointCloud2Modifier(message).resize(cloud.size());
  message.is_dense = true;

  sensor_msgs::PointCloud2Iterator<float> x(message, "x");
  for (std::size_t i = 0; i < cloud.size(); ++i, ++x) std::copy_n(cloud.points[i].data(), 3, &x[0]);
  if (cloud.hasReflectivity()) {
    sensor_msgs::PointCloud2Iterator<float> intensity(message, "intensity");
    for (std::size_t i = 0; i < cloud.size(); ++i, ++intensity) *intensity = cloud.reflectivity[i];
  }
  if (!cloud.ring.empty()) {
    sensor_msgs::PointCloud2Iterator<std::uint16_t> ring(message, "ring");
    for (std::size_t i = 0; i < cloud.size(); ++i, ++ring) *ring = cloud.ring[i];
  }
  return message;
}

void writeStaticTransform(rosbag::Bag& bag, const ros::Time& stamp, const Eigen::Isometry3d& T_camera_lidar) {
  tf2_msgs::TFMessage message;
  message.transforms.push_back(tf2::eigenToTransform(T_camera_lidar.inverse()));
  message.transforms[0].header.stamp = stamp;
  message.transforms[0].header.frame_id = kLidarFrame;
  message.transforms[0].child_frame_id = kCameraFrame;
  bag.write("/tf_static", stamp, message, latchedConnection<tf2_msgs::TFMessage>("/dataset_to_bag"));
}

/// One frame's messages. Returns whether it has masks.
bool writeFrame(rosbag::Bag& bag, const Dataset& dataset, std::size_t frame, double seconds) {
  std_msgs::Header header;
  header.stamp = ros::Time(seconds);
  header.frame_id = kCameraFrame;
  sensor_msgs::PointCloud2 cloud = cloudMessage(dataset.cloud(frame));
  cloud.header = header;
  cloud.header.frame_id = kLidarFrame;
  bag.write("/camera/image_raw", header.stamp, *toImageMessage(dataset.image(frame), header));
  bag.write("/camera/camera_info", header.stamp, toCameraInfo(header, dataset.intrinsics()));
  bag.write("/lidar/points", header.stamp, cloud);
  const std::vector<cv::Mat> layers = dataset.maskLayers(frame);
  if (layers.empty()) return false;
  bag.write("/camera/masks", header.stamp + ros::Duration(kMaskDelay), toMaskMessage(header, layers));
  return true;
}

std::filesystem::path outputPath(const Options& options) {
  if (!options.out.empty()) return options.out;
  return (std::filesystem::absolute(options.folder) / "").parent_path().filename().string() + ".bag";
}

struct Written {
  std::size_t frames = 0, with_masks = 0;
  double newest_stamp = 0.0;  ///< [s]
};

void writeTruth(const std::filesystem::path& bag, const Dataset& dataset, const Options& options,
                const Written& written) {
  StoredCalibration truth;
  truth.T_camera_lidar = *dataset.reference();
  truth.camera_frame = kCameraFrame;
  truth.lidar_frame = kLidarFrame;
  truth.reason = "reference of the dataset";
  truth.frames = written.frames;
  truth.stamp = written.newest_stamp;
  truth.source = dataset.layout() + " dataset " + std::filesystem::path(options.folder).filename().string();
  std::filesystem::path file = bag;
  file.replace_extension(".truth.yaml");
  writeCalibration(file.string(), truth);
  std::cout << "Reference extrinsic: " << file.string() << '\n';
}

Written writeBag(const std::string& path, const Dataset& dataset, const Options& options) {
  const std::vector<std::size_t> frames = selectedFrames(options, dataset.size());
  rosbag::Bag bag(path, rosbag::bagmode::Write);
  if (options.lz4) bag.setCompression(rosbag::compression::LZ4);
  ProgressBar progress;
  Written written;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    progress.show("writing", double(i) / double(frames.size()));
    double stamp = dataset.stamp(frames[i]);
    if (options.rate > 0.0) stamp = dataset.stamp(frames[0]) + double(i) / options.rate;
    if (i == 0 && dataset.reference()) {
      Eigen::Isometry3d guess = *dataset.reference();
      if (options.perturb) {
        guess = perturbedBy(guess, options.perturb->first * kDegree, options.perturb->second, options.seed);
      }
      writeStaticTransform(bag, ros::Time(stamp), guess);
    }
    written.with_masks += writeFrame(bag, dataset, frames[i], stamp);
    written.newest_stamp = std::max(written.newest_stamp, stamp);
  }
  written.frames = frames.size();
  progress.show("writing", 1.0);
  return written;
}

int convert(const Options& options) {
  const auto dataset = Dataset::open(options.folder);
  const std::filesystem::path path = outputPath(options);
  // Under its name stands a whole bag or none; `rosbag record` does the same.
  const std::filesystem::path active = path.string() + ".active";
  Written written;
  try {
    written = writeBag(active.string(), *dataset, options);
    std::filesystem::rename(active, path);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(active, ignored);
    throw;
  }
  std::cout << path.string() << ": " << written.frames << " frames of a " << dataset->layout() << " dataset, "
            << written.with_masks << " with masks\n";
  if (dataset->reference()) writeTruth(path, *dataset, options, written);
  return kExitOk;
}

}  // namespace

int datasetToBagMain(int argc, char** argv) {
  Options options;
  CommandLine line{
      "dataset_to_bag FOLDER [options]",
      "Writes a bag with /camera/image_raw, /camera/camera_info, /lidar/points, /camera/masks and "
      "/tf_static\n"
      "from a dataset in CalibAnything's layout, a KITTI raw drive (..._sync) or a KITTI odometry sequence,\n"
      "and the dataset's extrinsic as reference to BAG-without-.bag.truth.yaml.",
      po::options_description("Options"), "folder", "--perturb"};
  line.options.add_options()("folder", po::value(&options.folder)->required()->value_name("FOLDER"),
                             "the dataset")("out", po::value(&options.out)->value_name("BAG"),
                                            "default: the folder's name with .bag, here")(
      "frames", po::value(&options.frames)->value_name("0,3,5"), "only these frames, counted from 0")(
      "every", atLeast(1, &options.every, "every")->value_name("N"), "only each Nth frame")(
      "max", atLeast(1, &options.max, "max")->value_name("N"), "at most so many frames")(
      "perturb",
      po::value<NumberPair>()
          ->notifier([&options](const NumberPair& pair) { options.perturb = pair; })
          ->value_name("DEG M"),
      "/tf_static is off by this angle [deg] and distance [m] in random directions (default: exact)")(
      "seed", po::value(&options.seed)->value_name("S"), "of the random directions (default 1)")(
      "rate", atLeast(0.001, &options.rate, "rate")->value_name("HZ"),
      "new stamps at this rate (default: the dataset's own; 1 Hz where it has none)")(
      "lz4", po::bool_switch(&options.lz4), "compress the bag");
  return runTool(argc, argv, line, [&options](const po::variables_map&) {
    if (options.perturb &&
        (options.perturb->first < 0.0 || options.perturb->first > 180.0 || options.perturb->second < 0.0)) {
      throw po::error("--perturb takes an angle of 0 to 180 deg and a distance of at least 0 m");
    }
    return convert(options);
  });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::datasetToBagMain(argc, argv); }

// Writes a simulated drive through a street as a rosbag with the exact extrinsic beside it, as a dataset, or
// both.

#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/TransformStamped.h>
#include <rosbag/bag.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_msgs/TFMessage.h>

#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <string>
#include <thread>

#include "bag_writing.hpp"
#include "command_line.hpp"
#include "conversions.hpp"
#include "dataset_writing.hpp"
#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "result_messages.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/lidar_sensor.hpp"
#include "simulation/mask_model.hpp"
#include "simulation/random.hpp"
#include "simulation/rig.hpp"
#include "simulation/street.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

using namespace simulation;
using Eigen::Isometry3d;

constexpr double kLead = 0.5;       ///< tf before the first and after the last picture [s]
constexpr double kTfPeriod = 0.02;  ///< [s]
const char* const kBaseFrame = "base_link";
const char* const kLidarFrame = "lidar";
const char* const kCameraLinkFrame = "camera_link";
const char* const kCameraFrame = "camera_optical_frame";

struct Options {
  std::string out, dataset;  ///< bag and folder; one of them may be empty
  std::uint64_t seed = 1;
  int frames = 20;
  double start = 1700000000.0;  ///< ROS time of the first transform [s]
  double rate = 2.0, speed = 8.0, winding = 1.0;
  std::string truth;                                       ///< file; empty: seeded
  NumberPair error{3.0, 0.1};                              ///< [deg], [m]
  double step_time = -1.0, step_deg = 1.0, step_m = 0.05;  ///< a negative time means never
  int beams = 64;
  bool raw = false;
  double cloud_delay = 0.0;  ///< [s]
  int width = 1242, height = 376;
  double mask_fraction = 1.0;
  std::string compression = "lz4";
  std::string pictures;
  int threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));

  double duration() const { return 2 * kLead + (frames - 1) / rate; }
};

Intrinsics cameraIntrinsics(const Options& options) {
  Intrinsics intrinsics;
  intrinsics.width = options.width;
  intrinsics.height = options.height;
  intrinsics.fx = 0.58 * options.width;
  intrinsics.fy = 1.002 * intrinsics.fx;
  intrinsics.cx = 0.491 * options.width;
  intrinsics.cy = 0.482 * options.height;
  intrinsics.model = DistortionModel::kPlumbBob;
  intrinsics.distortion = {-0.19, 0.05, 0.0006, -0.0009, 0.0};
  return intrinsics;
}

// --- messages ---

/// @param stamp  ROS time [s]
std_msgs::Header header(double stamp, const char* frame) {
  std_msgs::Header result;
  result.stamp = ros::Time(stamp);
  result.frame_id = frame;
  return result;
}

geometry_msgs::TransformStamped transform(double stamp, const char* parent, const char* child,
                                          const Isometry3d& T_parent_child) {
  geometry_msgs::TransformStamped message = tf2::eigenToTransform(T_parent_child);
  message.header = header(stamp, parent);
  message.child_frame_id = child;
  return message;
}

sensor_msgs::PointCloud2 cloudMessage(double stamp, const std::vector<LidarReturn>& sweep) {
  sensor_msgs::PointCloud2 cloud;
  cloud.header = header(stamp, kLidarFrame);
  cloud.height = 1;
  cloud.is_dense = true;
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  using sensor_msgs::PointField;
  modifier.setPointCloud2Fields(6, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                PointField::FLOAT32, "intensity", 1, PointField::FLOAT32, "ring", 1,
                                PointField::UINT16, "time", 1, PointField::FLOAT32);
  modifier.resize(sweep.size());
  sensor_msgs::PointCloud2Iterator<float> xyz(cloud, "x"), intensity(cloud, "intensity"),
      fired(cloud, "time");
  sensor_msgs::PointCloud2Iterator<std::uint16_t> ring(cloud, "ring");
  for (const LidarReturn& r : sweep) {
    for (int i = 0; i < 3; ++i) xyz[i] = r.point[i];
    *intensity = r.intensity;
    *ring = r.ring;
    *fired = r.time;
    ++xyz, ++intensity, ++ring, ++fired;
  }
  return cloud;
}

// --- the bag ---

/// Writes messages in the order of their record times, though they are made in another: masks come late.
/// The file gets its name when it is complete.
class DriveBag {
 public:
  DriveBag(const std::string& path, bool compress) : path_(path), unfinished_(path + ".unfinished") {
    bag_.open(unfinished_, rosbag::bagmode::Write);
    bag_.setCompression(compress ? rosbag::compression::LZ4 : rosbag::compression::Uncompressed);
  }

  ~DriveBag() {
    if (closed_) return;
    bag_.close();
    std::error_code ignored;  // the reason why the drive stopped is the one to be told
    std::filesystem::remove(unfinished_, ignored);
  }

  /// @param stamp  ROS time of recording [s]
  template <typename Message>
  void add(const std::string& topic, double stamp, Message message, bool latched = false) {
    const ros::Time record_time(stamp);
    const auto connection = latched ? sharedConnection<Message>(topic) : nullptr;
    waiting_.emplace(record_time, [this, topic, record_time, connection, message = std::move(message)] {
      bag_.write(topic, record_time, message, connection);
    });
  }

  void flush(const ros::Time& until) {
    while (!waiting_.empty() && waiting_.begin()->first <= until) {
      waiting_.begin()->second();
      waiting_.erase(waiting_.begin());
    }
  }

  void close() {
    flush(ros::TIME_MAX);
    bag_.close();
    std::filesystem::rename(unfinished_, path_);
    closed_ = true;
  }

 private:
  template <typename Message>
  boost::shared_ptr<ros::M_string> sharedConnection(const std::string& topic) {
    auto& connection = latched_[topic];
    if (!connection) connection = latchedConnection<Message>("/simulate_drive");
    return connection;
  }

  std::string path_, unfinished_;
  bool closed_ = false;
  rosbag::Bag bag_;
  std::multimap<ros::Time, std::function<void()>> waiting_;
  std::map<std::string, boost::shared_ptr<ros::M_string>> latched_;
};

// --- the dataset ---

PointCloud pointCloud(const std::vector<LidarReturn>& sweep) {
  PointCloud cloud;
  for (const LidarReturn& r : sweep) {
    cloud.points.push_back(r.point);
    cloud.reflectivity.push_back(r.intensity);
    cloud.ring.push_back(r.ring);
  }
  return cloud;
}

// --- pictures for people ---

cv::Mat coloredMasks(const std::vector<cv::Mat>& layers, const cv::Mat& image) {
  cv::Mat all;
  for (const cv::Mat& layer : layers) {
    cv::Mat picture = image.clone();
    for (int v = 0; v < layer.rows; ++v) {
      for (int u = 0; u < layer.cols; ++u) {
        const auto id = static_cast<unsigned>(layer.at<int>(v, u));
        if (id == 0) continue;
        const cv::Vec3b color(static_cast<std::uint8_t>(id * 97), static_cast<std::uint8_t>(id * 57),
                              static_cast<std::uint8_t>(id * 23));
        cv::Vec3b& pixel = picture.at<cv::Vec3b>(v, u);
        for (int c = 0; c < 3; ++c) pixel[c] = static_cast<std::uint8_t>((pixel[c] + 2 * color[c]) / 3);
      }
    }
    all.push_back(picture);
  }
  return all;
}

cv::Mat lidarOverPicture(const cv::Mat& image, const Camera& camera, const Isometry3d& T_camera_lidar,
                         const std::vector<LidarReturn>& sweep) {
  cv::Mat picture = image.clone();
  for (const LidarReturn& r : sweep) {
    const auto pixel = camera.project(T_camera_lidar * r.point.cast<double>());
    if (!pixel) continue;
    const double hue = 120.0 * std::min(1.0, static_cast<double>(r.point.norm()) / 40.0);
    cv::Mat color(1, 1, CV_8UC3, cv::Scalar(hue, 255, 255));
    cv::cvtColor(color, color, cv::COLOR_HSV2BGR);
    cv::circle(picture, {cvRound((*pixel)[0]), cvRound((*pixel)[1])}, 1,
               cv::Scalar(color.at<cv::Vec3b>(0, 0)), cv::FILLED);
  }
  return picture;
}

void writePicture(const std::string& folder, const std::string& what, int frame, const cv::Mat& picture) {
  char number[16];
  std::snprintf(number, sizeof(number), "%06d", frame);
  const std::string path = folder + "/" + number + "_" + what + ".png";
  if (!cv::imwrite(path, picture)) throw Error(ErrorCause::kFile, "Cannot write the picture " + path + ".");
}

// --- the drive ---

class Drive {
 public:
  explicit Drive(const Options& options)
      : options_(options),
        street_(options.seed, options.speed * options.duration(), options.speed, options.winding),
        scene_(street_.world()),
        rig_(rig(options)),
        camera_(cameraIntrinsics(options)),
        camera_sensor_(camera_, options.threads),
        lidar_sensor_(lidarConfig(options)) {
    if (!options.out.empty()) bag_.emplace(options.out, options.compression == "lz4");
    if (!options.dataset.empty()) dataset_.emplace(options.dataset, camera_.intrinsics());
    const double angle = options.step_deg * kDegree;
    after_step_ = disturbed(rig_.T_camera_lidar, angle, options.step_m, options.seed + 1);
    believed_ =
        disturbed(rig_.T_camera_lidar, options.error.first * kDegree, options.error.second, options.seed);
  }

  void run() {
    if (bag_) {
      writeTruth();
      writeStaticTransforms();
    }
    for (int i = 0; i < options_.frames; ++i) {
      const double time = kLead + i / options_.rate;
      if (bag_) writeEgoMotion(time + kLead);
      simulateFrame(i, time);
      if (bag_) bag_->flush(ros::Time(stamp(time)));
      std::fprintf(stderr, "frame %d of %d: %zu points, %d masks\n", i + 1, options_.frames, points_, masks_);
    }
    if (bag_) bag_->close();
    if (dataset_) dataset_->finish(rig_.T_camera_lidar, "simulated; the extrinsic is exact. " + source());
  }

 private:
  static LidarConfig lidarConfig(const Options& options) {
    LidarConfig config;
    config.beams = options.beams;
    config.threads = options.threads;
    return config;
  }

  static Rig rig(const Options& options) {
    Rig rig = makeRig(options.seed);
    if (!options.truth.empty()) rig.T_camera_lidar = readCalibration(options.truth).T_camera_lidar;
    return rig;
  }

  /// ROS time of a time since the start of the drive [s]
  double stamp(double time) const { return options_.start + time; }

  bool stepHappens() const { return options_.step_time >= 0 && options_.step_time <= options_.duration(); }

  /// @param time  [s] since the start of the drive; the first frame is at kLead
  const Isometry3d& T_camera_lidar(double time) const {
    return stepHappens() && time >= kLead + options_.step_time ? after_step_ : rig_.T_camera_lidar;
  }

  std::string source() const { return "simulate_drive --seed " + std::to_string(options_.seed); }

  void writeTruth() {
    std::filesystem::path path(options_.out);
    StoredCalibration truth;
    truth.camera_frame = kCameraFrame;
    truth.lidar_frame = kLidarFrame;
    truth.reason = "exact, from the simulation";
    truth.frames = static_cast<std::size_t>(options_.frames);
    truth.source = source();
    truth.stamp = stamp(0.0);
    truth.T_camera_lidar = rig_.T_camera_lidar;
    writeCalibration(path.replace_extension(".truth.yaml").string(), truth);
    bag_->add("/simulation/T_camera_lidar", stamp(0.0),
              transform(stamp(0.0), kCameraFrame, kLidarFrame, rig_.T_camera_lidar), true);
    if (!stepHappens()) return;
    const double time = kLead + options_.step_time;
    truth.stamp = stamp(time);
    truth.T_camera_lidar = after_step_;
    path = options_.out;
    writeCalibration(path.replace_extension(".truth_after_step.yaml").string(), truth);
    bag_->add("/simulation/T_camera_lidar", stamp(time),
              transform(stamp(time), kCameraFrame, kLidarFrame, after_step_), true);
  }

  /// What the vehicle believes: base_link -> lidar and base_link -> camera_link -> camera_optical_frame.
  void writeStaticTransforms() {
    const Isometry3d T_link_optical = opticalFromLink().inverse();
    const Isometry3d T_base_link = rig_.T_base_lidar * believed_.inverse() * T_link_optical.inverse();
    tf2_msgs::TFMessage message;
    message.transforms = {transform(stamp(0.0), kBaseFrame, kLidarFrame, rig_.T_base_lidar),
                          transform(stamp(0.0), kBaseFrame, kCameraLinkFrame, T_base_link),
                          transform(stamp(0.0), kCameraLinkFrame, kCameraFrame, T_link_optical)};
    bag_->add("/tf_static", stamp(0.0), message, true);
  }

  void writeEgoMotion(double until) {
    for (; tf_count_ * kTfPeriod <= until; ++tf_count_) {
      const double time = tf_count_ * kTfPeriod;
      tf2_msgs::TFMessage message;
      message.transforms = {transform(stamp(time), "odom", kBaseFrame, T_odom_base(time))};
      bag_->add("/tf", stamp(time + 0.002), message);
    }
  }

  /// odom starts where the vehicle starts.
  Isometry3d T_odom_base(double time) const { return street_.egoPose(0.0).inverse() * street_.egoPose(time); }

  void simulateFrame(int index, double time) {
    const std::uint64_t seed = options_.seed * 1000003 + static_cast<std::uint64_t>(index);
    const double half = 0.5 * lidar_sensor_.duration(), cloud_time = time + options_.cloud_delay;
    scene_.setInterval(time - half, cloud_time + half);
    const auto T_world_lidar = [&](double t) { return street_.egoPose(t) * rig_.T_base_lidar; };
    const Picture picture =
        camera_sensor_.take(scene_, T_world_lidar(time) * T_camera_lidar(time).inverse(), time, seed);
    std::vector<LidarReturn> sweep = lidar_sensor_.sweep(scene_, T_world_lidar, cloud_time, seed);
    if (!options_.raw) motionCompensate(sweep, T_world_lidar, cloud_time);
    const std::vector<cv::Mat> masks = simulateMasks(picture, street_.world().parts, MaskConfig(), seed);
    points_ = sweep.size();

    Random random(seed, 8);
    const double mask_delay = random.uniform(0.3, 2.5);
    const bool has_masks = random.chance(options_.mask_fraction);
    masks_ = has_masks ? countMasks(masks) : 0;
    const std::vector<cv::Mat> written_masks = has_masks ? masks : std::vector<cv::Mat>();
    if (bag_) record(time, mask_delay, picture.image, written_masks, sweep);
    if (dataset_) dataset_->add(picture.image, written_masks, pointCloud(sweep));
    if (options_.pictures.empty()) return;
    writePicture(options_.pictures, "image", index, picture.image);
    writePicture(options_.pictures, "masks", index, coloredMasks(masks, picture.image));
    writePicture(options_.pictures, "lidar", index,
                 lidarOverPicture(picture.image, camera_, T_camera_lidar(time), sweep));
  }

  /// Record times: exposure and transport, the end of the sweep, and a segmenter that takes its time.
  void record(double time, double mask_delay, const cv::Mat& image, const std::vector<cv::Mat>& masks,
              const std::vector<LidarReturn>& sweep) {
    const std_msgs::Header image_header = header(stamp(time), kCameraFrame);
    bag_->add("/camera/image_raw", stamp(time + 0.035), *toImageMessage(image, image_header));
    bag_->add("/camera/camera_info", stamp(time + 0.035), toCameraInfo(image_header, camera_.intrinsics()));
    const double cloud_time = time + options_.cloud_delay;
    bag_->add("/lidar/points", stamp(cloud_time + 0.5 * lidar_sensor_.duration() + 0.015),
              cloudMessage(stamp(cloud_time), sweep));
    if (!masks.empty())
      bag_->add("/camera/masks", stamp(time + mask_delay), toMaskMessage(image_header, masks));
  }

  static int countMasks(const std::vector<cv::Mat>& layers) {
    std::set<int> ids;
    for (const cv::Mat& layer : layers) ids.insert(layer.begin<int>(), layer.end<int>());
    ids.erase(0);
    return static_cast<int>(ids.size());
  }

  Options options_;
  Street street_;
  Scene scene_;
  Rig rig_;
  Isometry3d after_step_, believed_;
  Camera camera_;
  CameraSensor camera_sensor_;
  LidarSensor lidar_sensor_;
  std::optional<DriveBag> bag_;
  std::optional<DatasetWriter> dataset_;
  int tf_count_ = 0;
  std::size_t points_ = 0;
  int masks_ = 0;
};

int simulate(const Options& options) {
  if (!options.pictures.empty()) std::filesystem::create_directories(options.pictures);
  const std::clock_t start = std::clock();
  Drive(options).run();
  const double cpu_seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
  if (!options.dataset.empty()) std::fprintf(stderr, "%s: a dataset\n", options.dataset.c_str());
  if (!options.out.empty()) {
    std::fprintf(stderr, "%s: %.1f MB\n", options.out.c_str(),
                 static_cast<double>(std::filesystem::file_size(options.out)) / 1e6);
  }
  std::fprintf(stderr, "%d frames, %.2f s of CPU a frame\n", options.frames, cpu_seconds / options.frames);
  return kExitOk;
}

/// What the limits of single options cannot say.
void check(const Options& options) {
  if (options.out.empty() && options.dataset.empty())
    throw po::error("name what to write: a bag (OUT.bag), a folder (--dataset DIR), or both");
  if (!options.dataset.empty() && options.step_time >= 0.0)
    throw po::error("--dataset holds one extrinsic, --step-time changes it: leave one of them out");
  if (options.beams != 16 && options.beams != 32 && options.beams != 64)
    throw po::error("--beams " + std::to_string(options.beams) + ": must be 16, 32 or 64");
  if (options.compression != "lz4" && options.compression != "none")
    throw po::error("--compression " + options.compression + ": must be lz4 or none");
  const auto [degrees, metres] = options.error;
  if (!(degrees >= 0.0 && degrees <= 170.0 && metres >= 0.0 && metres <= 10.0))
    throw po::error("--perturb takes an angle of 0 to 170 deg and a distance of 0 to 10 m");
}

}  // namespace

int simulateDriveMain(int argc, char** argv) {
  Options options;
  CommandLine line{
      "simulate_drive [OUT.bag] [--dataset DIR] [options]",
      "Drives a vehicle with a spinning LiDAR and a camera through a simulated street and records a bag "
      "whose\n"
      "tf_static holds an extrinsic that is off by a known amount. Topics: /camera/image_raw,\n"
      "/camera/camera_info, /camera/masks, /lidar/points, /tf, /tf_static, /simulation/T_camera_lidar.\n"
      "Beside the bag: OUT.truth.yaml, the true extrinsic (with a step also OUT.truth_after_step.yaml).\n"
      "With --dataset the same frames as a folder in CalibAnything's layout, whose calib.json holds the "
      "truth.",
      po::options_description("Options"), "out", "--perturb"};
  const auto add = [&line](const char* name, po::value_semantic* value, const char* what) {
    line.options.add_options()(name, value, what);
  };
  add("out", po::value(&options.out)->value_name("BAG"), "the bag");
  add("dataset", po::value(&options.dataset)->value_name("DIR"),
      "the folder, instead of the bag or beside it");
  add("seed", po::value(&options.seed)->value_name("N"), "another street and other errors (default 1)");
  add("frames", inRange(1, 100000, &options.frames, "frames")->value_name("N"),
      "pictures with a LiDAR sweep each (default 20)");
  add("rate", inRange(0.02, 10.0, &options.rate, "rate")->value_name("HZ"),
      "frames per second; a low rate spreads them over a long street (default 2)");
  add("speed", inRange(0.0, 40.0, &options.speed, "speed")->value_name("V"),
      "of the vehicle [m/s] (default 8)");
  add("winding", inRange(0.0, 2.0, &options.winding, "winding")->value_name("K"),
      "of the road: its bends have radii of 60 m and more, divided by K (default 1)");
  add("start", inRange(1.0, 2e9, &options.start, "start")->value_name("S"),
      "ROS time at which the drive starts [s] (default 1700000000)");
  add("truth", po::value(&options.truth)->value_name("YAML"),
      "the true extrinsic, as a result file (default: seeded)");
  add("perturb", po::value(&options.error)->value_name("DEG M"),
      "error of the extrinsic in tf_static: angle and distance (default 3 0.1)");
  add("step-time", inRange(0.0, 1e6, &options.step_time, "step-time")->value_name("S"),
      "the true extrinsic changes so long after the first frame [s] (default: never)");
  add("step-rotation-deg", inRange(0.0, 170.0, &options.step_deg, "step-rotation-deg")->value_name("R"),
      "by this angle (default 1)");
  add("step-translation-m", inRange(0.0, 10.0, &options.step_m, "step-translation-m")->value_name("T"),
      "and this distance (default 0.05)");
  add("beams", po::value(&options.beams)->value_name("N"), "of the LiDAR: 16, 32 or 64 (default 64)");
  add("raw", po::bool_switch(&options.raw),
      "points as fired, each from the sensor's place at its time (default: moved to the stamp, as datasets "
      "deliver them)");
  add("cloud-delay", inRange(0.0, 0.1, &options.cloud_delay, "cloud-delay")->value_name("S"),
      "the middle of each sweep is so much later than its picture [s] (default 0)");
  add("width", inRange(64, 8192, &options.width, "width")->value_name("PX"), "of the picture (default 1242)");
  add("height", inRange(64, 8192, &options.height, "height")->value_name("PX"), "default 376");
  add("mask-fraction", inRange(0.0, 1.0, &options.mask_fraction, "mask-fraction")->value_name("F"),
      "share of the pictures that get masks (default 1)");
  add("compression", po::value(&options.compression)->value_name("lz4|none"), "of the bag (default lz4)");
  add("pictures", po::value(&options.pictures)->value_name("DIR"),
      "also write picture, masks and LiDAR over picture as PNG");
  add("threads", inRange(1, 1024, &options.threads, "threads")->value_name("N"),
      "does not change the result (default: one a core)");
  return runTool(argc, argv, line, [&options](const po::variables_map&) {
    check(options);
    return simulate(options);
  });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::simulateDriveMain(argc, argv); }

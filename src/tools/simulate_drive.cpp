// Writes a rosbag of a simulated drive through a street, with the exact extrinsic beside it.

#include <cv_bridge/cv_bridge.h>
#include <geometry_msgs/TransformStamped.h>
#include <getopt.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
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
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <string>
#include <thread>

#include "conversions.hpp"
#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "simulation/camera_sensor.hpp"
#include "simulation/lidar_sensor.hpp"
#include "simulation/mask_model.hpp"
#include "simulation/random.hpp"
#include "simulation/rig.hpp"
#include "simulation/street.hpp"

namespace lidar_camera_recalibration {
namespace {

using namespace simulation;
using Eigen::Isometry3d;

constexpr double kEpoch = 1700000000.0;  ///< ROS time of the drive's start [s]
constexpr double kLead = 0.5;            ///< tf before the first and after the last picture [s]
constexpr double kTfPeriod = 0.02;       ///< [s]
const char* const kBaseFrame = "base_link";
const char* const kLidarFrame = "lidar";
const char* const kCameraLinkFrame = "camera_link";
const char* const kCameraFrame = "camera_optical_frame";

const char* const kHelp = R"(usage: simulate_drive OUT.bag [options]

Drives a vehicle with a spinning LiDAR and a camera through a simulated street and records a bag whose tf_static holds an
extrinsic that is off by a known amount.

Topics: /camera/image_raw /camera/camera_info /camera/masks /lidar/points /tf /tf_static /simulation/T_camera_lidar
Beside the bag: OUT.truth.yaml, the true extrinsic (with a step also OUT.truth_after_step.yaml).

  --seed N                  another seed, another street and other errors              [1]
  --frames N                pictures with a LiDAR sweep each                           [20]
  --rate HZ                 frames per second, 0.1 to 10                               [2]
  --speed V                 of the vehicle [m/s], 0 to 40                              [8]
  --perturb DEG M           error of the extrinsic in tf_static: angle and distance    [3 0.1]
  --step-time S             the true extrinsic changes S seconds after the first frame [never]
  --step-rotation-deg R     by this angle                                              [1]
  --step-translation-m T    and this distance                                          [0.05]
  --beams N                 of the LiDAR: 16, 32 or 64                                 [64]
  --deskewed                points are moved to the stamp, as datasets deliver them    [default]
  --raw                     points as fired, each from the sensor's place at its time
  --width PX --height PX    of the picture                                             [1242 376]
  --mask-fraction F         share of the pictures that get masks, 0 to 1               [1]
  --compression none|lz4    of the bag                                                 [lz4]
  --pictures DIR            also write picture, masks and LiDAR over picture as PNG
  --threads N               does not change the result                                 [all cores]
  --help

Exit status: 0 written, 1 failed, 2 wrong command line.
)";

/// The command line is wrong; the message says where.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Options {
  std::string out;
  std::uint64_t seed = 1;
  int frames = 20;
  double rate = 2.0, speed = 8.0;
  double error_deg = 3.0, error_m = 0.1;
  double step_time = -1.0, step_deg = 1.0, step_m = 0.05;  ///< a negative time means never
  int beams = 64;
  bool deskewed = true;
  int width = 1242, height = 376;
  double mask_fraction = 1.0;
  bool compress = true;
  std::string pictures;
  int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));

  double duration() const { return 2 * kLead + (frames - 1) / rate; }
};

double number(const std::string& option, const char* text, double low, double high) {
  char* end = nullptr;
  const double value = text ? std::strtod(text, &end) : 0.0;
  if (!text || end == text || *end != '\0' || !(value >= low && value <= high)) {
    char range[64];
    std::snprintf(range, sizeof(range), "%g to %g", low, high);
    throw UsageError(option + " needs a number from " + range +
                     (text ? std::string(", not '") + text + "'." : std::string(".")));
  }
  return value;
}

int integer(const std::string& option, const char* text, int low, int high) {
  const double value = number(option, text, low, high);
  if (value != std::floor(value)) throw UsageError(option + " needs a whole number, not '" + text + "'.");
  return static_cast<int>(value);
}

std::string choice(const std::string& option, const std::string& text, const std::string& a,
                   const std::string& b) {
  if (text != a && text != b)
    throw UsageError(option + " needs '" + a + "' or '" + b + "', not '" + text + "'.");
  return text;
}

using Setters = std::map<std::string, std::function<void(const std::string&)>>;

/// What each option does with its value, which getopt leaves in `optarg`.
Setters setters(Options& options, int argc, char** argv) {
  return {
      {"seed",
       [&options](const std::string& o) {
         options.seed = static_cast<std::uint64_t>(number(o, optarg, 0, 9e15));
       }},
      {"frames", [&options](const std::string& o) { options.frames = integer(o, optarg, 1, 100000); }},
      {"rate", [&options](const std::string& o) { options.rate = number(o, optarg, 0.1, 10); }},
      {"speed", [&options](const std::string& o) { options.speed = number(o, optarg, 0, 40); }},
      {"perturb",
       [&options, argc, argv](const std::string& o) {
         options.error_deg = number(o + " DEG", optarg, 0, 170);
         options.error_m = number(o + " M", optind < argc ? argv[optind] : nullptr, 0, 10);
         ++optind;  // the second value belongs to the option
       }},
      {"step-time", [&options](const std::string& o) { options.step_time = number(o, optarg, 0, 1e6); }},
      {"step-rotation-deg",
       [&options](const std::string& o) { options.step_deg = number(o, optarg, 0, 170); }},
      {"step-translation-m", [&options](const std::string& o) { options.step_m = number(o, optarg, 0, 10); }},
      {"beams", [&options](const std::string& o) { options.beams = integer(o, optarg, 16, 64); }},
      {"width", [&options](const std::string& o) { options.width = integer(o, optarg, 64, 8192); }},
      {"height", [&options](const std::string& o) { options.height = integer(o, optarg, 64, 8192); }},
      {"mask-fraction",
       [&options](const std::string& o) { options.mask_fraction = number(o, optarg, 0, 1); }},
      {"compression",
       [&options](const std::string& o) { options.compress = choice(o, optarg, "lz4", "none") == "lz4"; }},
      {"pictures", [&options](const std::string&) { options.pictures = optarg; }},
      {"threads", [&options](const std::string& o) { options.threads = integer(o, optarg, 1, 1024); }},
      {"deskewed", [&options](const std::string&) { options.deskewed = true; }},
      {"raw", [&options](const std::string&) { options.deskewed = false; }}};
}

std::vector<option> longOptions() {
  std::vector<option> list;
  for (const char* with_value :
       {"seed", "frames", "rate", "speed", "perturb", "step-time", "step-rotation-deg", "step-translation-m",
        "beams", "width", "height", "mask-fraction", "compression", "pictures", "threads"}) {
    list.push_back({with_value, required_argument, nullptr, 0});
  }
  for (const char* flag : {"deskewed", "raw", "help"}) list.push_back({flag, no_argument, nullptr, 0});
  list.push_back({nullptr, 0, nullptr, 0});
  return list;
}

/// @return nothing if help was asked for.
std::optional<Options> parse(int argc, char** argv) {
  const std::vector<option> long_options = longOptions();
  Options options;
  const Setters set = setters(options, argc, argv);
  opterr = 0;
  for (int index = 0, code; (code = getopt_long(argc, argv, ":", long_options.data(), &index)) != -1;) {
    const std::string word = optind > 0 && optind <= argc ? argv[optind - 1] : "";
    if (code == ':') throw UsageError(word + " needs a value.");
    if (code == '?') throw UsageError("Unknown option '" + word + "'.");
    const std::string option_name = long_options[static_cast<std::size_t>(index)].name;
    if (option_name == "help") return std::nullopt;
    set.at(option_name)("--" + option_name);
  }
  if (optind + 1 != argc) {
    throw UsageError(optind < argc ? "One bag at a time; what is '" + std::string(argv[optind + 1]) + "'?"
                                   : "Which bag shall be written?");
  }
  options.out = argv[optind];
  if (options.beams != 16 && options.beams != 32 && options.beams != 64) {
    throw UsageError("--beams needs 16, 32 or 64, not " + std::to_string(options.beams) + ".");
  }
  return options;
}

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

// --- messages
// ------------------------------------------------------------------------------------------------------

std_msgs::Header header(double time, const char* frame) {
  std_msgs::Header result;
  result.stamp = ros::Time(kEpoch + time);
  result.frame_id = frame;
  return result;
}

geometry_msgs::TransformStamped transform(double time, const char* parent, const char* child,
                                          const Isometry3d& T_parent_child) {
  geometry_msgs::TransformStamped message = tf2::eigenToTransform(T_parent_child);
  message.header = header(time, parent);
  message.child_frame_id = child;
  return message;
}

sensor_msgs::CameraInfo cameraInfo(double time, const Intrinsics& intrinsics) {
  sensor_msgs::CameraInfo info;
  info.header = header(time, kCameraFrame);
  info.width = static_cast<std::uint32_t>(intrinsics.width);
  info.height = static_cast<std::uint32_t>(intrinsics.height);
  info.distortion_model = name(intrinsics.model);
  info.D = intrinsics.distortion;
  info.K = {intrinsics.fx, 0, intrinsics.cx, 0, intrinsics.fy, intrinsics.cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {intrinsics.fx, 0, intrinsics.cx, 0, 0, intrinsics.fy, intrinsics.cy, 0, 0, 0, 1, 0};
  return info;
}

sensor_msgs::PointCloud2 cloudMessage(double time, const std::vector<LidarReturn>& sweep) {
  sensor_msgs::PointCloud2 cloud;
  cloud.header = header(time, kLidarFrame);
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

// --- the bag
// -------------------------------------------------------------------------------------------------------

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

  /// @param time  of recording [s] since the start of the drive
  template <typename Message>
  void add(const std::string& topic, double time, Message message, bool latched = false) {
    const ros::Time record_time(kEpoch + time);
    const auto connection = latched ? latchedConnection<Message>(topic) : nullptr;
    waiting_.emplace(record_time, [this, topic, record_time, connection, message = std::move(message)] {
      bag_.write(topic, record_time, message, connection);
    });
  }

  void flush(double until) {
    while (!waiting_.empty() && waiting_.begin()->first <= ros::Time(kEpoch + until)) {
      waiting_.begin()->second();
      waiting_.erase(waiting_.begin());
    }
  }

  void close() {
    flush(1e9);
    bag_.close();
    std::filesystem::rename(unfinished_, path_);
    closed_ = true;
  }

 private:
  /// A player then repeats the message for late subscribers, as its publisher would have.
  template <typename Message>
  boost::shared_ptr<ros::M_string> latchedConnection(const std::string& topic) {
    auto& connection = latched_[topic];
    if (!connection) {
      connection = boost::make_shared<ros::M_string>();
      (*connection)["callerid"] = "/simulate_drive";
      (*connection)["latching"] = "1";
      (*connection)["type"] = ros::message_traits::datatype<Message>();
      (*connection)["md5sum"] = ros::message_traits::md5sum<Message>();
      (*connection)["message_definition"] = ros::message_traits::definition<Message>();
    }
    return connection;
  }

  std::string path_, unfinished_;
  bool closed_ = false;
  rosbag::Bag bag_;
  std::multimap<ros::Time, std::function<void()>> waiting_;
  std::map<std::string, boost::shared_ptr<ros::M_string>> latched_;
};

// --- pictures for people
// -------------------------------------------------------------------------------------------

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

// --- the drive
// -----------------------------------------------------------------------------------------------------

class Drive {
 public:
  explicit Drive(const Options& options)
      : options_(options),
        street_(options.seed, options.speed * options.duration(), options.speed),
        scene_(street_.world()),
        rig_(makeRig(options.seed)),
        camera_(cameraIntrinsics(options)),
        camera_sensor_(camera_, options.threads),
        lidar_sensor_(lidarConfig(options)),
        bag_(options.out, options.compress) {
    const double angle = options.step_deg * kDegree;
    after_step_ = disturbed(rig_.T_camera_lidar, angle, options.step_m, options.seed + 1);
    believed_ = disturbed(rig_.T_camera_lidar, options.error_deg * kDegree, options.error_m, options.seed);
  }

  void run() {
    writeTruth();
    writeStaticTransforms();
    for (int i = 0; i < options_.frames; ++i) {
      const double time = kLead + i / options_.rate;
      writeEgoMotion(time + kLead);
      simulateFrame(i, time);
      bag_.flush(time);
      std::fprintf(stderr, "frame %d of %d: %zu points, %d masks\n", i + 1, options_.frames, points_, masks_);
    }
    bag_.close();
  }

 private:
  static LidarConfig lidarConfig(const Options& options) {
    LidarConfig config;
    config.beams = options.beams;
    config.threads = options.threads;
    return config;
  }

  bool stepHappens() const { return options_.step_time >= 0 && options_.step_time <= options_.duration(); }

  /// @param time  [s] since the start of the drive; the first frame is at kLead
  const Isometry3d& T_camera_lidar(double time) const {
    return stepHappens() && time >= kLead + options_.step_time ? after_step_ : rig_.T_camera_lidar;
  }

  void writeTruth() {
    std::filesystem::path path(options_.out);
    StoredCalibration truth;
    truth.camera_frame = kCameraFrame;
    truth.lidar_frame = kLidarFrame;
    truth.reason = "exact, from the simulation";
    truth.frames = static_cast<std::size_t>(options_.frames);
    truth.source = "simulate_drive --seed " + std::to_string(options_.seed);
    truth.stamp = kEpoch;
    truth.T_camera_lidar = rig_.T_camera_lidar;
    writeCalibration(path.replace_extension(".truth.yaml").string(), truth);
    bag_.add("/simulation/T_camera_lidar", 0.0,
             transform(0.0, kCameraFrame, kLidarFrame, rig_.T_camera_lidar), true);
    if (!stepHappens()) return;
    const double time = kLead + options_.step_time;
    truth.stamp = kEpoch + time;
    truth.T_camera_lidar = after_step_;
    path = options_.out;
    writeCalibration(path.replace_extension(".truth_after_step.yaml").string(), truth);
    bag_.add("/simulation/T_camera_lidar", time, transform(time, kCameraFrame, kLidarFrame, after_step_),
             true);
  }

  /// What the vehicle believes: base_link -> lidar and base_link -> camera_link -> camera_optical_frame.
  void writeStaticTransforms() {
    const Isometry3d T_link_optical = opticalFromLink().inverse();
    const Isometry3d T_base_link = rig_.T_base_lidar * believed_.inverse() * T_link_optical.inverse();
    tf2_msgs::TFMessage message;
    message.transforms = {transform(0.0, kBaseFrame, kLidarFrame, rig_.T_base_lidar),
                          transform(0.0, kBaseFrame, kCameraLinkFrame, T_base_link),
                          transform(0.0, kCameraLinkFrame, kCameraFrame, T_link_optical)};
    bag_.add("/tf_static", 0.0, message, true);
  }

  void writeEgoMotion(double until) {
    for (; tf_count_ * kTfPeriod <= until; ++tf_count_) {
      const double time = tf_count_ * kTfPeriod;
      tf2_msgs::TFMessage message;
      message.transforms = {transform(time, "odom", kBaseFrame, T_odom_base(time))};
      bag_.add("/tf", time + 0.002, message);
    }
  }

  /// odom starts where the vehicle starts.
  Isometry3d T_odom_base(double time) const { return street_.egoPose(0.0).inverse() * street_.egoPose(time); }

  void simulateFrame(int index, double time) {
    const std::uint64_t seed = options_.seed * 1000003 + static_cast<std::uint64_t>(index);
    const double half = 0.5 * lidar_sensor_.duration();
    scene_.setInterval(time - half, time + half);
    const auto T_world_lidar = [&](double t) { return street_.egoPose(t) * rig_.T_base_lidar; };
    const Picture picture =
        camera_sensor_.take(scene_, T_world_lidar(time) * T_camera_lidar(time).inverse(), time, seed);
    std::vector<LidarReturn> sweep = lidar_sensor_.sweep(scene_, T_world_lidar, time, seed);
    if (options_.deskewed) motionCompensate(sweep, T_world_lidar, time);
    const std::vector<cv::Mat> masks = simulateMasks(picture, street_.world().parts, MaskConfig(), seed);
    points_ = sweep.size();

    // Record times: exposure and transport, the end of the sweep, and a segmenter that takes its time.
    const std_msgs::Header image_header = header(time, kCameraFrame);
    bag_.add("/camera/image_raw", time + 0.035,
             *cv_bridge::CvImage(image_header, "bgr8", picture.image).toImageMsg());
    bag_.add("/camera/camera_info", time + 0.035, cameraInfo(time, camera_.intrinsics()));
    bag_.add("/lidar/points", time + half + 0.015, cloudMessage(time, sweep));
    Random random(seed, 8);
    const double delay = random.uniform(0.3, 2.5);
    masks_ = 0;
    if (random.chance(options_.mask_fraction)) {
      masks_ = countMasks(masks);
      bag_.add("/camera/masks", time + delay, toMaskMessage(image_header, masks));
    }
    if (options_.pictures.empty()) return;
    writePicture(options_.pictures, "image", index, picture.image);
    writePicture(options_.pictures, "masks", index, coloredMasks(masks, picture.image));
    writePicture(options_.pictures, "lidar", index,
                 lidarOverPicture(picture.image, camera_, T_camera_lidar(time), sweep));
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
  DriveBag bag_;
  int tf_count_ = 0;
  std::size_t points_ = 0;
  int masks_ = 0;
};

int run(int argc, char** argv) {
  try {
    const std::optional<Options> options = parse(argc, argv);
    if (!options) {
      std::cout << kHelp;
      return 0;
    }
    if (!options->pictures.empty()) std::filesystem::create_directories(options->pictures);
    const std::clock_t start = std::clock();
    Drive(*options).run();
    std::fprintf(stderr, "%s: %d frames, %.1f MB, %.2f s of CPU a frame\n", options->out.c_str(),
                 options->frames, static_cast<double>(std::filesystem::file_size(options->out)) / 1e6,
                 static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC / options->frames);
    return 0;
  } catch (const UsageError& error) {
    std::cerr << "simulate_drive: " << error.what() << " See --help.\n";
    return 2;
  } catch (const std::exception& error) {
    std::cerr << "simulate_drive: " << error.what() << "\n";
    return 1;
  }
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::run(argc, argv); }

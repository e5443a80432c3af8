// Preflight of a bag: whether what is in it fits together, what is missing, and what to remap.

#include <ros/time.h>
#include <tf2/exceptions.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <optional>
#include <set>

#include "bag_contents.hpp"
#include "camera_info_file.hpp"
#include "cameras.hpp"
#include "command_line.hpp"
#include "conversions.hpp"
#include "frame_builder.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/masks.hpp"
#include "lidar_edges.hpp"
#include "motion.hpp"
#include "parameters.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

struct Options {
  std::vector<std::string> bags, assignments, cameras;
  std::string config;
  InputTopics topics;
  double max_gap = -1.0;  ///< [s]; negative: as the parameters say
  int min_frames = 0;     ///< 0: as the parameters say
  bool no_masks = false, no_tf = false;
};

/// One camera's part of the recording, under its parameters.
struct Check {
  const BagContents& contents;
  ServerConfig config;
  InputTopics topics;
  bool no_masks, no_tf;
};

class Verdict {
 public:
  void ok(const std::string& text) { print("ok", text); }
  void note(const std::string& text) { print("note", text); }
  void missing(const std::string& text) { fail("missing", text); }
  void wrong(const std::string& text) { fail("wrong", text); }
  bool usable() const { return usable_; }

 private:
  static void print(const char* label, const std::string& text) {
    std::cout << label << ": " << text << '\n';
  }
  void fail(const char* label, const std::string& text) {
    usable_ = false;
    print(label, text);
  }
  bool usable_ = true;
};

const TopicStats* find(const BagContents& contents, const std::string& topic) {
  const auto found = contents.topics.find(topic);
  return found == contents.topics.end() || found->second.stamps.empty() ? nullptr : &found->second;
}

template <typename Pointer>
Pointer firstOn(const std::map<std::string, Pointer>& messages, const std::string& topic) {
  const auto found = messages.find(topic);
  return found == messages.end() ? nullptr : found->second;
}

// --- what the recording as a whole tells ---

/// Types that hold an input in another form, and how to get from there to the right one.
struct OtherForm {
  const char *type, *part, *remedy;
};
constexpr OtherForm kOtherForms[] = {
    {"velodyne_msgs/VelodyneScan", "points", "play the bag to velodyne_pointcloud and record its cloud"},
    {"ouster_ros/PacketMsg", "points", "play the bag to ouster_ros (replay) and record its cloud"},
    {"hesai_lidar/PandarScan", "points", "play the bag to the Hesai driver and record its cloud"},
    {"hesai_ros_driver/UdpFrame", "points", "play the bag to the Hesai driver and record its cloud"},
    {"rslidar_msg/RslidarPacket", "points", "play the bag to rslidar_sdk and record its cloud"},
    {"livox_ros_driver/CustomMsg", "points",
     "record with xfer_format 0, which makes the driver publish PointCloud2"},
    {"livox_ros_driver2/CustomMsg", "points",
     "record with xfer_format 0, which makes the driver publish PointCloud2"},
    {"theora_image_transport/Packet", "image", "republish it: rosrun image_transport republish theora raw"},
};

std::string otherForm(const BagContents& contents, const std::string& part) {
  for (const auto& [name, stats] : contents.topics) {
    for (const OtherForm& form : kOtherForms) {
      if (stats.topic.count > 0 && stats.topic.type == form.type && part == form.part)
        return name + " is a " + form.type + ": " + form.remedy;
    }
  }
  return "";
}

/// Recordings of known converters need parameters that come with the package.
void suggestConfig(Verdict& verdict, const BagContents& contents, const Options& options) {
  const auto has = [&contents](const char* with_slash) {
    return contents.topics.count(with_slash) > 0 || contents.topics.count(with_slash + 1) > 0;
  };
  const auto suggest = [&](const char* tool, const std::string& file) {
    if (options.config.find(file) == std::string::npos)
      verdict.note(std::string("this looks like a bag of ") + tool + ": use --config config/" + file +
                   ", and read what it says");
  };
  if (has("/kitti/velo/pointcloud")) suggest("kitti2bag", "kitti2bag.yaml");
  if (has("/lidar_top")) suggest("nuscenes2bag", "nuscenes2bag.yaml");
}

void suggestCameras(Verdict& verdict, const BagContents& contents, const Options& options) {
  if (!options.cameras.empty()) return;
  std::set<std::string> infos;
  for (const auto& [name, stats] : contents.topics) {
    if (stats.topic.type == "sensor_msgs/CameraInfo") infos.insert(name);
  }
  if (infos.size() > 1)
    verdict.note("there are " + std::to_string(infos.size()) + " cameras (" + join(infos) +
                 "); --camera NAME=IMAGE_TOPIC, repeated, checks several");
}

// --- topics ---

/// Whether the topic is there, and whether its stamps can be used.
void checkTopic(Verdict& verdict, const BagContents& contents, const std::string& part,
                const std::string& topic, const std::string& remedy) {
  const TopicStats* stats = find(contents, topic);
  if (!stats) {
    const std::string other = otherForm(contents, part);
    return verdict.missing(
        part + (topic.empty() ? ": no topic fits" : ": no messages of a fitting type on " + topic) + "; " +
        (other.empty() ? remedy : other));
  }
  if (stats->stamps.front().isZero())
    return verdict.wrong(part + ": stamps of " + topic + " are zero; the driver must set them");
  if (stats->backwards > 0) {
    verdict.wrong(part + ": " + std::to_string(stats->backwards) + " stamps of " + topic +
                  " are earlier than the one before; each time the node would start over");
  }
  if (stats->frame_ids.size() > 1) verdict.wrong(part + ": several frame ids: " + join(stats->frame_ids));
  // The masks' number of layers may change, a sensor's messages may not.
  if (stats->kinds.size() > 1 && part != "masks") {
    verdict.wrong(part + ": the messages of " + topic + " are not of one kind: " + join(stats->kinds));
  }
  verdict.ok(part + ": " + topic + ", " + std::to_string(stats->stamps.size()) + " messages");
}

void checkTopics(Verdict& verdict, const Check& check) {
  checkTopic(verdict, check.contents, "image", check.topics.image,
             "record the camera's image, or name it with --image");
  if (check.config.camera_info_file.empty()) {
    checkTopic(
        verdict, check.contents, "camera_info", check.topics.camera_info,
        "record the CameraInfo beside the image, or name it with --camera-info, or a file with the parameter "
        "camera_info_file");
  }
  checkTopic(verdict, check.contents, "points", check.topics.points,
             "record the LiDAR as PointCloud2, or name it with --points");
  if (check.no_masks) return;
  checkTopic(verdict, check.contents, "masks", check.topics.masks,
             "play the bag to a mask process and record its output too, or name it with --masks (--no-masks: "
             "do not ask)");
}

// --- first messages ---

/// Runs a conversion of the node on a first message.
template <typename Convert>
void tryConvert(Verdict& verdict, const std::string& part, const Convert& convert) {
  try {
    verdict.ok(part + ": " + convert());
  } catch (const Error& error) {
    verdict.wrong(part + ": " + error.what());
  }
}

std::size_t ringCount(const std::vector<std::uint16_t>& rings) {
  return std::set<std::uint16_t>(rings.begin(), rings.end()).size();
}

void checkRings(Verdict& verdict, const PointCloud& cloud, const ServerConfig& config) {
  const std::vector<std::uint16_t> rings = ringsOf(cloud);
  const bool needed = config.calibrator.objective.objective == "consistency_edges";
  if (!rings.empty()) {
    const std::string count = std::to_string(ringCount(rings)) + " rings, ";
    verdict.ok("points: " + count +
               (rings == cloud.ring ? "by their field"
                                    : "told apart without a field `ring`, by order or elevation"));
  } else if (needed) {
    verdict.wrong(
        "points: no rings (no field `ring`, and none in the order or the elevations of the points); for a "
        "LiDAR that "
        "does not spin, such as Livox, set --set objective=paper --set search=paper, which is less accurate");
  } else {
    verdict.note("points: no rings; objective paper does without, the default one would not");
  }
}

void checkCloud(Verdict& verdict, const sensor_msgs::PointCloud2& message, const ServerConfig& config) {
  std::optional<PointCloud> cloud;
  tryConvert(verdict, "points", [&] {
    cloud = toPointCloud(message, config.intensity_field);
    return std::to_string(cloud->size()) + " usable points in the first cloud, " +
           (cloud->hasReflectivity() ? "with" : "without") + " reflectivity, " +
           (cloud->time.empty() ? "without times of their own" : "with times of their own");
  });
  if (!cloud) return;
  checkRings(verdict, *cloud, config);
  const auto has = [&message](const std::string& name) {
    return std::any_of(message.fields.begin(), message.fields.end(),
                       [&name](const sensor_msgs::PointField& field) { return field.name == name; });
  };
  if (config.intensity_field.empty() && has("intensity") && has("reflectivity")) {
    verdict.note(
        "points: intensity is used; reflectivity, which Ouster frees of the distance, may be better: --set "
        "intensity_field=reflectivity");
  }
}

void checkMasks(Verdict& verdict, const sensor_msgs::Image& message, const FrameConfig& config) {
  std::size_t masks = 0;
  tryConvert(verdict, "masks", [&] {
    const std::vector<cv::Mat> layers = toMaskLayers(message);
    masks = MaskSets::fromLayers(layers).maskCount();
    return "readable, " + std::to_string(masks) + " in the first image in " + std::to_string(layers.size()) +
           " layers, " + describe(message);
  });
  if (masks < static_cast<std::size_t>(config.min_masks)) {
    verdict.note("masks: the first image has " + std::to_string(masks) +
                 ", the parameter frame/min_masks asks for " + std::to_string(config.min_masks));
  }
}

void checkSize(Verdict& verdict, const sensor_msgs::Image& image, const std::string& part,
               const sensor_msgs::CameraInfo& info) {
  if (image.width == info.width && image.height == info.height) return;
  verdict.wrong(part + " is " + std::to_string(image.width) + "x" + std::to_string(image.height) +
                ", camera_info says " + std::to_string(info.width) + "x" + std::to_string(info.height) +
                "; they must be of one size");
}

/// The first messages; null what is not there or cannot be read.
FrameMessages firstMessages(const Check& check) {
  FrameMessages first;
  first.image = firstOn(check.contents.images, check.topics.image);
  first.info = firstOn(check.contents.infos, check.topics.camera_info);
  first.cloud = firstOn(check.contents.clouds, check.topics.points);
  first.masks = check.no_masks ? nullptr : firstOn(check.contents.images, check.topics.masks);
  if (!check.config.camera_info_file.empty())
    first.info =
        boost::make_shared<sensor_msgs::CameraInfo>(readCameraInfoFile(check.config.camera_info_file));
  return first;
}

void checkMessages(Verdict& verdict, const Check& check, const FrameMessages& first) {
  for (const std::string& topic : {check.topics.image, check.topics.masks}) {
    const auto problem = check.contents.unreadable.find(topic);
    if (problem != check.contents.unreadable.end()) verdict.wrong(topic + ": " + problem->second);
  }
  const bool rectified = check.config.image_rectified;
  if (!rectified && check.topics.image.find("image_rect") != std::string::npos)
    verdict.wrong(
        "image: the topic's name says rectified; set image_rectified to true (--set image_rectified=true)");
  if (first.image) {
    tryConvert(verdict, "image", [&] {
      toBgr(*first.image);
      return "readable, " + describe(*first.image);
    });
  }
  if (first.info) {
    tryConvert(verdict, "camera_info", [&] {
      toCamera(*first.info, rectified);
      return "a camera, " + describe(*first.info);
    });
  }
  if (first.cloud) checkCloud(verdict, *first.cloud, check.config);
  if (first.masks) checkMasks(verdict, *first.masks, check.config.frame);
  if (first.image && first.info) checkSize(verdict, *first.image, "image", *first.info);
  if (first.masks && first.info) checkSize(verdict, *first.masks, "masks", *first.info);
}

// --- stamps ---

/// Distance to the nearest stamp [s]; sorted stamps.
double nearest(const std::vector<ros::Time>& stamps, const ros::Time& stamp) {
  const auto after = std::lower_bound(stamps.begin(), stamps.end(), stamp);
  double gap = std::numeric_limits<double>::infinity();
  if (after != stamps.end()) gap = (*after - stamp).toSec();
  if (after != stamps.begin()) gap = std::min(gap, (stamp - *std::prev(after)).toSec());
  return gap;
}

std::vector<ros::Time> sortedStamps(const TopicStats* stats) {
  std::vector<ros::Time> stamps;
  if (stats) stamps = stats->stamps;
  std::sort(stamps.begin(), stamps.end());
  return stamps;
}

std::string share(std::size_t count, std::size_t total) {
  return std::to_string(count) + " of " + std::to_string(total);
}

/// Whether the stamps of the inputs make complete frames.
void checkPairs(Verdict& verdict, const Check& check) {
  const TopicStats *image = find(check.contents, check.topics.image),
                   *info = find(check.contents, check.topics.camera_info),
                   *points = find(check.contents, check.topics.points),
                   *masks = find(check.contents, check.topics.masks);
  const bool info_from_file = !check.config.camera_info_file.empty();
  if (!image || (!info && !info_from_file) || !points) return;
  const std::vector<ros::Time> infos = sortedStamps(info), clouds = sortedStamps(points),
                               mask_stamps = sortedStamps(masks);
  const double limit = check.config.synchroniser.max_stamp_gap;
  std::size_t with_info = 0, with_cloud = 0, with_masks = 0, complete = 0;
  double max_gap = 0.0;
  for (const ros::Time& stamp : image->stamps) {
    const bool has_info = info_from_file || std::binary_search(infos.begin(), infos.end(), stamp);
    const double gap = nearest(clouds, stamp);
    const bool has_cloud = gap <= limit;
    const bool has_masks = std::binary_search(mask_stamps.begin(), mask_stamps.end(), stamp);
    if (has_cloud) max_gap = std::max(max_gap, gap);
    with_info += has_info;
    with_cloud += has_cloud;
    with_masks += has_masks;
    complete += has_info && has_cloud && (has_masks || check.no_masks);
  }
  const std::size_t total = image->stamps.size();
  const auto judge = [&](std::size_t count, const std::string& text, const std::string& remedy) {
    count > 0 ? verdict.ok(share(count, total) + text)
              : verdict.wrong(share(count, total) + text + "; " + remedy);
  };
  if (!info_from_file)
    judge(with_info, " images have a CameraInfo of the same stamp", "both must come from the same driver");
  judge(
      with_cloud,
      " images have a cloud within " + format("%.3f s", limit) + ", largest gap " + format("%.3f s", max_gap),
      "are the clocks of the sensors synchronised? --max-gap sets the limit");
  if (masks && !check.no_masks) {
    judge(with_masks, " images have masks", "the masks must copy the stamp of their image");
  }
  const std::string frames = std::to_string(complete) + " complete frames";
  complete >= static_cast<std::size_t>(check.config.frames_min)
      ? verdict.ok(frames)
      : verdict.wrong(frames + ", " + std::to_string(check.config.frames_min) + " are needed (--min-frames)");
}

void checkClock(Verdict& verdict, const Check& check) {
  constexpr double kLate = 1.0;  // [s]
  for (const std::string& topic : {check.topics.image, check.topics.points}) {
    const TopicStats* stats = find(check.contents, topic);
    if (!stats || (std::abs(stats->min_delay) < kLate && std::abs(stats->max_delay) < kLate)) continue;
    verdict.note(topic + ": stamps and record times are up to " +
                 format("%.1f s", std::max(std::abs(stats->min_delay), std::abs(stats->max_delay))) +
                 " apart: does the sensor have its own clock? Then tf at these stamps may be missing");
  }
  const TopicStats* masks = find(check.contents, check.topics.masks);
  const double timeout = check.config.synchroniser.mask_timeout;
  if (masks && masks->max_delay > timeout) {
    verdict.note("masks: recorded up to " + format("%.1f s", masks->max_delay) +
                 " after their images; the node waits for " + format("%.0f s", timeout) +
                 " (parameter sync/mask_timeout)");
  }
}

// --- frames ---

/// The first guess: the parameter, else tf. Says what is wrong with tf.
std::optional<Eigen::Isometry3d> firstGuess(Verdict& verdict, const Check& check, const FrameIds& ids) {
  if (check.config.initial_T_camera_lidar) return check.config.initial_T_camera_lidar;
  for (const auto& [edge, problem] : check.contents.tf_problems)
    verdict.wrong("tf: " + edge + ": " + problem);
  const std::string chain = ids.lidar + " -> " + ids.camera;
  const std::string remedy =
      "; record /tf and /tf_static, or give an initial extrinsic (--no-tf: do not ask)";
  if (!check.contents.has_tf) {
    verdict.missing("tf: the bag has neither /tf nor /tf_static" + remedy);
    return std::nullopt;
  }
  try {
    const auto transform = check.contents.tf.lookupTransform(ids.camera, ids.lidar, ros::Time(0));
    verdict.ok("tf: " + chain);
    return Eigen::Isometry3d(tf2::transformToEigen(transform).matrix());
  } catch (const tf2::TransformException& error) {
    verdict.missing("tf: no chain " + chain + ": " + error.what() + remedy);
    return std::nullopt;
  }
}

/// Whether tf has the way of the vehicle at the middle frame of the recording.
void checkMotion(Verdict& verdict, const Check& check, const FrameIds& ids) {
  const std::string& fixed = check.config.fixed_frame;
  if (fixed.empty()) return;
  const std::vector<ros::Time>& stamps = find(check.contents, check.topics.image)->stamps;
  const ros::Time stamp = stamps[stamps.size() / 2];
  try {
    PointCloud nothing;
    moveToImage(nothing, check.contents.tf, fixed, ids.lidar, stamp, stamp);
    verdict.ok("tf: the way of " + ids.lidar + " in " + fixed);
  } catch (const Error& error) {
    verdict.wrong(std::string("tf: ") + error.what());
  }
}

void checkFrames(Verdict& verdict, const Check& check, const FrameMessages& first) {
  if (check.no_tf || !first.image || !first.cloud) return;
  try {
    const FrameIds ids = frameIds(first, check.config);
    const auto guess = firstGuess(verdict, check, ids);
    checkMotion(verdict, check, ids);
    if (!guess || !first.info) return;
    const FrameInputs inputs{toCamera(*first.info, check.config.image_rectified),
                             {},
                             {},
                             toPointCloud(*first.cloud, check.config.intensity_field)};
    const StartupCheck projection = checkProjection(inputs, *guess, ids);
    projection.plausible ? verdict.ok(projection.text) : verdict.wrong(projection.text);
  } catch (const Error& error) {
    verdict.wrong(error.what());
  }
}

// --- all of it ---

/// What the launch files are to be told.
std::string remapping(const Check& check) {
  std::string text;
  const auto add = [&](const char* input, const char* flag, const std::string& topic) {
    if (topic.empty()) return;
    const TopicStats* stats = find(check.contents, topic);
    const bool compressed = stats && stats->topic.type == "sensor_msgs/CompressedImage";
    const std::string name = compressed ? withoutTransport(topic) : topic;
    text += std::string(text.empty() ? "" : " ") + input + ":=" + (name.front() == '/' ? "" : "/") + name;
    if (!compressed) return;
    text += std::string(" ") + flag + ":=true";
    if (name == topic) text += " (the node takes NAME/compressed only: relay " + topic + " to such a name)";
  };
  add("image", "compressed", check.topics.image);
  if (check.config.camera_info_file.empty()) add("camera_info", "", check.topics.camera_info);
  add("points", "", check.topics.points);
  add("masks", "masks_compressed", check.topics.masks);
  return text;
}

ServerConfig configOf(const CameraOption& camera, const Options& options) {
  std::vector<std::string> assignments = options.assignments;
  assignments.insert(assignments.end(), camera.assignments.begin(), camera.assignments.end());
  ServerConfig config = loadServerConfig(options.config, assignments);
  if (options.max_gap >= 0.0) config.synchroniser.max_stamp_gap = options.max_gap;
  if (options.min_frames > 0) config.frames_min = options.min_frames;
  return config;
}

bool isUsable(const CameraOption& camera, const Check& check) {
  if (!camera.name.empty()) std::cout << "\ncamera " << camera.name << '\n';
  Verdict verdict;
  checkTopics(verdict, check);
  try {
    const FrameMessages first = firstMessages(check);
    checkMessages(verdict, check, first);
    checkPairs(verdict, check);
    checkClock(verdict, check);
    checkFrames(verdict, check, first);
  } catch (const Error& error) {
    verdict.wrong(error.what());
  }
  std::cout << (verdict.usable() ? "usable; " : "not usable; ") << "remap with " << remapping(check) << '\n';
  return verdict.usable();
}

int check(const Options& options) {
  ros::Time::init();
  const auto bags = openBags(options.bags);
  const std::vector<BagTopic> present = topicsOf(bags);
  std::vector<std::pair<CameraOption, ServerConfig>> cameras;
  std::set<std::string> images, masks;
  for (CameraOption& camera : parseCameras(options.cameras, options.topics)) {
    const ServerConfig config = configOf(camera, options);
    camera.topics = guessTopics(present, firstOf(camera.topics, config.topics));
    images.insert(camera.topics.image);
    masks.insert(camera.topics.masks);
    cameras.emplace_back(std::move(camera), config);
  }
  BagContents contents;
  readContents(bags, images, masks, contents);
  printTable(contents);
  Verdict recording;
  suggestConfig(recording, contents, options);
  suggestCameras(recording, contents, options);
  bool usable = true;
  for (const auto& [camera, config] : cameras) {
    const Check one{contents, config, camera.topics, options.no_masks, options.no_tf};
    usable = isUsable(camera, one) && usable;
  }
  return usable ? kExitOk : kExitInput;
}

}  // namespace

int checkBagMain(int argc, char** argv) {
  Options options;
  CommandLine line{
      "check_bag BAG... [options]",
      "Lists what a recording holds and says whether it can be used to recalibrate, and if not, what is "
      "missing.\n"
      "Several bags are taken as one recording. Exit status 0: usable, 1: not, 2: wrong options.",
      po::options_description("Options"), "bag"};
  line.options.add_options()("bag", po::value(&options.bags)->required()->composing()->value_name("BAG"),
                             "the recording")("config", po::value(&options.config)->value_name("YAML"),
                                              "parameters of the node, as for calibrate_bag")(
      "set", po::value(&options.assignments)->composing()->value_name("NAME=VALUE"),
      "one parameter; may be repeated")("max-gap", atLeast(0.0, &options.max_gap, "max-gap")->value_name("S"),
                                        "largest difference between the stamps of image and cloud [s] "
                                        "(default: the parameter sync/max_stamp_gap)")(
      "min-frames", atLeast(1, &options.min_frames, "min-frames")->value_name("N"),
      "default: the parameter frames/min")("no-masks", po::bool_switch(&options.no_masks),
                                           "masks will be made later")(
      "no-tf", po::bool_switch(&options.no_tf), "the initial extrinsic will come from elsewhere");
  addTopicOptions(line.options, options.topics);
  addCameraOption(line.options, options.cameras);
  return runTool(argc, argv, line, [&options](const po::variables_map&) { return check(options); });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::checkBagMain(argc, argv); }

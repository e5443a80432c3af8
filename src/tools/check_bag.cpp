// Preflight of a bag: what is in it, whether it fits together, and what is missing.

#include <ros/time.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2/buffer_core.h>
#include <tf2/exceptions.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <sstream>

#include "bag_topics.hpp"
#include "command_line.hpp"
#include "conversions.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

struct Options {
  std::vector<std::string> bags;
  InputTopics topics;
  double max_gap = 0.06;  ///< [s]
  int min_frames = 5;
  bool no_masks = false, no_tf = false;
};

/// What was seen on one topic.
struct TopicStats {
  BagTopic topic;
  double first = 0.0, last = 0.0;  ///< record times [s]
  // Of the messages with a header:
  std::vector<ros::Time> stamps;  ///< in the order of recording
  std::set<std::string> frame_ids;
  double max_delay = -std::numeric_limits<double>::infinity();  ///< record time minus stamp [s]
  double min_delay = std::numeric_limits<double>::infinity();
  std::size_t backwards = 0;    ///< stamps earlier than the one before
  std::set<std::string> kinds;  ///< fields, encodings and sizes, camera models
};

struct Contents {
  std::map<std::string, TopicStats> topics;
  tf2::BufferCore tf;
  bool has_tf = false;
  std::map<std::string, std::string> tf_problems;  ///< transforms that tf2 refuses, by edge
  // First messages of the inputs.
  sensor_msgs::ImageConstPtr image, masks;
  sensor_msgs::CameraInfoConstPtr info;
  sensor_msgs::PointCloud2ConstPtr cloud;
};

std::string format(const char* pattern, double value) {
  char text[64];
  std::snprintf(text, sizeof text, pattern, value);
  return text;
}

std::string join(const std::set<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

// --- reading ---

void addHeader(TopicStats& stats, const std_msgs::Header& header, const ros::Time& recorded) {
  if (!stats.stamps.empty() && header.stamp < stats.stamps.back()) ++stats.backwards;
  stats.stamps.push_back(header.stamp);
  stats.frame_ids.insert(header.frame_id.empty() ? "(none)" : header.frame_id);
  const double delay = recorded.toSec() - header.stamp.toSec();
  stats.min_delay = std::min(stats.min_delay, delay);
  stats.max_delay = std::max(stats.max_delay, delay);
}

std::string describe(const sensor_msgs::PointCloud2& cloud) {
  static const char* const kTypes[] = {"?",     "int8",   "uint8",   "int16",  "uint16",
                                       "int32", "uint32", "float32", "float64"};
  std::string text;
  for (const sensor_msgs::PointField& field : cloud.fields) {
    text += (text.empty() ? "" : " ") + field.name + ":" + kTypes[field.datatype <= 8 ? field.datatype : 0];
  }
  return text;
}

std::string describe(const sensor_msgs::Image& image) {
  return image.encoding + " " + std::to_string(image.width) + "x" + std::to_string(image.height);
}

std::string describe(const sensor_msgs::CameraInfo& info) {
  std::ostringstream text;
  text << (info.distortion_model.empty() ? "(no model)" : info.distortion_model) << ' ' << info.width << 'x'
       << info.height << " fx " << info.K[0] << " fy " << info.K[4] << " cx " << info.K[2] << " cy "
       << info.K[5] << ", " << info.D.size() << " coefficients";
  return text.str();
}

void addTf(Contents& contents, const tf2_msgs::TFMessage& message, bool is_static) {
  contents.has_tf = true;
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    if (contents.tf.setTransform(transform, "bag", is_static)) continue;
    contents.tf_problems[transform.header.frame_id + " -> " + transform.child_frame_id] = "refused by tf2";
  }
}

/// Describing is cheap, decoding is not: compressed images are decoded only once.
void addMessage(Contents& contents, TopicStats& stats, const rosbag::MessageInstance& message,
                const InputTopics& inputs) {
  const std::string& topic = message.getTopic();
  const ros::Time& recorded = message.getTime();
  if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
    addHeader(stats, cloud->header, recorded);
    stats.kinds.insert(describe(*cloud));
    if (topic == inputs.points && !contents.cloud) contents.cloud = cloud;
  } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
    addHeader(stats, info->header, recorded);
    stats.kinds.insert(describe(*info));
    if (topic == inputs.camera_info && !contents.info) contents.info = info;
  } else if (const auto image = message.instantiate<sensor_msgs::Image>()) {
    addHeader(stats, image->header, recorded);
    stats.kinds.insert(describe(*image));
    if (topic == inputs.image && !contents.image) contents.image = image;
    if (topic == inputs.masks && !contents.masks) contents.masks = image;
  } else if (const auto compressed = message.instantiate<sensor_msgs::CompressedImage>()) {
    addHeader(stats, compressed->header, recorded);
    stats.kinds.insert(compressed->format);
    if (topic == inputs.image && !contents.image) contents.image = imageFrom(message);
    if (topic == inputs.masks && !contents.masks) contents.masks = imageFrom(message);
  } else if (const auto tf = message.instantiate<tf2_msgs::TFMessage>()) {
    addTf(contents, *tf, topic.find("static") != std::string::npos);
  }
}

void readContents(const std::vector<std::unique_ptr<rosbag::Bag>>& bags, const InputTopics& inputs,
                  Contents& contents) {
  for (const BagTopic& topic : topicsOf(bags)) contents.topics[topic.name].topic = topic;
  rosbag::View view;
  for (const auto& bag : bags) view.addQuery(*bag);
  ProgressBar progress;
  std::size_t count = 0;
  for (const rosbag::MessageInstance& message : view) {
    TopicStats& stats = contents.topics[message.getTopic()];
    const double recorded = message.getTime().toSec();
    if (stats.first == 0.0) stats.first = recorded;
    stats.last = recorded;
    addMessage(contents, stats, message, inputs);
    progress.show("reading", double(++count) / double(view.size()));
  }
}

// --- table ---

double maxStampGap(const TopicStats& stats) {
  std::vector<ros::Time> stamps = stats.stamps;
  std::sort(stamps.begin(), stamps.end());
  double gap = 0.0;
  for (std::size_t i = 1; i < stamps.size(); ++i) gap = std::max(gap, (stamps[i] - stamps[i - 1]).toSec());
  return gap;
}

void printTable(const Contents& contents) {
  std::printf("%-32s %-28s %7s %7s %9s %18s %9s  %s\n", "topic", "type", "count", "Hz", "max gap",
              "recorded - stamp", "backwards", "frame ids");
  for (const auto& [name, stats] : contents.topics) {
    const double span = stats.last - stats.first;
    const std::string rate = span > 0.0 ? format("%.2f", double(stats.topic.count - 1) / span) : "-";
    std::string gap = "-", delay = "-", backwards = "-";
    if (!stats.stamps.empty()) {
      gap = format("%.3f s", maxStampGap(stats));
      delay = format("%.3f", stats.min_delay) + " to " + format("%.3f s", stats.max_delay);
      backwards = std::to_string(stats.backwards);
    }
    std::printf("%-32s %-28s %7llu %7s %9s %18s %9s  %s\n", name.c_str(), stats.topic.type.c_str(),
                static_cast<unsigned long long>(stats.topic.count), rate.c_str(), gap.c_str(), delay.c_str(),
                backwards.c_str(), join(stats.frame_ids).c_str());
    for (const std::string& kind : stats.kinds) std::printf("    %s\n", kind.c_str());
  }
  std::printf("\n");
}

// --- verdict ---

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

const TopicStats* find(const Contents& contents, const std::string& topic) {
  const auto found = contents.topics.find(topic);
  return found == contents.topics.end() || found->second.stamps.empty() ? nullptr : &found->second;
}

/// Whether the topic is there, and whether its stamps can be used.
void checkTopic(Verdict& verdict, const Contents& contents, const std::string& part, const std::string& topic,
                const std::string& remedy) {
  const TopicStats* stats = find(contents, topic);
  if (!stats) {
    return verdict.missing(
        part + (topic.empty() ? ": no topic fits" : ": no messages of a fitting type on " + topic) + "; " +
        remedy);
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

void checkTopics(Verdict& verdict, const Contents& contents, const Options& options,
                 const InputTopics& topics) {
  checkTopic(verdict, contents, "image", topics.image, "record the camera's image, or name it with --image");
  checkTopic(verdict, contents, "camera_info", topics.camera_info,
             "record the CameraInfo beside the image, or name it with --camera-info");
  checkTopic(verdict, contents, "points", topics.points,
             "record the LiDAR as PointCloud2, or name it with --points");
  if (options.no_masks) return;
  checkTopic(verdict, contents, "masks", topics.masks,
             "play the bag to a mask process and record its output too, or name it with --masks (--no-masks: "
             "do not ask)");
}

/// Runs a conversion of the node on a first message.
template <typename Convert>
void tryConvert(Verdict& verdict, const std::string& part, const Convert& convert) {
  try {
    verdict.ok(part + ": " + convert());
  } catch (const Error& error) {
    verdict.wrong(part + ": " + error.what());
  }
}

void checkSize(Verdict& verdict, const sensor_msgs::Image& image, const std::string& part,
               const sensor_msgs::CameraInfo& info) {
  if (image.width == info.width && image.height == info.height) return;
  verdict.wrong(part + " is " + std::to_string(image.width) + "x" + std::to_string(image.height) +
                ", camera_info says " + std::to_string(info.width) + "x" + std::to_string(info.height) +
                "; they must be of one size");
}

void checkMessages(Verdict& verdict, const Contents& contents, const InputTopics& topics) {
  const bool rectified = topics.image.find("image_rect") != std::string::npos;
  if (rectified)
    verdict.note("image: the topic's name says rectified; the parameter image_rectified must then be true");
  if (contents.image) {
    tryConvert(verdict, "image", [&] {
      toBgr(*contents.image);
      return "readable, " + describe(*contents.image);
    });
  }
  if (contents.info) {
    tryConvert(verdict, "camera_info", [&] {
      toCamera(*contents.info, rectified);
      return "a camera, " + describe(*contents.info);
    });
  }
  if (contents.cloud) {
    tryConvert(verdict, "points", [&] {
      const PointCloud cloud = toPointCloud(*contents.cloud, "");
      return std::to_string(cloud.size()) + " usable points in the first cloud, " +
             (cloud.hasReflectivity() ? "with" : "without") + " reflectivity";
    });
  }
  if (contents.masks) {
    tryConvert(verdict, "masks", [&] {
      return "readable, " + std::to_string(toMaskLayers(*contents.masks).size()) + " layers, " +
             describe(*contents.masks);
    });
  }
  if (contents.image && contents.info) checkSize(verdict, *contents.image, "image", *contents.info);
  if (contents.masks && contents.info) checkSize(verdict, *contents.masks, "masks", *contents.info);
}

/// Distance to the nearest stamp [s]; sorted stamps.
double nearest(const std::vector<ros::Time>& stamps, const ros::Time& stamp) {
  const auto after = std::lower_bound(stamps.begin(), stamps.end(), stamp);
  double gap = std::numeric_limits<double>::infinity();
  if (after != stamps.end()) gap = (*after - stamp).toSec();
  if (after != stamps.begin()) gap = std::min(gap, (stamp - *std::prev(after)).toSec());
  return gap;
}

std::vector<ros::Time> sortedStamps(const TopicStats& stats) {
  std::vector<ros::Time> stamps = stats.stamps;
  std::sort(stamps.begin(), stamps.end());
  return stamps;
}

std::string share(std::size_t count, std::size_t total) {
  return std::to_string(count) + " of " + std::to_string(total);
}

/// Whether the stamps of the inputs make complete frames.
void checkPairs(Verdict& verdict, const Contents& contents, const Options& options,
                const InputTopics& topics) {
  const TopicStats *image = find(contents, topics.image), *info = find(contents, topics.camera_info),
                   *points = find(contents, topics.points), *masks = find(contents, topics.masks);
  if (!image || !info || !points) return;
  const std::vector<ros::Time> infos = sortedStamps(*info), clouds = sortedStamps(*points);
  const std::vector<ros::Time> mask_stamps = masks ? sortedStamps(*masks) : std::vector<ros::Time>();
  std::size_t with_info = 0, with_cloud = 0, with_masks = 0, complete = 0;
  double max_gap = 0.0;
  for (const ros::Time& stamp : image->stamps) {
    const bool has_info = std::binary_search(infos.begin(), infos.end(), stamp);
    const double gap = nearest(clouds, stamp);
    const bool has_cloud = gap <= options.max_gap;
    const bool has_masks = std::binary_search(mask_stamps.begin(), mask_stamps.end(), stamp);
    if (has_cloud) max_gap = std::max(max_gap, gap);
    with_info += has_info;
    with_cloud += has_cloud;
    with_masks += has_masks;
    complete += has_info && has_cloud && (has_masks || options.no_masks);
  }
  const std::size_t total = image->stamps.size();
  const auto judge = [&](std::size_t count, const std::string& text, const std::string& remedy) {
    count > 0 ? verdict.ok(share(count, total) + text)
              : verdict.wrong(share(count, total) + text + "; " + remedy);
  };
  judge(with_info, " images have a CameraInfo of the same stamp", "both must come from the same driver");
  judge(with_cloud,
        " images have a cloud within " + format("%.3f s", options.max_gap) + ", largest gap " +
            format("%.3f s", max_gap),
        "are the clocks of the sensors synchronised? --max-gap sets the limit");
  if (masks && !options.no_masks) {
    judge(with_masks, " images have masks", "the masks must copy the stamp of their image");
  }
  const std::string frames = std::to_string(complete) + " complete frames";
  complete >= static_cast<std::size_t>(options.min_frames)
      ? verdict.ok(frames)
      : verdict.wrong(frames + ", " + std::to_string(options.min_frames) + " are needed (--min-frames)");
}

void checkClock(Verdict& verdict, const Contents& contents, const InputTopics& topics) {
  constexpr double kLate = 1.0;  // [s]
  for (const std::string& topic : {topics.image, topics.points}) {
    const TopicStats* stats = find(contents, topic);
    if (!stats || (std::abs(stats->min_delay) < kLate && std::abs(stats->max_delay) < kLate)) continue;
    verdict.note(topic + ": stamps and record times are up to " +
                 format("%.1f s", std::max(std::abs(stats->min_delay), std::abs(stats->max_delay))) +
                 " apart: does the sensor have its own clock? Then tf at these stamps may be missing");
  }
  const TopicStats* masks = find(contents, topics.masks);
  constexpr double kMaskTimeout = 60.0;  // [s], the default of the node
  if (masks && masks->max_delay > kMaskTimeout) {
    verdict.note("masks: recorded up to " + format("%.1f s", masks->max_delay) +
                 " after their images; the node waits for " + format("%.0f s", kMaskTimeout) + " by default");
  }
}

void checkTf(Verdict& verdict, const Contents& contents, const Options& options, const InputTopics& topics) {
  const TopicStats *image = find(contents, topics.image), *points = find(contents, topics.points);
  if (options.no_tf || !image || !points) return;
  for (const auto& [edge, problem] : contents.tf_problems) verdict.wrong("tf: " + edge + ": " + problem);
  const auto id = [](const TopicStats& stats) {
    return stats.frame_ids.begin()->substr(stats.frame_ids.begin()->find_first_not_of('/'));
  };
  const std::string camera = id(*image), lidar = id(*points);
  const std::string chain = lidar + " -> " + camera;
  const std::string remedy =
      "; record /tf and /tf_static, or give an initial extrinsic (--no-tf: do not ask)";
  if (!contents.has_tf) return verdict.missing("tf: the bag has neither /tf nor /tf_static" + remedy);
  std::string problem;
  try {
    if (contents.tf.canTransform(camera, lidar, ros::Time(0), &problem)) {
      verdict.ok("tf: " + chain);
    } else {
      verdict.missing("tf: no chain " + chain + ": " + problem + remedy);
    }
  } catch (const tf2::TransformException& error) {
    verdict.missing("tf: no chain " + chain + ": " + error.what() + remedy);
  }
}

int check(const Options& options) {
  ros::Time::init();
  const auto bags = openBags(options.bags);
  const InputTopics topics = guessTopics(topicsOf(bags), options.topics);
  Contents contents;
  readContents(bags, topics, contents);
  printTable(contents);
  Verdict verdict;
  checkTopics(verdict, contents, options, topics);
  checkMessages(verdict, contents, topics);
  checkPairs(verdict, contents, options, topics);
  checkClock(verdict, contents, topics);
  checkTf(verdict, contents, options, topics);
  std::cout << (verdict.usable() ? "usable; " : "not usable; ") << "remap with image:=" << topics.image
            << " camera_info:=" << topics.camera_info << " points:=" << topics.points
            << " masks:=" << topics.masks << '\n';
  return verdict.usable() ? kExitOk : kExitInput;
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
                             "the recording")(
      "max-gap", atLeast(0.0, &options.max_gap, "max-gap")->value_name("S"),
      "largest difference between the stamps of image and cloud [s] (default 0.06)")(
      "min-frames", atLeast(1, &options.min_frames, "min-frames")->value_name("N"), "default 5")(
      "no-masks", po::bool_switch(&options.no_masks), "masks will be made later")(
      "no-tf", po::bool_switch(&options.no_tf), "the initial extrinsic will come from elsewhere");
  addTopicOptions(line.options, options.topics);
  return runTool(argc, argv, line, [&options](const po::variables_map&) { return check(options); });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::checkBagMain(argc, argv); }

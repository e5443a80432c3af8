#include "bag_contents.hpp"

#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <tf2_msgs/TFMessage.h>

#include <algorithm>
#include <cstdio>
#include <sstream>

#include "command_line.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

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

namespace {

void addHeader(TopicStats& stats, const std_msgs::Header& header, const ros::Time& recorded) {
  if (!stats.stamps.empty() && header.stamp < stats.stamps.back()) ++stats.backwards;
  stats.stamps.push_back(header.stamp);
  stats.frame_ids.insert(header.frame_id.empty() ? "(none)" : header.frame_id);
  const double delay = recorded.toSec() - header.stamp.toSec();
  stats.min_delay = std::min(stats.min_delay, delay);
  stats.max_delay = std::max(stats.max_delay, delay);
}

void addTf(BagContents& contents, const tf2_msgs::TFMessage& message, bool is_static) {
  contents.has_tf = true;
  for (const geometry_msgs::TransformStamped& transform : message.transforms) {
    if (contents.tf.setTransform(transform, "bag", is_static)) continue;
    contents.tf_problems[transform.header.frame_id + " -> " + transform.child_frame_id] = "refused by tf2";
  }
}

/// Describing is cheap, decoding is not: compressed images are decoded only once.
void decodeFirst(BagContents& contents, const rosbag::MessageInstance& message, bool masks) {
  const std::string& topic = message.getTopic();
  if (contents.images.count(topic) > 0 || contents.unreadable.count(topic) > 0) return;
  try {
    contents.images[topic] = masks ? masksFrom(message) : imageFrom(message);
  } catch (const Error& error) {
    contents.unreadable[topic] = error.what();
  }
}

void addMessage(BagContents& contents, TopicStats& stats, const rosbag::MessageInstance& message,
                const std::set<std::string>& images, const std::set<std::string>& masks) {
  const std::string& topic = message.getTopic();
  const ros::Time& recorded = message.getTime();
  if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
    addHeader(stats, cloud->header, recorded);
    stats.kinds.insert(describe(*cloud));
    contents.clouds.emplace(topic, cloud);
  } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
    addHeader(stats, info->header, recorded);
    stats.kinds.insert(describe(*info));
    contents.infos.emplace(topic, info);
  } else if (const auto image = message.instantiate<sensor_msgs::Image>()) {
    addHeader(stats, image->header, recorded);
    stats.kinds.insert(describe(*image));
    contents.images.emplace(topic, image);
  } else if (const auto compressed = message.instantiate<sensor_msgs::CompressedImage>()) {
    addHeader(stats, compressed->header, recorded);
    stats.kinds.insert(compressed->format);
    if (masks.count(topic) > 0 || images.count(topic) > 0)
      decodeFirst(contents, message, masks.count(topic) > 0);
  } else if (const auto tf = message.instantiate<tf2_msgs::TFMessage>()) {
    addTf(contents, *tf, topic.find("static") != std::string::npos);
  }
}

double maxStampGap(const TopicStats& stats) {
  std::vector<ros::Time> stamps = stats.stamps;
  std::sort(stamps.begin(), stamps.end());
  double gap = 0.0;
  for (std::size_t i = 1; i < stamps.size(); ++i) gap = std::max(gap, (stamps[i] - stamps[i - 1]).toSec());
  return gap;
}

}  // namespace

void readContents(const std::vector<std::unique_ptr<rosbag::Bag>>& bags, const std::set<std::string>& images,
                  const std::set<std::string>& masks, BagContents& contents) {
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
    addMessage(contents, stats, message, images, masks);
    progress.show("reading", double(++count) / double(view.size()));
  }
}

void printTable(const BagContents& contents) {
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

}  // namespace lidar_camera_recalibration

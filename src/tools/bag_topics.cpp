#include "bag_topics.hpp"

#include <rosbag/view.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/PointCloud2.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>

#include "conversions.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

bool containsAny(const std::string& text, const std::vector<std::string>& parts) {
  return std::any_of(parts.begin(), parts.end(),
                     [&](const std::string& part) { return contains(text, part); });
}

/// Topic without its last part, and without the transport's suffix: `/camera` of
/// `/camera/image_raw/compressed`.
std::string cameraNamespace(std::string topic) {
  const std::string suffix = "/compressed";
  if (topic.size() > suffix.size() &&
      topic.compare(topic.size() - suffix.size(), suffix.size(), suffix) == 0) {
    topic.erase(topic.size() - suffix.size());
  }
  return topic.substr(0, topic.rfind('/'));
}

bool isImage(const BagTopic& topic) {
  return topic.type == "sensor_msgs/Image" || topic.type == "sensor_msgs/CompressedImage";
}
bool isMasks(const BagTopic& topic) { return isImage(topic) && contains(topic.name, "mask"); }

/// How well a topic fits a part; negative: not at all.
using Fit = std::function<int(const BagTopic&)>;

int imageFit(const BagTopic& topic) {
  const std::vector<std::string> others = {"overlay", "depth", "label", "segment", "disparity", "debug"};
  if (!isImage(topic) || isMasks(topic) || containsAny(topic.name, others)) return -1;
  int fit = 1;
  if (topic.type == "sensor_msgs/Image") fit += 1;  // nothing to decode
  if (contains(topic.name, "image_raw")) {
    fit += 6;
  } else if (contains(topic.name, "image_rect")) {
    fit += 4;
  } else if (contains(topic.name, "image")) {
    fit += 2;
  }
  return fit;
}

int masksFit(const BagTopic& topic) { return isMasks(topic) ? 1 + (topic.type == "sensor_msgs/Image") : -1; }

int pointsFit(const BagTopic& topic) {
  if (topic.type != "sensor_msgs/PointCloud2") return -1;
  if (containsAny(topic.name, {"colored", "map", "filtered", "ground", "cluster"})) return 0;
  const bool hint =
      containsAny(topic.name, {"lidar", "velodyne", "ouster", "hesai", "livox", "rslidar", "pandar"});
  return hint ? 2 : 1;
}

std::string best(const std::vector<BagTopic>& topics, const Fit& fit) {
  const BagTopic* winner = nullptr;
  const auto better = [&fit](const BagTopic& a, const BagTopic& b) {
    return std::make_pair(fit(a), a.count) > std::make_pair(fit(b), b.count);
  };
  for (const BagTopic& topic : topics) {
    if (topic.count > 0 && fit(topic) >= 0 && (!winner || better(topic, *winner))) winner = &topic;
  }
  return winner ? winner->name : "";
}

}  // namespace

InputTopics guessTopics(const std::vector<BagTopic>& topics, const InputTopics& given) {
  InputTopics result = given;
  if (result.image.empty()) result.image = best(topics, imageFit);
  if (result.points.empty()) result.points = best(topics, pointsFit);
  if (result.masks.empty()) result.masks = best(topics, masksFit);
  if (result.camera_info.empty()) {
    const std::string home = cameraNamespace(result.image);
    result.camera_info = best(topics, [&home](const BagTopic& topic) {
      if (topic.type != "sensor_msgs/CameraInfo") return -1;
      return cameraNamespace(topic.name) == home ? 1 : 0;
    });
  }
  return result;
}

void addTopicOptions(po::options_description& options, InputTopics& topics) {
  options.add_options()("image", po::value(&topics.image)->value_name("TOPIC"),
                        "image, raw or compressed (default: guessed by type and name, as for the others)")(
      "camera-info", po::value(&topics.camera_info)->value_name("TOPIC"), "its CameraInfo")(
      "points", po::value(&topics.points)->value_name("TOPIC"), "PointCloud2 of the LiDAR")(
      "masks", po::value(&topics.masks)->value_name("TOPIC"), "mask images");
}

std::unique_ptr<rosbag::Bag> openBag(const std::string& path) {
  const auto refuse = [&path](const std::string& what) -> Error {
    return Error(ErrorCause::kFile, "\"" + path + "\": " + what);
  };
  std::error_code error;
  if (!std::filesystem::is_regular_file(path, error)) throw refuse("there is no such file");
  auto bag = std::make_unique<rosbag::Bag>();
  try {
    bag->open(path, rosbag::bagmode::Read);
  } catch (const rosbag::BagUnindexedException&) {
    throw refuse("the bag has no index, its recording was interrupted; \"rosbag reindex\" repairs it");
  } catch (const std::exception& problem) {
    throw refuse(std::string("this is no ROS 1 bag, or it was cut short (") + problem.what() + ")");
  }
  return bag;
}

std::vector<std::unique_ptr<rosbag::Bag>> openBags(const std::vector<std::string>& paths) {
  std::vector<std::unique_ptr<rosbag::Bag>> bags;
  for (const std::string& path : paths) bags.push_back(openBag(path));
  return bags;
}

std::vector<BagTopic> topicsOf(const std::vector<std::unique_ptr<rosbag::Bag>>& bags) {
  std::map<std::string, BagTopic> topics;
  for (const auto& bag : bags) {
    rosbag::View all(*bag);
    for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
      topics[connection->topic] = {connection->topic, connection->datatype, 0};
    }
  }
  std::vector<BagTopic> result;
  for (auto& [name, topic] : topics) {
    for (const auto& bag : bags) topic.count += rosbag::View(*bag, rosbag::TopicQuery(name)).size();
    result.push_back(topic);
  }
  return result;
}

std::string frameIdOf(const std::vector<std::unique_ptr<rosbag::Bag>>& bags, const std::string& topic) {
  for (const auto& bag : bags) {
    for (const rosbag::MessageInstance& message : rosbag::View(*bag, rosbag::TopicQuery(topic))) {
      if (const auto image = message.instantiate<sensor_msgs::Image>()) return image->header.frame_id;
      if (const auto image = message.instantiate<sensor_msgs::CompressedImage>())
        return image->header.frame_id;
      if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) return cloud->header.frame_id;
      break;
    }
  }
  return "";
}

sensor_msgs::ImageConstPtr imageFrom(const rosbag::MessageInstance& message) {
  if (const auto image = message.instantiate<sensor_msgs::Image>()) return image;
  if (const auto compressed = message.instantiate<sensor_msgs::CompressedImage>()) return decode(*compressed);
  return nullptr;
}

}  // namespace lidar_camera_recalibration

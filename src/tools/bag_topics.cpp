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

std::string withoutSlash(const std::string& topic) {
  return topic.empty() || topic.front() != '/' ? topic : topic.substr(1);
}

/// Topic without its last part, the transport's suffix and the slash before all: `front/camera` of
/// `/front/camera/image_raw/compressed`, `front` of `front/compressed`.
std::string cameraNamespace(const std::string& topic) {
  const std::string name = withoutSlash(withoutTransport(topic));
  const std::size_t slash = name.rfind('/');
  if (slash != std::string::npos) return name.substr(0, slash);
  return withoutTransport(topic) == topic ? "" : name;
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

/// A topic as the bags spell it; unchanged if they do not have it.
std::string asRecorded(const std::vector<BagTopic>& topics, const std::string& given) {
  if (given.empty()) return given;
  for (const std::string& name : {given, given + "/compressed"}) {
    for (const BagTopic& topic : topics) {
      if (topic.count > 0 && withoutSlash(topic.name) == withoutSlash(name)) return topic.name;
    }
  }
  return given;
}

/// Whether the masks, those given or any, are those of the image's camera.
bool hasMasks(const std::vector<BagTopic>& topics, const std::string& given, const std::string& image) {
  if (!given.empty()) return cameraNamespace(given) == cameraNamespace(image);
  return std::any_of(topics.begin(), topics.end(), [&image](const BagTopic& topic) {
    return isMasks(topic) && topic.count > 0 && cameraNamespace(topic.name) == cameraNamespace(image);
  });
}

/// Whether another camera's images stand in the topic's namespace.
bool belongsToAnother(const std::vector<BagTopic>& topics, const BagTopic& topic, const std::string& home) {
  const std::string own = cameraNamespace(topic.name);
  return own != home && std::any_of(topics.begin(), topics.end(), [&own](const BagTopic& other) {
           return imageFit(other) >= 0 && cameraNamespace(other.name) == own;
         });
}

/// The best topic in the image's namespace; else the best one with the camera's name in its own; else the
/// only one: what belongs to another camera must not slip in.
std::string ofCamera(const std::vector<BagTopic>& topics, const std::string& image, const Fit& fit) {
  const std::string home = cameraNamespace(image), camera = home.substr(home.rfind('/') + 1);
  constexpr int kRelated = 100, kNeighbour = 200;
  const Fit kinship = [&](const BagTopic& topic) {
    const int own = fit(topic);
    if (own < 0 || belongsToAnother(topics, topic, home)) return -1;
    if (cameraNamespace(topic.name) == home) return kNeighbour + own;
    return !camera.empty() && contains(topic.name, camera) ? kRelated + own : own;
  };
  const auto candidates = std::count_if(topics.begin(), topics.end(), [&](const BagTopic& topic) {
    return topic.count > 0 && kinship(topic) >= 0;
  });
  const std::string winner = best(topics, kinship);
  const bool related = std::any_of(topics.begin(), topics.end(), [&](const BagTopic& topic) {
    return topic.name == winner && kinship(topic) >= kRelated;
  });
  return candidates == 1 || related ? winner : "";
}

}  // namespace

std::string withoutTransport(const std::string& topic) {
  const std::string suffix = "/compressed";
  const bool ends =
      topic.size() > suffix.size() && topic.compare(topic.size() - suffix.size(), suffix.size(), suffix) == 0;
  return ends ? topic.substr(0, topic.size() - suffix.size()) : topic;
}

InputTopics guessTopics(const std::vector<BagTopic>& topics, const InputTopics& given) {
  InputTopics result = given;
  for (std::string* topic : {&result.image, &result.camera_info, &result.points, &result.masks})
    *topic = asRecorded(topics, *topic);
  if (result.points.empty()) result.points = best(topics, pointsFit);
  if (result.image.empty()) {
    result.image = best(topics, [&](const BagTopic& topic) {
      constexpr int kHasMasks = 100;
      const int fit = imageFit(topic);
      return fit >= 0 && hasMasks(topics, result.masks, topic.name) ? fit + kHasMasks : fit;
    });
  }
  if (result.masks.empty()) result.masks = ofCamera(topics, result.image, masksFit);
  if (result.camera_info.empty()) {
    result.camera_info = ofCamera(topics, result.image, [](const BagTopic& topic) {
      return topic.type == "sensor_msgs/CameraInfo" ? 0 : -1;
    });
  }
  return result;
}

InputTopics firstOf(InputTopics first, const InputTopics& second) {
  const auto fill = [](std::string& topic, const std::string& other) {
    if (topic.empty()) topic = other;
  };
  fill(first.image, second.image);
  fill(first.camera_info, second.camera_info);
  fill(first.points, second.points);
  fill(first.masks, second.masks);
  return first;
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

sensor_msgs::ImageConstPtr masksFrom(const rosbag::MessageInstance& message) {
  if (const auto compressed = message.instantiate<sensor_msgs::CompressedImage>())
    return decodeMasks(*compressed);
  return imageFrom(message);
}

}  // namespace lidar_camera_recalibration

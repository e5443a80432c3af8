#pragma once

#include <rosbag/bag.h>
#include <sensor_msgs/Image.h>

#include <boost/program_options.hpp>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "server_config.hpp"

namespace rosbag {
class MessageInstance;
}

namespace lidar_camera_recalibration {

struct BagTopic {
  std::string name;
  std::string type;         ///< `sensor_msgs/Image`
  std::uint64_t count = 0;  ///< messages
};

/// Finds what is `given`, with or without a leading slash or `/compressed`, as the bags spell it, and fills
/// in what is left empty, by type and name: masks are images with `mask` in their names, the other image is
/// preferably a raw one of a camera with masks, CameraInfo and masks are those of the image's camera, the
/// cloud's name hints at a LiDAR. Between equals the one with more messages wins. Empty: nothing fits, or
/// several cameras and no hint.
InputTopics guessTopics(const std::vector<BagTopic>& topics, const InputTopics& given);

/// The first, where it is silent the second.
InputTopics firstOf(InputTopics first, const InputTopics& second);

/// `/camera/image_raw` of `/camera/image_raw/compressed`.
std::string withoutTransport(const std::string& topic);

/// `--image`, `--camera-info`, `--points`, `--masks`.
void addTopicOptions(boost::program_options::options_description& options, InputTopics& topics);

/// @throw Error(kFile) saying in words why the bag cannot be read, and that an unindexed one can be repaired.
std::unique_ptr<rosbag::Bag> openBag(const std::string& path);
std::vector<std::unique_ptr<rosbag::Bag>> openBags(const std::vector<std::string>& paths);

/// Topics of all bags together, sorted by name.
std::vector<BagTopic> topicsOf(const std::vector<std::unique_ptr<rosbag::Bag>>& bags);

/// Frame id of the topic's first message with a header; empty if there is none.
std::string frameIdOf(const std::vector<std::unique_ptr<rosbag::Bag>>& bags, const std::string& topic);

/// The image, or masks, of an Image or CompressedImage message; null for any other type.
/// @throw Error(kImage, kMasks) if the compressed one cannot be decoded.
sensor_msgs::ImageConstPtr imageFrom(const rosbag::MessageInstance& message);
sensor_msgs::ImageConstPtr masksFrom(const rosbag::MessageInstance& message);

}  // namespace lidar_camera_recalibration

#pragma once

#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2/buffer_core.h>

#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "bag_topics.hpp"

namespace lidar_camera_recalibration {

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

/// All that a preflight asks of a recording.
struct BagContents {
  std::map<std::string, TopicStats> topics;
  tf2::BufferCore tf{ros::Duration(1e6)};  ///< the whole recording's
  bool has_tf = false;
  std::map<std::string, std::string> tf_problems;  ///< transforms that tf2 refuses, by edge
  // First messages, by topic. An image that cannot be decoded is in `unreadable`, with the reason.
  std::map<std::string, sensor_msgs::ImageConstPtr> images;
  std::map<std::string, std::string> unreadable;
  std::map<std::string, sensor_msgs::CameraInfoConstPtr> infos;
  std::map<std::string, sensor_msgs::PointCloud2ConstPtr> clouds;
};

/// @param images, masks  the topics of which the first compressed message is decoded
void readContents(const std::vector<std::unique_ptr<rosbag::Bag>>& bags, const std::set<std::string>& images,
                  const std::set<std::string>& masks, BagContents& contents);

/// The topics' rates, gaps, delays, frames and kinds, on stdout.
void printTable(const BagContents& contents);

/// A number as printf writes it, and words in a row.
std::string format(const char* pattern, double value);
std::string join(const std::set<std::string>& words);

std::string describe(const sensor_msgs::PointCloud2& cloud);
std::string describe(const sensor_msgs::Image& image);
std::string describe(const sensor_msgs::CameraInfo& info);

}  // namespace lidar_camera_recalibration

#pragma once

#include <ros/header.h>
#include <ros/message_traits.h>
#include <sensor_msgs/CameraInfo.h>

#include <boost/make_shared.hpp>
#include <string>

#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration {

/// As a driver publishes it, of an image that is not rectified.
sensor_msgs::CameraInfo toCameraInfo(const std_msgs::Header& header, const Intrinsics& intrinsics);

/// The connection of a latched topic: `rosbag play` then repeats the message for late subscribers.
template <typename Message>
boost::shared_ptr<ros::M_string> latchedConnection(const std::string& caller) {
  auto connection = boost::make_shared<ros::M_string>();
  (*connection)["callerid"] = caller;
  (*connection)["latching"] = "1";
  (*connection)["type"] = ros::message_traits::datatype<Message>();
  (*connection)["md5sum"] = ros::message_traits::md5sum<Message>();
  (*connection)["message_definition"] = ros::message_traits::definition<Message>();
  return connection;
}

}  // namespace lidar_camera_recalibration

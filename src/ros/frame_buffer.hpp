#pragma once

#include <ros/time.h>

#include <deque>
#include <string>

#include "lidar_camera_recalibration/frame.hpp"
#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// The frames that the next search will use: bounded in count and bytes, the oldest one leaves.
class FrameBuffer {
 public:
  explicit FrameBuffer(const ServerConfig& config) : config_(config) {}

  /// Why a frame of this stamp would not be kept; empty if it would.
  std::string refusal(const ros::Time& stamp) const;
  void add(const FramePtr& frame, const ros::Time& stamp);
  void clear();

  Frames frames() const;
  std::size_t size() const { return held_.size(); }
  std::size_t bytes() const { return bytes_; }
  ros::Time newestStamp() const;

 private:
  struct Held {
    FramePtr frame;
    ros::Time stamp;
    std::size_t bytes;
  };
  const ServerConfig& config_;
  std::deque<Held> held_;
  std::size_t bytes_ = 0;
};

}  // namespace lidar_camera_recalibration

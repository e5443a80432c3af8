#pragma once

#include <ros/time.h>

#include <deque>
#include <string>

#include "frame_view.hpp"
#include "lidar_camera_recalibration/frame.hpp"
#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// The frames that the next search will use: bounded in count and bytes, and diverse. A frame that shows what
/// another one shows is not taken; of the two that are most alike the older one leaves.
class FrameBuffer {
 public:
  explicit FrameBuffer(const ServerConfig& config) : config_(config) {}

  /// Takes the frame. @return why not, otherwise empty.
  /// @param turn_rate_deg  of the vehicle [deg/s]; 0 if it is not known
  std::string add(const FramePtr& frame, const ros::Time& stamp, double turn_rate_deg);
  void clear();
  /// Forgets what was taken before: under an extrinsic that does not hold any more.
  void dropOlderThan(const ros::Time& stamp);

  Frames frames() const;
  std::size_t size() const { return held_.size(); }
  std::size_t bytes() const { return bytes_; }
  ros::Time newestStamp() const;

 private:
  struct Held {
    FramePtr frame;
    ros::Time stamp;
    std::size_t bytes;
    FrameView view;
  };
  std::string refusal(const FrameView& view, const ros::Time& stamp, double turn_rate_deg) const;
  std::deque<Held>::iterator mostRedundant();
  void drop(std::deque<Held>::iterator held);

  const ServerConfig& config_;
  std::deque<Held> held_;  ///< in the order of arrival
  std::size_t bytes_ = 0;
};

}  // namespace lidar_camera_recalibration

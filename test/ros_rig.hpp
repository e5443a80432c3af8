#pragma once

#include <diagnostic_msgs/DiagnosticArray.h>
#include <lidar_camera_recalibration/CalibrationResult.h>
#include <lidar_camera_recalibration/CalibrationScore.h>
#include <lidar_camera_recalibration/Recalibrate.h>
#include <lidar_camera_recalibration/RecalibrationState.h>
#include <ros/ros.h>

#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "synthetic_messages.hpp"

namespace lidar_camera_recalibration {

inline std::uint64_t imagesDropped(const RecalibrationState& state) {
  return state.dropped_unmatched + state.dropped_no_masks + state.dropped_invalid + state.dropped_poor +
         state.dropped_no_extrinsic + state.dropped_no_motion + state.dropped_memory +
         state.dropped_forgotten;
}

inline bool addsUp(const RecalibrationState& state) {
  return state.images == state.scored + state.waiting + imagesDropped(state);
}

/// The vehicle around the node under test: publishes the synthetic scene, listens to what the node says.
class RosRig {
 public:
  explicit RosRig(const std::string& node = "/recalibration", const std::string& camera = "/camera")
      : node_(node) {
    image_ = handle_.advertise<sensor_msgs::Image>(camera + "/image_raw", 10);
    info_ = handle_.advertise<sensor_msgs::CameraInfo>(camera + "/camera_info", 10);
    points_ = handle_.advertise<sensor_msgs::PointCloud2>("/lidar/points", 10);
    masks_ = handle_.advertise<sensor_msgs::Image>(camera + "/masks", 10);
    score_ = handle_.subscribe<CalibrationScore>(node + "/score", 100,
                                                 [this](const CalibrationScore::ConstPtr& score) {
                                                   const std::lock_guard<std::mutex> lock(mutex_);
                                                   scores_[score->header.stamp] = *score;
                                                 });
    state_ = handle_.subscribe<RecalibrationState>(node + "/state", 100,
                                                   [this](const RecalibrationState::ConstPtr& state) {
                                                     const std::lock_guard<std::mutex> lock(mutex_);
                                                     last_state_ = *state;
                                                     if (!addsUp(*state)) states_add_up_ = false;
                                                   });
    diagnostics_ = handle_.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArray::ConstPtr& array) {
          const std::lock_guard<std::mutex> lock(mutex_);
          for (const auto& status : array->status) statuses_[status.name] = status;
        });
  }

  /// Wall time: simulated time may stand still.
  static bool eventually(const std::function<bool()>& condition, double seconds = 20.0) {
    const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds);
    while (!condition()) {
      if (ros::WallTime::now() > end || !ros::ok()) return false;
      ros::WallDuration(0.02).sleep();
    }
    return true;
  }

  /// @param with_images  false where the test publishes images and masks itself
  bool connect(bool with_images = true) {
    return eventually([&] {
      const bool images = image_.getNumSubscribers() > 0 && masks_.getNumSubscribers() > 0;
      return (images || !with_images) && info_.getNumSubscribers() > 0 && points_.getNumSubscribers() > 0 &&
             score_.getNumPublishers() > 0 && state_.getNumPublishers() > 0;
    });
  }
  bool isConnected() const { return image_.getNumSubscribers() > 0; }

  void publish(const FrameMessages& messages) {
    if (messages.image) image_.publish(messages.image);
    if (messages.info) info_.publish(messages.info);
    if (messages.cloud) points_.publish(messages.cloud);
    if (messages.masks) masks_.publish(messages.masks);
  }

  using Edit = std::function<void(FrameMessages&)>;
  /// Publishes a frame of the scene and waits for its score; a score without a stamp means that none came.
  CalibrationScore frame(unsigned seed, const ros::Time& stamp, const Edit& edit = nullptr) {
    FrameMessages messages = syntheticMessages(seed, stamp);
    if (edit) edit(messages);
    publish(messages);
    eventually([&] { return !score(stamp).header.stamp.isZero(); });
    return score(stamp);
  }
  /// The score that came for the image of this stamp; one without a stamp if none did.
  CalibrationScore score(const ros::Time& stamp) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = scores_.find(stamp);
    return found != scores_.end() ? found->second : CalibrationScore();
  }

  RecalibrationState state() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return last_state_;
  }
  /// Whether in every state so far each image was scored, held or dropped by one cause.
  bool statesAddUp() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return states_add_up_;
  }
  /// The diagnostic status whose name ends like this.
  diagnostic_msgs::DiagnosticStatus diagnostic(const std::string& name) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& [key, status] : statuses_) {
      if (key.size() >= name.size() && key.compare(key.size() - name.size(), name.size(), name) == 0)
        return status;
    }
    return {};
  }

  template <typename Service>
  bool call(const std::string& name, Service& service) {
    return ros::service::waitForService(node_ + "/" + name, ros::Duration(10.0)) &&
           ros::service::call(node_ + "/" + name, service);
  }

 private:
  ros::NodeHandle handle_;
  std::string node_;
  ros::Publisher image_, info_, points_, masks_;
  ros::Subscriber score_, state_, diagnostics_;
  mutable std::mutex mutex_;
  std::map<ros::Time, CalibrationScore> scores_;
  RecalibrationState last_state_;
  bool states_add_up_ = true;
  std::map<std::string, diagnostic_msgs::DiagnosticStatus> statuses_;
};

}  // namespace lidar_camera_recalibration

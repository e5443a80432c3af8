#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <lidar_camera_recalibration/CalibrationResult.h>
#include <lidar_camera_recalibration/CalibrationScore.h>
#include <lidar_camera_recalibration/Recalibrate.h>
#include <lidar_camera_recalibration/RecalibrationState.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2/buffer_core.h>

#include <functional>
#include <memory>
#include <string>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "server_config.hpp"

namespace lidar_camera_recalibration {

/// Where the server's results go: topics in the node, files in the bag tool. Called from the worker thread,
/// one at a time.
struct ServerOutputs {
  std::function<void(const CalibrationScore&)> score;
  std::function<void(const FramePtr&)> kept;             ///< each frame that was taken into the buffer
  std::function<void(const CalibrationResult&)> result;  ///< the message
  /// The same before it became a message, with all frames that the search had; only of searches that ended.
  std::function<void(const CalibrationOutcome&, const Frames&)> outcome;
  std::function<void(const RecalibrationState&)> state;
  std::function<void(const geometry_msgs::TransformStamped&)> transform;  ///< static transform to broadcast
  std::function<bool()> wants_overlay, wants_colored_points;              ///< asked per frame: drawing costs
  std::function<void(const sensor_msgs::ImageConstPtr&)> overlay;
  std::function<void(const sensor_msgs::PointCloud2ConstPtr&)> colored_points;
};

/// The one server: messages in, extrinsic out. The nodelet, the node and the bag tool are shells around it.
///
/// Knows messages but no node, so it runs without a master. The add… functions queue and return at once; one
/// worker thread owns caches, frames and the outputs, and starts one thread per search. Nothing but the
/// constructor and setParameters throw; bad input is logged (throttled), counted and dropped. The destructor
/// cancels a running search and joins.
class RecalibrationServer {
 public:
  /// @throw Error(kParameter) for an objective, a search or a range that does not exist.
  RecalibrationServer(const ServerConfig& config, const tf2::BufferCore& tf, const std::string& name,
                      ServerOutputs outputs);
  ~RecalibrationServer();
  RecalibrationServer(const RecalibrationServer&) = delete;
  RecalibrationServer& operator=(const RecalibrationServer&) = delete;

  void addImage(const sensor_msgs::ImageConstPtr& image);
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& cloud);
  void addMasks(const sensor_msgs::ImageConstPtr& masks);
  void addImage(const sensor_msgs::CompressedImageConstPtr& image);
  void addMasks(const sensor_msgs::CompressedImageConstPtr& masks);
  /// Time went back (a bag loops): caches are cleared, frames already prepared stay.
  void timeJumpedBack();

  /// Blocks only if the request says `wait`, and only so many callers at a time: a thread each.
  static constexpr std::size_t kMaxWaitingCallers = 4;
  Recalibrate::Response recalibrate(const Recalibrate::Request& request);
  bool save(const std::string& path, const std::string& format, std::string& message);
  /// Of live parameters; takes effect before the next frame and the next search.
  /// @throw Error(kParameter) as setLiveParameters(); then nothing changes.
  void setParameters(const Parameters& values);
  void reset();                        ///< forgets frames and caches, keeps the extrinsic
  bool cancel(std::string& message);   ///< the running or waiting recalibration
  bool restore(std::string& message);  ///< back to the extrinsic before the last accepted result

  RecalibrationState state() const;
  std::string extrinsicSource() const;  ///< where the extrinsic in force came from, in words
  /// The recording ends here: nothing waits any longer for a partner that could be nearer in time.
  void flush();
  /// Returns when everything queued so far is processed. For the bag tool, which reads faster than any
  /// sensor.
  void waitUntilIdle();
  /// Cancels a search and ends every call that waits; nothing is accepted any more. The destructor calls it;
  /// whoever calls recalibrate() from other threads must call it first and join them.
  void stop();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lidar_camera_recalibration

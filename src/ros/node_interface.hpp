#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <lidar_camera_recalibration/SaveCalibration.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/CompressedImage.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>

#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "input_monitor.hpp"
#include "reconfiguration.hpp"
#include "repeat_filter.hpp"
#include "server.hpp"

namespace lidar_camera_recalibration {

/// The server's face in ROS: topics, services, tf, parameters and diagnostics. Nodelet and node are shells
/// around it.
///
/// Subscriptions and timer use the queue of the node handles; services have threads of their own, so a
/// `~recalibrate` that waits holds nothing up. Destruction ends a running search and every waiting call.
class NodeInterface {
 public:
  NodeInterface(const ros::NodeHandle& node, const ros::NodeHandle& private_node);
  ~NodeInterface();
  NodeInterface(const NodeInterface&) = delete;
  NodeInterface& operator=(const NodeInterface&) = delete;

  /// False if a parameter is wrong: then the reason is logged and in /diagnostics, and nothing else happens.
  bool isWorking() const { return server_ != nullptr; }

 private:
  void start();
  void warnOfUnknownParameters() const;
  ServerOutputs advertise();
  void subscribe(const ServerConfig& config);
  void offerServices();
  void offerReconfiguration(const ServerConfig& config);
  bool reconfigure(dynamic_reconfigure::Reconfigure::Request& request,
                   dynamic_reconfigure::Reconfigure::Response& response);

  /// Receives the very message that a publisher in the same process published; nothing is copied.
  template <typename Message>
  void subscribe(InputMonitor& monitor, const std::string& topic,
                 std::function<void(const boost::shared_ptr<const Message>&)> take);
  template <typename Message>
  void subscribeImage(const std::string& topic);
  template <typename Message>
  void subscribeMasks(const std::string& topic);
  void noticeTimeJump(const ros::Time* image_stamp = nullptr);
  void onTimer(const ros::WallTimerEvent& event);
  void diagnoseInputs(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseRecalibration(diagnostic_updater::DiagnosticStatusWrapper& status);
  void diagnoseDrift(diagnostic_updater::DiagnosticStatusWrapper& status);

  ros::NodeHandle node_, private_node_;
  const std::string name_;
  std::string parameter_error_;  ///< why it does not work

  diagnostic_updater::Updater diagnostics_;
  RepeatFilter repeat_filter_;
  ros::Time last_now_, last_image_stamp_, second_last_image_stamp_;
  ros::WallTime start_ = ros::WallTime::now();

  /// Written by the server's worker, read by the diagnostics.
  std::mutex report_mutex_;
  std::string last_result_ = "none yet";
  bool last_result_accepted_ = true;
  double last_stamp_gap_ = 0.0;

  std::optional<tf2_ros::Buffer> tf_;
  std::unique_ptr<tf2_ros::TransformListener> tf_listener_;
  tf2_ros::StaticTransformBroadcaster tf_broadcaster_;
  ros::Publisher score_, result_, state_, overlay_, colored_points_;
  std::unique_ptr<RecalibrationServer> server_;

  InputMonitor image_monitor_{"image", 5.0}, info_monitor_{"camera_info", 5.0},
      points_monitor_{"points", 5.0}, masks_monitor_{"masks", 60.0};
  ros::CallbackQueue recalibrate_queue_, service_queue_;
  std::vector<ros::ServiceServer> services_;
  ServerConfig live_;  ///< its live parameters are in force; after the start of service_queue_ alone
  ros::Publisher parameter_descriptions_, parameter_updates_;
  std::unique_ptr<ros::AsyncSpinner> recalibrate_spinner_, service_spinner_;
  ros::WallTimer timer_;
};

}  // namespace lidar_camera_recalibration

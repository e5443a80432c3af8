#include "node_interface.hpp"

#include <algorithm>
#include <utility>

#include "lidar_camera_recalibration/error.hpp"
#include "server_config.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::uint32_t kInputQueue = 10;
/// A step back by less is a clock adjustment or a driver's jitter, not a bag that starts again.
constexpr double kTimeJump = 1.0;  // [s]

using diagnostic_msgs::DiagnosticStatus;
using diagnostic_updater::DiagnosticStatusWrapper;

}  // namespace

NodeInterface::NodeInterface(const ros::NodeHandle& node, const ros::NodeHandle& private_node)
    : node_(node),
      private_node_(private_node),
      name_(private_node.getNamespace().substr(1)),
      diagnostics_(node_, private_node_, private_node.getNamespace()) {
  diagnostics_.setHardwareID("none");
  diagnostics_.add("inputs", this, &NodeInterface::diagnoseInputs);
  diagnostics_.add("recalibration", this, &NodeInterface::diagnoseRecalibration);
  diagnostics_.add("drift", this, &NodeInterface::diagnoseDrift);
  try {
    start();
  } catch (const Error& e) {
    parameter_error_ = e.what();
    ROS_FATAL_STREAM_NAMED(name_, name_ << " does not start: " << parameter_error_);
  }
  timer_ = node_.createWallTimer(ros::WallDuration(1.0), &NodeInterface::onTimer, this);
}

NodeInterface::~NodeInterface() {
  timer_.stop();
  for (InputMonitor* monitor : {&image_monitor_, &info_monitor_, &points_monitor_, &masks_monitor_})
    monitor->stop();
  if (server_) server_->stop();  // ends a call that waits, so that its thread can be joined
  for (ros::ServiceServer& service : services_) service.shutdown();
  for (auto* spinner : {&recalibrate_spinner_, &service_spinner_}) {
    if (*spinner) (*spinner)->stop();
  }
}

void NodeInterface::start() {
  const ServerConfig config = readServerConfig([this](const std::string& name, XmlRpc::XmlRpcValue& value) {
    return private_node_.getParam(name, value);
  });
  warnOfUnknownParameters();
  // Frames are made when their masks come: only then is the vehicle's way looked up in tf.
  const double mask_timeout = config.fixed_frame.empty() ? 0.0 : config.synchroniser.mask_timeout;
  tf_.emplace(ros::Duration(tf2::BufferCore::DEFAULT_CACHE_TIME + mask_timeout));
  tf_listener_ = std::make_unique<tf2_ros::TransformListener>(*tf_, node_);
  server_ = std::make_unique<RecalibrationServer>(config, *tf_, name_, advertise());
  subscribe(config);
  offerReconfiguration(config);
  offerServices();
}

/// A misspelt parameter would otherwise keep its default without a word.
void NodeInterface::warnOfUnknownParameters() const {
  XmlRpc::XmlRpcValue tree;
  if (!ros::param::get(private_node_.getNamespace(), tree)) return;
  std::vector<std::string> names;
  for (const auto& [name, value] : flatten(tree)) names.push_back(name);
  for (const std::string& sentence : unknownParameters(names))
    ROS_WARN_STREAM_NAMED(name_, name_ << ": " << sentence);
}

ServerOutputs NodeInterface::advertise() {
  score_ = private_node_.advertise<CalibrationScore>("score", 10);
  result_ = private_node_.advertise<CalibrationResult>("result", 1, true);
  state_ = private_node_.advertise<RecalibrationState>("state", 1, true);
  overlay_ = private_node_.advertise<sensor_msgs::Image>("overlay", 1);
  colored_points_ = private_node_.advertise<sensor_msgs::PointCloud2>("colored_points", 1);

  ServerOutputs outputs;
  outputs.score = [this](const CalibrationScore& score) {
    score_.publish(score);
    const std::lock_guard<std::mutex> lock(report_mutex_);
    last_stamp_gap_ = score.stamp_gap;
  };
  outputs.result = [this](const CalibrationResult& result) {
    result_.publish(result);
    const std::lock_guard<std::mutex> lock(report_mutex_);
    last_result_accepted_ = result.accepted;
    last_result_ = result.reason;
  };
  outputs.state = [this](const RecalibrationState& state) { state_.publish(state); };
  outputs.transform = [this](const geometry_msgs::TransformStamped& transform) {
    tf_broadcaster_.sendTransform(transform);
  };
  outputs.wants_overlay = [this] { return overlay_.getNumSubscribers() > 0; };
  outputs.overlay = [this](const sensor_msgs::ImageConstPtr& image) { overlay_.publish(image); };
  outputs.wants_colored_points = [this] { return colored_points_.getNumSubscribers() > 0; };
  outputs.colored_points = [this](const sensor_msgs::PointCloud2ConstPtr& cloud) {
    colored_points_.publish(cloud);
  };
  return outputs;
}

// --- inputs ---

template <typename Message>
void NodeInterface::subscribe(InputMonitor& monitor, const std::string& topic,
                              std::function<void(const boost::shared_ptr<const Message>&)> take) {
  const boost::function<void(const boost::shared_ptr<const Message>&)> callback =
      [&monitor, take = std::move(take)](const boost::shared_ptr<const Message>& message) {
        const InputMonitor::Callback timed(monitor);
        take(message);
      };
  monitor.watch(node_.subscribe<Message>(topic, kInputQueue, callback));
}

template <typename Message>
void NodeInterface::subscribeImage(const std::string& topic) {
  subscribe<Message>(image_monitor_, topic, [this](const boost::shared_ptr<const Message>& message) {
    noticeTimeJump(&message->header.stamp);
    server_->addImage(message);
  });
}

template <typename Message>
void NodeInterface::subscribeMasks(const std::string& topic) {
  subscribe<Message>(masks_monitor_, topic, [this](const boost::shared_ptr<const Message>& message) {
    noticeTimeJump();
    server_->addMasks(message);
  });
}

void NodeInterface::subscribe(const ServerConfig& config) {
  const auto nameOr = [](const std::string& given, const char* usual) {
    return given.empty() ? usual : given;
  };
  const std::string image = nameOr(config.topics.image, "image"),
                    masks = nameOr(config.topics.masks, "masks");
  // Remappings hold for whole names only, so `image/compressed` has to follow the one of `image`.
  if (config.compressed) {
    subscribeImage<sensor_msgs::CompressedImage>(node_.resolveName(image) + "/compressed");
  } else {
    subscribeImage<sensor_msgs::Image>(image);
  }
  if (config.masks_compressed) {
    subscribeMasks<sensor_msgs::CompressedImage>(node_.resolveName(masks) + "/compressed");
  } else {
    subscribeMasks<sensor_msgs::Image>(masks);
  }
  if (config.camera_info_file.empty()) {
    subscribe<sensor_msgs::CameraInfo>(info_monitor_, nameOr(config.topics.camera_info, "camera_info"),
                                       [this](const sensor_msgs::CameraInfoConstPtr& info) {
                                         noticeTimeJump();
                                         server_->addCameraInfo(info);
                                       });
  }
  subscribe<sensor_msgs::PointCloud2>(points_monitor_, nameOr(config.topics.points, "points"),
                                      [this](const sensor_msgs::PointCloud2ConstPtr& cloud) {
                                        noticeTimeJump();
                                        server_->addCloud(cloud);
                                      });
}

/// The node's clock goes back when a bag is played again with --clock, the images' stamps also without. An
/// image is judged by the older of the two before it, so that one bad stamp far ahead is no jump.
void NodeInterface::noticeTimeJump(const ros::Time* image_stamp) {
  const ros::Time now = ros::Time::now();
  // As numbers: the difference of two ros::Time throws if a bad stamp makes it too large.
  const double clock_step = now.toSec() - last_now_.toSec();
  double image_step = 0.0;
  if (image_stamp != nullptr) {
    image_step = image_stamp->toSec() - std::min(last_image_stamp_, second_last_image_stamp_).toSec();
    second_last_image_stamp_ = std::exchange(last_image_stamp_, *image_stamp);
  }
  last_now_ = now;
  if (clock_step >= (ros::Time::isSimTime() ? 0.0 : -kTimeJump) && image_step >= -kTimeJump) return;
  ROS_INFO_STREAM_NAMED(name_, name_ << ": time went back by " << -std::min(clock_step, image_step)
                                     << " s: caches are cleared, prepared frames stay");
  // The images to come are older than the last ones, and that is no second jump.
  if (clock_step < image_step) last_image_stamp_ = second_last_image_stamp_ = ros::Time();
  server_->timeJumpedBack();
}

// --- services ---

void NodeInterface::offerServices() {
  using std_srvs::Trigger;
  const auto offer = [this](auto service, const std::string& name, ros::CallbackQueue& queue, auto handle) {
    using Service = decltype(service);
    ros::NodeHandle node(private_node_);
    node.setCallbackQueue(&queue);
    const boost::function<bool(typename Service::Request&, typename Service::Response&)> callback =
        [handle](auto& request, auto& response) {
          handle(request, response);
          return true;
        };
    services_.push_back(node.advertiseService(name, callback));
  };
  const auto offerTrigger = [&](const std::string& name, std::function<bool(std::string&)> action) {
    offer(Trigger(), name, service_queue_, [action](const Trigger::Request&, Trigger::Response& response) {
      response.success = action(response.message);
    });
  };
  offer(Recalibrate(), "recalibrate", recalibrate_queue_,
        [this](const Recalibrate::Request& request, Recalibrate::Response& response) {
          response = server_->recalibrate(request);
        });
  offer(SaveCalibration(), "save", service_queue_,
        [this](const SaveCalibration::Request& request, SaveCalibration::Response& response) {
          response.success = server_->save(request.path, request.format, response.message);
        });
  offerTrigger("reset", [this](std::string& message) {
    server_->reset();
    message = "frames and caches are forgotten, the extrinsic stays";
    return true;
  });
  offerTrigger("cancel", [this](std::string& message) { return server_->cancel(message); });
  offerTrigger("restore", [this](std::string& message) { return server_->restore(message); });

  // While some callers wait for a recalibration, one thread answers the others.
  constexpr std::uint32_t kThreads = RecalibrationServer::kMaxWaitingCallers + 1;
  recalibrate_spinner_ = std::make_unique<ros::AsyncSpinner>(kThreads, &recalibrate_queue_);
  service_spinner_ = std::make_unique<ros::AsyncSpinner>(1, &service_queue_);
  recalibrate_spinner_->start();
  service_spinner_->start();
}

/// The protocol of dynamic_reconfigure. A value that is not allowed changes nothing: to clamp it, as other
/// nodes do, would open the gate of whoever mistyped a number.
void NodeInterface::offerReconfiguration(const ServerConfig& config) {
  live_ = config;
  parameter_descriptions_ =
      private_node_.advertise<dynamic_reconfigure::ConfigDescription>("parameter_descriptions", 1, true);
  parameter_updates_ = private_node_.advertise<dynamic_reconfigure::Config>("parameter_updates", 1, true);
  parameter_descriptions_.publish(describeLiveParameters());
  parameter_updates_.publish(liveConfig(live_));
  ros::NodeHandle node(private_node_);
  node.setCallbackQueue(&service_queue_);
  services_.push_back(node.advertiseService("set_parameters", &NodeInterface::reconfigure, this));
}

bool NodeInterface::reconfigure(dynamic_reconfigure::Reconfigure::Request& request,
                                dynamic_reconfigure::Reconfigure::Response& response) {
  const Parameters values = valuesOf(request.config);
  try {
    server_->setParameters(values);
    setLiveParameters(values, live_);
    for (const auto& [name, value] : values) private_node_.setParam(name, value);
  } catch (const Error& e) {
    ROS_ERROR_STREAM_NAMED(name_, name_ << ": nothing is changed: " << e.what());
  }
  response.config = liveConfig(live_);
  parameter_updates_.publish(response.config);
  return true;
}

// --- diagnostics ---

void NodeInterface::onTimer(const ros::WallTimerEvent&) {
  if (isWorking()) noticeTimeJump();
  diagnostics_.force_update();
}

void NodeInterface::diagnoseInputs(DiagnosticStatusWrapper& status) {
  if (!isWorking()) return status.summary(DiagnosticStatus::ERROR, "not started: " + parameter_error_);
  std::string problems;
  for (const InputMonitor* monitor : {&image_monitor_, &info_monitor_, &points_monitor_, &masks_monitor_}) {
    const std::string problem = monitor->report(status);
    if (!problem.empty()) problems += (problems.empty() ? "" : "; ") + problem;
  }
  {
    const std::lock_guard<std::mutex> lock(report_mutex_);
    status.addf("stamp gap of the last frame", "%.4f s", last_stamp_gap_);
  }
  if (problems.empty()) return status.summary(DiagnosticStatus::OK, "all inputs arrive");
  status.summary(DiagnosticStatus::WARN, problems);
  // Other nodes may still be starting: the log hears of it a little later.
  const bool started = ros::WallTime::now() - start_ > ros::WallDuration(10.0);
  if (started && repeat_filter_.isDue(problems)) ROS_WARN_STREAM_NAMED(name_, name_ << ": " << problems);
}

void NodeInterface::diagnoseRecalibration(DiagnosticStatusWrapper& status) {
  if (!isWorking()) return status.summary(DiagnosticStatus::ERROR, "not started: " + parameter_error_);
  const RecalibrationState state = server_->state();
  const std::string source = server_->extrinsicSource();
  status.add("state", state.text);
  status.add("frames", state.frames);
  status.add("extrinsic", source);
  status.add("images", state.images);
  status.add("images scored", state.scored);
  status.add("images that wait", state.waiting);
  status.add("memory [MB]", state.memory / 1000000);
  status.add("dropped: unmatched", state.dropped_unmatched);
  status.add("dropped: no masks", state.dropped_no_masks);
  status.add("dropped: invalid", state.dropped_invalid);
  status.add("dropped: poor", state.dropped_poor);
  status.add("dropped: no extrinsic", state.dropped_no_extrinsic);
  status.add("dropped: no motion", state.dropped_no_motion);
  status.add("dropped: memory", state.dropped_memory);
  status.add("dropped: forgotten", state.dropped_forgotten);
  status.add("dropped: unknown masks", state.dropped_unknown_masks);
  status.add("dropped: unused messages", state.dropped_unused);
  const std::lock_guard<std::mutex> lock(report_mutex_);
  status.add("last result", last_result_);
  if (!last_result_accepted_)
    status.summary(DiagnosticStatus::WARN, "last result " + last_result_);
  else
    status.summary(DiagnosticStatus::OK, state.text);
}

void NodeInterface::diagnoseDrift(DiagnosticStatusWrapper& status) {
  if (!isWorking()) return status.summary(DiagnosticStatus::ERROR, "not started: " + parameter_error_);
  const RecalibrationState state = server_->state();
  status.summary(state.drift_state == CalibrationScore::DRIFT_OFF        ? DiagnosticStatus::ERROR
                 : state.drift_state == CalibrationScore::DRIFT_DOUBTFUL ? DiagnosticStatus::WARN
                                                                         : DiagnosticStatus::OK,
                 state.drift);
}

}  // namespace lidar_camera_recalibration

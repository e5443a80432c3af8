#include "frame_pipeline.hpp"

#include <ros/console.h>

#include <cstdio>
#include <opencv2/core.hpp>
#include <utility>

#include "conversions.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/overlay.hpp"
#include "motion.hpp"
#include "result_messages.hpp"

namespace lidar_camera_recalibration {

FramePipeline::FramePipeline(const ServerConfig& config, const tf2::BufferCore& tf, ExtrinsicKeeper& keeper,
                             const std::string& name, const ServerOutputs& outputs)
    : config_(config),
      tf_(tf),
      keeper_(keeper),
      name_(name),
      outputs_(outputs),
      synchroniser_(config.synchroniser),
      buffer_(config),
      objective_(makeObjective(config.calibrator.objective)),
      drift_monitor_(config.monitor) {}

void FramePipeline::warn(const std::string& what) {
  if (repeat_filter_.isDue(what)) ROS_WARN_STREAM_NAMED(name_, name_ << ": " << what);
}

sensor_msgs::ImageConstPtr FramePipeline::decoded(const char* input, Decoder decoder,
                                                  const sensor_msgs::CompressedImage& message) {
  try {
    return decoder(message);
  } catch (const Error& e) {
    last_problem_ = std::string(input) + ": " + e.what();
    warn(last_problem_);
    return nullptr;
  }
}

void FramePipeline::addImage(const sensor_msgs::CompressedImage& image) {
  if (const auto message = decoded("image", decode, image)) return synchroniser_.addImage(message);
  ++dropped_invalid_;
}

void FramePipeline::addMasks(const sensor_msgs::CompressedImage& masks) {
  if (const auto message = decoded("masks", decodeMasks, masks)) return synchroniser_.addMasks(message);
  ++dropped_unreadable_masks_;
}

bool FramePipeline::step() {
  collectReady();
  if (ready_.empty()) return false;
  const FrameMessages messages = std::move(ready_.front());
  ready_.pop_front();
  process(messages);
  return true;
}

void FramePipeline::collectReady() {
  // Masks faster than frames can be prepared: the newest ones matter, a growing lag helps nobody.
  constexpr std::size_t kMaxReady = 16;
  while (auto messages = synchroniser_.next()) ready_.push_back(std::move(*messages));
  while (ready_.size() > kMaxReady ||
         (ready_.size() > 1 && readyBytes() > config_.synchroniser.max_bytes / 2)) {
    ready_.pop_front();
    ++dropped_late_;
  }
}

std::size_t FramePipeline::readyBytes() const {
  std::size_t bytes = 0;
  for (const FrameMessages& messages : ready_)
    bytes += messages.image->data.size() + messages.cloud->data.size() + messages.masks->data.size();
  return bytes;
}

void FramePipeline::clearCaches() {
  synchroniser_.clear();
  dropped_forgotten_ += ready_.size();
  ready_.clear();
}

void FramePipeline::clearFrames() {
  buffer_.clear();
  drift_monitor_.reset();
}

DriftVerdict FramePipeline::drift() const {
  const auto current = keeper_.current();
  return current ? drift_monitor_.window(current->T_camera_lidar) : DriftVerdict();
}

void FramePipeline::process(const FrameMessages& messages) {
  try {
    const FrameIds ids = frameIds(messages, config_);
    const Eigen::Isometry3d extrinsic = keeper_.get(ids, messages.image->header.stamp);
    score(messages, prepare(messages, extrinsic, ids), extrinsic);
  } catch (const Error& e) {
    std::uint64_t& counter = e.cause() == ErrorCause::kExtrinsic   ? dropped_no_extrinsic_
                             : e.cause() == ErrorCause::kMotion    ? dropped_no_motion_
                             : e.cause() == ErrorCause::kNotEnough ? dropped_poor_
                                                                   : dropped_invalid_;
    refuse(messages, counter, e.what());
  } catch (const std::exception& e) {
    refuse(messages, dropped_invalid_, std::string("unexpected error: ") + e.what());
  }
}

FramePipeline::Prepared FramePipeline::prepare(const FrameMessages& messages,
                                               const Eigen::Isometry3d& extrinsic, const FrameIds& ids) {
  FrameInputs inputs = readMessages(messages, config_);
  if (!startup_checked_) {
    startup_checked_ = true;
    const StartupCheck check = checkProjection(inputs, extrinsic, ids);
    if (check.plausible)
      ROS_INFO_STREAM_NAMED(name_, name_ << ": " << check.text);
    else
      ROS_WARN_STREAM_NAMED(name_, name_ << ": " << check.text);
  }
  if (!inputs.cloud.hasReflectivity())
    warn("points have no intensity field: the reflectivity term is left out");
  Prepared prepared;
  if (!config_.fixed_frame.empty()) {
    if (!config_.deskew) inputs.cloud.time.clear();
    if (config_.deskew && inputs.cloud.time.empty())
      warn(
          "points have no times of their own that make sense (see the parameter fixed_frame): clouds are "
          "moved "
          "to the stamps of the images, but not deskewed");
    prepared.turn_rate_deg = moveToImage(inputs.cloud, tf_, config_.fixed_frame, ids.lidar,
                                         messages.cloud->header.stamp, messages.image->header.stamp);
  }
  prepared.frame = makeFrame(messages.image->header.stamp.toSec(), inputs.camera, inputs.image, inputs.layers,
                             inputs.cloud, extrinsic, config_.frame);
  return prepared;
}

void FramePipeline::score(const FrameMessages& messages, const Prepared& prepared,
                          const Eigen::Isometry3d& extrinsic) {
  const FramePtr& frame = prepared.frame;
  const auto evaluator = objective_->evaluator({frame}, {});
  const Score score = (*evaluator)(extrinsic);
  CalibrationScore message =
      scoreMessage(messages.image->header, score, validityIndex(*evaluator, extrinsic));
  message.reason = buffer_.add(frame, messages.image->header.stamp, prepared.turn_rate_deg);
  message.used = message.reason.empty();
  const DriftVerdict drift = drift_monitor_.add(*evaluator, extrinsic, isNewToMonitor(prepared, extrinsic));
  addDrift(drift, drift_monitor_.window(extrinsic), config_.monitor, message);
  if (message.used && outputs_.kept) outputs_.kept(frame);
  newest_ = Newest{frame, messages.image->header, messages.cloud->header};
  newest_->cloud_header.frame_id = frameIds(messages, config_).lidar;
  if (!config_.fixed_frame.empty())
    newest_->cloud_header.stamp = messages.image->header.stamp;  // moved there
  last_problem_.clear();
  publish(message, messages);
  pictures_due_ = true;
  ++scored_;
}

/// At a traffic light the window would fill with one view, and one view can be wrong.
bool FramePipeline::isNewToMonitor(const Prepared& prepared, const Eigen::Isometry3d& extrinsic) {
  if (prepared.turn_rate_deg > config_.frames_max_turn_rate_deg) return false;
  FrameView view(*prepared.frame);
  const bool begins = drift_monitor_.window(extrinsic).frames == 0;
  if (!begins && watched_ && view.changeFrom(*watched_) < config_.frames_min_view_change) return false;
  watched_ = std::move(view);
  return true;
}

void FramePipeline::refuse(const FrameMessages& messages, std::uint64_t& counter, const std::string& reason) {
  ++counter;
  last_problem_ = reason;
  warn("frame refused: " + reason);
  publish(refusedMessage(messages.image->header, reason), messages);
}

void FramePipeline::publish(CalibrationScore message, const FrameMessages& messages) {
  message.stamp_gap = (messages.cloud->header.stamp - messages.image->header.stamp).toSec();
  if (outputs_.score) outputs_.score(message);
}

/// With score and state as title; after a result, if the parameters want that, the start above it.
cv::Mat FramePipeline::overlay(const FramePtr& frame, const Eigen::Isometry3d& T_camera_lidar,
                               const std::string& state) const {
  const bool compare = config_.overlay_compare && comparison_start_;
  const Views in_view = compare ? Views{*comparison_start_, T_camera_lidar} : Views{};
  const auto evaluator = objective_->evaluator({frame}, in_view);
  const auto draw = [&](const std::string& when, const Eigen::Isometry3d& extrinsic,
                        const std::string& note) {
    char score[32];
    std::snprintf(score, sizeof score, "score %.4f", (*evaluator)(extrinsic).total);
    return drawOverlay(*frame, extrinsic, config_.overlay_color, when + score + note);
  };
  if (!compare) return draw("", T_camera_lidar, ", " + state);
  cv::Mat picture;
  cv::vconcat(draw("before: ", *comparison_start_, ""), draw("after: ", T_camera_lidar, ", " + state),
              picture);
  return picture;
}

void FramePipeline::publishPictures(const std::string& state) {
  if (!std::exchange(pictures_due_, false)) return;
  const auto current = keeper_.current();
  if (!newest_ || !current) return;
  const Eigen::Isometry3d& T_camera_lidar = current->T_camera_lidar;
  if (outputs_.overlay && outputs_.wants_overlay && outputs_.wants_overlay())
    outputs_.overlay(toImageMessage(overlay(newest_->frame, T_camera_lidar, state), newest_->image_header));
  if (outputs_.colored_points && outputs_.wants_colored_points && outputs_.wants_colored_points())
    outputs_.colored_points(coloredPoints(*newest_->frame, T_camera_lidar, newest_->cloud_header));
}

void FramePipeline::describe(RecalibrationState& state) const {
  const SynchroniserCounts& counts = synchroniser_.counts();
  state.frames = static_cast<std::uint32_t>(buffer_.size());
  state.pending = static_cast<std::uint32_t>(synchroniser_.pending());
  state.memory = synchroniser_.bytes() + readyBytes() + buffer_.bytes();
  const DriftVerdict verdict = drift();
  state.drift_state = static_cast<std::uint8_t>(verdict.state());
  state.drift = lidar_camera_recalibration::describe(verdict, config_.monitor);
  state.scored = scored_;
  state.waiting = synchroniser_.images() + ready_.size();
  state.dropped_unmatched = counts.unmatched;
  state.dropped_no_masks = counts.no_masks;
  state.dropped_unknown_masks = counts.unknown_masks + dropped_unreadable_masks_;
  state.dropped_unused = counts.unused;
  state.dropped_memory = counts.memory + dropped_late_;
  state.dropped_forgotten = counts.forgotten + dropped_forgotten_;
  state.dropped_invalid = dropped_invalid_;
  state.dropped_poor = dropped_poor_;
  state.dropped_no_extrinsic = dropped_no_extrinsic_;
  state.dropped_no_motion = dropped_no_motion_;
}

}  // namespace lidar_camera_recalibration

#include "frame_buffer.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <memory>

namespace lidar_camera_recalibration {

std::string FrameBuffer::add(const FramePtr& frame, const ros::Time& stamp, double turn_rate_deg) {
  FrameView view(*frame);
  std::string reason = refusal(view, stamp, turn_rate_deg);
  if (!reason.empty()) return reason;
  // The node draws none of these frames, and the image would be a fourth of their memory and more.
  const auto without_image = std::make_shared<Frame>(*frame);
  without_image->image.release();
  held_.push_back({config_.frames_keep_images ? frame : without_image, stamp, memoryUse(*without_image),
                   std::move(view)});
  bytes_ += held_.back().bytes;
  while (held_.size() > static_cast<std::size_t>(config_.frames_max) ||
         (held_.size() > 1 && bytes_ > config_.frames_max_bytes))
    drop(mostRedundant());
  return "";
}

std::string FrameBuffer::refusal(const FrameView& view, const ros::Time& stamp, double turn_rate_deg) const {
  char text[120] = "";
  if (turn_rate_deg > config_.frames_max_turn_rate_deg)
    std::snprintf(text, sizeof text,
                  "not kept: the vehicle turns at %.1f deg/s, more than frames/max_turn_rate_deg",
                  turn_rate_deg);
  for (const Held& held : held_) {
    if (text[0] != '\0') break;
    const double change = view.changeFrom(held.view);
    if (std::abs(stamp.toSec() - held.stamp.toSec()) < config_.frames_min_interval)
      std::snprintf(text, sizeof text, "not kept: less than %.2f s from a frame that is held",
                    config_.frames_min_interval);
    else if (change < config_.frames_min_view_change)
      std::snprintf(text, sizeof text, "not kept: the view differs in %.1f %% only from a frame that is held",
                    100.0 * change);
  }
  return text;
}

/// The older one of the pair that is most alike.
std::deque<FrameBuffer::Held>::iterator FrameBuffer::mostRedundant() {
  auto redundant = held_.begin();
  double least = 2.0;
  for (auto older = held_.begin(); older != held_.end(); ++older) {
    for (auto newer = std::next(older); newer != held_.end(); ++newer) {
      const double change = older->view.changeFrom(newer->view);
      if (change < least) {
        least = change;
        redundant = older;
      }
    }
  }
  return redundant;
}

void FrameBuffer::drop(std::deque<Held>::iterator held) {
  bytes_ -= held->bytes;
  held_.erase(held);
}

void FrameBuffer::clear() {
  held_.clear();
  bytes_ = 0;
}

void FrameBuffer::dropOlderThan(const ros::Time& stamp) {
  for (auto held = held_.begin(); held != held_.end();) {
    if (held->stamp >= stamp) {
      ++held;
      continue;
    }
    bytes_ -= held->bytes;
    held = held_.erase(held);
  }
}

Frames FrameBuffer::frames() const {
  Frames frames;
  for (const Held& held : held_) frames.push_back(held.frame);
  return frames;
}

ros::Time FrameBuffer::newestStamp() const {
  ros::Time newest;
  for (const Held& held : held_) newest = std::max(newest, held.stamp);
  return newest;
}

}  // namespace lidar_camera_recalibration

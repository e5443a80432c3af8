#include "frame_buffer.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

namespace lidar_camera_recalibration {

std::string FrameBuffer::refusal(const ros::Time& stamp) const {
  const auto tooNear = [&](const Held& held) {
    return std::abs(stamp.toSec() - held.stamp.toSec()) < config_.frames_min_interval;
  };
  if (std::none_of(held_.begin(), held_.end(), tooNear)) return "";
  char text[80];
  std::snprintf(text, sizeof text, "not kept: less than %.2f s from a frame that is held",
                config_.frames_min_interval);
  return text;
}

void FrameBuffer::add(const FramePtr& frame, const ros::Time& stamp) {
  // Nothing draws these frames, and the image would be a fourth of their memory and more.
  const auto without_image = std::make_shared<Frame>(*frame);
  without_image->image.release();
  held_.push_back({without_image, stamp, memoryUse(*without_image)});
  bytes_ += held_.back().bytes;
  while (held_.size() > static_cast<std::size_t>(config_.frames_max) ||
         (held_.size() > 1 && bytes_ > config_.frames_max_bytes)) {
    bytes_ -= held_.front().bytes;
    held_.pop_front();
  }
}

void FrameBuffer::clear() {
  held_.clear();
  bytes_ = 0;
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

#pragma once

#include <chrono>
#include <map>
#include <string>

namespace lidar_camera_recalibration {

/// Lets a message through once per period. Messages that differ only in their digits count as the same, so a
/// bad input that repeats with every frame is reported rarely, and another problem in between is still
/// reported at once. (ROS_WARN_THROTTLE knows only the place in the code, and needs a clock that a bag tool
/// does not have.)
class RepeatFilter {
 public:
  explicit RepeatFilter(std::chrono::seconds period = std::chrono::seconds(15)) : period_(period) {}

  bool isDue(const std::string& message) {
    constexpr std::size_t kMaxMessages = 100;
    std::string key;
    for (const char c : message) {
      if (c < '0' || c > '9') key += c;
    }
    const auto now = std::chrono::steady_clock::now();
    if (last_.size() >= kMaxMessages) last_.clear();
    const auto [entry, is_new] = last_.try_emplace(key, now);
    if (!is_new && now - entry->second < period_) return false;
    entry->second = now;
    return true;
  }

 private:
  std::chrono::seconds period_;
  std::map<std::string, std::chrono::steady_clock::time_point> last_;
};

}  // namespace lidar_camera_recalibration

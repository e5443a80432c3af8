#include "input_monitor.hpp"

#include <algorithm>
#include <cstdio>
#include <vector>

namespace lidar_camera_recalibration {
namespace {

double seconds(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

void InputMonitor::count(Clock::time_point start, Clock::time_point end) {
  constexpr std::size_t kWindow = 20, kCallbacks = 1000;
  arrivals_.push_back(start);
  if (arrivals_.size() > kWindow) arrivals_.pop_front();
  callback_times_.push_back(seconds(end - start));
  if (callback_times_.size() > kCallbacks) callback_times_.pop_front();
}

std::string InputMonitor::report(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  const std::string topic = subscriber_.getTopic();
  const auto now = Clock::now();
  const double age = seconds(now - (arrivals_.empty() ? start_ : arrivals_.back()));
  if (arrivals_.empty()) {
    status.add(topic, "no message yet");
  } else {
    const double span = seconds(arrivals_.back() - arrivals_.front());
    const double rate = span > 0.0 ? static_cast<double>(arrivals_.size() - 1) / span : 0.0;
    std::vector<double> times(callback_times_.begin(), callback_times_.end());
    const auto percentile = times.begin() + static_cast<std::ptrdiff_t>(times.size() * 99 / 100);
    std::nth_element(times.begin(), percentile, times.end());
    status.addf(topic, "%.2f Hz, last one %.1f s ago, callback %.3f ms (99th percentile)", rate, age,
                1e3 * *percentile);
  }
  if (subscriber_.getNumPublishers() == 0)
    return "nobody publishes " + topic + " (the input `" + input_ + "`)";
  if (age <= max_age_) return "";
  char text[64];
  std::snprintf(text, sizeof text, " for %.0f s", age);
  return "no message on " + topic + text;
}

}  // namespace lidar_camera_recalibration

#include "input_monitor.hpp"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <vector>

namespace lidar_camera_recalibration {
namespace {

double seconds(std::chrono::steady_clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

double percentile99(const std::deque<double>& values) {
  std::vector<double> sorted(values.begin(), values.end());
  const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() * 99 / 100);
  std::nth_element(sorted.begin(), at, sorted.end());
  return *at;
}

}  // namespace

double InputMonitor::threadCpuTime() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void InputMonitor::count(Clock::time_point start, double cpu_start) {
  constexpr std::size_t kWindow = 20, kCallbacks = 1000;
  const auto push = [](auto& values, auto value, std::size_t size) {
    values.push_back(value);
    if (values.size() > size) values.pop_front();
  };
  push(arrivals_, start, kWindow);
  push(callback_times_, seconds(Clock::now() - start), kCallbacks);
  push(callback_cpu_times_, threadCpuTime() - cpu_start, kCallbacks);
}

std::string InputMonitor::report(diagnostic_updater::DiagnosticStatusWrapper& status) const {
  if (!subscriber_) return "";  // it comes from elsewhere
  const std::string topic = subscriber_.getTopic();
  const auto now = Clock::now();
  const double age = seconds(now - (arrivals_.empty() ? start_ : arrivals_.back()));
  if (arrivals_.empty()) {
    status.add(topic, "no message yet");
  } else {
    const double span = seconds(arrivals_.back() - arrivals_.front());
    const double rate = span > 0.0 ? static_cast<double>(arrivals_.size() - 1) / span : 0.0;
    status.addf(topic, "%.2f Hz, last one %.1f s ago, callback %.3f ms, of it CPU %.3f ms (99th percentiles)",
                rate, age, 1e3 * percentile99(callback_times_), 1e3 * percentile99(callback_cpu_times_));
  }
  if (subscriber_.getNumPublishers() == 0)
    return "nobody publishes " + topic + " (the input `" + input_ + "`)";
  if (age <= max_age_) return "";
  char text[64];
  std::snprintf(text, sizeof text, " for %.0f s", age);
  return "no message on " + topic + text;
}

}  // namespace lidar_camera_recalibration

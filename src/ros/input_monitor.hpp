#pragma once

#include <diagnostic_updater/DiagnosticStatusWrapper.h>
#include <ros/subscriber.h>

#include <chrono>
#include <deque>
#include <string>

namespace lidar_camera_recalibration {

/// Watches one subscribed topic: who publishes it, how often a message comes, how long ago the last one came,
/// and for how long its callbacks held the thread that called them. All of it in the callbacks' one thread.
class InputMonitor {
 public:
  /// @param max_age  a longer silence is worth a warning [s]
  InputMonitor(const std::string& input, double max_age) : input_(input), max_age_(max_age) {}

  void watch(const ros::Subscriber& subscriber) { subscriber_ = subscriber; }
  void stop() { subscriber_.shutdown(); }

  /// Lives as long as the callback that takes a message: counts it and measures the time.
  class Callback {
   public:
    explicit Callback(InputMonitor& monitor) : monitor_(monitor) {}
    ~Callback() { monitor_.count(start_, cpu_start_); }
    Callback(const Callback&) = delete;
    Callback& operator=(const Callback&) = delete;

   private:
    InputMonitor& monitor_;
    const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
    const double cpu_start_ = threadCpuTime();
  };

  /// Adds rate and age to the status. @return what is wrong with this input, empty if nothing.
  std::string report(diagnostic_updater::DiagnosticStatusWrapper& status) const;

 private:
  using Clock = std::chrono::steady_clock;
  void count(Clock::time_point start, double cpu_start);
  static double threadCpuTime();  ///< of the calling thread [s]

  std::string input_;
  double max_age_;
  ros::Subscriber subscriber_;
  Clock::time_point start_ = Clock::now();
  std::deque<Clock::time_point> arrivals_;  ///< the last few
  /// Of the last thousand callbacks [s]. On a busy machine the time is mostly that of others; the CPU time
  /// tells.
  std::deque<double> callback_times_, callback_cpu_times_;
};

}  // namespace lidar_camera_recalibration

#pragma once

#include <functional>
#include <map>
#include <string>

namespace lidar_camera_recalibration::performance {

/// Figures that belong to a measurement: how much was worked on, what came out.
using Counters = std::map<std::string, double>;

/// What is measured, with everything that it needs.
using Work = std::function<void(Counters&)>;

struct MeasurementOptions {
  double min_time = 0.2;  ///< of each repetition [s]
  int repetitions = 1;    ///< the script asks for more and takes the fastest: noise only ever adds
  /// Nothing is timed. Each measurement is done once with cold caches, as valgrind's callgrind counts it, and
  /// is a dump of its own.
  bool count_instructions = false;
};

/// Registers measurements with Google Benchmark. CPU time is that of the whole process, all threads together.
class Measurements {
 public:
  explicit Measurements(const MeasurementOptions& options) : options_(options) {}

  /// @param prepare  called when the measurement is first done; what it returned is kept until the next
  /// measurement
  /// @param max_repetitions  of something slow
  void add(const std::string& name, const std::function<Work(Counters&)>& prepare, int max_repetitions = 100);

 private:
  MeasurementOptions options_;
};

}  // namespace lidar_camera_recalibration::performance

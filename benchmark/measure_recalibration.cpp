// Whole recalibrations, from prepared frames to the judged result, and what they hold in memory.

#include <malloc.h>
#include <unistd.h>

#include <fstream>
#include <memory>
#include <string>

#include "lidar_camera_recalibration/calibrator.hpp"
#include "measurements.hpp"
#include "simulation/rig.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

constexpr std::uint64_t kSeed = 2;

/// The default configuration, with the limits of the start as range.
CalibratorConfig configOf(const StartError& start, int threads) {
  CalibratorConfig config;
  config.range = {start.rotation_deg, start.translation_m};
  config.search.threads = threads;
  return config;
}

Eigen::Isometry3d startFrom(const Source& source, const StartError& start) {
  return simulation::disturbed(source.T_camera_lidar(), start.rotation_deg * kDegree, start.translation_m,
                               kSeed);
}

/// A line of /proc/self/status [byte].
double statusBytes(const std::string& key) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.rfind(key + ":", 0) == 0) return 1024.0 * std::stod(line.substr(key.size() + 1));
  }
  return 0.0;
}

double residentBytes() {
  malloc_trim(0);  // what is free but not given back is not held
  return statusBytes("VmRSS");
}

/// From here on the peak counts anew.
void resetPeak() { std::ofstream("/proc/self/clear_refs") << "5"; }

}  // namespace

void addRecalibration(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                      const std::string& source, std::size_t count, const StartError& start, int threads) {
  char name[128];
  std::snprintf(name, sizeof(name), "recalibration/%s/frames:%zu/start:%.1fdeg_%.0fcm/threads:%d",
                source.c_str(), count, start.rotation_deg, 100.0 * start.translation_m, threads);
  measurements.add(
      name,
      [=](Counters&) -> Work {
        const Frames frames = store->frames(source, count);
        const CalibratorConfig config = configOf(start, threads);
        const Eigen::Isometry3d T_start = startFrom(store->source(source), start);
        return [=](Counters& result) {
          const CalibrationOutcome outcome = calibrate(frames, T_start, config);
          const ExtrinsicError error =
              extrinsicError(outcome.T_camera_lidar, store->source(source).T_camera_lidar());
          result["rotation_deg"] = error.angle() / kDegree;
          result["translation_m"] = error.distance();
          result["evaluations"] = static_cast<double>(outcome.evaluations);
          result["accepted"] = outcome.accepted;
        };
      },
      3);
}

void addMemory(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
               const std::string& source, std::size_t count) {
  measurements.add(
      "memory/" + source + "/frames:" + std::to_string(count),
      [=](Counters& counters) -> Work {
        const Source& from = store->source(source);
        const auto makeOne = [&](std::size_t i) {
          return prepare(from, from.frame(i), from.T_camera_lidar());
        };
        makeOne(0);  // what is set up once belongs to no frame
        const double before = residentBytes();
        Frames frames;
        double use = 0.0;
        for (std::size_t i = 0; i < count; ++i) {
          frames.push_back(makeOne(i));
          use += static_cast<double>(memoryUse(*frames.back()));
        }
        const double with_frames = residentBytes(), n = static_cast<double>(count);
        counters["memory_use_per_frame"] = use / n;
        counters["resident_per_frame"] = (with_frames - before) / n;
        for (const char* objective : {"paper", "consistency_edges"}) {
          ObjectiveConfig config;
          config.objective = objective;
          const double without = residentBytes();
          const auto evaluator = makeObjective(config)->evaluator(frames, {from.T_camera_lidar()});
          (*evaluator)(from.T_camera_lidar());
          counters[std::string("evaluator_") + objective] = residentBytes() - without;
        }
        resetPeak();
        const StartError start{2.5, 0.1};
        calibrate(frames, startFrom(from, start), configOf(start, 2));
        counters["process_without_frames"] = before;
        counters["process_with_frames"] = with_frames;
        counters["peak_of_calibration"] = statusBytes("VmHWM");
        return [](Counters&) {};
      },
      1);
}

}  // namespace lidar_camera_recalibration::performance

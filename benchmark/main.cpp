// Measures what the package costs. scripts/performance.py asks it for what doc/performance.md shows; by hand
// it is a Google Benchmark program like others (--benchmark_filter=REGEX, --benchmark_list_tests).

#include <benchmark/benchmark.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "measurements.hpp"

namespace lidar_camera_recalibration::performance {
namespace {

struct Options {
  std::string kitti = SHARED_DATA "/kitti_00";  ///< left out if there is no such folder
  std::string drive;                            ///< written by simulate_drive; left out if empty
  MeasurementOptions measurements;
  bool build = false;
};

const char* const kUsage =
    "performance_benchmark [options] [--benchmark_...]\n"
    "  --kitti=FOLDER        KITTI odometry 00 with masks\n"
    "  --drive=FOLDER        a longer drive, as simulate_drive --dataset writes it\n"
    "  --min-time=SECONDS    of each repetition\n"
    "  --repetitions=N\n"
    "  --count-instructions  each measurement once, for valgrind --tool=callgrind --instr-atstart=no\n"
    "  --build               only tell compiler and flags\n";

/// Takes its own options out of the command line; the rest is Google Benchmark's.
Options parse(int& argc, char** argv) {
  Options options;
  int kept = 1;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&](const std::string& name) {
      return word.rfind(name + "=", 0) == 0 ? word.substr(name.size() + 1) : std::string();
    };
    if (const std::string folder = value("--kitti"); !folder.empty()) {
      options.kitti = folder;
    } else if (const std::string drive = value("--drive"); !drive.empty()) {
      options.drive = drive;
    } else if (const std::string time = value("--min-time"); !time.empty()) {
      options.measurements.min_time = std::atof(time.c_str());
    } else if (const std::string count = value("--repetitions"); !count.empty()) {
      options.measurements.repetitions = std::atoi(count.c_str());
    } else if (word == "--count-instructions") {
      options.measurements.count_instructions = true;
    } else if (word == "--build") {
      options.build = true;
    } else {
      argv[kept++] = argv[i];
    }
  }
  argc = kept;
  return options;
}

/// Azimuth steps [deg] and numbers of beams that give about 5 k to 200 k points in the image.
const std::vector<std::pair<int, double>> kDensities = {{16, 0.2},    {32, 0.1728}, {64, 0.1728},
                                                        {64, 0.0864}, {64, 0.0432}, {64, 0.0146}};
constexpr int kMaskCounts[] = {35, 100, 200, 350};

void addAll(Measurements& measurements, const Options& options) {
  std::map<std::string, std::shared_ptr<const Source>> sources;
  if (std::filesystem::is_directory(options.kitti)) sources["kitti_00"] = openFolder(options.kitti);
  if (!options.drive.empty()) sources["drive"] = openFolder(options.drive);
  std::vector<std::string> densities, mask_counts;
  for (const auto& [beams, step] : kDensities) {
    SensorSizes sizes;
    sizes.beams = beams;
    sizes.azimuth_step_deg = step;
    char name[64];
    std::snprintf(name, sizeof(name), "density_%d_%.4f", beams, step);
    sources[name] = simulateFrame(sizes);
    densities.push_back(name);
  }
  for (const int masks : kMaskCounts) {
    SensorSizes sizes;
    sizes.masks = masks;
    mask_counts.push_back("masks_" + std::to_string(masks));
    sources[mask_counts.back()] = simulateFrame(sizes);
  }
  SensorSizes large;
  large.width = 1920;
  large.height = 1200;
  large.azimuth_step_deg = 0.08;
  sources["large"] = simulateFrame(large);

  const auto store = std::make_shared<FrameStore>(sources);
  if (store->has("kitti_00")) {
    addEvaluation(measurements, store, "kitti_00", 10, {1, 2});
    for (const std::size_t frames : {1, 5}) addEvaluation(measurements, store, "kitti_00", frames, {1});
    addPreparation(measurements, store, "kitti_00", true);
    addSideBySide(measurements, store, "kitti_00", 1);
  }
  if (store->has("drive")) {
    for (const std::size_t frames : {1, 5, 10, 50}) addEvaluation(measurements, store, "drive", frames, {1});
  }
  for (const std::string& name : densities) {
    addEvaluation(measurements, store, name, 1, {1});
    addPreparation(measurements, store, name, false);
  }
  for (const std::string& name : mask_counts) {
    addEvaluation(measurements, store, name, 1, {1});
    addPreparation(measurements, store, name, false);
  }
  addPreparation(measurements, store, "large", true);
  const std::vector<std::pair<std::string, std::size_t>> recalibrations = {
      {"kitti_00", 10}, {"drive", 10}, {"drive", 50}};
  for (const auto& [source, frames] : recalibrations) {
    if (!store->has(source)) continue;
    for (const StartError& start : {StartError{2.5, 0.1}, {5.0, 0.2}}) {
      for (const int threads : {1, 2}) {
        addRecalibration(measurements, store, source, frames, start, threads);
      }
    }
    addMemory(measurements, store, source, frames);
  }
  addMemory(measurements, store, "large", 1);
}

}  // namespace
}  // namespace lidar_camera_recalibration::performance

int main(int argc, char** argv) {
  using namespace lidar_camera_recalibration::performance;
  const Options options = parse(argc, argv);
  if (options.build) {
    std::printf("{\"compiler\": \"%s\", \"flags\": \"%s\"}\n", COMPILER, COMPILE_FLAGS);
    return 0;
  }
  Measurements measurements(options.measurements);
  try {
    addAll(measurements, options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "performance_benchmark: %s\n", error.what());
    return 1;
  }
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}

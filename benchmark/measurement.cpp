#include "measurement.hpp"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <exception>
#include <memory>
#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#else
#define CALLGRIND_START_INSTRUMENTATION
#define CALLGRIND_STOP_INSTRUMENTATION
#define CALLGRIND_ZERO_STATS
#define CALLGRIND_DUMP_STATS_AT(name)
#endif

namespace lidar_camera_recalibration::performance {
namespace {

struct Prepared {
  std::string name;
  Counters counters;
  Work work;
};

/// Google Benchmark calls a function again for each repetition, and to find out how often to iterate.
Prepared& prepared(const std::string& name, const std::function<Work(Counters&)>& prepare) {
  static std::unique_ptr<Prepared> current;
  if (!current || current->name != name) {
    current.reset();  // its memory first
    auto next = std::make_unique<Prepared>();
    next->name = name;
    next->work = prepare(next->counters);
    current = std::move(next);
  }
  return *current;
}

void countInstructions(Prepared& measured) {
  measured.work(measured.counters);  // what is set up once is not counted
  CALLGRIND_START_INSTRUMENTATION;
  CALLGRIND_ZERO_STATS;
  measured.work(measured.counters);
  CALLGRIND_DUMP_STATS_AT(measured.name.c_str());
  CALLGRIND_STOP_INSTRUMENTATION;
}

}  // namespace

void Measurements::add(const std::string& name, const std::function<Work(Counters&)>& prepare,
                       int max_repetitions) {
  const bool count_instructions = options_.count_instructions;
  auto* const registered = benchmark::RegisterBenchmark(name.c_str(), [=](benchmark::State& state) {
    try {
      Prepared& measured = prepared(name, prepare);
      if (count_instructions) countInstructions(measured);
      for (auto _ : state) {
        if (!count_instructions) measured.work(measured.counters);
      }
      for (const auto& [key, value] : measured.counters) state.counters[key] = value;
    } catch (const std::exception& error) {
      state.SkipWithError(error.what());
    }
  });
  registered->MeasureProcessCPUTime()->UseRealTime()->Unit(benchmark::kMillisecond);
  if (count_instructions) {
    registered->Iterations(1);
  } else {
    registered->MinTime(options_.min_time)->Repetitions(std::min(options_.repetitions, max_repetitions));
  }
}

}  // namespace lidar_camera_recalibration::performance

#pragma once

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace lidar_camera_recalibration::simulation {

/// Calls work(0) ... work(count - 1), each once, on several threads. The order is open, so the calls must be
/// independent.
template <typename Work>
void parallelFor(int count, int threads, const Work& work) {
  std::atomic<int> next{0};
  const auto run = [&] {
    for (int i = next++; i < count; i = next++) work(i);
  };
  std::vector<std::thread> helpers;
  for (int i = 1; i < std::min(threads, count); ++i) helpers.emplace_back(run);
  run();
  for (std::thread& helper : helpers) helper.join();
}

}  // namespace lidar_camera_recalibration::simulation

#pragma once

#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

namespace lidar_camera_recalibration {

/// Calls function(worker, index) for all indices below `count` on at most `workers` threads, the caller's
/// included. Which worker gets which index is not determined, so results must not depend on it.
template <typename Function>
void parallelFor(std::size_t count, std::size_t workers, const Function& function) {
  std::atomic<std::size_t> next{0};
  const auto work = [&](std::size_t worker) {
    for (std::size_t i = next++; i < count; i = next++) function(worker, i);
  };
  std::vector<std::thread> threads;
  for (std::size_t w = 1; w < workers && w < count; ++w) threads.emplace_back(work, w);
  work(0);
  for (std::thread& thread : threads) thread.join();
}

}  // namespace lidar_camera_recalibration

#pragma once

#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace lidar_camera_recalibration {

/// Calls function(worker, index) for all indices below `count` on at most `workers` threads; worker 0 is the
/// caller's. Which worker gets which index is not determined, so results must not depend on it. What the
/// function throws ends the work and is thrown on, that of the lowest index if there are several.
template <typename Function>
void parallelFor(std::size_t count, std::size_t workers, const Function& function) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::size_t failed = count;
  std::exception_ptr failure;
  const auto work = [&](std::size_t worker) {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        function(worker, i);
      } catch (...) {
        // Lower indices have been taken before and are worked on to their end.
        next = count;
        const std::lock_guard<std::mutex> lock(mutex);
        if (i < failed) {
          failed = i;
          failure = std::current_exception();
        }
      }
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t w = 1; w < workers && w < count; ++w) threads.emplace_back(work, w);
  work(0);
  for (std::thread& thread : threads) thread.join();
  if (failure) std::rethrow_exception(failure);
}

}  // namespace lidar_camera_recalibration

#pragma once

#include <atomic>

#include "lidar_camera_recalibration/search.hpp"
#include "parallel.hpp"

namespace lidar_camera_recalibration {

/// For a step that is the part from `begin` to `end` (0..1) of the whole. `progress` must outlive it and may
/// be empty.
inline Progress partOf(const Progress& progress, double begin, double end) {
  return [&progress, begin, end](double fraction, double best) {
    return !progress || progress(begin + (end - begin) * fraction, best);
  };
}

/// Calls job(i, progress) for all i below `count` on several threads, see parallelFor. `progress` is told by
/// the caller's thread alone, and when it cancels, the jobs are told by theirs.
/// @return false if cancelled; then not all jobs were done
template <typename Job>
bool runJobs(std::size_t count, int threads, const Progress& progress, const Job& job) {
  std::atomic<std::size_t> done{0};
  std::atomic<bool> cancelled{false};
  parallelFor(count, static_cast<std::size_t>(threads), [&](std::size_t worker, std::size_t i) {
    if (cancelled) return;
    job(i, [&](double fraction, double best) {
      const double whole = (static_cast<double>(done) + fraction) / static_cast<double>(count);
      if (worker == 0 && progress && !progress(whole, best)) cancelled = true;
      return !cancelled;
    });
    ++done;
  });
  return !cancelled;
}

}  // namespace lidar_camera_recalibration

#pragma once

#include <malloc.h>

#include <fstream>
#include <string>

namespace lidar_camera_recalibration {

/// Resident memory of this process [MB].
inline double residentMemory() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    double kilobytes = 0.0;
    if (word == "VmRSS:" && status >> kilobytes) return kilobytes / 1024.0;
  }
  return 0.0;
}

/// What this process has allocated and not freed [MB]; unlike the resident memory without what the allocator
/// keeps for the next one.
inline double allocatedMemory() {
#if __GLIBC_PREREQ(2, 33)
  const struct mallinfo2 info = mallinfo2();
#else
  const struct mallinfo info = mallinfo();
#endif
  return (static_cast<double>(info.uordblks) + static_cast<double>(info.hblkhd)) / 1048576.0;
}

}  // namespace lidar_camera_recalibration

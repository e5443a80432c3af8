#pragma once

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

}  // namespace lidar_camera_recalibration

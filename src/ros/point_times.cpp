#include "point_times.hpp"

#include <algorithm>
#include <cmath>

namespace lidar_camera_recalibration {

std::vector<float> secondsAfter(double stamp, const std::vector<double>& raw) {
  constexpr double kShortest = 0.002, kLongest = 1.0, kFurthest = 1.0;  // [s]
  const bool finite = std::all_of(raw.begin(), raw.end(), [](double value) { return std::isfinite(value); });
  if (raw.empty() || !finite) return {};
  const auto [first, last] = std::minmax_element(raw.begin(), raw.end());
  for (const double unit : {1.0, 1e-3, 1e-6, 1e-9}) {
    const double begin = unit * *first, end = unit * *last;
    if (!(end - begin >= kShortest && end - begin <= kLongest)) continue;
    const auto isNear = [&](double zero) {
      return std::abs(begin - zero) <= kFurthest && std::abs(end - zero) <= kFurthest;
    };
    const double zero = isNear(0.0) ? 0.0 : stamp;
    if (!isNear(zero)) return {};
    std::vector<float> seconds;
    seconds.reserve(raw.size());
    for (const double value : raw) seconds.push_back(static_cast<float>(unit * value - zero));
    return seconds;
  }
  return {};
}

}  // namespace lidar_camera_recalibration

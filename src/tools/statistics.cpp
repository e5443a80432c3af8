#include "statistics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lidar_camera_recalibration {

namespace {
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
}

double mean(const std::vector<double>& values) {
  if (values.empty()) return kNaN;
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

double quantile(std::vector<double> values, double fraction) {
  if (values.empty()) return kNaN;
  std::sort(values.begin(), values.end());
  const double position = fraction * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(position);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (position - static_cast<double>(below)) * (values[above] - values[below]);
}

double huberMean(const std::vector<double>& values) {
  double location = quantile(values, 0.5);
  std::vector<double> deviations;
  for (const double value : values) deviations.push_back(std::abs(value - location));
  // 1.4826 makes the median absolute deviation a standard deviation, 1.345 gives 95 % efficiency (normal
  // values).
  const double limit = 1.345 * 1.4826 * quantile(deviations, 0.5);
  if (!(limit > 0.0)) return location;
  for (int iteration = 0; iteration < 100; ++iteration) {
    double sum = 0.0, weights = 0.0;
    for (const double value : values) {
      const double deviation = std::abs(value - location);
      const double weight = deviation <= limit ? 1.0 : limit / deviation;
      sum += weight * value;
      weights += weight;
    }
    const double next = sum / weights;
    if (std::abs(next - location) < 1e-12 * limit) return next;
    location = next;
  }
  return location;
}

}  // namespace lidar_camera_recalibration

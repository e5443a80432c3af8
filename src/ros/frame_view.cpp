#include "frame_view.hpp"

#include <algorithm>
#include <cmath>

namespace lidar_camera_recalibration {
namespace {

// Cells are several samples of a LiDAR with few beams wide, so that noise and jitter of the angles average
// out.
constexpr int kColumns = 120, kRows = 60;  // of 3 deg
constexpr int kMinPoints = 4;              ///< a cell with fewer says nothing
constexpr float kChange = 0.05F;           ///< of the logarithm of the range, 5 %

std::size_t cellOf(float x, float y, float z) {
  const double azimuth = std::atan2(y, x), elevation = std::atan2(z, std::hypot(x, y));
  const int column = static_cast<int>((azimuth + M_PI) / (2.0 * M_PI) * kColumns);
  const int row = static_cast<int>((elevation + M_PI_2) / M_PI * kRows);
  return static_cast<std::size_t>(std::clamp(row, 0, kRows - 1) * kColumns +
                                  std::clamp(column, 0, kColumns - 1));
}

}  // namespace

FrameView::FrameView(const Frame& frame) : cells_(kColumns * kRows) {
  const FramePoints& points = frame.points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    Cell& cell = cells_[cellOf(points.x[i], points.y[i], points.z[i])];
    const float range =
        std::sqrt(points.x[i] * points.x[i] + points.y[i] * points.y[i] + points.z[i] * points.z[i]);
    ++cell.points;
    cell.mean_log_range += (std::log(range) - cell.mean_log_range) / static_cast<float>(cell.points);
  }
}

double FrameView::changeFrom(const FrameView& other) const {
  int seen = 0, changed = 0;
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    const Cell &a = cells_[i], &b = other.cells_[i];
    // In between, the border of something runs along the cell's, and it may be there or not.
    const bool in_both = std::min(a.points, b.points) >= kMinPoints;
    const bool in_one = std::max(a.points, b.points) >= kMinPoints && std::min(a.points, b.points) == 0;
    if (!in_both && !in_one) continue;
    ++seen;
    changed += in_one || std::abs(a.mean_log_range - b.mean_log_range) > kChange ? 1 : 0;
  }
  return seen == 0 ? 1.0 : static_cast<double>(changed) / seen;
}

}  // namespace lidar_camera_recalibration

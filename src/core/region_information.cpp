#include "region_information.hpp"

#include <cmath>

#include "projection.hpp"

namespace lidar_camera_recalibration {
namespace {

double entropyPart(double share) { return share > 0.0 ? -share * std::log(share) : 0.0; }

double entropy(const std::vector<double>& shares) {
  double sum = 0.0;
  for (const double share : shares) sum += entropyPart(share);
  return sum;
}

}  // namespace

double regionInformation(const Frame& frame, const std::vector<std::uint32_t>& points,
                         const Eigen::Isometry3d& T_camera_lidar, std::size_t& used) {
  const FramePoints& p = frame.points;
  // Overlapping masks: a set of them counts as a mask of its own. No mask and no class count as well.
  const std::size_t sets = frame.masks.setCount(), classes = static_cast<std::size_t>(p.segment_count) + 1;
  const Projection project(frame.camera.intrinsics(), T_camera_lidar);
  std::vector<std::uint32_t> joint(sets * classes, 0u);
  std::size_t count = 0;
  for (const std::uint32_t i : points) {
    std::size_t u, v;
    if (!project.nearest(p.x[i], p.y[i], p.z[i], u, v)) continue;
    const std::size_t set = frame.masks.setOfPixel().ptr<std::uint16_t>(static_cast<int>(v))[u];
    ++joint[set * classes + static_cast<std::size_t>(p.segment[i] + 1)];
    ++count;
  }
  used += count;
  if (count == 0) return 0.0;

  std::vector<double> of_set(sets, 0.0), of_class(classes, 0.0);
  double joint_entropy = 0.0;
  for (std::size_t s = 0; s < sets; ++s) {
    for (std::size_t c = 0; c < classes; ++c) {
      const std::uint32_t points_here = joint[s * classes + c];
      if (points_here == 0) continue;
      const double share = static_cast<double>(points_here) / static_cast<double>(count);
      of_set[s] += share;
      of_class[c] += share;
      joint_entropy += entropyPart(share);
    }
  }
  return joint_entropy > 0.0 ? (entropy(of_set) + entropy(of_class) - joint_entropy) / joint_entropy : 0.0;
}

}  // namespace lidar_camera_recalibration

#include "search_space.hpp"

#include <string>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {

std::vector<Eigen::Isometry3d> rotationGrid(const Eigen::Isometry3d& start, int n, double step) {
  std::vector<Eigen::Isometry3d> grid;
  for (int x = -n; x <= n; ++x) {
    for (int y = -n; y <= n; ++y) {
      for (int z = -n; z <= n; ++z) {
        Vector6d xi = Vector6d::Zero();
        xi.head<3>() = step * Eigen::Vector3d(x, y, z);
        grid.push_back(exp(xi) * start);
      }
    }
  }
  return grid;
}

Eigen::Vector3d turnedTranslation(const Eigen::Isometry3d& T, const Eigen::Isometry3d& start) {
  return T.linear() * start.linear().transpose() * start.translation();
}

Eigen::Isometry3d withLimitedTranslation(Eigen::Isometry3d T, const Eigen::Isometry3d& start, double limit) {
  const Eigen::Vector3d centre = turnedTranslation(T, start);
  T.translation() = centre + (T.translation() - centre).cwiseMax(-limit).cwiseMin(limit);
  return T;
}

void requireFrames(const Frames& frames) {
  if (frames.empty()) throw Error(ErrorCause::kNotEnough, "search: there is no frame to search on");
}

void requireThreads(int threads) {
  if (threads < 1 || threads > 256) {
    throw Error(ErrorCause::kParameter, "threads: " + std::to_string(threads) + " is outside of 1 to 256");
  }
}

}  // namespace lidar_camera_recalibration

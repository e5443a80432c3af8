#include "perturbation.hpp"

#include <random>

#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {

namespace {

Eigen::Vector3d randomDirection(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::Vector3d direction;
  do {
    for (double& value : direction) value = normal(random);
  } while (direction.norm() < 1e-6);
  return direction.normalized();
}

}  // namespace

Eigen::Isometry3d perturbedBy(const Eigen::Isometry3d& T_camera_lidar, double angle, double distance,
                              std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Eigen::Isometry3d result = T_camera_lidar;
  result.linear() = Eigen::AngleAxisd(angle, randomDirection(random)) * T_camera_lidar.linear();
  result.translation() += distance * randomDirection(random);
  return result;
}

}  // namespace lidar_camera_recalibration

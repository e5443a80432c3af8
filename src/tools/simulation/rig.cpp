#include "simulation/rig.hpp"

#include "simulation/random.hpp"

namespace lidar_camera_recalibration::simulation {

using Eigen::Isometry3d;
using Eigen::Vector3d;

namespace {

Vector3d randomDirection(Random& random) {
  Vector3d direction;
  do {
    direction = {random.gaussian(1.0), random.gaussian(1.0), random.gaussian(1.0)};
  } while (direction.norm() < 1e-3);
  return direction.normalized();
}

}  // namespace

Isometry3d opticalFromLink() {
  Isometry3d T_optical_link = Isometry3d::Identity();
  T_optical_link.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  return T_optical_link;
}

Isometry3d disturbed(const Isometry3d& T_camera_lidar, double angle, double distance, std::uint64_t seed) {
  Random random(seed, 5);
  Isometry3d result = Isometry3d::Identity();
  result.linear() =
      Eigen::AngleAxisd(angle, randomDirection(random)).toRotationMatrix() * T_camera_lidar.linear();
  result.translation() = T_camera_lidar.translation() + distance * randomDirection(random);
  return result;
}

Rig makeRig(std::uint64_t seed) {
  Rig rig;
  rig.T_base_lidar = Isometry3d::Identity();
  rig.T_base_lidar.translation() = Vector3d(0.0, 0.0, 1.85);
  Random random(seed, 6);
  Isometry3d nominal = opticalFromLink();
  nominal.translation() = Vector3d(0.05, -0.28, -0.30);
  for (int i = 0; i < 3; ++i) nominal.translation()[i] += random.uniform(-0.02, 0.02);
  const Vector3d tilt(random.uniform(-0.017, 0.017), random.uniform(-0.017, 0.017),
                      random.uniform(-0.012, 0.012));
  nominal.linear() = Eigen::AngleAxisd(tilt.norm(), tilt.normalized()).toRotationMatrix() * nominal.linear();
  rig.T_camera_lidar = nominal;
  return rig;
}

}  // namespace lidar_camera_recalibration::simulation

#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "simulation/scene.hpp"

namespace lidar_camera_recalibration::simulation {

/// The middle line of a winding road on level ground.
class Road {
 public:
  /// Defined for arc lengths from..to [m].
  /// @param winding  1: the tightest radius is about 60 m; 2: half of that
  Road(double from, double to, std::uint64_t seed, double winding = 1.0);

  double from() const { return from_; }
  double to() const { return to_; }
  double heading(double s) const;  ///< [rad], 0 along the world's x
  /// x along the road at arc length s [m], origin d [m] left of the middle line.
  Eigen::Isometry3d pose(double s, double d) const;

 private:
  double from_, to_, winding_;
  double phase_a_, phase_b_;
  std::vector<Eigen::Vector2d> middle_;
};

/// A seeded street with a vehicle that drives along it.
class Street {
 public:
  /// @param length  distance the vehicle will drive [m]
  /// @param speed   of the vehicle [m/s]
  /// @param winding  of the road
  /// @throw Error(kParameter) for a length beyond what single precision resolves.
  Street(std::uint64_t seed, double length, double speed, double winding = 1.0);
  Street(const Street&) = delete;  // its traffic follows its own road
  Street& operator=(const Street&) = delete;

  const World& world() const { return world_; }
  /// T_world_base at a time [s] since the start: base is the ground below the LiDAR, x forward, z up.
  Eigen::Isometry3d egoPose(double time) const;

 private:
  Road road_;
  World world_;
  double speed_;
  double bounce_phase_;
};

}  // namespace lidar_camera_recalibration::simulation

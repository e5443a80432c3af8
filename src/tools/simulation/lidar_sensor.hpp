#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "simulation/scene.hpp"

namespace lidar_camera_recalibration::simulation {

struct LidarConfig {
  int beams = 64;                    ///< 16, 32 or 64
  double azimuth_step_deg = 0.1728;  ///< [deg]
  double sweep_duration = 0.1;       ///< one turn [s]
  double min_range = 1.5;            ///< [m]
  double max_range = 100.0;          ///< [m]
  double range_noise = 0.015;        ///< sigma [m]
  bool dropouts = true;              ///< weak echoes, glass, and a few at random
  int threads = 2;                   ///< does not change the result
};

/// Elevation angles [rad] from the lowest beam (ring 0) to the highest, as of common sensors with 16, 32 and
/// 64 beams.
/// @throw Error(kParameter) for another number.
std::vector<double> beamElevations(int beams);

struct LidarReturn {
  Eigen::Vector3f point;  ///< [m], in the sensor's frame at the moment of firing
  float time;             ///< of firing, relative to the middle of the sweep [s]
  float intensity;        ///< 0..255; diffuse targets up to about 100, retro-reflectors saturate
  std::uint16_t ring;     ///< 0 is the lowest
  std::uint32_t part;     ///< what was hit
};

/// A spinning LiDAR, x forward, z up. It turns clockwise and looks forward in the middle of the sweep.
class LidarSensor {
 public:
  explicit LidarSensor(const LidarConfig& config);

  /// One turn around `time` [s], each ray from the pose at its own time.
  /// @param T_world_lidar  pose over time; the scene's interval must cover the sweep
  std::vector<LidarReturn> sweep(const Scene& scene, const Trajectory& T_world_lidar, double time,
                                 std::uint64_t seed) const;

  double duration() const { return config_.sweep_duration; }

 private:
  LidarConfig config_;
  std::vector<double> elevations_;
};

/// Moves the points to where a still sensor would have seen them from its pose at `time`, as datasets deliver
/// them; all belong to `time` then. What moved by itself stays smeared.
void motionCompensate(std::vector<LidarReturn>& sweep, const Trajectory& T_world_lidar, double time);

}  // namespace lidar_camera_recalibration::simulation

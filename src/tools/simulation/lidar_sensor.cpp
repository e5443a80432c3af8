#include "simulation/lidar_sensor.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "parallel.hpp"
#include "simulation/appearance.hpp"
#include "simulation/random.hpp"

namespace lidar_camera_recalibration::simulation {

using Eigen::Vector3f;

namespace {

constexpr double kHalfSignal =
    1.2e-5;                           ///< reflectivity / range^2 [1/m^2] at which half of the echoes are lost
constexpr double kRandomLoss = 0.01;  ///< share of echoes lost for no visible reason

/// Surfaces are rough: their echo falls off slower than the cosine.
float echo(const Part& part, const Hit& hit, const Vector3f& direction) {
  const float cosine = std::max(0.0F, -hit.normal.dot(direction));
  // Grain of the surface, seen by a beam a few centimetres wide.
  const float brightness = part.texture == Texture::kPlain
                               ? 1.0F
                               : surfaceColor(part, hit, 0.03F).mean() / std::max(0.02F, part.color.mean());
  const float grain = part.retro_reflective ? 1.0F : std::clamp(brightness, 0.4F, 2.0F);
  return part.reflectivity * grain * std::pow(cosine, 0.6F);
}

bool lost(const Part& part, const Hit& hit, const Vector3f& direction, float signal, Random& random) {
  if (random.chance(kRandomLoss)) return true;
  // Glass lets most beams through and mirrors the slanting ones away.
  if (part.glass && (-hit.normal.dot(direction) < 0.75F || random.chance(0.5))) return true;
  const double strength =
      (part.retro_reflective ? 20.0 : 1.0) * signal / (hit.distance * hit.distance) / kHalfSignal;
  return !random.chance(strength * strength / (1.0 + strength * strength));
}

}  // namespace

std::vector<double> beamElevations(int beams) {
  std::vector<double> degrees;
  if (beams == 64) {  // two blocks of 32 with different spacing
    for (int i = 0; i < 32; ++i) degrees.push_back(-24.8 + i * (24.8 - 8.83) / 31.0);
    for (int i = 0; i < 32; ++i) degrees.push_back(-8.33 + i * (8.33 + 2.0) / 31.0);
  } else if (beams == 32) {
    for (int i = 0; i < 32; ++i) degrees.push_back(-30.67 + i * (30.67 + 10.67) / 31.0);
  } else if (beams == 16) {
    for (int i = 0; i < 16; ++i) degrees.push_back(-15.0 + 2.0 * i);
  } else {
    throw Error(ErrorCause::kParameter,
                "There is no LiDAR with " + std::to_string(beams) + " beams here: use 16, 32 or 64.");
  }
  for (double& angle : degrees) angle *= kDegree;
  return degrees;
}

LidarSensor::LidarSensor(const LidarConfig& config)
    : config_(config), elevations_(beamElevations(config.beams)) {
  if (!(config.azimuth_step_deg >= 0.01 && config.azimuth_step_deg <= 5.0)) {
    throw Error(ErrorCause::kParameter, "azimuth_step_deg is " + std::to_string(config.azimuth_step_deg) +
                                            " deg; it must be 0.01 to 5.");
  }
}

std::vector<LidarReturn> LidarSensor::sweep(const Scene& scene, const Trajectory& T_world_lidar, double time,
                                            std::uint64_t seed) const {
  const auto columns = static_cast<std::size_t>(std::lround(360.0 / config_.azimuth_step_deg));
  const double columns_around = static_cast<double>(columns);
  std::vector<std::vector<LidarReturn>> of_column(columns);
  const std::vector<Part>& parts = scene.world().parts;
  parallelFor(columns, static_cast<std::size_t>(config_.threads), [&](std::size_t, std::size_t column) {
    Random random(seed, 4, column);
    const double turned = (static_cast<double>(column) + 0.5) / columns_around;
    const double azimuth = M_PI - 2 * M_PI * turned, relative = config_.sweep_duration * (turned - 0.5);
    const Eigen::Isometry3f pose = T_world_lidar(time + relative).cast<float>();
    for (std::size_t ring = 0; ring < elevations_.size(); ++ring) {
      const double level = std::cos(elevations_[ring]);
      const Vector3f ray =
          Eigen::Vector3d(level * std::cos(azimuth), level * std::sin(azimuth), std::sin(elevations_[ring]))
              .cast<float>();
      const Vector3f direction = pose.linear() * ray;
      const std::optional<Hit> hit = scene.cast(pose.translation(), direction, time + relative);
      if (!hit || hit->distance < config_.min_range || hit->distance > config_.max_range) continue;
      const Part& part = parts[hit->part];
      const float signal = echo(part, *hit, direction);
      if (config_.dropouts && lost(part, *hit, direction, signal, random)) continue;
      const float range = hit->distance + static_cast<float>(random.gaussian(config_.range_noise));
      const double intensity = part.retro_reflective
                                   ? 255.0
                                   : 100.0 * signal * (1.0 + random.gaussian(0.06)) + random.gaussian(0.6);
      of_column[column].push_back({range * ray, static_cast<float>(relative),
                                   static_cast<float>(std::clamp(intensity, 0.0, 255.0)),
                                   static_cast<std::uint16_t>(ring), hit->part});
    }
  });
  std::vector<LidarReturn> sweep;
  for (const auto& returns : of_column) sweep.insert(sweep.end(), returns.begin(), returns.end());
  return sweep;
}

void motionCompensate(std::vector<LidarReturn>& sweep, const Trajectory& T_world_lidar, double time) {
  const Eigen::Isometry3d T_lidar_world = T_world_lidar(time).inverse();
  float last_time = 0.0F;
  Eigen::Isometry3d T_now_then = Eigen::Isometry3d::Identity();
  bool first = true;
  for (LidarReturn& r : sweep) {
    if (first || r.time != last_time)
      T_now_then = T_lidar_world * T_world_lidar(time + static_cast<double>(r.time));
    first = false;
    last_time = r.time;
    r.point = (T_now_then * r.point.cast<double>()).cast<float>();
    r.time = 0.0F;
  }
}

}  // namespace lidar_camera_recalibration::simulation

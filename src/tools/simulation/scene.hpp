#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "simulation/mesh.hpp"

namespace lidar_camera_recalibration::simulation {

/// T_world_object at a time [s].
using Trajectory = std::function<Eigen::Isometry3d(double)>;

struct MovingObject {
  Mesh mesh;
  Trajectory pose;
};

/// Everything there is to see. Part 0 is the sky.
struct World {
  std::vector<Part> parts;
  Mesh ground_and_buildings;  ///< all that stands still
  std::vector<MovingObject> moving;
  Eigen::Vector3f to_sun = Eigen::Vector3f::UnitZ();  ///< unit vector
};

struct Hit {
  float distance;           ///< [m]
  std::uint32_t part;       ///< index into World::parts
  Eigen::Vector3f normal;   ///< unit vector, facing the ray's origin
  Eigen::Vector2f texture;  ///< texture coordinates
};

/// A world ready for ray casting (Embree). Queries are const and may run in parallel.
class Scene {
 public:
  /// The world must outlive the scene. @throw Error(kParameter) if Embree cannot be started.
  explicit Scene(const World& world);
  ~Scene();

  const World& world() const;

  /// Chooses the times [s] that queries may ask for. Moving objects go straight from their pose at the one to
  /// that at the other.
  void setInterval(double from, double to);

  /// The first surface along a unit ray; nothing means sky.
  std::optional<Hit> cast(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, double time) const;

  /// Something lies between the origin and `distance` along a unit ray.
  bool blocked(const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float distance,
               double time) const;

 private:
  struct Data;
  std::unique_ptr<Data> data_;
};

}  // namespace lidar_camera_recalibration::simulation

#include "simulation/street.hpp"

#include <algorithm>
#include <cmath>

#include "lidar_camera_recalibration/error.hpp"
#include "simulation/random.hpp"
#include "simulation/street_objects.hpp"

namespace lidar_camera_recalibration::simulation {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::Vector3f;

namespace {

// Cross section, distances from the middle line [m].
constexpr double kLane = 1.65;     ///< middle of a lane
constexpr double kRoadHalf = 5.3;  ///< to the kerb; the outer 2 m are for parking
constexpr double kKerbWidth = 0.15;
constexpr double kKerbHeight = 0.13;
constexpr double kFront = 8.6;  ///< where the first fronts may stand
constexpr double kGroundHalf = 90.0;
constexpr double kParking = 4.25;

constexpr double kBehind = 110.0,
                 kAhead = 160.0;       ///< street built before the start and beyond the end of the drive [m]
constexpr double kSampling = 0.25;     ///< of the middle line [m]
constexpr double kMaxLength = 8000.0;  ///< [m]; single precision then still resolves 0.5 mm

Isometry3d turned(const Isometry3d& pose, double angle) {
  return pose * Eigen::AngleAxisd(angle, Vector3d::UnitZ());
}

/// Puts the things along the road, side by side; each member draws one kind over the whole length.
class StreetBuilder {
 public:
  StreetBuilder(World& world, const Road& road, double from, double to, Random& random)
      : world_(world), road_(road), from_(from), to_(to), random_(random), factory_(world.parts, random) {}

  void build(double speed) {
    ground();
    markings();
    for (const double side : {-1.0, 1.0}) {
      fronts(side);
      parkedCars(side);
      furniture(side);
    }
    traffic(speed);
  }

 private:
  Mesh& still() { return world_.ground_and_buildings; }

  /// Frame on the pavement: x along the road, y away from it on its left.
  Eigen::Isometry3f stand(double s, double d, double z = kKerbHeight, double turn = 0.0) const {
    Isometry3d pose = turned(road_.pose(s, d), turn);
    pose.translation().z() = z;
    return pose.cast<float>();
  }

  /// Ribbon along the road between two offsets, texture coordinates (s, d).
  void ribbon(double s0, double s1, double d0, double z0, double d1, double z1, std::uint32_t part) {
    MeshBuilder builder(still(), Eigen::Isometry3f::Identity());
    const int steps = std::max(1, static_cast<int>(std::ceil(s1 - s0)));
    const auto point = [&](int i, double d, double z) {
      Vector3d p = road_.pose(s0 + (s1 - s0) * i / steps, d).translation();
      p.z() = z;
      return Vector3f(p.cast<float>());
    };
    for (int i = 0; i < steps; ++i) {
      builder.quad(point(i, d0, z0), point(i + 1, d0, z0), point(i + 1, d1, z1), point(i, d1, z1), part);
    }
  }

  void ground() {
    const auto road = factory_.addPart(PartKind::kRoad, 0, {0.085F, 0.085F, 0.09F}, 0.14F, Texture::kAsphalt);
    ribbon(from_, to_, -kRoadHalf, 0, kRoadHalf, 0, road);
    for (const double side : {-1.0, 1.0}) {
      const auto kerb = factory_.addPart(PartKind::kKerb, 0, {0.36F, 0.36F, 0.35F}, 0.3F);
      const auto pavement =
          factory_.addPart(PartKind::kPavement, 0, {0.26F, 0.25F, 0.24F}, 0.24F, Texture::kPaving);
      const auto grass = factory_.addPart(PartKind::kGrass, 0, {0.10F, 0.15F, 0.04F}, 0.4F, Texture::kGrass);
      const double inner = side * kRoadHalf, outer = side * (kRoadHalf + kKerbWidth), front = side * kFront;
      ribbon(from_, to_, inner, 0, inner, kKerbHeight, kerb);
      ribbon(from_, to_, inner, kKerbHeight, outer, kKerbHeight, kerb);
      ribbon(from_, to_, outer, kKerbHeight, front, kKerbHeight, pavement);
      // Beyond the radius of the sharpest bend ribbons would fold; a large square below takes over.
      ribbon(from_, to_, front, kKerbHeight, side * 20.0, kKerbHeight, grass);
    }
    const auto meadow = factory_.addPart(PartKind::kGrass, 0, {0.10F, 0.14F, 0.05F}, 0.4F, Texture::kGrass);
    double level = -0.05;  // one below the other: equal levels would flicker
    for (double s = from_; s < to_; s += 40.0, level -= 0.002) {
      MeshBuilder builder(still(), stand(s, 0, level));
      const float h = static_cast<float>(kGroundHalf);
      builder.quad({-h, -h, 0}, {h, -h, 0}, {h, h, 0}, {-h, h, 0}, meadow);
    }
  }

  void dash(double s, double length, double d, double width, double level = 0.003) {
    const auto paint =
        factory_.addPart(PartKind::kLaneMarking, 0, {0.62F, 0.62F, 0.60F}, 0.55F, Texture::kPlaster);
    ribbon(s, s + length, d - width / 2, level, d + width / 2, level, paint);
  }

  void markings() {
    for (double s = from_; s + 3 < to_; s += 7.0) dash(s, 3.0, 0.0, 0.13);
    for (const double side : {-1.0, 1.0}) {
      for (double s = from_; s + 5.2 < to_; s += 5.5) {
        dash(s, 5.2, side * 3.25, 0.1);  // edge of the parking lane
        if (random_.chance(0.6)) bayLine(s + 5.3, side);
      }
    }
    for (double s = from_ + random_.uniform(10, 50); s + 6 < to_; s += random_.uniform(50, 90)) zebra(s);
  }

  void bayLine(double s, double side) {
    const auto paint =
        factory_.addPart(PartKind::kLaneMarking, 0, {0.6F, 0.6F, 0.58F}, 0.5F, Texture::kPlaster);
    ribbon(s, s + 0.1, side * 3.3, 0.003, side * (kRoadHalf - 0.05), 0.003, paint);
  }

  void zebra(double s) {
    for (double d = -3.0; d < 3.0; d += 1.0) dash(s, 3.5, d + 0.25, 0.5, 0.005);
  }

  void fronts(double side) {
    double s = from_;
    while (s < to_) {
      const double width = random_.uniform(7.5, 15.0),
                   setback = random_.chance(0.4) ? random_.uniform(0.5, 4.0) : 0.0;
      const double d = side * (kFront + setback);
      // A house's x runs to the right as seen from the street, so that its y points away from it.
      const double start = side > 0 ? s : s + width;
      const double turn = side > 0 ? 0.0 : M_PI;
      if (random_.chance(0.84)) {
        factory_.house(still(), stand(start, d, kKerbHeight, turn), static_cast<float>(width),
                       static_cast<float>(random_.uniform(8, 12)));
        if (setback > 1.5) hedgeOrFence(start, side, turn, width);
      } else {
        hedgeOrFence(start, side, turn, width);
        const int trees = random_.integer(1, 3);
        for (int i = 0; i < trees; ++i) {
          factory_.tree(still(), stand(s + random_.uniform(1, width - 1), side * random_.uniform(11, 18)));
        }
      }
      s += width + (random_.chance(0.35) ? random_.uniform(0.6, 4.0) : 0.02);
    }
  }

  void hedgeOrFence(double start, double side, double turn, double width) {
    const double draw = random_.uniform(0, 1);
    const Eigen::Isometry3f place = stand(start, side * (kFront + 0.3), kKerbHeight, turn);
    if (draw < 0.4)
      factory_.bush(still(), place, static_cast<float>(width));
    else if (draw < 0.8)
      factory_.fence(still(), place, static_cast<float>(width));
  }

  void parkedCars(double side) {
    double s = from_ + random_.uniform(0, 6);
    while (s < to_ - 6) {
      if (random_.chance(0.55)) {
        const double turn = (side > 0 ? M_PI : 0.0) + random_.gaussian(0.02);
        const Eigen::Isometry3f place = stand(s, side * (kParking + random_.gaussian(0.08)), 0.0, turn);
        if (random_.chance(0.14))
          factory_.van(still(), place);
        else
          factory_.car(still(), place);
      }
      s += random_.uniform(5.6, 7.5);
    }
  }

  void furniture(double side) {
    const double away = side > 0 ? 0.0 : M_PI;  // turns y away from the road
    const auto spread = [&](double step_low, double step_high, const auto& place) {
      for (double s = from_ + random_.uniform(0, step_high); s < to_;
           s += random_.uniform(step_low, step_high))
        place(s);
    };
    spread(24, 34, [&](double s) { factory_.lamp(still(), stand(s, side * 5.75, kKerbHeight, away)); });
    spread(11, 24, [&](double s) {
      const double turn = random_.chance(0.75) == (side < 0) ? 0.0 : M_PI;
      factory_.sign(still(),
                    stand(s, side * random_.uniform(5.75, 6.1), kKerbHeight, turn + random_.gaussian(0.08)));
    });
    spread(9, 30, [&](double s) {
      factory_.tree(still(), stand(s, side * random_.uniform(6.0, 6.6), kKerbHeight, random_.uniform(0, 6)));
    });
    spread(8, 22, [&](double s) {
      factory_.bin(still(), stand(s, side * random_.uniform(7.6, 8.1), kKerbHeight, random_.gaussian(0.1)));
    });
    spread(6, 20, [&](double s) { factory_.bollard(still(), stand(s, side * 5.65)); });
    spread(8, 25, [&](double s) {
      factory_.person(still(),
                      stand(s, side * random_.uniform(6.2, 8.2), kKerbHeight, random_.uniform(0, 6.28)));
    });
  }

  /// @param s0,speed  along the road; speed is negative for the oncoming lane
  void addMoving(const std::function<void(Mesh&)>& make, double s0, double d, double z, double speed) {
    MovingObject object;
    make(object.mesh);
    const Road& road = road_;
    const double from = from_, to = to_;
    object.pose = [&road, from, to, s0, d, z, speed](double time) {
      const double s = s0 + speed * time;
      Isometry3d pose = turned(road.pose(std::clamp(s, from, to), d), speed < 0 ? M_PI : 0.0);
      pose.translation().z() =
          s < from || s > to ? -1000.0 : z;  // out of sight beyond the ends of the street
      return pose;
    };
    world_.moving.push_back(std::move(object));
  }

  void traffic(double ego_speed) {
    const Eigen::Isometry3f here = Eigen::Isometry3f::Identity();
    const auto vehicle = [&](Mesh& mesh) {
      random_.chance(0.2) ? factory_.van(mesh, here) : factory_.car(mesh, here);
    };
    const auto walker = [&](Mesh& mesh) { factory_.person(mesh, here); };
    double s = random_.uniform(14, 40);  // ahead in the same lane, a little faster or slower
    for (int i = 0; i < 3; ++i, s += random_.uniform(20, 60)) {
      addMoving(vehicle, s, -kLane + random_.gaussian(0.1), 0.0, ego_speed * (1.0 + 0.02 * i));
    }
    addMoving(vehicle, -random_.uniform(10, 18), -kLane, 0.0, ego_speed);
    // Oncoming cars that will be met within the drive: twice its length away at most.
    for (s = random_.uniform(5, 30); s < 2 * to_; s += random_.uniform(20, 70)) {
      addMoving(vehicle, s, kLane + random_.gaussian(0.1), 0.0,
                -random_.uniform(0.8, 1.2) * std::max(ego_speed, 4.0));
    }
    for (s = 0; s < to_; s += random_.uniform(12, 40)) {
      const double side = random_.chance(0.5) ? 1.0 : -1.0;
      addMoving(walker, s, side * random_.uniform(6.8, 7.6), kKerbHeight,
                (random_.chance(0.5) ? 1 : -1) * random_.uniform(0.8, 1.7));
    }
  }

  World& world_;
  const Road& road_;
  double from_, to_;
  Random& random_;
  ObjectFactory factory_;
};

}  // namespace

Road::Road(double from, double to, std::uint64_t seed, double winding)
    : from_(from), to_(to), winding_(winding) {
  Random random(seed, 1);
  phase_a_ = random.uniform(0, 2 * M_PI);
  phase_b_ = random.uniform(0, 2 * M_PI);
  Eigen::Vector2d point(0, 0);
  for (double s = from_; s < to_ + 2 * kSampling; s += kSampling) {
    middle_.push_back(point);
    const double h = heading(s + kSampling / 2);
    point += kSampling * Eigen::Vector2d(std::cos(h), std::sin(h));
  }
}

double Road::heading(double s) const {
  // Two superposed swings.
  return winding_ * (0.36 * std::sin(s / 34.0 + phase_a_) + 0.25 * std::sin(s / 61.0 + phase_b_));
}

Isometry3d Road::pose(double s, double d) const {
  const auto index = static_cast<std::size_t>(
      std::clamp((s - from_) / kSampling, 0.0, static_cast<double>(middle_.size() - 1)));
  const double start = from_ + kSampling * static_cast<double>(index);
  const double half_way = heading(0.5 * (start + s)), h = heading(s);
  const Eigen::Vector2d point = middle_[index] +
                                (s - start) * Eigen::Vector2d(std::cos(half_way), std::sin(half_way)) +
                                d * Eigen::Vector2d(-std::sin(h), std::cos(h));
  Isometry3d pose = Isometry3d::Identity();
  pose.translation() << point, 0.0;
  pose.linear() = Eigen::AngleAxisd(h, Vector3d::UnitZ()).toRotationMatrix();
  return pose;
}

Street::Street(std::uint64_t seed, double length, double speed, double winding)
    : road_(-kBehind, std::clamp(length, 0.0, kMaxLength) + kAhead, seed, winding), speed_(speed) {
  if (!(length >= 0.0 && length <= kMaxLength)) {
    throw Error(ErrorCause::kParameter, "The drive would be " + std::to_string(length) +
                                            " m long; the street can be 0 to " +
                                            std::to_string(static_cast<int>(kMaxLength)) +
                                            " m. Use fewer frames, a lower speed or a higher rate.");
  }
  Random random(seed, 2);
  bounce_phase_ = random.uniform(0, 2 * M_PI);
  const double azimuth = random.uniform(0, 2 * M_PI), elevation = random.uniform(0.6, 1.0);
  world_.to_sun = Vector3d(std::cos(azimuth) * std::cos(elevation), std::sin(azimuth) * std::cos(elevation),
                           std::sin(elevation))
                      .cast<float>();
  world_.parts.emplace_back();  // the sky
  StreetBuilder(world_, road_, road_.from(), road_.to(), random).build(speed);
}

Isometry3d Street::egoPose(double time) const {
  Isometry3d pose = road_.pose(speed_ * time, -kLane);
  // The body bounces a little on its springs.
  const double sway = bounce_phase_ + 2 * M_PI * time;
  pose.translation().z() += 0.01 * std::sin(1.3 * sway);
  pose.rotate(Eigen::AngleAxisd(0.003 * std::sin(1.1 * sway), Vector3d::UnitY()));
  pose.rotate(Eigen::AngleAxisd(0.002 * std::sin(0.7 * sway), Vector3d::UnitX()));
  return pose;
}

}  // namespace lidar_camera_recalibration::simulation

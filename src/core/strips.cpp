#include "strips.hpp"

#include <algorithm>
#include <vector>

namespace lidar_camera_recalibration {
namespace {

/// Parts of an image, from left to right, that hold as many edges each; points where there are no edges.
class Strips {
 public:
  Strips(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar, std::size_t count)
      : camera_(frame.camera.intrinsics()), T_(T_camera_lidar) {
    std::vector<double> u = frame.edges.size() > 0 ? columns(frame.edges) : columns(frame.points);
    std::sort(u.begin(), u.end());
    for (std::size_t i = 1; i < count && !u.empty(); ++i) borders_.push_back(u[i * u.size() / count]);
  }

  /// Of what lies in a strip.
  /// @param places  x, y and z of points or edges
  template <typename Places>
  std::vector<std::size_t> indices(const Places& places, std::size_t strip) const {
    const std::vector<double> u = columns(places);
    std::vector<std::size_t> chosen;
    for (std::size_t i = 0; i < u.size(); ++i) {
      const auto border = std::upper_bound(borders_.begin(), borders_.end(), u[i]);
      if (static_cast<std::size_t>(border - borders_.begin()) == strip) chosen.push_back(i);
    }
    return chosen;
  }

 private:
  template <typename Places>
  std::vector<double> columns(const Places& places) const {
    constexpr double kNear = 1e-3;  // what lies behind the camera counts as beside the image [m]
    constexpr double kTie = 1e-9;   // the order decides between equal columns, so that strips are never empty
    std::vector<double> u(places.size());
    for (std::size_t i = 0; i < u.size(); ++i) {
      const Eigen::Vector3d p = T_ * Eigen::Vector3d(places.x[i], places.y[i], places.z[i]);
      u[i] =
          std::clamp(camera_.fx * p.x() / std::max(p.z(), kNear) + camera_.cx, 0.0, double(camera_.width)) +
          kTie * static_cast<double>(i);
    }
    return u;
  }

  const Intrinsics& camera_;
  const Eigen::Isometry3d& T_;
  std::vector<double> borders_;  ///< between the strips [px]
};

/// Some of the values; none stay none.
template <typename Value>
void keep(const std::vector<std::size_t>& indices, std::vector<Value>& values) {
  if (values.empty()) return;
  std::vector<Value> kept;
  kept.reserve(indices.size());
  for (const std::size_t i : indices) kept.push_back(values[i]);
  values = std::move(kept);
}

FramePtr cut(const Frame& frame, const Strips& strips, std::size_t strip) {
  const auto part = std::make_shared<Frame>(frame);
  FramePoints& points = part->points;
  const std::vector<std::size_t> own_points = strips.indices(points, strip);
  for (auto* values :
       {&points.x, &points.y, &points.z, &points.nx, &points.ny, &points.nz, &points.reflectivity}) {
    keep(own_points, *values);
  }
  keep(own_points, points.segment);
  keep(own_points, part->visible);
  EdgePoints& edges = part->edges;
  const std::vector<std::size_t> own_edges = strips.indices(edges, strip);
  for (auto* values : {&edges.x, &edges.y, &edges.z, &edges.weight}) keep(own_edges, *values);
  keep(own_edges, edges.kind);
  return part;
}

}  // namespace

Frames framesOrStrips(const Frames& frames, const Eigen::Isometry3d& T_camera_lidar, std::size_t at_least) {
  if (frames.empty() || frames.size() >= at_least) return frames;
  const std::size_t count = (at_least + frames.size() - 1) / frames.size();
  Frames parts;
  for (const FramePtr& frame : frames) {
    const Strips strips(*frame, T_camera_lidar, count);
    for (std::size_t strip = 0; strip < count; ++strip) parts.push_back(cut(*frame, strips, strip));
  }
  return parts;
}

}  // namespace lidar_camera_recalibration

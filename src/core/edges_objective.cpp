#include "edges_objective.hpp"

#include <algorithm>
#include <cmath>

namespace lidar_camera_recalibration {
namespace {

constexpr float kMinDepth = 0.1f;  // [m]

/// Pixels of the ideal image; centres at integer coordinates.
class Pinhole {
 public:
  Pinhole(const Intrinsics& camera, const Eigen::Isometry3d& T_camera_lidar)
      : fx_(static_cast<float>(camera.fx)),
        fy_(static_cast<float>(camera.fy)),
        cx_(static_cast<float>(camera.cx)),
        cy_(static_cast<float>(camera.cy)),
        width_(static_cast<float>(camera.width)),
        height_(static_cast<float>(camera.height)),
        R_(T_camera_lidar.linear().cast<float>()),
        t_(T_camera_lidar.translation().cast<float>()) {}

  struct Pixel {
    Eigen::Vector3f point;  // optical frame [m]
    float u = -1.0f, v = -1.0f;
    bool inside = false;
  };

  Pixel operator()(const EdgePoints& edges, std::size_t i) const {
    Pixel pixel;
    pixel.point = R_ * Eigen::Vector3f(edges.x[i], edges.y[i], edges.z[i]) + t_;
    if (!(pixel.point.z() > kMinDepth)) return pixel;
    pixel.u = fx_ * pixel.point.x() / pixel.point.z() + cx_;
    pixel.v = fy_ * pixel.point.y() / pixel.point.z() + cy_;
    pixel.inside =
        pixel.u >= 0.0f && pixel.u <= width_ - 1.0f && pixel.v >= 0.0f && pixel.v <= height_ - 1.0f;
    return pixel;
  }

  /// Derivative of a quantity with the derivatives du, dv by the pixel, by the perturbation xi.
  Vector6d gradient(const Eigen::Vector3f& point, float du, float dv) const {
    const Eigen::Vector3d p = point.cast<double>();
    const double gu = du * fx_ / p.z(), gv = dv * fy_ / p.z();
    const Eigen::Vector3d by_point(gu, gv, -(gu * p.x() + gv * p.y()) / p.z());
    Vector6d result;
    result << p.cross(by_point), by_point;  // d(exp(xi) p) = omega x p + v
    return result;
  }

 private:
  float fx_, fy_, cx_, cy_, width_, height_;
  Eigen::Matrix3f R_;
  Eigen::Vector3f t_;
};

BoundaryField::Direction directionOf(EdgePoints::Kind kind) {
  return kind == EdgePoints::Kind::kRingGap ? BoundaryField::kLevel : BoundaryField::kUpright;
}

}  // namespace

EdgeEvaluator::EdgeEvaluator(std::vector<View> views) : views_(std::move(views)) {
  for (const View& view : views_) {
    edge_count_ += view.chosen.size();
    for (const std::size_t i : view.chosen) weight_ += view.frame->edges.weight[i];
  }
}

Score EdgeEvaluator::operator()(const Eigen::Isometry3d& T_camera_lidar) {
  Score score;
  score.total = this->score(T_camera_lidar, kScoreLevel);
  for (const View& view : views_) {
    const Pinhole project(view.frame->camera.intrinsics(), T_camera_lidar);
    const auto inside = std::count_if(view.chosen.begin(), view.chosen.end(),
                                      [&](std::size_t i) { return project(view.frame->edges, i).inside; });
    score.points += static_cast<std::size_t>(inside);
    if (inside > 0) score.masks += view.frame->masks.maskCount();
  }
  return score;
}

double EdgeEvaluator::score(const Eigen::Isometry3d& T_camera_lidar, std::size_t level) const {
  double sum = 0.0;
  for (const View& view : views_) {
    const EdgePoints& edges = view.frame->edges;
    const Pinhole project(view.frame->camera.intrinsics(), T_camera_lidar);
    for (const std::size_t i : view.chosen) {
      const Pinhole::Pixel pixel = project(edges, i);
      if (!pixel.inside) continue;
      sum += edges.weight[i] * view.field->closeness(directionOf(edges.kind[i]), level, pixel.u, pixel.v);
    }
  }
  return weight_ > 0.0 ? sum / weight_ : 0.0;
}

Linearisation EdgeEvaluator::linearise(const Eigen::Isometry3d& T_camera_lidar, std::size_t level) const {
  Linearisation result;
  for (const View& view : views_) {
    const EdgePoints& edges = view.frame->edges;
    const Intrinsics& camera = view.frame->camera.intrinsics();
    const Pinhole project(camera, T_camera_lidar);
    const double sigma = camera.fx * kBoundaryWidths[level] * kDegree;  // [px]
    for (const std::size_t i : view.chosen) {
      const Pinhole::Pixel pixel = project(edges, i);
      BoundaryField::Distance d;
      if (pixel.inside) d = view.field->distance(directionOf(edges.kind[i]), pixel.u, pixel.v);
      if (!d.inside) {
        result.cost += edges.weight[i];  // as far from any border
        continue;
      }
      const double residual = d.value / sigma, closeness = std::exp(-0.5 * residual * residual);
      result.cost += edges.weight[i] * (1.0 - closeness);
      if (closeness < 1e-3) continue;
      const Vector6d J = project.gradient(pixel.point, d.du, d.dv) / sigma;
      const double weight = 0.5 * edges.weight[i] * closeness;
      result.H.noalias() += weight * J * J.transpose();
      result.b += weight * residual * J;
    }
  }
  return result;
}

std::unique_ptr<Evaluator> EdgesObjective::evaluator(const Frames& frames, const Views& in_view) const {
  std::vector<EdgeEvaluator::View> views;
  for (const FramePtr& frame : frames) {
    EdgeEvaluator::View view{field(frame), frame, {}};
    std::vector<Pinhole> bounds;
    for (const Eigen::Isometry3d& T : in_view) bounds.emplace_back(frame->camera.intrinsics(), T);
    for (std::size_t i = 0; i < frame->edges.size(); ++i) {
      const auto sees = [&](const Pinhole& project) { return project(frame->edges, i).inside; };
      if (std::all_of(bounds.begin(), bounds.end(), sees)) view.chosen.push_back(i);
    }
    views.push_back(std::move(view));
  }
  return std::make_unique<EdgeEvaluator>(std::move(views));
}

std::shared_ptr<const BoundaryField> EdgesObjective::field(const FramePtr& frame) const {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto known = fields_.find(frame);
    if (known != fields_.end()) return known->second;
  }
  auto made = std::make_shared<const BoundaryField>(*frame);
  const std::lock_guard<std::mutex> lock(mutex_);
  // A server scores frame after frame with one objective: forget the fields of frames that are gone.
  for (auto known = fields_.begin(); known != fields_.end();) {
    known = known->first.expired() ? fields_.erase(known) : std::next(known);
  }
  return fields_.emplace(frame, std::move(made)).first->second;
}

}  // namespace lidar_camera_recalibration

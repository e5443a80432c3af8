#include "consistency_edges_objective.hpp"

#include <algorithm>
#include <cmath>

#include "lidar_camera_recalibration/error.hpp"
#include "projection.hpp"
#include "region_information.hpp"

namespace lidar_camera_recalibration {
namespace {

using View = ConsistencyEdgesEvaluator::View;

/// Beside the end of a border: nearer to its line than to itself by this much [px].
constexpr float kBesideEnd = 2.0f;

BoundaryField::Direction directionOf(EdgePoints::Kind kind) {
  return kind == EdgePoints::Kind::kRingGap ? BoundaryField::kLevel : BoundaryField::kUpright;
}

/// Derivative of nu * u + nv * v, (u, v) the pixel of a point, by the perturbation xi.
Vector6d gradient(const Intrinsics& camera, const Eigen::Vector3f& in_camera, float nu, float nv) {
  const Eigen::Vector3d p = in_camera.cast<double>();
  const double gu = nu * camera.fx / p.z(), gv = nv * camera.fy / p.z();
  const Eigen::Vector3d by_point(gu, gv, -(gu * p.x() + gv * p.y()) / p.z());
  Vector6d result;
  result << p.cross(by_point), by_point;  // d(exp(xi) p) = omega x p + v
  return result;
}

}  // namespace

void ConsistencyEdgesEvaluator::View::addEdge(const Eigen::Vector3f& point, float edge_weight,
                                              BoundaryField::Direction edge_direction) {
  x.push_back(point.x());
  y.push_back(point.y());
  z.push_back(point.z());
  weight.push_back(edge_weight);
  direction.push_back(edge_direction);
}

ConsistencyEdgesEvaluator::ConsistencyEdgesEvaluator(std::vector<View> views, double region_weight)
    : views_(std::move(views)), region_weight_(region_weight) {
  for (const View& view : views_) {
    edge_count_ += view.size();
    for (const float weight : view.weight) weight_ += static_cast<double>(weight);
  }
}

Score ConsistencyEdgesEvaluator::operator()(const Eigen::Isometry3d& T_camera_lidar) {
  Score score;
  score.edges = edgeScore(T_camera_lidar, kScoreLevel);
  for (const View& view : views_) {
    std::size_t used = 0;
    score.region += regionInformation(*view.frame, view.points, T_camera_lidar, used) /
                    static_cast<double>(views_.size());
    score.points += used;
    if (used > 0) score.masks += view.frame->masks.maskCount();
  }
  score.total = score.edges + region_weight_ * score.region;
  return score;
}

double ConsistencyEdgesEvaluator::edgeScore(const Eigen::Isometry3d& T_camera_lidar,
                                            std::size_t level) const {
  double sum = 0.0;
  for (const View& view : views_) {
    const BoundaryField& field = *view.frame->borders;
    const Projection project(view.frame->camera.intrinsics(), T_camera_lidar);
    float frame_sum = 0.0f;
    for (std::size_t i = 0; i < view.size(); ++i) {
      const Projection::Pixel pixel = project(view.x[i], view.y[i], view.z[i]);
      if (!pixel.ahead) continue;
      frame_sum += view.weight[i] * field.closeness(view.direction[i], level, pixel.u, pixel.v);
    }
    sum += static_cast<double>(frame_sum);
  }
  return weight_ > 0.0 ? sum / weight_ : 0.0;
}

Linearisation ConsistencyEdgesEvaluator::linearise(const Eigen::Isometry3d& T_camera_lidar,
                                                   std::size_t level) const {
  Linearisation result;
  for (const View& view : views_) {
    const Intrinsics& camera = view.frame->camera.intrinsics();
    const Projection project(camera, T_camera_lidar);
    const double sigma = camera.fx * kBoundaryWidths[level] * kDegree;  // [px]
    for (std::size_t i = 0; i < view.size(); ++i) {
      const double edge_weight = static_cast<double>(view.weight[i]);
      const Eigen::Vector3f point = project.toCamera(view.x[i], view.y[i], view.z[i]);
      const Projection::Pixel pixel = project(point);
      const Border* border =
          pixel.ahead ? view.frame->borders->nearest(view.direction[i], pixel.u, pixel.v) : nullptr;
      result.cost += edge_weight;  // as far from any border, unless there is one
      if (border == nullptr) continue;
      const float du = pixel.u - border->u, dv = pixel.v - border->v;
      const float across = du * border->nu + dv * border->nv;
      if (std::hypot(du, dv) > std::abs(across) + kBesideEnd) continue;
      const double residual = static_cast<double>(across) / sigma;
      const double closeness = std::exp(-0.5 * residual * residual);
      result.cost -= edge_weight * closeness;
      if (closeness < 1e-3) continue;
      const Vector6d J = gradient(camera, point, border->nu, border->nv) / sigma;
      const double weight = 0.5 * edge_weight * closeness;
      result.H.noalias() += weight * J * J.transpose();
      result.b += weight * residual * J;
    }
  }
  return result;
}

ConsistencyEdgesEvaluator ConsistencyEdgesEvaluator::thinned(std::size_t count) const {
  const std::size_t step = std::max<std::size_t>(1, edge_count_ / std::max<std::size_t>(1, count));
  std::vector<View> views;
  std::size_t number = 0;
  for (const View& view : views_) {
    View thin;
    thin.frame = view.frame;
    for (std::size_t i = 0; i < view.size(); ++i) {
      if (number++ % step != 0) continue;
      thin.addEdge({view.x[i], view.y[i], view.z[i]}, view.weight[i], view.direction[i]);
    }
    views.push_back(std::move(thin));
  }
  return ConsistencyEdgesEvaluator(std::move(views), 0.0);
}

ConsistencyEdgesObjective::ConsistencyEdgesObjective(const ObjectiveConfig& config)
    : edge_weights_{static_cast<float>(config.weight_azimuth_gap), static_cast<float>(config.weight_ring_gap),
                    static_cast<float>(config.weight_reflectivity_step)},
      region_weight_(config.weight_region) {
  const std::array<double, 4> weights = {config.weight_azimuth_gap, config.weight_ring_gap,
                                         config.weight_reflectivity_step, config.weight_region};
  const bool valid =
      std::all_of(weights.begin(), weights.end(), [](double w) { return std::isfinite(w) && w >= 0.0; });
  if (!valid || weights[0] + weights[1] + weights[2] <= 0.0) {
    throw Error(ErrorCause::kParameter,
                "consistency_edges weights: they must not be negative, and one of weight_azimuth_gap, "
                "weight_ring_gap and weight_reflectivity_step must be above 0");
  }
}

std::unique_ptr<Evaluator> ConsistencyEdgesObjective::evaluator(const Frames& frames,
                                                                const Views& in_view) const {
  std::vector<View> views;
  for (const FramePtr& frame : frames) {
    if (!frame->borders) {
      throw Error(ErrorCause::kParameter,
                  "objective 'consistency_edges': a frame was made without edges; set FrameConfig::edges");
    }
    std::vector<Projection> bounds;
    for (const Eigen::Isometry3d& T : in_view) bounds.emplace_back(frame->camera.intrinsics(), T);
    const float margin = kViewMargin * static_cast<float>(frame->camera.intrinsics().height);
    const auto seen = [&](float x, float y, float z, float distance) {
      return std::all_of(bounds.begin(), bounds.end(),
                         [&](const Projection& view) { return view.wellInside(x, y, z, distance); });
    };
    View view;
    view.frame = frame;
    const EdgePoints& edges = frame->edges;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      const float weight = edges.weight[i] * edge_weights_[static_cast<std::size_t>(edges.kind[i])];
      if (!(weight > 0.0f) || !seen(edges.x[i], edges.y[i], edges.z[i], 0.0f)) continue;
      view.addEdge({edges.x[i], edges.y[i], edges.z[i]}, weight, directionOf(edges.kind[i]));
    }
    const FramePoints& points = frame->points;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (seen(points.x[i], points.y[i], points.z[i], margin)) {
        view.points.push_back(static_cast<std::uint32_t>(i));
      }
    }
    views.push_back(std::move(view));
  }
  return std::make_unique<ConsistencyEdgesEvaluator>(std::move(views), region_weight_);
}

}  // namespace lidar_camera_recalibration

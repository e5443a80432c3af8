#pragma once

#include <cmath>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "../src/core/consistency_edges_objective.hpp"
#include "../src/core/paper_objective.hpp"
#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// The formulas of the objectives as they are written down: double precision, point after point, a list of
/// points for each mask, all pairs of normals.

/// In the ideal image; nothing for what is not ahead of the camera.
inline std::optional<Eigen::Vector2d> plainPixel(const Intrinsics& camera, const Eigen::Vector3d& in_camera) {
  if (in_camera.z() <= 0.1) return std::nullopt;
  return Eigen::Vector2d(camera.fx * in_camera.x() / in_camera.z() + camera.cx,
                         camera.fy * in_camera.y() / in_camera.z() + camera.cy);
}

/// The set of masks in which a point lies; nothing outside of the image.
inline std::optional<std::size_t> plainSet(const Frame& frame, const Eigen::Isometry3d& T,
                                           std::size_t point) {
  const FramePoints& p = frame.points;
  const auto pixel =
      plainPixel(frame.camera.intrinsics(), T * Eigen::Vector3d(p.x[point], p.y[point], p.z[point]));
  if (!pixel) return std::nullopt;
  const double u = std::floor(pixel->x() + 0.5), v = std::floor(pixel->y() + 0.5);
  if (u < 0 || v < 0 || u >= frame.masks.width() || v >= frame.masks.height()) return std::nullopt;
  return frame.masks.setOfPixel().at<std::uint16_t>(static_cast<int>(v), static_cast<int>(u));
}

/// F_N as the paper prints it: the double loop over all pairs.
inline double plainNormalConsistency(const std::vector<Eigen::Vector3f>& normals) {
  double sum = 0.0;
  for (const auto& a : normals) {
    for (const auto& b : normals) sum += std::abs(a.cast<double>().dot(b.cast<double>()));
  }
  return sum / static_cast<double>(normals.size() * normals.size());
}

inline Score plainPaperScore(const Frames& frames, const Eigen::Isometry3d& T,
                             const Eigen::Vector3d& weights) {
  Score score;
  double total = 0.0;
  for (const FramePtr& frame : frames) {
    const FramePoints& p = frame->points;
    const MaskSets& masks = frame->masks;
    std::map<std::uint32_t, std::vector<std::size_t>> points_of_mask;
    for (std::size_t i = 0; i < p.size(); ++i) {
      const std::size_t set = plainSet(*frame, T, i).value_or(0);
      for (std::uint32_t m = masks.setBegin()[set]; m < masks.setBegin()[set + 1]; ++m) {
        points_of_mask[masks.setMasks()[m]].push_back(i);
      }
      score.points += set != 0;
    }
    Eigen::Vector3d w = weights;
    if (!p.hasReflectivity()) w.x() = 0.0;
    w /= w.sum();
    for (const auto& [mask, indices] : points_of_mask) {
      const double n = static_cast<double>(indices.size());
      double mean = 0.0, variance = 0.0;
      std::vector<Eigen::Vector3f> normals;
      std::map<int, std::uint32_t> classes;
      for (const std::size_t i : indices) {
        const Eigen::Vector3f normal(p.nx[i], p.ny[i], p.nz[i]);
        if (normal.norm() > 0.5f) normals.push_back(normal);
        if (p.segment[i] >= 0) ++classes[p.segment[i]];
        if (p.hasReflectivity()) mean += p.reflectivity[i] / n;
      }
      for (const std::size_t i : indices) {
        if (p.hasReflectivity()) variance += std::pow(p.reflectivity[i] - mean, 2) / n;
      }
      std::vector<std::uint32_t> counts;
      for (const auto& [id, count] : classes) counts.push_back(count);
      const double F_R = p.hasReflectivity() ? 1.0 - std::sqrt(variance) : 0.0;
      const double F_N = normals.empty() ? 0.0 : plainNormalConsistency(normals);
      const double F_S = segmentConsistency(counts);
      score.total += n * w.dot(Eigen::Vector3d(F_R, F_N, F_S)) * std::max(0.0, 1.0 - 1.5 * std::pow(n, -0.4));
      score.reflectivity += n * F_R;
      score.normal += n * F_N;
      score.segment += n * F_S;
      total += n;
      ++score.masks;
    }
  }
  for (double* mean : {&score.total, &score.reflectivity, &score.normal, &score.segment}) *mean /= total;
  return score;
}

// --- consistency_edges ---

/// What the score and the steps need of one edge.
struct PlainEdge {
  double weight;
  BoundaryField::Direction direction;
  Eigen::Vector3d in_camera;
  std::optional<Eigen::Vector2d> pixel;

  PixelBlock block() const {
    PixelBlock result;
    result.u[0] = pixel ? static_cast<float>(pixel->x()) : std::nanf("");
    result.v[0] = pixel ? static_cast<float>(pixel->y()) : std::nanf("");
    return result;
  }
};

inline std::vector<PlainEdge> plainEdges(const Frame& frame, const Eigen::Isometry3d& T) {
  const ObjectiveConfig config;
  const EdgePoints& e = frame.edges;
  std::vector<PlainEdge> edges;
  for (std::size_t i = 0; i < e.size(); ++i) {
    const bool ring_gap = e.kind[i] == EdgePoints::Kind::kRingGap;
    PlainEdge edge;
    edge.weight =
        e.weight[i] * (ring_gap                                     ? config.weight_ring_gap
                       : e.kind[i] == EdgePoints::Kind::kAzimuthGap ? config.weight_azimuth_gap
                                                                    : config.weight_reflectivity_step);
    edge.direction = ring_gap ? BoundaryField::kLevel : BoundaryField::kUpright;
    edge.in_camera = T * Eigen::Vector3d(e.x[i], e.y[i], e.z[i]);
    edge.pixel = plainPixel(frame.camera.intrinsics(), edge.in_camera);
    edges.push_back(edge);
  }
  return edges;
}

/// Score::edges
inline double plainEdgeScore(const Frames& frames, const Eigen::Isometry3d& T, std::size_t level) {
  double sum = 0.0, weights = 0.0;
  for (const FramePtr& frame : frames) {
    for (const PlainEdge& edge : plainEdges(*frame, T)) {
      Block<float> closeness;
      frame->borders->closeness(edge.direction, level, edge.block(), 1, closeness);
      sum += edge.weight * static_cast<double>(closeness[0]);
      weights += edge.weight;
    }
  }
  return sum / weights;
}

inline Linearisation plainLinearisation(const Frames& frames, const Eigen::Isometry3d& T, std::size_t level) {
  Linearisation result;
  for (const FramePtr& frame : frames) {
    const Intrinsics& camera = frame->camera.intrinsics();
    const double sigma = camera.fx * kBoundaryWidths[level] * kDegree;
    for (const PlainEdge& edge : plainEdges(*frame, T)) {
      result.cost += edge.weight;
      Block<std::int32_t> nearest;
      frame->borders->nearest(edge.direction, edge.block(), 1, nearest);
      if (nearest[0] < 0) continue;
      const BoundaryField::Line& line =
          frame->borders->lines(edge.direction)[static_cast<std::size_t>(nearest[0])];
      const Eigen::Vector2d normal(line.nu, line.nv), offset = *edge.pixel - Eigen::Vector2d(line.u, line.v);
      const double across = offset.dot(normal), residual = across / sigma;
      if (offset.norm() > std::abs(across) + 2.0) continue;
      const double closeness = std::exp(-0.5 * residual * residual);
      if (closeness < 1e-3) continue;
      result.cost -= edge.weight * closeness;
      const Eigen::Vector3d& p = edge.in_camera;
      Eigen::Matrix<double, 2, 3> by_point;
      by_point << camera.fx / p.z(), 0.0, -camera.fx * p.x() / (p.z() * p.z()), 0.0, camera.fy / p.z(),
          -camera.fy * p.y() / (p.z() * p.z());
      Eigen::Matrix<double, 3, 6> by_twist;
      by_twist << 0.0, p.z(), -p.y(), 1.0, 0.0, 0.0, -p.z(), 0.0, p.x(), 0.0, 1.0, 0.0, p.y(), -p.x(), 0.0,
          0.0, 0.0, 1.0;
      const Vector6d J = (normal.transpose() * by_point * by_twist).transpose() / sigma;
      const double weight = 0.5 * edge.weight * closeness;
      result.H += weight * J * J.transpose();
      result.b += weight * residual * J;
    }
  }
  return result;
}

/// Score::region, with entropies as they are defined.
inline double plainRegionScore(const Frames& frames, const Eigen::Isometry3d& T) {
  double sum = 0.0;
  for (const FramePtr& frame : frames) {
    std::map<std::pair<std::size_t, int>, double> joint;
    double count = 0.0;
    for (std::size_t i = 0; i < frame->points.size(); ++i) {
      const auto set = plainSet(*frame, T, i);
      if (!set) continue;
      ++joint[{*set, frame->points.segment[i]}];
      ++count;
    }
    std::map<std::size_t, double> sets;
    std::map<int, double> classes;
    for (const auto& [cell, points] : joint) {
      sets[cell.first] += points;
      classes[cell.second] += points;
    }
    const auto entropy = [&](const auto& counts) {
      double result = 0.0;
      for (const auto& [key, points] : counts) result -= points / count * std::log(points / count);
      return result;
    };
    sum += (entropy(sets) + entropy(classes) - entropy(joint)) / entropy(joint);
  }
  return sum / static_cast<double>(frames.size());
}

}  // namespace lidar_camera_recalibration

#include "lidar_camera_recalibration/lidar_features.hpp"

#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <random>
#include <string>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

using PclCloud = pcl::PointCloud<pcl::PointXYZ>;
using Plane = Eigen::Hyperplane<float, 3>;
using Indices = std::vector<int>;

// Neighbours whose second principal variance is below this share of the first one lie on a line: they fit any
// plane through it.
constexpr double kLineRatio = 1e-6;

// Below this share the neighbours are likely from one ring of the LiDAR, and noise turns the plane around
// that line: then more neighbours are taken, up to kMaxWidening times as many.
constexpr double kRingRatio = 0.02;
constexpr int kMaxWidening = 4;

// RANSAC stops when it has missed no better plane with this probability, or after so many hypotheses. Each is
// one point with its normal; only this share of the points on a plane have normals good enough to find it.
constexpr double kRansacProbability = 0.99;
constexpr double kRansacGoodShare = 0.1;
constexpr int kRansacMaxHypotheses = 500;
// RANSAC looks for a plane in a random sample of so many points: this bounds its time.
constexpr std::size_t kRansacSample = 2000;
// A normal that is off by more than 20 deg never supports a plane. From 30 deg on, planes across cars and
// hedges were found in street scenes.
constexpr float kMinNormalCosine = 0.94f;
// A plane is fitted to its own support until that grows no more, but at most so often.
constexpr int kMaxFits = 10;

PclCloud::Ptr toPcl(const std::vector<Eigen::Vector3f>& points) {
  PclCloud::Ptr cloud(new PclCloud);
  cloud->reserve(points.size());
  for (const auto& p : points) cloud->push_back(pcl::PointXYZ(p.x(), p.y(), p.z()));
  return cloud;
}

struct PlaneFit {
  Eigen::Vector3d mean;
  Eigen::Vector3d normal;  // zero where no plane fits
  double elongation;       // second principal variance over the first one; 0 = a line, 1 = as wide as long
};

// The normal is the direction of least variance. The neighbours are centred before they are multiplied, so
// that the distance from the origin costs no digits.
PlaneFit fitPlane(const std::vector<Eigen::Vector3f>& points, const Indices& neighbours) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int i : neighbours) mean += points[i].cast<double>();
  mean /= static_cast<double>(neighbours.size());

  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (const int i : neighbours) {
    const Eigen::Vector3d d = points[i].cast<double>() - mean;
    covariance.noalias() += d * d.transpose();
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(covariance);
  const Eigen::Vector3d variances = solver.eigenvalues();  // ascending
  if (!(variances[1] > kLineRatio * variances[2])) return {mean, Eigen::Vector3d::Zero(), 0.0};
  return {mean, solver.eigenvectors().col(0), variances[1] / variances[2]};
}

// The largest plane among some points by RANSAC. Only points whose normals agree support it: without normals,
// a slab cut level through cars, trees and walls beats every real surface, for a ring of the LiDAR lies in
// it.
class PlaneSearch {
 public:
  PlaneSearch(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals,
              const LidarFeatureConfig& config, const Indices& candidates)
      : points_(points), config_(config), random_(static_cast<std::mt19937::result_type>(candidates.size())) {
    std::sample(candidates.begin(), candidates.end(), std::back_inserter(sample_), kRansacSample, random_);
    positions_.resize(static_cast<Eigen::Index>(sample_.size()), 3);
    normals_.resize(positions_.rows(), 3);
    for (std::size_t i = 0; i < sample_.size(); ++i) {
      positions_.row(static_cast<Eigen::Index>(i)) = points[sample_[i]];
      normals_.row(static_cast<Eigen::Index>(i)) = normals[sample_[i]];
    }
    // The sample holds the same share of the plane as the candidates.
    min_support_ = std::max(config.plane_min_points, 3) * static_cast<double>(sample_.size()) /
                   static_cast<double>(candidates.size());
  }

  std::optional<Plane> find() {
    if (min_support_ > static_cast<double>(sample_.size())) return {};
    std::uniform_int_distribution<Eigen::Index> any(0, positions_.rows() - 1);
    Hypothesis best{Plane(Eigen::Vector3f::UnitZ(), 0.0f), 0};
    Eigen::Index best_unfitted = 0;
    for (int tried = 0; tried < hypothesesNeeded(best.support); ++tried) {
      const Eigen::Index i = any(random_);
      const Plane plane(normals_.row(i).transpose(), positions_.row(i).transpose());
      const Eigen::Index support = supporters(plane).count();
      if (support <= best_unfitted) continue;
      best_unfitted = support;
      const Hypothesis fitted = fitToSupport({plane, support});
      if (fitted.support > best.support) best = fitted;
    }
    if (static_cast<double>(best.support) < min_support_) return {};
    return best.plane;
  }

 private:
  struct Hypothesis {
    Plane plane;
    Eigen::Index support;
  };
  using Columns = Eigen::Matrix<float, Eigen::Dynamic, 3>;
  using Flags = Eigen::Array<bool, Eigen::Dynamic, 1>;

  Flags supporters(const Plane& plane) const {
    const auto max_distance = static_cast<float>(config_.plane_distance);
    return ((positions_ * plane.normal()).array() + plane.offset()).abs() <= max_distance &&
           (normals_ * plane.normal()).array().abs() >= kMinNormalCosine;
  }

  // The normal of one point is too coarse for a plane of tens of metres.
  Hypothesis fitToSupport(Hypothesis hypothesis) const {
    for (int i = 0; i < kMaxFits; ++i) {
      const Flags flags = supporters(hypothesis.plane);
      Indices members;
      for (std::size_t k = 0; k < sample_.size(); ++k) {
        if (flags[static_cast<Eigen::Index>(k)]) members.push_back(sample_[k]);
      }
      const PlaneFit fit = fitPlane(points_, members);
      const Plane plane(fit.normal.cast<float>(), fit.mean.cast<float>());
      const Eigen::Index support = supporters(plane).count();
      if (support <= hypothesis.support) break;
      hypothesis = {plane, support};
    }
    return hypothesis;
  }

  int hypothesesNeeded(Eigen::Index support) const {
    const double share =
        std::max(static_cast<double>(support), min_support_) / static_cast<double>(sample_.size());
    const double needed = std::log(1.0 - kRansacProbability) / std::log1p(-kRansacGoodShare * share);
    return static_cast<int>(std::min<double>(needed, kRansacMaxHypotheses));
  }

  const std::vector<Eigen::Vector3f>& points_;
  const LidarFeatureConfig& config_;
  std::mt19937 random_;
  Indices sample_;
  Columns positions_, normals_;  // of the sample
  double min_support_;
};

// Takes planes out of `remaining`, each with all points near it, whatever their normals: where the plane is
// sampled thinly or ends, normals are poor.
std::vector<Indices> takePlanes(const std::vector<Eigen::Vector3f>& points,
                                const std::vector<Eigen::Vector3f>& normals, const LidarFeatureConfig& config,
                                Indices& remaining) {
  std::vector<Indices> planes;
  while (!remaining.empty() && static_cast<int>(planes.size()) < config.plane_max_count) {
    const std::optional<Plane> plane = PlaneSearch(points, normals, config, remaining).find();
    if (!plane) break;
    const auto off_plane = [&](int i) { return plane->absDistance(points[i]) > config.plane_distance; };
    const auto split = std::stable_partition(remaining.begin(), remaining.end(), off_plane);
    planes.emplace_back(split, remaining.end());
    remaining.erase(split, remaining.end());
  }
  return planes;
}

// Connected components of the graph that joins p and q if |p - q| <= max(tolerance, slope * min(range_p,
// range_q)). The smaller range makes the relation symmetric, so the components do not depend on the order of
// the points.
std::vector<Indices> clusters(const PclCloud& all, const LidarFeatureConfig& config, const Indices& members) {
  if (members.empty()) return {};
  const PclCloud::Ptr cloud(new PclCloud(all, members));
  pcl::KdTreeFLANN<pcl::PointXYZ> tree(false);
  tree.setInputCloud(cloud);
  const auto tolerance = [&](int i) {
    const float range = cloud->points[i].getVector3fMap().norm();
    return std::max(config.cluster_tolerance, config.cluster_tolerance_slope * range);
  };

  std::vector<Indices> found;
  std::vector<bool> reached(members.size(), false);
  Indices neighbours;
  std::vector<float> squared_distances;
  for (int seed = 0; seed < static_cast<int>(members.size()); ++seed) {
    if (reached[seed]) continue;
    reached[seed] = true;
    Indices component{seed};
    for (std::size_t next = 0; next < component.size(); ++next) {
      const int p = component[next];
      const double radius = tolerance(p);
      tree.radiusSearch(p, 1.001 * radius, neighbours, squared_distances);  // the limit below decides
      for (std::size_t k = 0; k < neighbours.size(); ++k) {
        const int q = neighbours[k];
        if (reached[q]) continue;
        const double limit = std::min(radius, tolerance(q));
        if (squared_distances[k] > limit * limit) continue;
        reached[q] = true;
        component.push_back(q);
      }
    }
    if (static_cast<int>(component.size()) < config.cluster_min_points) continue;
    for (int& i : component) i = members[i];
    found.push_back(std::move(component));
  }
  return found;
}

void numberBySize(std::vector<Indices> groups, LidarFeatures& features) {
  std::stable_sort(groups.begin(), groups.end(),
                   [](const Indices& a, const Indices& b) { return a.size() > b.size(); });
  for (const Indices& group : groups) {
    for (const int i : group) features.segment[i] = features.segment_count;
    ++features.segment_count;
  }
}

}  // namespace

std::vector<Eigen::Vector3f> estimateNormals(const std::vector<Eigen::Vector3f>& points, int neighbours) {
  std::vector<Eigen::Vector3f> normals(points.size(), Eigen::Vector3f::Zero());
  if (points.size() < 3 || neighbours < 3) return normals;
  const PclCloud::Ptr cloud = toPcl(points);
  pcl::KdTreeFLANN<pcl::PointXYZ> tree(false);
  tree.setInputCloud(cloud);

  Indices nearest;
  std::vector<float> squared_distances;
  const auto fit = [&](std::size_t i, int wanted) {
    const int count = std::min(wanted, static_cast<int>(points.size()));
    tree.nearestKSearch(cloud->points[i], count, nearest, squared_distances);
    return fitPlane(points, nearest);
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    PlaneFit plane = fit(i, neighbours);
    for (int wider = 2; wider <= kMaxWidening && plane.elongation < kRingRatio; wider *= 2) {
      plane = fit(i, wider * neighbours);
    }
    if (plane.normal.dot(points[i].cast<double>()) > 0.0) plane.normal = -plane.normal;
    normals[i] = plane.normal.cast<float>();
  }
  return normals;
}

std::vector<float> normaliseReflectivity(const std::vector<float>& reflectivity, double quantile) {
  if (reflectivity.empty()) return {};
  std::vector<float> result(reflectivity);
  for (float& r : result) r = std::isfinite(r) ? std::max(r, 0.0f) : 0.0f;

  std::vector<float> sorted(result);
  const double rank = std::min(std::max(quantile, 0.0), 1.0) * static_cast<double>(sorted.size() - 1);
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(std::lround(rank));
  std::nth_element(sorted.begin(), nth, sorted.end());
  // Nearly all points may be black; then the largest value is the only scale there is.
  const float scale = *nth > 0.0f ? *nth : *std::max_element(nth, sorted.end());
  if (scale == 0.0f) return result;
  for (float& r : result) r = std::min(r / scale, 1.0f);
  return result;
}

void segment(const std::vector<Eigen::Vector3f>& points, const LidarFeatureConfig& config,
             LidarFeatures& features) {
  features.segment.assign(points.size(), LidarFeatures::kNoSegment);
  features.plane_count = 0;
  features.segment_count = 0;
  if (features.normals.size() != points.size()) {
    features.normals = estimateNormals(points, config.normal_neighbours);
  }
  Indices remaining(points.size());
  std::iota(remaining.begin(), remaining.end(), 0);

  numberBySize(takePlanes(points, features.normals, config, remaining), features);
  features.plane_count = features.segment_count;
  numberBySize(clusters(*toPcl(points), config, remaining), features);
}

void checkCloud(const PointCloud& cloud) {
  if (cloud.points.empty()) {
    throw Error(ErrorCause::kCloud,
                "The point cloud is empty: check that the LiDAR driver publishes points.");
  }
  if (cloud.hasReflectivity() && cloud.reflectivity.size() != cloud.size()) {
    throw Error(ErrorCause::kCloud, "The point cloud has " + std::to_string(cloud.size()) + " points but " +
                                        std::to_string(cloud.reflectivity.size()) +
                                        " reflectivity values: give one for each point, or none.");
  }
}

LidarFeatures computeLidarFeatures(const PointCloud& cloud, const LidarFeatureConfig& config) {
  checkCloud(cloud);
  LidarFeatures features;
  features.normals = estimateNormals(cloud.points, config.normal_neighbours);
  features.reflectivity = normaliseReflectivity(cloud.reflectivity, config.reflectivity_quantile);
  segment(cloud.points, config, features);
  return features;
}

}  // namespace lidar_camera_recalibration

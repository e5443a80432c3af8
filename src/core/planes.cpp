#include "planes.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <random>

#include "plane_fit.hpp"

namespace lidar_camera_recalibration {
namespace {

using Indices = std::vector<int>;
using Plane = Eigen::Hyperplane<float, 3>;

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

// The largest plane among some points by RANSAC. Only points whose normals agree support it: without normals,
// a slab cut level through cars, trees and walls beats every real surface, for a ring of the LiDAR lies in
// it.
class PlaneSearch {
 public:
  PlaneSearch(const std::vector<Eigen::Vector3f>& points, const std::vector<Eigen::Vector3f>& normals,
              const LidarFeatureConfig& config, const Indices& candidates)
      : config_(config), random_(static_cast<std::mt19937::result_type>(candidates.size())) {
    Indices sample;
    std::sample(candidates.begin(), candidates.end(), std::back_inserter(sample), kRansacSample, random_);
    positions_.resize(static_cast<Eigen::Index>(sample.size()), 3);
    normals_.resize(positions_.rows(), 3);
    for (std::size_t i = 0; i < sample.size(); ++i) {
      positions_.row(static_cast<Eigen::Index>(i)) = points[sample[i]];
      normals_.row(static_cast<Eigen::Index>(i)) = normals[sample[i]];
    }
    // The sample holds the same share of the plane as the candidates.
    min_support_ = std::max(config.plane_min_points, 3) * static_cast<double>(sample.size()) /
                   static_cast<double>(candidates.size());
  }

  std::optional<Plane> find() {
    if (min_support_ > static_cast<double>(positions_.rows())) return {};
    std::uniform_int_distribution<Eigen::Index> any(0, positions_.rows() - 1);
    Hypothesis best{Plane(Eigen::Vector3f::UnitZ(), 0.0f), 0.0f};
    float best_unfitted = 0.0f;
    for (int tried = 0; tried < hypothesesNeeded(best.score); ++tried) {
      const Eigen::Index i = any(random_);
      const Plane plane(normals_.row(i).transpose(), positions_.row(i).transpose());
      const float unfitted = score(plane);
      if (unfitted <= best_unfitted) continue;
      best_unfitted = unfitted;
      const Hypothesis fitted = fitToSupport({plane, unfitted});
      if (fitted.score > best.score) best = fitted;
    }
    if (static_cast<double>((weights(best.plane) > 0.0f).count()) < min_support_) return {};
    return best.plane;
  }

 private:
  struct Hypothesis {
    Plane plane;
    float score;
  };
  using Columns = Eigen::Matrix<float, Eigen::Dynamic, 3>;

  // 1 on the plane, falling to 0 at plane_distance (MSAC): where counts alone decide, a plane between road
  // and pavement beats both. 0 if the normal disagrees.
  Eigen::ArrayXf weights(const Plane& plane) const {
    const auto scale = static_cast<float>(1.0 / config_.plane_distance);
    const Eigen::ArrayXf distances = scale * ((positions_ * plane.normal()).array() + plane.offset());
    const Eigen::ArrayXf cosines = (normals_ * plane.normal()).array().abs();
    return (cosines >= kMinNormalCosine).select((1.0f - distances.square()).max(0.0f), 0.0f);
  }

  float score(const Plane& plane) const { return weights(plane).sum(); }

  // The normal of one point is too coarse for a plane of tens of metres.
  Hypothesis fitToSupport(Hypothesis hypothesis) const {
    for (int i = 0; i < kMaxFits; ++i) {
      const Plane plane = fitTo(weights(hypothesis.plane));
      const float fitted = score(plane);
      if (fitted <= hypothesis.score) break;
      hypothesis = {plane, fitted};
    }
    return hypothesis;
  }

  // To the points of the sample with a weight, all alike.
  Plane fitTo(const Eigen::ArrayXf& weights) const {
    const Eigen::Vector3d centre = positions_.colwise().mean().transpose().cast<double>();
    double count = 0.0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
      if (!(weights[k] > 0.0f)) continue;
      const Eigen::Vector3d d = positions_.row(k).transpose().cast<double>() - centre;
      count += 1.0;
      sum += d;
      products.noalias() += d * d.transpose();
    }
    const PlaneFit fit = fitPlane(count, sum, products);
    return Plane(fit.normal.cast<float>(), (fit.mean + centre).cast<float>());
  }

  int hypothesesNeeded(float score_found) const {
    const double share =
        std::max(static_cast<double>(score_found), min_support_) / static_cast<double>(positions_.rows());
    const double needed = std::log(1.0 - kRansacProbability) / std::log1p(-kRansacGoodShare * share);
    return static_cast<int>(std::min<double>(needed, kRansacMaxHypotheses));
  }

  const LidarFeatureConfig& config_;
  std::mt19937 random_;
  Columns positions_, normals_;  // of the sample
  double min_support_;
};

}  // namespace

std::vector<std::vector<int>> takePlanes(const std::vector<Eigen::Vector3f>& points,
                                         const std::vector<Eigen::Vector3f>& normals,
                                         const LidarFeatureConfig& config, std::vector<int>& remaining) {
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

}  // namespace lidar_camera_recalibration

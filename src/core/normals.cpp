#include <algorithm>
#include <cmath>
#include <vector>

#include "kd_tree.hpp"
#include "lidar_camera_recalibration/lidar_features.hpp"
#include "multiversion.hpp"
#include "plane_fit.hpp"

namespace lidar_camera_recalibration {
namespace {

// Below this ratio of the principal variances the neighbours are likely from one ring of the LiDAR, and noise
// turns the plane around that line: then more neighbours are taken, up to kMaxWidening times as many.
constexpr double kRingRatio = 0.02;
constexpr int kMaxWidening = 4;

// Room for what rounding does to distances.
constexpr float kSlack = 1.001f;

// Some points, from an origin near them.
struct Columns {
  std::vector<float> x, y, z;  // [m]

  std::size_t size() const { return x.size(); }

  void resize(std::size_t size) {
    for (auto* column : {&x, &y, &z}) column->resize(size);
  }
};

// How many values are not above a limit.
LCR_MULTIVERSION int countWithin(const float* values, std::size_t size, float limit) {
  int count = 0;
  for (std::size_t k = 0; k < size; ++k) count += values[k] <= limit;
  return count;
}

int countWithin(const std::vector<float>& values, float limit) {
  return countWithin(values.data(), values.size(), limit);
}

// Squared distances from a place. @return the largest
LCR_MULTIVERSION float squaredDistances(const float* x, const float* y, const float* z, std::size_t size,
                                        float px, float py, float pz, float* __restrict squared) {
  float largest = 0.0f;
#pragma omp simd reduction(max : largest)
  for (std::size_t k = 0; k < size; ++k) {
    const float dx = x[k] - px, dy = y[k] - py, dz = z[k] - pz;
    const float d = dx * dx + dy * dy + dz * dz;
    squared[k] = d;
    largest = d > largest ? d : largest;
  }
  return largest;
}

// Squared distances from a box around the origin, of half the sides hx, hy, hz.
LCR_MULTIVERSION void squaredDistancesFromBox(const float* x, const float* y, const float* z,
                                              std::size_t size, float hx, float hy, float hz,
                                              float* __restrict squared) {
#pragma omp simd
  for (std::size_t k = 0; k < size; ++k) {
    float dx = std::abs(x[k]) - hx, dy = std::abs(y[k]) - hy, dz = std::abs(z[k]) - hz;
    dx = dx > 0.0f ? dx : 0.0f;
    dy = dy > 0.0f ? dy : 0.0f;
    dz = dz > 0.0f ? dz : 0.0f;
    squared[k] = dx * dx + dy * dy + dz * dz;
  }
}

// A limit that exactly `count` of the values keep, more only if some are equal; none is above `upper`. The
// squared distances of points on a surface are spread evenly, so that a few steps of interpolation find it,
// faster than any sorting.
float limitOf(const std::vector<float>& values, int count, float upper) {
  float lower = 0.0f;
  int below_lower = 0, below_upper = countWithin(values, upper);
  for (bool interpolate = true; below_upper > count; interpolate = !interpolate) {
    const float share =
        static_cast<float>(count - below_lower) / static_cast<float>(below_upper - below_lower);
    const float middle = lower + (upper - lower) * (interpolate ? share : 0.5f);
    if (!(middle > lower && middle < upper)) {
      if (interpolate) continue;
      break;  // equal values
    }
    const int below = countWithin(values, middle);
    if (below >= count) {
      upper = middle;
      below_upper = below;
    } else {
      lower = middle;
      below_lower = below;
    }
  }
  return upper;
}

// Planes through the nearest neighbours of all points. The points of a leaf share one search: their
// neighbours are among those around its middle.
class NeighbourPlanes {
 public:
  explicit NeighbourPlanes(const std::vector<Eigen::Vector3f>& points) : tree_(points) {}

  // Facing the origin.
  std::vector<Eigen::Vector3f> normals(std::size_t neighbours) {
    std::vector<Eigen::Vector3f> normals(tree_.size());
    std::vector<std::uint32_t> ancestors;  // the node at hand and those around it, from the root on
    for (std::uint32_t n = 0; n < tree_.nodes().size(); ++n) {
      const KdTree::Node& node = tree_.nodes()[n];
      while (!ancestors.empty() && tree_.nodes()[ancestors.back()].end < node.end) ancestors.pop_back();
      ancestors.push_back(n);
      if (node.isLeaf()) addNormals(node, ancestors, neighbours, normals);
    }
    return normals;
  }

 private:
  void addNormals(const KdTree::Node& leaf, const std::vector<std::uint32_t>& ancestors,
                  std::size_t neighbours, std::vector<Eigen::Vector3f>& normals) {
    open_.clear();
    for (std::uint32_t i = leaf.begin; i < leaf.end; ++i) open_.push_back(i);
    for (std::size_t wider = 1; wider <= kMaxWidening && !open_.empty(); wider *= 2) {
      const std::size_t count = std::min(wider * neighbours, tree_.size());
      findCandidates(leaf, ancestors, static_cast<int>(count));
      const auto is_done = [&](std::uint32_t i) {
        const Eigen::Vector3f& point = tree_.points()[i];
        const PlaneFit plane = fit(point, static_cast<int>(count));
        const bool away = plane.normal.dot(point.cast<double>()) > 0.0;
        normals[tree_.indices()[i]] = (away ? -plane.normal : plane.normal).cast<float>();
        return plane.elongation >= kRingRatio;
      };
      open_.erase(std::remove_if(open_.begin(), open_.end(), is_done), open_.end());
    }
  }

  // All points that may be among the `count` nearest ones of a point of the leaf.
  void findCandidates(const KdTree::Node& leaf, const std::vector<std::uint32_t>& ancestors, int count) {
    middle_ = leaf.box.center();
    const Eigen::Vector3f half = 0.5f * leaf.box.sizes();
    // The neighbours of a point are at most so much farther away than those of the middle.
    const float farther = half.norm();
    // The smallest box around that has enough points bounds the distance.
    auto around = ancestors.rbegin();
    while (static_cast<int>(tree_.nodes()[*around].size()) < count) ++around;
    const KdTree::Node& box = tree_.nodes()[*around];
    ranges_.assign(1, {box.begin, box.end});
    takeCandidates();
    tree_.rangesWithin(leaf.box, reachOfMiddle(count) + farther, ranges_);
    takeCandidates();
    reach_ = reachOfMiddle(count);
    keepNear(half, reach_ + farther);
  }

  void takeCandidates() {
    std::size_t size = 0;
    for (const KdTree::Range& range : ranges_) size += range.end - range.begin;
    candidates_.resize(size);
    std::size_t k = 0;
    for (const KdTree::Range& range : ranges_) {
      for (std::uint32_t i = range.begin; i < range.end; ++i, ++k) {
        const Eigen::Vector3f point = tree_.points()[i] - middle_;
        candidates_.x[k] = point.x();
        candidates_.y[k] = point.y();
        candidates_.z[k] = point.z();
      }
    }
  }

  // Keeps candidates within a distance of a box around the middle.
  void keepNear(const Eigen::Vector3f& half, float distance) {
    const std::size_t size = candidates_.size();
    squared_.resize(size);
    const float* const squared = squared_.data();
    float *const x = candidates_.x.data(), *const y = candidates_.y.data(), *const z = candidates_.z.data();
    squaredDistancesFromBox(x, y, z, size, half.x(), half.y(), half.z(), squared_.data());
    const float limit = distance * distance;
    std::size_t kept = 0;
    for (std::size_t k = 0; k < size; ++k) {
      x[kept] = x[k];
      y[kept] = y[k];
      z[kept] = z[k];
      kept += squared[k] <= limit;
    }
    candidates_.resize(kept);
  }

  // Distance of the middle's neighbours among the candidates.
  float reachOfMiddle(int count) {
    const float largest = measure(Eigen::Vector3f::Zero());
    return kSlack * std::sqrt(limitOf(squared_, count, largest));
  }

  // Squared distances of the candidates from a place. @return the largest
  float measure(const Eigen::Vector3f& place) {
    squared_.resize(candidates_.size());
    return squaredDistances(candidates_.x.data(), candidates_.y.data(), candidates_.z.data(), squared_.size(),
                            place.x(), place.y(), place.z(), squared_.data());
  }

  PlaneFit fit(const Eigen::Vector3f& point, int count) {
    const Eigen::Vector3f place = point - middle_;
    measure(place);
    const float bound = kSlack * (reach_ + place.norm());
    const float limit = limitOf(squared_, count, bound * bound);
    const std::size_t size = candidates_.size();
    const float* const squared = squared_.data();
    const float *const x = candidates_.x.data(), *const y = candidates_.y.data(),
                       *const z = candidates_.z.data();
    const float px = place.x(), py = place.y(), pz = place.z();
    float n = 0.0f, sx = 0.0f, sy = 0.0f, sz = 0.0f;
    float xx = 0.0f, xy = 0.0f, xz = 0.0f, yy = 0.0f, yz = 0.0f, zz = 0.0f;
#pragma omp simd reduction(+ : n, sx, sy, sz, xx, xy, xz, yy, yz, zz)
    for (std::size_t k = 0; k < size; ++k) {
      const float w = squared[k] <= limit ? 1.0f : 0.0f;
      const float dx = w * (x[k] - px), dy = w * (y[k] - py), dz = w * (z[k] - pz);
      n += w;
      sx += dx;
      sy += dy;
      sz += dz;
      xx += dx * dx;
      xy += dx * dy;
      xz += dx * dz;
      yy += dy * dy;
      yz += dy * dz;
      zz += dz * dz;
    }
    Eigen::Matrix3d products;
    products << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    return fitPlane(n, Eigen::Vector3d(sx, sy, sz), products);
  }

  KdTree tree_;
  std::vector<std::uint32_t> open_;  // points of the leaf that have no good plane yet
  std::vector<KdTree::Range> ranges_;
  Eigen::Vector3f middle_;  // of the leaf
  float reach_ = 0.0f;      // distance of the middle's farthest neighbour [m]
  Columns candidates_;      // from the middle
  std::vector<float> squared_;
};

}  // namespace

std::vector<Eigen::Vector3f> estimateNormals(const std::vector<Eigen::Vector3f>& points, int neighbours) {
  if (points.size() < 3 || neighbours < 3) {
    return std::vector<Eigen::Vector3f>(points.size(), Eigen::Vector3f::Zero());
  }
  return NeighbourPlanes(points).normals(static_cast<std::size_t>(neighbours));
}

}  // namespace lidar_camera_recalibration

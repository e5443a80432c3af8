#include "clusters.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "kd_tree.hpp"

namespace lidar_camera_recalibration {
namespace {

using Indices = std::vector<int>;

// Sets of things that are joined one by one.
class DisjointSets {
 public:
  explicit DisjointSets(std::size_t size) : parent_(size) { std::iota(parent_.begin(), parent_.end(), 0u); }

  std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parent_;
};

// Joins the points of boxes with each other. Most pairs of boxes are too far apart or are one component
// already, so few pairs of points are ever looked at.
class Joining {
 public:
  Joining(const KdTree& tree, const LidarFeatureConfig& config)
      : tree_(tree), sets_(tree.size()), whole_(tree.nodes().size(), false), widest_(tree.nodes().size()) {
    for (const Eigen::Vector3f& point : tree.points()) {
      const double slope = config.cluster_tolerance_slope * point.norm();
      tolerance_.push_back(static_cast<float>(std::max(config.cluster_tolerance, slope)));
    }
    if (tree.size() > 0) joinWithin(0);
  }

  std::uint32_t componentOf(std::uint32_t point) { return sets_.root(point); }

 private:
  // @return the children of a node
  std::pair<std::uint32_t, std::uint32_t> childrenOf(std::uint32_t n) const {
    return {n + 1, tree_.nodes()[n].second_child};
  }

  void joinWithin(std::uint32_t n) {
    const KdTree::Node& node = tree_.nodes()[n];
    if (node.isLeaf()) {
      widest_[n] = *std::max_element(tolerance_.begin() + node.begin, tolerance_.begin() + node.end);
      for (std::uint32_t i = node.begin; i < node.end; ++i) joinPoint(i, i + 1, node.end);
    } else {
      const auto [first, second] = childrenOf(n);
      joinWithin(first);
      joinWithin(second);
      widest_[n] = std::max(widest_[first], widest_[second]);
      joinBetween(first, second);
    }
    whole_[n] = isWhole(n);
  }

  void joinBetween(std::uint32_t a, std::uint32_t b) {
    const KdTree::Node &node_a = tree_.nodes()[a], &node_b = tree_.nodes()[b];
    const float limit = std::min(widest_[a], widest_[b]);
    if (node_a.box.squaredExteriorDistance(node_b.box) > limit * limit) return;
    if (whole_[a] && whole_[b] && sets_.root(node_a.begin) == sets_.root(node_b.begin)) return;
    if (node_a.isLeaf() && node_b.isLeaf()) {
      for (std::uint32_t i = node_a.begin; i < node_a.end; ++i) joinPoint(i, node_b.begin, node_b.end);
    } else if (node_b.isLeaf() || (!node_a.isLeaf() && node_a.size() >= node_b.size())) {
      const auto [first, second] = childrenOf(a);
      joinBetween(first, b);
      joinBetween(second, b);
    } else {
      const auto [first, second] = childrenOf(b);
      joinBetween(a, first);
      joinBetween(a, second);
    }
  }

  void joinPoint(std::uint32_t i, std::uint32_t begin, std::uint32_t end) {
    for (std::uint32_t k = begin; k < end; ++k) {
      const float limit = std::min(tolerance_[i], tolerance_[k]);
      if ((tree_.points()[i] - tree_.points()[k]).squaredNorm() <= limit * limit) sets_.join(i, k);
    }
  }

  // Whether all points of a node are known to be one component; what joins only through points elsewhere is
  // found later.
  bool isWhole(std::uint32_t n) {
    const KdTree::Node& node = tree_.nodes()[n];
    if (!node.isLeaf()) {
      const auto [first, second] = childrenOf(n);
      return whole_[first] && whole_[second] &&
             sets_.root(tree_.nodes()[first].begin) == sets_.root(tree_.nodes()[second].begin);
    }
    const std::uint32_t root = sets_.root(node.begin);
    for (std::uint32_t i = node.begin; i < node.end; ++i) {
      if (sets_.root(i) != root) return false;
    }
    return true;
  }

  const KdTree& tree_;
  DisjointSets sets_;
  std::vector<float> tolerance_;  // of each point [m]
  std::vector<bool> whole_;       // of each node
  std::vector<float> widest_;     // tolerance in each node [m]
};

}  // namespace

std::vector<Indices> findClusters(const std::vector<Eigen::Vector3f>& points,
                                  const LidarFeatureConfig& config, const Indices& members) {
  std::vector<Eigen::Vector3f> chosen;
  chosen.reserve(members.size());
  for (const int i : members) chosen.push_back(points[i]);
  const KdTree tree(chosen);
  Joining joining(tree, config);
  // In the order of the cloud.
  std::vector<std::uint32_t> component(members.size());
  for (std::uint32_t i = 0; i < members.size(); ++i) component[tree.indices()[i]] = joining.componentOf(i);
  std::vector<Indices> of_root(members.size());
  for (std::size_t i = 0; i < members.size(); ++i) of_root[component[i]].push_back(members[i]);
  std::vector<Indices> found;
  for (Indices& cluster : of_root) {
    const auto size = static_cast<int>(cluster.size());
    if (size > 0 && size >= config.cluster_min_points) found.push_back(std::move(cluster));
  }
  // Like the cloud: the root is some place of the tree.
  std::sort(found.begin(), found.end(),
            [](const Indices& a, const Indices& b) { return a.front() < b.front(); });
  return found;
}

}  // namespace lidar_camera_recalibration

#include "kd_tree.hpp"

#include <algorithm>

namespace lidar_camera_recalibration {

KdTree::KdTree(const std::vector<Eigen::Vector3f>& points) {
  if (points.empty()) return;
  std::vector<Entry> entries;
  entries.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    entries.push_back({points[i], static_cast<std::uint32_t>(i)});
  nodes_.reserve(4 * points.size() / kLeafSize + 1);
  split(entries, 0, static_cast<std::uint32_t>(entries.size()));
  points_.reserve(entries.size());
  indices_.reserve(entries.size());
  for (const Entry& entry : entries) {
    points_.push_back(entry.point);
    indices_.push_back(entry.index);
  }
}

// At the median of the longest side, so the depth is bounded whatever the points are.
void KdTree::split(std::vector<Entry>& entries, std::uint32_t begin, std::uint32_t end) {
  Node node{{}, begin, end};
  for (std::uint32_t i = begin; i < end; ++i) node.box.extend(entries[i].point);
  const std::size_t place = nodes_.size();
  nodes_.push_back(node);
  if (node.size() <= kLeafSize) return;
  Eigen::Index side;
  node.box.sizes().maxCoeff(&side);
  const std::uint32_t middle = begin + (end - begin) / 2;
  std::nth_element(entries.begin() + begin, entries.begin() + middle, entries.begin() + end,
                   [side](const Entry& a, const Entry& b) { return a.point[side] < b.point[side]; });
  split(entries, begin, middle);
  nodes_[place].second_child = static_cast<std::uint32_t>(nodes_.size());
  split(entries, middle, end);
}

void KdTree::rangesWithin(const Eigen::AlignedBox3f& box, float distance, std::vector<Range>& ranges) const {
  ranges.clear();
  if (nodes_.empty()) return;
  const float limit = distance * distance;
  constexpr std::size_t kMaxDepth = 40;  // 2^40 leaves
  std::uint32_t open[kMaxDepth];
  std::size_t count = 0;
  open[count++] = 0;
  while (count > 0) {
    const std::uint32_t number = open[--count];
    const Node& node = nodes_[number];
    if (node.box.squaredExteriorDistance(box) > limit) continue;
    if (!node.isLeaf()) {
      open[count++] = node.second_child;
      open[count++] = number + 1;
    } else if (!ranges.empty() && ranges.back().end == node.begin) {
      ranges.back().end = node.end;
    } else {
      ranges.push_back({node.begin, node.end});
    }
  }
}

}  // namespace lidar_camera_recalibration

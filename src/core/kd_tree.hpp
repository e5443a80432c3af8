#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lidar_camera_recalibration {

/// Points in boxes within boxes, for searches around all of them. The points of a box lie together in memory,
/// so that a search around a whole leaf costs little more than around one point.
class KdTree {
 public:
  static constexpr std::size_t kLeafSize = 24;

  struct Node {
    Eigen::AlignedBox3f box;        ///< of its points
    std::uint32_t begin, end;       ///< of its points, in the order of the tree
    std::uint32_t second_child{0};  ///< the first one is the next node; 0: a leaf

    bool isLeaf() const { return second_child == 0; }
    std::size_t size() const { return end - begin; }
  };
  struct Range {
    std::uint32_t begin, end;
  };

  explicit KdTree(const std::vector<Eigen::Vector3f>& points);

  std::size_t size() const { return points_.size(); }
  /// A parent stands before its children; the root is the first. None without points.
  const std::vector<Node>& nodes() const { return nodes_; }
  /// In the order of the tree.
  const std::vector<Eigen::Vector3f>& points() const { return points_; }
  /// Places of points() in the cloud.
  const std::vector<std::uint32_t>& indices() const { return indices_; }

  /// All leaves that reach within a distance of a box, neighbouring ones joined.
  void rangesWithin(const Eigen::AlignedBox3f& box, float distance, std::vector<Range>& ranges) const;

 private:
  struct Entry {
    Eigen::Vector3f point;
    std::uint32_t index;
  };
  void split(std::vector<Entry>& entries, std::uint32_t begin, std::uint32_t end);

  std::vector<Node> nodes_;
  std::vector<Eigen::Vector3f> points_;
  std::vector<std::uint32_t> indices_;
};

}  // namespace lidar_camera_recalibration

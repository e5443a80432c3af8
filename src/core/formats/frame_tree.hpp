#pragma once

#include <Eigen/Geometry>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace lidar_camera_recalibration {

/// Frames that hang on each other, as in URDF and tf.
class FrameTree {
 public:
  /// @throw std::runtime_error if the child hangs on something already.
  void add(const std::string& parent, const std::string& child, const Eigen::Isometry3d& T_parent_child);

  bool has(const std::string& frame) const;
  bool isParent(const std::string& frame) const;
  std::vector<std::string> children() const;  ///< sorted
  /// T_target_source maps points of the frame `source` into the frame `target`.
  /// @throw std::runtime_error if one of them is not there or nothing connects them.
  Eigen::Isometry3d transform(const std::string& target, const std::string& source) const;

 private:
  /// The frame's root and T_root_frame.
  std::pair<std::string, Eigen::Isometry3d> fromRoot(const std::string& frame) const;

  std::map<std::string, std::pair<std::string, Eigen::Isometry3d>>
      parents_;  ///< child -> parent, T_parent_child
};

/// `a, b, c`
std::string joined(const std::vector<std::string>& names);

}  // namespace lidar_camera_recalibration

#include "frame_tree.hpp"

#include <stdexcept>

namespace lidar_camera_recalibration {

void FrameTree::add(const std::string& parent, const std::string& child,
                    const Eigen::Isometry3d& T_parent_child) {
  if (!parents_.emplace(child, std::make_pair(parent, T_parent_child)).second)
    throw std::runtime_error("the frame '" + child + "' has two parents");
}

bool FrameTree::has(const std::string& frame) const { return parents_.count(frame) > 0 || isParent(frame); }

bool FrameTree::isParent(const std::string& frame) const {
  for (const auto& [child, parent] : parents_) {
    if (parent.first == frame) return true;
  }
  return false;
}

std::vector<std::string> FrameTree::children() const {
  std::vector<std::string> names;
  for (const auto& [child, parent] : parents_) names.push_back(child);
  return names;
}

std::pair<std::string, Eigen::Isometry3d> FrameTree::fromRoot(const std::string& frame) const {
  if (!has(frame))
    throw std::runtime_error("there is no frame '" + frame + "'; known are " + joined(children()));
  std::string root = frame;
  Eigen::Isometry3d T_root_frame = Eigen::Isometry3d::Identity();
  std::size_t steps = 0;
  for (auto found = parents_.find(root); found != parents_.end(); found = parents_.find(root)) {
    if (++steps > parents_.size()) throw std::runtime_error("the frames hang on each other in a ring");
    root = found->second.first;
    T_root_frame = found->second.second * T_root_frame;
  }
  return {root, T_root_frame};
}

Eigen::Isometry3d FrameTree::transform(const std::string& target, const std::string& source) const {
  const auto [target_root, T_root_target] = fromRoot(target);
  const auto [source_root, T_root_source] = fromRoot(source);
  if (target_root != source_root)
    throw std::runtime_error("nothing connects the frames '" + target + "' and '" + source + "'");
  return T_root_target.inverse() * T_root_source;
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

}  // namespace lidar_camera_recalibration

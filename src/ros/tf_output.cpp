#include "tf_output.hpp"

#include <tf2/exceptions.h>
#include <tf2_eigen/tf2_eigen.h>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

/// Whether `ancestor` is the frame itself or lies between it and the root of its tree.
bool isBelow(const tf2::BufferCore& tf, std::string frame, const std::string& ancestor) {
  constexpr int kMaxDepth = 1000;  // tf itself refuses deeper trees
  for (int depth = 0; depth < kMaxDepth; ++depth) {
    if (frame == ancestor) return true;
    std::string parent;
    if (!tf._getParent(frame, ros::Time(0), parent)) return false;
    frame = parent;
  }
  return false;
}

geometry_msgs::TransformStamped toMessage(const Eigen::Isometry3d& T_parent_child, const std::string& parent,
                                          const std::string& child) {
  geometry_msgs::TransformStamped message = tf2::eigenToTransform(T_parent_child);
  message.header.frame_id = parent;
  message.child_frame_id = child;
  return message;
}

/// T_parent_child' = T_parent_near * T_near_far' * T_far_child, where `near` is the sensor on the parent's
/// side of the edge.
Eigen::Isometry3d onEdge(const tf2::BufferCore& tf, const std::string& parent, const std::string& child,
                         const FrameIds& frames, const Eigen::Isometry3d& T_camera_lidar) {
  const std::string edge = "the edge tf/correct_parent '" + parent + "' -> tf/correct_child '" + child + "'";
  std::string actual_parent;
  if (tf._getParent(child, ros::Time(0), actual_parent) && actual_parent != parent)
    throw Error(ErrorCause::kExtrinsic, edge + " does not exist: the parent of '" + child + "' in tf is '" +
                                            actual_parent + "'; name an edge of the chain between '" +
                                            frames.lidar + "' and '" + frames.camera + "'");
  const bool camera_below = isBelow(tf, frames.camera, child), lidar_below = isBelow(tf, frames.lidar, child);
  if (camera_below == lidar_below)
    throw Error(
        ErrorCause::kExtrinsic,
        edge + " does not lie between the sensors: " +
            (camera_below
                 ? "both '" + frames.camera + "' and '" + frames.lidar + "' hang below '" + child + "'"
                 : "neither '" + frames.camera + "' nor '" + frames.lidar + "' hangs below '" + child + "'") +
            "; name an edge of the chain between them");
  const std::string& near = camera_below ? frames.lidar : frames.camera;
  const std::string& far = camera_below ? frames.camera : frames.lidar;
  const Eigen::Isometry3d T_near_far = camera_below ? T_camera_lidar.inverse() : T_camera_lidar;
  return lookUp(tf, parent, near, ros::Time(0)) * T_near_far * lookUp(tf, far, child, ros::Time(0));
}

}  // namespace

Eigen::Isometry3d lookUp(const tf2::BufferCore& tf, const std::string& target, const std::string& source,
                         const ros::Time& stamp) {
  try {
    return tf2::transformToEigen(tf.lookupTransform(target, source, stamp));
  } catch (const tf2::TransformException&) {
    // A buffer that does not reach the stamp may still know the (mostly static) transform at another time.
  }
  try {
    return tf2::transformToEigen(tf.lookupTransform(target, source, ros::Time(0)));
  } catch (const tf2::TransformException& e) {
    throw Error(ErrorCause::kExtrinsic, "tf has no transform from '" + source + "' to '" + target + "' (" +
                                            e.what() +
                                            "): publish it, or check the frame ids of the messages");
  }
}

geometry_msgs::TransformStamped outputTransform(const tf2::BufferCore& tf, const ServerConfig& config,
                                                const FrameIds& frames,
                                                const Eigen::Isometry3d& T_camera_lidar) {
  const std::string &parent = config.tf_correct_parent, &child = config.tf_correct_child;
  if (!child.empty()) return toMessage(onEdge(tf, parent, child, frames, T_camera_lidar), parent, child);
  return toMessage(T_camera_lidar.inverse(), frames.lidar,
                   config.tf_child_frame.empty() ? frames.camera + "_recalibrated" : config.tf_child_frame);
}

}  // namespace lidar_camera_recalibration

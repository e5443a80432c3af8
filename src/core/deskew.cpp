#include "lidar_camera_recalibration/deskew.hpp"

#include <algorithm>
#include <sstream>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

/// Times come through single and double precision; so much earlier or later [s] is not outside.
constexpr double kTolerance = 1e-6;

/// The LiDAR's motion between its poses.
class Motion {
 public:
  explicit Motion(const std::vector<LidarPose>& poses) : poses_(poses) {
    if (poses.empty()) throw Error(ErrorCause::kMotion, "no pose of the LiDAR is known");
    for (std::size_t i = 0; i + 1 < poses.size(); ++i) {
      if (!(poses[i].time < poses[i + 1].time))
        throw Error(ErrorCause::kMotion, "the poses of the LiDAR are not in the order of time");
      screws_.push_back(log(poses[i].T_fixed_lidar.inverse() * poses[i + 1].T_fixed_lidar));
    }
  }

  Eigen::Isometry3d T_fixed_lidar(double time) const {
    if (!(time >= poses_.front().time - kTolerance && time <= poses_.back().time + kTolerance)) {
      std::ostringstream text;
      text << "a point was taken " << time
           << " s after the stamp of its cloud, but the poses of the LiDAR reach from " << poses_.front().time
           << " to " << poses_.back().time << " s";
      throw Error(ErrorCause::kMotion, text.str());
    }
    const auto later = std::upper_bound(poses_.begin(), poses_.end(), time,
                                        [](double t, const LidarPose& pose) { return t < pose.time; });
    const auto next = std::clamp<std::ptrdiff_t>(
        later - poses_.begin(), 1,
        std::max<std::ptrdiff_t>(1, static_cast<std::ptrdiff_t>(poses_.size()) - 1));
    const auto i = static_cast<std::size_t>(next - 1);
    if (i >= screws_.size()) return poses_[i].T_fixed_lidar;  // there is one pose only
    const double share = (time - poses_[i].time) / (poses_[i + 1].time - poses_[i].time);
    return poses_[i].T_fixed_lidar * exp(share * screws_[i]);
  }

 private:
  const std::vector<LidarPose>& poses_;
  std::vector<Vector6d> screws_;  ///< from each pose to the next one
};

}  // namespace

void deskew(PointCloud& cloud, const std::vector<LidarPose>& poses, double time) {
  const Motion motion(poses);
  const Eigen::Isometry3d T_lidar_fixed = motion.T_fixed_lidar(time).inverse();
  float last_time = 0.0F;
  Eigen::Isometry3f T_image_point = (T_lidar_fixed * motion.T_fixed_lidar(0.0)).cast<float>();
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    // Beams that fire together share their time.
    if (!cloud.time.empty() && cloud.time[i] != last_time) {
      last_time = cloud.time[i];
      T_image_point = (T_lidar_fixed * motion.T_fixed_lidar(static_cast<double>(last_time))).cast<float>();
    }
    cloud.points[i] = T_image_point * cloud.points[i];
  }
  cloud.time.clear();
}

}  // namespace lidar_camera_recalibration

#include "motion.hpp"

#include <tf2/exceptions.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "lidar_camera_recalibration/deskew.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

/// Between two samples even a vehicle at its limit moves along a screw to less than a millimetre.
constexpr double kSampling = 0.01;  // [s]
constexpr double kMaxSamples = 100;
constexpr double kTurnWindow = 0.1;  ///< before the image, over which the turn rate is taken [s]

LidarPose lookUpPose(const tf2::BufferCore& tf, const std::string& fixed_frame,
                     const std::string& lidar_frame, const ros::Time& cloud_stamp, double time) {
  const double stamp = cloud_stamp.toSec() + time;
  try {
    if (!(stamp > 0.0))
      throw tf2::ExtrapolationException("the stamp is not positive");  // 0 would be the latest
    return {time, tf2::transformToEigen(tf.lookupTransform(fixed_frame, lidar_frame, ros::Time(stamp)))};
  } catch (const tf2::TransformException& e) {
    throw Error(ErrorCause::kMotion,
                "the cloud cannot be moved to the image: tf does not know where '" + lidar_frame +
                    "' was in '" + fixed_frame + "', the parameter fixed_frame (" + e.what() +
                    "); publish the vehicle's odometry in tf, or leave fixed_frame empty");
  }
}

}  // namespace

double moveToImage(PointCloud& cloud, const tf2::BufferCore& tf, const std::string& fixed_frame,
                   const std::string& lidar_frame, const ros::Time& cloud_stamp,
                   const ros::Time& image_stamp) {
  const double image_time = image_stamp.toSec() - cloud_stamp.toSec();
  double from = std::min(0.0, image_time - kTurnWindow), to = std::max(0.0, image_time);
  if (!cloud.time.empty()) {
    const auto [first, last] = std::minmax_element(cloud.time.begin(), cloud.time.end());
    from = std::min(from, static_cast<double>(*first));
    to = std::max(to, static_cast<double>(*last));
  }
  const double intervals = std::clamp(std::ceil((to - from) / kSampling), 1.0, kMaxSamples);
  std::vector<LidarPose> poses;
  for (double i = 0.0; i <= intervals; ++i)
    poses.push_back(
        lookUpPose(tf, fixed_frame, lidar_frame, cloud_stamp, from + (to - from) * i / intervals));

  deskew(cloud, poses, image_time);

  const auto R_fixed_lidar = [&](double time) -> Eigen::Matrix3d {
    return lookUpPose(tf, fixed_frame, lidar_frame, cloud_stamp, time).T_fixed_lidar.linear();
  };
  const Eigen::Matrix3d turn =
      R_fixed_lidar(image_time - kTurnWindow).transpose() * R_fixed_lidar(image_time);
  return Eigen::AngleAxisd(turn).angle() / kDegree / kTurnWindow;
}

}  // namespace lidar_camera_recalibration

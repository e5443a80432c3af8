#include "result_messages.hpp"

#include <boost/make_shared.hpp>

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <tf2_eigen/tf2_eigen.h>

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace lidar_camera_recalibration {
namespace {

geometry_msgs::TransformStamped cameraFromLidar(const Eigen::Isometry3d& T_camera_lidar,
                                                const FrameIds& frames, const ros::Time& stamp) {
  geometry_msgs::TransformStamped message = tf2::eigenToTransform(T_camera_lidar);
  message.header.stamp = stamp;
  message.header.frame_id = frames.camera;
  message.child_frame_id = frames.lidar;
  return message;
}

}  // namespace

CalibrationResult toMessage(const CalibrationOutcome& outcome, const FrameIds& frames,
                            const ros::Time& stamp) {
  CalibrationResult message;
  message.header.stamp = stamp;
  message.header.frame_id = frames.camera;
  message.transform = cameraFromLidar(outcome.T_camera_lidar, frames, stamp);
  message.start = cameraFromLidar(outcome.start, frames, stamp);
  message.covariance.fill(0.0);
  message.covariance[0] = -1.0;
  if (outcome.covariance) {
    for (int row = 0; row < 6; ++row)
      for (int column = 0; column < 6; ++column)
        message.covariance[static_cast<std::size_t>(6 * row + column)] = (*outcome.covariance)(row, column);
  }
  message.score_before = outcome.before.total;
  message.score_after = outcome.after.total;
  message.accepted = outcome.accepted;
  message.cancelled = outcome.cancelled;
  message.reason = outcome.reason;
  message.frames = static_cast<std::uint32_t>(outcome.frames);
  message.frames_left_out = static_cast<std::uint32_t>(outcome.left_out.size());
  for (const double left_out : outcome.left_out_stamps) {
    message.stamps_left_out.push_back(ros::Time(left_out));
  }
  message.evaluations = static_cast<std::uint32_t>(outcome.evaluations);
  message.duration = outcome.duration;
  message.unseen_gain = outcome.unseen.gain;
  message.unseen_gain_sigma = outcome.unseen.gain_sigma;
  message.distinctness = outcome.unseen.distinctness.value_or(-1.0);
  for (std::size_t axis = 0; axis < 6; ++axis) {
    message.kept[axis] = outcome.kept[axis];
    message.scatter[axis] = outcome.unseen.scatter[static_cast<Eigen::Index>(axis)];
  }
  std::copy(outcome.pixel_shift.begin(), outcome.pixel_shift.end(), message.pixel_shift.begin());
  return message;
}

CalibrationScore scoreMessage(const std_msgs::Header& image_header, const Score& score, double validity) {
  CalibrationScore message;
  message.header = image_header;
  message.score = score.total;
  message.edges = score.edges;
  message.region = score.region;
  message.reflectivity = score.reflectivity;
  message.normal = score.normal;
  message.segment = score.segment;
  message.validity = validity;
  message.points = static_cast<std::uint32_t>(score.points);
  message.masks = static_cast<std::uint32_t>(score.masks);
  return message;
}

void addDrift(const DriftVerdict& frame, const DriftVerdict& window, const DriftConfig& config,
              CalibrationScore& message) {
  const auto probability = [](const DriftVerdict& verdict) {
    return verdict.frames > 0 ? verdict.probability : std::numeric_limits<double>::quiet_NaN();
  };
  message.drift_probability = probability(window);
  message.drift_probability_frame = probability(frame);
  message.drift_frames = static_cast<std::uint32_t>(window.frames);
  static_assert(static_cast<std::uint8_t>(DriftVerdict::State::kOff) == CalibrationScore::DRIFT_OFF);
  message.drift_state = static_cast<std::uint8_t>(window.state());
  message.drift = describe(window, config);
}

CalibrationScore refusedMessage(const std_msgs::Header& image_header, const std::string& reason) {
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  CalibrationScore message;
  message.header = image_header;
  message.score = message.edges = message.region = message.validity = kNothing;
  message.drift_probability = message.drift_probability_frame = kNothing;
  message.reflectivity = message.normal = message.segment = kNothing;
  message.reason = reason;
  return message;
}

sensor_msgs::PointCloud2Ptr coloredPoints(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar,
                                          const std_msgs::Header& cloud_header) {
  const FramePoints& points = frame.points;
  const cv::Rect bounds(0, 0, frame.image.cols, frame.image.rows);
  std::vector<std::pair<std::size_t, cv::Vec3b>> painted;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!frame.visible[i]) continue;
    const auto pixel =
        frame.camera.project(T_camera_lidar * Eigen::Vector3d(points.x[i], points.y[i], points.z[i]));
    if (!pixel) continue;
    const cv::Point at(cvRound(pixel->x()), cvRound(pixel->y()));
    if (bounds.contains(at)) painted.emplace_back(i, frame.image.at<cv::Vec3b>(at));
  }

  auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
  cloud->header = cloud_header;
  sensor_msgs::PointCloud2Modifier modifier(*cloud);
  modifier.setPointCloud2FieldsByString(2, "xyz", "rgb");
  modifier.resize(painted.size());
  sensor_msgs::PointCloud2Iterator<float> x(*cloud, "x"), y(*cloud, "y"), z(*cloud, "z");
  sensor_msgs::PointCloud2Iterator<std::uint8_t> rgb(*cloud, "rgb");  // stored as b, g, r, unused
  for (const auto& [i, bgr] : painted) {
    *x = points.x[i];
    *y = points.y[i];
    *z = points.z[i];
    for (int channel = 0; channel < 3; ++channel) rgb[static_cast<std::size_t>(channel)] = bgr[channel];
    ++x, ++y, ++z, ++rgb;
  }
  return cloud;
}

sensor_msgs::ImagePtr toImageMessage(const cv::Mat& bgr, const std_msgs::Header& header) {
  return cv_bridge::CvImage(header, sensor_msgs::image_encodings::BGR8, bgr).toImageMsg();
}

}  // namespace lidar_camera_recalibration

#pragma once

#include <sensor_msgs/CompressedImage.h>

#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "extrinsic_keeper.hpp"
#include "frame_buffer.hpp"
#include "frame_builder.hpp"
#include "frame_synchroniser.hpp"
#include "frame_view.hpp"
#include "lidar_camera_recalibration/drift_monitor.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "repeat_filter.hpp"
#include "server.hpp"

namespace lidar_camera_recalibration {

/// From messages to scored frames in the buffer. Belongs to the server's worker thread alone.
class FramePipeline {
 public:
  FramePipeline(const ServerConfig& config, const tf2::BufferCore& tf, ExtrinsicKeeper& keeper,
                const std::string& name, const ServerOutputs& outputs);

  FrameSynchroniser& synchroniser() { return synchroniser_; }
  /// Decodes first: that takes long, so it is the worker's work. What cannot be decoded is given up.
  void addImage(const sensor_msgs::CompressedImage& image);
  void addMasks(const sensor_msgs::CompressedImage& masks);

  /// Prepares, scores and keeps (or refuses) the oldest complete frame. @return false if there was none.
  bool step();
  bool hasReady() const { return !ready_.empty(); }

  void clearCaches();
  void clearFrames();
  void dropFramesOlderThan(const ros::Time& stamp) { buffer_.dropOlderThan(stamp); }
  const FrameBuffer& buffer() const { return buffer_; }

  /// What the newest frames say about the extrinsic in force; nothing before the first frame after a change
  /// of it.
  DriftVerdict drift() const;
  /// Of the image that was scored last; zero before the first one.
  ros::Time newestStamp() const { return newest_ ? newest_->image_header.stamp : ros::Time(); }

  /// The overlay shows the extrinsic before and after a result if the parameters want that.
  void setComparison(const Eigen::Isometry3d& start) { comparison_start_ = start; }
  void requestPictures() { pictures_due_ = true; }
  /// After a new frame or on request: draws the newest frame under the extrinsic in force, if anybody looks.
  /// @param state  what the node is doing, for the title
  void publishPictures(const std::string& state);

  /// Counters, memory and, if there is a problem, the reason why the last frame was refused.
  void describe(RecalibrationState& state) const;
  const std::string& lastProblem() const { return last_problem_; }

 private:
  void collectReady();
  std::size_t readyBytes() const;
  using Decoder = sensor_msgs::ImagePtr (*)(const sensor_msgs::CompressedImage&);
  sensor_msgs::ImageConstPtr decoded(const char* input, Decoder decoder,
                                     const sensor_msgs::CompressedImage& message);
  void process(const FrameMessages& messages);
  struct Prepared {
    FramePtr frame;
    double turn_rate_deg = 0.0;  ///< [deg/s]; 0 if it is not known
  };
  Prepared prepare(const FrameMessages& messages, const Eigen::Isometry3d& extrinsic, const FrameIds& ids);
  void score(const FrameMessages& messages, const Prepared& prepared, const Eigen::Isometry3d& extrinsic);
  bool isNewToMonitor(const Prepared& prepared, const Eigen::Isometry3d& extrinsic);
  void refuse(const FrameMessages& messages, std::uint64_t& counter, const std::string& reason);
  cv::Mat overlay(const FramePtr& frame, const Eigen::Isometry3d& T_camera_lidar,
                  const std::string& state) const;
  void warn(const std::string& what);
  void publish(CalibrationScore message, const FrameMessages& messages);

  const ServerConfig& config_;
  const tf2::BufferCore& tf_;
  ExtrinsicKeeper& keeper_;
  const std::string name_;
  const ServerOutputs& outputs_;
  FrameSynchroniser synchroniser_;
  FrameBuffer buffer_;
  std::unique_ptr<Objective> objective_;
  DriftMonitor drift_monitor_;
  std::optional<FrameView> watched_;  ///< of the frame that entered the monitor's window last
  RepeatFilter repeat_filter_;
  std::deque<FrameMessages> ready_;

  struct Newest {
    FramePtr frame;
    std_msgs::Header image_header, cloud_header;
  };
  std::optional<Newest> newest_;
  std::optional<Eigen::Isometry3d> comparison_start_;
  std::string last_problem_;
  bool startup_checked_ = false, pictures_due_ = false;
  std::uint64_t scored_ = 0, dropped_invalid_ = 0, dropped_poor_ = 0, dropped_no_extrinsic_ = 0,
                dropped_no_motion_ = 0, dropped_late_ = 0, dropped_forgotten_ = 0,
                dropped_unreadable_masks_ = 0;
};

}  // namespace lidar_camera_recalibration

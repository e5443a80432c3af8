#pragma once

#include <tf2/buffer_core.h>

#include <Eigen/Geometry>
#include <mutex>
#include <optional>
#include <string>

#include "lidar_camera_recalibration/result_file.hpp"
#include "server_config.hpp"
#include "tf_output.hpp"

namespace lidar_camera_recalibration {

/// The extrinsic in force: where it came from, the one before it, and the file it is kept in. Thread-safe.
class ExtrinsicKeeper {
 public:
  ExtrinsicKeeper(const ServerConfig& config, const tf2::BufferCore& tf, const std::string& name);

  /// The extrinsic in force. The first time it is taken from the saved result, the parameter or tf, in this
  /// order.
  /// @throw Error(kExtrinsic) if none of them has it, or if the frames are not those it belongs to.
  Eigen::Isometry3d get(const FrameIds& frames, const ros::Time& stamp);

  /// Nothing before the first get() that succeeded.
  std::optional<StoredCalibration> current() const;
  /// In words, e.g. "tf (lidar to camera_optical)".
  std::string source() const;
  bool isFromTf() const;
  /// True once after each change: the transform is to be published.
  bool takeChanged();

  /// Replaces the extrinsic and writes the result file. @return what went wrong with the file, otherwise
  /// empty.
  std::string accept(const StoredCalibration& calibration);
  bool restore(std::string& message);
  bool save(const std::string& path, const std::string& format, std::string& message) const;

 private:
  struct Entry {
    StoredCalibration calibration;
    std::string source;
    bool from_tf = false;
  };
  Entry firstGuess(const FrameIds& frames, const ros::Time& stamp) const;
  std::optional<Entry> readSaved(const FrameIds& frames) const;
  std::string writeResultFile(const StoredCalibration& calibration) const;

  const ServerConfig& config_;
  const tf2::BufferCore& tf_;
  const std::string name_;
  std::mutex file_mutex_;     ///< the file follows the extrinsic in the same order
  mutable std::mutex mutex_;  ///< never held while a file is written: callbacks ask for the extrinsic
  std::optional<Entry> current_, previous_;
  bool changed_ = false;
};

}  // namespace lidar_camera_recalibration

#include "extrinsic_keeper.hpp"

#include <ros/console.h>

#include <fstream>
#include <utility>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

ExtrinsicKeeper::ExtrinsicKeeper(const ServerConfig& config, const tf2::BufferCore& tf,
                                 const std::string& name)
    : config_(config), tf_(tf), name_(name) {}

Eigen::Isometry3d ExtrinsicKeeper::get(const FrameIds& frames, const ros::Time& stamp) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!current_) {
    current_ = firstGuess(frames, stamp);
    changed_ = true;
    ROS_INFO_STREAM_NAMED(name_, name_ << ": the extrinsic between '" << frames.lidar << "' and '"
                                       << frames.camera << "' comes from " << current_->source);
  }
  const StoredCalibration& known = current_->calibration;
  if (frames.camera != known.camera_frame || frames.lidar != known.lidar_frame)
    throw Error(ErrorCause::kExtrinsic,
                "the frame ids changed: image '" + frames.camera + "', points '" + frames.lidar +
                    "', but the extrinsic belongs to '" + known.camera_frame + "' and '" + known.lidar_frame +
                    "'; run one node per camera, or set the parameters camera_frame and lidar_frame");
  return known.T_camera_lidar;
}

std::optional<StoredCalibration> ExtrinsicKeeper::current() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!current_) return std::nullopt;
  return current_->calibration;
}

std::string ExtrinsicKeeper::source() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return current_ ? current_->source : "none yet";
}

bool ExtrinsicKeeper::isFromTf() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return current_ && current_->from_tf;
}

bool ExtrinsicKeeper::takeChanged() {
  const std::lock_guard<std::mutex> lock(mutex_);
  return std::exchange(changed_, false);
}

std::string ExtrinsicKeeper::accept(const StoredCalibration& calibration) {
  const std::lock_guard<std::mutex> file_lock(file_mutex_);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    previous_ = std::move(current_);
    current_ = Entry{calibration,
                     "the recalibration with the frame stamped " + std::to_string(calibration.stamp), false};
    changed_ = true;
  }
  return writeResultFile(calibration);
}

bool ExtrinsicKeeper::restore(std::string& message) {
  const std::lock_guard<std::mutex> file_lock(file_mutex_);
  StoredCalibration calibration;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!previous_) {
      message = "nothing to restore: no result was accepted since the start or since the last restore";
      return false;
    }
    current_ = std::move(previous_);
    previous_.reset();
    changed_ = true;
    message = "back to the extrinsic from " + current_->source;
    calibration = current_->calibration;
  }
  // The rejected result must not come back as the first guess of the next start.
  const std::string problem = writeResultFile(calibration);
  if (!problem.empty()) message += "; " + problem;
  return true;
}

bool ExtrinsicKeeper::save(const std::string& path, const std::string& format, std::string& message) const {
  const std::optional<StoredCalibration> calibration = current();
  const std::string& file = path.empty() ? config_.result_file : path;
  if (!format.empty() && format != "yaml") {
    message = "unknown format '" + format + "'; known: yaml";
  } else if (file.empty()) {
    message = "no path given, and the parameter result_file is not set";
  } else if (!calibration) {
    message = "no extrinsic is known yet; ~state tells what is missing";
  } else {
    try {
      writeCalibration(file, *calibration);
      message = file;
      return true;
    } catch (const Error& e) {
      message = e.what();
    }
  }
  return false;
}

ExtrinsicKeeper::Entry ExtrinsicKeeper::firstGuess(const FrameIds& frames, const ros::Time& stamp) const {
  if (config_.initial_from_saved && !config_.result_file.empty()) {
    if (auto saved = readSaved(frames)) return *saved;
  }
  Entry entry;
  entry.calibration.camera_frame = frames.camera;
  entry.calibration.lidar_frame = frames.lidar;
  entry.calibration.stamp = stamp.toSec();
  if (config_.initial_T_camera_lidar) {
    entry.calibration.T_camera_lidar = *config_.initial_T_camera_lidar;
    entry.source = "the parameter initial/T_camera_lidar";
  } else {
    try {
      entry.calibration.T_camera_lidar = lookUp(tf_, frames.camera, frames.lidar, stamp);
    } catch (const Error& e) {
      throw Error(ErrorCause::kExtrinsic, std::string("no initial extrinsic: ") + e.what() +
                                              "; or give one as parameter or saved result");
    }
    entry.source = "tf ('" + frames.lidar + "' to '" + frames.camera + "')";
    entry.from_tf = true;
  }
  entry.calibration.source = name_;
  entry.calibration.reason = "initial extrinsic from " + entry.source;
  return entry;
}

std::optional<ExtrinsicKeeper::Entry> ExtrinsicKeeper::readSaved(const FrameIds& frames) const {
  if (!std::ifstream(config_.result_file)) {
    ROS_DEBUG_STREAM_NAMED(name_, name_ << ": there is no saved result " << config_.result_file << " yet");
    return std::nullopt;
  }
  try {
    Entry entry;
    entry.calibration = readCalibration(config_.result_file);
    StoredCalibration& saved = entry.calibration;
    const auto differs = [](const std::string& a, const std::string& b) { return !a.empty() && a != b; };
    if (differs(saved.camera_frame, frames.camera) || differs(saved.lidar_frame, frames.lidar))
      throw Error(ErrorCause::kFile, config_.result_file + " belongs to the frames '" + saved.lidar_frame +
                                         "' and '" + saved.camera_frame + "', not to '" + frames.lidar +
                                         "' and '" + frames.camera +
                                         "'; give each camera its own result_file");
    saved.camera_frame = frames.camera;
    saved.lidar_frame = frames.lidar;
    entry.source = "the saved result " + config_.result_file;
    return entry;
  } catch (const Error& e) {
    ROS_WARN_STREAM_NAMED(name_, name_ << ": saved result not used: " << e.what());
    return std::nullopt;
  }
}

std::string ExtrinsicKeeper::writeResultFile(const StoredCalibration& calibration) const {
  if (config_.result_file.empty()) return "";
  try {
    writeCalibration(config_.result_file, calibration);
    ROS_INFO_STREAM_NAMED(name_, name_ << ": extrinsic written to " << config_.result_file);
    return "";
  } catch (const Error& e) {
    ROS_ERROR_STREAM_NAMED(name_, name_ << ": result not written: " << e.what());
    return std::string("result file not written: ") + e.what();
  }
}

}  // namespace lidar_camera_recalibration

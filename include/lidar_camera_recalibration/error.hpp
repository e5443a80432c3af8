#pragma once

#include <stdexcept>
#include <string>

namespace lidar_camera_recalibration {

/// What kind of input was refused; the message says which one and what to do about it.
enum class ErrorCause {
  kCloud,      ///< a point cloud that cannot be used: empty, no xyz, unreadable layout
  kMasks,      ///< a mask image of the wrong size, type or content
  kImage,      ///< an image of the wrong size or encoding
  kCamera,     ///< intrinsics that describe no camera, or an unknown distortion model
  kExtrinsic,  ///< not a rigid transform, or none known
  kMotion,     ///< how the vehicle moved is not known
  kParameter,  ///< a parameter out of its range or of the wrong type
  kFile,       ///< a file that is missing, unreadable or malformed
  kNotEnough,  ///< too few frames, points or masks to calibrate from
};

/// The one exception type of the core. Thrown for bad input only; never for bugs.
class Error : public std::runtime_error {
 public:
  Error(ErrorCause cause, const std::string& what) : std::runtime_error(what), cause_(cause) {}
  ErrorCause cause() const noexcept { return cause_; }

 private:
  ErrorCause cause_;
};

}  // namespace lidar_camera_recalibration

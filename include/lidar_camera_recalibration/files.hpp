#pragma once

#include <string>

namespace lidar_camera_recalibration {

/// The whole of a calibration file.
/// @throw Error(kFile) with the system's reason, or because it is no regular file or larger than 1 MB.
std::string readCalibrationText(const std::string& path);

/// Writes to a temporary file beside it and renames, so that a reader never sees half a file.
/// @throw Error(kFile) with the system's reason; the old file is then untouched.
void writeFileAtomically(const std::string& path, const std::string& text);

}  // namespace lidar_camera_recalibration

#pragma once

#include <boost/program_options.hpp>
#include <string>

#include "lidar_camera_recalibration/calibration_formats.hpp"

namespace lidar_camera_recalibration {

/// `--camera-frame`, `--lidar-frame`, `--camera-in-file` and `--lidar-height`: what calibration files do not
/// tell.
void addCalibrationOptions(boost::program_options::options_description& options, FormatOptions& hints);

/// Reads `FILE` or `FILE:FORMAT`; what was taken for granted goes to stderr.
CalibrationContents readCalibrationArgument(const std::string& argument, FormatOptions hints);

/// The same of an argument that must have an extrinsic, or intrinsics. @throw Error(kFile)
StoredCalibration extrinsicArgument(const std::string& argument, const FormatOptions& hints);
CalibrationContents intrinsicsArgument(const std::string& argument, const FormatOptions& hints);

}  // namespace lidar_camera_recalibration

#include "calibration_options.hpp"

#include <cmath>
#include <iostream>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

void addCalibrationOptions(po::options_description& options, FormatOptions& hints) {
  const auto set_height = [&hints](double height) {
    if (!std::isfinite(height)) throw po::error("--lidar-height must be a finite number of metres");
    hints.lidar_height = height;
  };
  options.add_options()("camera-frame", po::value(&hints.camera_frame)->value_name("FRAME"),
                        "the camera's optical frame, where the input does not tell it or tells several")(
      "lidar-frame", po::value(&hints.lidar_frame)->value_name("FRAME"), "frame of the points, likewise")(
      "camera-in-file", po::value(&hints.camera)->value_name("NAME"),
      "which camera of the calibration file: KITTI's number (default 2), Kalibr's name (cam0)")(
      "lidar-height", po::value<double>()->notifier(set_height)->value_name("M"),
      "Autoware: frame of the points above the LiDAR's ..._base_link [m]; VLS-128: 0.06611");
}

CalibrationContents readCalibrationArgument(const std::string& argument, FormatOptions hints) {
  std::string path;
  splitFormat(argument, path, hints);
  CalibrationContents contents = readCalibrationFile(path, hints);
  for (const std::string& note : contents.notes) std::cerr << path << ": " << note << '\n';
  return contents;
}

StoredCalibration extrinsicArgument(const std::string& argument, const FormatOptions& hints) {
  const CalibrationContents contents = readCalibrationArgument(argument, hints);
  if (!contents.calibration)
    throw Error(ErrorCause::kFile, "calibration file '" + argument + "' holds intrinsics only, no extrinsic");
  return *contents.calibration;
}

CalibrationContents intrinsicsArgument(const std::string& argument, const FormatOptions& hints) {
  CalibrationContents contents = readCalibrationArgument(argument, hints);
  if (!contents.intrinsics)
    throw Error(ErrorCause::kFile,
                "calibration file '" + argument + "' holds an extrinsic only, no intrinsics");
  return contents;
}

}  // namespace lidar_camera_recalibration

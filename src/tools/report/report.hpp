#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/calibration_formats.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"

namespace lidar_camera_recalibration {

/// What became of an image whose masks came.
struct ImageRecord {
  double stamp = 0.0;  ///< [s]
  bool kept = false;
  std::string reason;  ///< why it was not
};

/// What a page about one calibration is made of.
struct ReportInput {
  CalibrationOutcome outcome;
  Frames frames;  ///< all that the search had, with their images, those left out included
  CalibratorConfig config;
  CalibrationContents contents;     ///< the result as it is written to files, with the frames' names
  FormatOptions hints;              ///< for the lines to paste
  std::vector<ImageRecord> images;  ///< in the order of their masks
  std::string given_up;             ///< what else was given up, by cause
  std::optional<Eigen::Isometry3d> reference;  ///< T_camera_lidar to compare with
};

/// One self-contained HTML page, pictures inside: shows at a glance whether to believe a result, and how to
/// use it. For screens of any width and for paper. The same input gives the same page.
/// @throw Error(kFile) if a picture cannot be encoded.
std::string reportHtml(const ReportInput& input);

}  // namespace lidar_camera_recalibration

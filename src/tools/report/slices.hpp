#pragma once

#include <string>

#include "report/report.hpp"

namespace lidar_camera_recalibration {

/// The score along the six axes of the optical frame around the result, as one inline SVG each, with the
/// result's standard deviation and where the start lies.
std::string sliceFigures(const ReportInput& input);

}  // namespace lidar_camera_recalibration

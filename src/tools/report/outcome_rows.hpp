#pragma once

#include <string>
#include <vector>

#include "report/report.hpp"

namespace lidar_camera_recalibration {

/// A condition of the acceptance gate.
struct CheckRow {
  std::string what, value, limit;
  bool passed = false;
};

/// A figure of the result.
struct NumberRow {
  std::string what, value;
};

/// Every condition of the gate (calibrator.cpp), in its order, with what the result has.
std::vector<CheckRow> gateRows(const CalibrationOutcome& outcome, const CalibratorConfig& config);

/// Every figure of the outcome.
std::vector<NumberRow> numberRows(const ReportInput& input);

}  // namespace lidar_camera_recalibration

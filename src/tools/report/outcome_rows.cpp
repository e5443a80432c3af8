#include "outcome_rows.hpp"

#include <cmath>

#include "html.hpp"

namespace lidar_camera_recalibration {
namespace {

std::string three(const Eigen::Vector3d& values, int digits, std::string (*text)(double, int)) {
  return text(values.x(), digits) + "  " + text(values.y(), digits) + "  " + text(values.z(), digits);
}

std::string axes(const Eigen::Vector3d& values, int digits) { return three(values, digits, signedFixed); }

std::string difference(const ExtrinsicError& error) {
  return fixed(error.angle() / kDegree, 3) + "\u00b0 (" + axes(error.rotation / kDegree, 3) + "), " +
         fixed(100.0 * error.distance(), 1) + " cm (" + axes(100.0 * error.translation, 1) + ")";
}

std::string score(const Score& before, const Score& after, double Score::*part) {
  return fixed(before.*part, 4) + " \u2192 " + fixed(after.*part, 4);
}

}  // namespace

std::vector<CheckRow> gateRows(const CalibrationOutcome& o, const CalibratorConfig& config) {
  std::vector<CheckRow> rows;
  for (const GateCheck& check : gateChecks(o, config))
    rows.push_back({check.what, check.measured, check.needed, check.passed});
  return rows;
}

std::vector<NumberRow> numberRows(const ReportInput& input) {
  const CalibrationOutcome& o = input.outcome;
  const ExtrinsicError moved = extrinsicError(o.T_camera_lidar, o.start);
  std::vector<NumberRow> rows = {
      {"Rotation from the start (x y z)",
       fixed(moved.angle() / kDegree, 3) + "\u00b0 (" + axes(moved.rotation / kDegree, 3) + ")"},
      {"Translation from the start (x y z)",
       fixed(100.0 * moved.distance(), 1) + " cm (" + axes(100.0 * moved.translation, 1) + ")"},
      {"Image shift at 10, 20, 40 m", fixed(o.pixel_shift[0], 1) + ", " + fixed(o.pixel_shift[1], 1) + ", " +
                                          fixed(o.pixel_shift[2], 1) + " px"}};
  if (o.covariance) {
    const Vector6d sigma = o.covariance->diagonal().cwiseSqrt();
    rows.push_back(
        {"\u03c3 of the rotation (x y z)", three(sigma.head<3>() / kDegree, 3, fixed) + " \u00b0"});
    rows.push_back({"\u03c3 of the translation (x y z)", three(100.0 * sigma.tail<3>(), 1, fixed) + " cm"});
  } else {
    rows.push_back({"\u03c3", "not known"});
  }
  rows.push_back({"Score", score(o.before, o.after, &Score::total)});
  if (input.config.objective.objective == "paper") {
    rows.push_back({"Reflectivity term", score(o.before, o.after, &Score::reflectivity)});
    rows.push_back({"Normal term", score(o.before, o.after, &Score::normal)});
    rows.push_back({"Segment term", score(o.before, o.after, &Score::segment)});
  } else {
    rows.push_back({"Edges on borders of masks", score(o.before, o.after, &Score::edges)});
    rows.push_back({"Information of masks about points", score(o.before, o.after, &Score::region)});
  }
  rows.push_back(
      {"Gain on unseen frames", fixed(o.unseen.gain, 4) + " \u00b1 " + fixed(o.unseen.gain_sigma, 4)});
  rows.push_back(
      {"Frames used, left out", std::to_string(o.frames) + ", " + std::to_string(o.left_out.size())});
  rows.push_back({"Masks, points of the frames used",
                  std::to_string(o.after.masks) + ", " + std::to_string(o.after.points)});
  rows.push_back({"Objective, search", input.config.objective.objective + ", " + input.config.search.search});
  rows.push_back({"Search range", "\u00b1" + fixed(input.config.range.rotation_deg, 1) + "\u00b0, \u00b1" +
                                      fixed(100.0 * input.config.range.translation_m, 0) + " cm"});
  rows.push_back({"Extrinsics scored", std::to_string(o.evaluations)});
  if (input.reference) {
    rows.push_back(
        {"Start, off the reference (x y z)", difference(extrinsicError(o.start, *input.reference))});
    rows.push_back({"Result, off the reference (x y z)",
                    difference(extrinsicError(o.T_camera_lidar, *input.reference))});
  }
  return rows;
}

}  // namespace lidar_camera_recalibration

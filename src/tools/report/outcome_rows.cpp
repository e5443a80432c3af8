#include "outcome_rows.hpp"

#include <cmath>

#include "html.hpp"

namespace lidar_camera_recalibration {
namespace {

std::string percent(double share) { return fixed(100.0 * share, 0) + " %"; }

double largestSigma(const Matrix6d& covariance, Eigen::Index first) {
  return std::sqrt(covariance.diagonal().segment<3>(first).maxCoeff());
}

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
  const GateConfig& gate = config.gate;
  const double gain = o.after.total - o.before.total;
  const double turn = log(o.T_camera_lidar * o.start.inverse()).head<3>().cwiseAbs().maxCoeff() / kDegree;
  std::vector<CheckRow> rows = {
      {"Masks that hold points", std::to_string(o.after.masks), "at least 1", o.after.masks > 0},
      {"Gain of the score", signedFixed(gain, 4), "at least " + fixed(gate.min_gain, 4),
       gain >= gate.min_gain},
      {"Largest turn about an axis", fixed(turn, 2) + "\u00b0",
       "inside of \u00b1" + fixed(config.range.rotation_deg, 1) + "\u00b0",
       turn <= 0.99 * config.range.rotation_deg},
      {"Frames that contradict the result", std::to_string(o.contradicting),
       "no more than the " + std::to_string(o.left_out.size()) + " left out",
       o.contradicting <= o.left_out.size()},
      {"Frames that score higher", percent(o.frame_agreement),
       "at least " + percent(gate.min_frame_agreement), o.frame_agreement >= gate.min_frame_agreement},
      {"Extrinsics around it that score worse", percent(o.validity), "at least " + percent(gate.min_validity),
       o.validity >= gate.min_validity}};
  if (o.distinctness)
    rows.push_back({"Stands out from the scores around it by", fixed(*o.distinctness, 1) + " \u03c3",
                    "at least " + fixed(gate.min_distinctness, 1) + " \u03c3",
                    *o.distinctness >= gate.min_distinctness});
  if (o.covariance) {
    const double rotation = largestSigma(*o.covariance, 0) / kDegree,
                 translation = largestSigma(*o.covariance, 3);
    rows.push_back({"Largest \u03c3 of a rotation", fixed(rotation, 3) + "\u00b0",
                    "at most " + fixed(gate.max_rotation_sigma_deg, 2) + "\u00b0",
                    rotation <= gate.max_rotation_sigma_deg});
    rows.push_back({"Largest \u03c3 of a translation", fixed(100.0 * translation, 1) + " cm",
                    "at most " + fixed(100.0 * gate.max_translation_sigma_m, 1) + " cm",
                    translation <= gate.max_translation_sigma_m});
  }
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
    rows.push_back({"\u03c3", "not known, fewer than 5 frames"});
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
  rows.push_back({"Validity", fixed(o.validity, 2)});
  if (o.distinctness) rows.push_back({"Distinctness", fixed(*o.distinctness, 1) + " \u03c3"});
  rows.push_back(
      {"Frames used, left out", std::to_string(o.frames) + ", " + std::to_string(o.left_out.size())});
  rows.push_back({"Frames that score higher", percent(o.frame_agreement)});
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

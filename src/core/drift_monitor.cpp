#include "lidar_camera_recalibration/drift_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>

#include "consistency_edges_objective.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

// From 0.2 on there are no false alarms yet, and 0.5 deg or 10 cm sideways are always found; from 0.5 on it
// is more likely than not (doc/accuracy.md, "Drift").
constexpr double kDoubtful = 0.2, kOff = 0.5;
// One frame alone raises false alarms in up to 10 % of cases.
constexpr std::size_t kMinFrames = 3;

/// Steps by twice and four times the tolerance, since the place two tolerances away is the better one when
/// the truth is more than one away. On each axis, on slanted axes, and along what moves the image alike.
std::vector<Eigen::Isometry3d> makePattern(const DriftConfig& config) {
  const std::vector<std::vector<int>> directions = {{0},    {1},    {2},       {3},    {4},    {5},   {0, 1},
                                                    {1, 2}, {0, 2}, {0, 1, 2}, {1, 3}, {0, 4}, {3, 4}};
  Vector6d tolerance;
  tolerance << Eigen::Vector3d::Constant(config.rotation_tolerance_deg * kDegree),
      Eigen::Vector3d::Constant(config.translation_tolerance_m);
  std::vector<Eigen::Isometry3d> pattern;
  for (const double size : {2.0, 4.0}) {
    for (const std::vector<int>& axes : directions) {
      const double share = size / std::sqrt(static_cast<double>(axes.size()));
      for (unsigned signs = 0; signs < 1u << axes.size(); ++signs) {
        Vector6d xi = Vector6d::Zero();
        for (std::size_t i = 0; i < axes.size(); ++i)
          xi[axes[i]] = (signs >> i & 1u ? share : -share) * tolerance[axes[i]];
        pattern.push_back(exp(xi));
      }
    }
  }
  return pattern;
}

/// Logistic model, fitted by scripts/fit_drift_monitor.py (see there) on the even frames of kitti_00 and of a
/// simulated drive (seed 5), for the default tolerances.
double probabilityOf(double statistic, std::size_t frames) {
  constexpr double kIntercept = -1.81, kSlope = 21.9, kSlopeOfFew = -7.1;
  const double slope = kSlope + kSlopeOfFew / std::sqrt(static_cast<double>(frames));
  return 1.0 / (1.0 + std::exp(-kIntercept - slope * statistic));
}

}  // namespace

DriftVerdict::State DriftVerdict::state() const {
  if (frames < kMinFrames) return State::kUnknown;
  return probability < kDoubtful ? State::kFits : probability < kOff ? State::kDoubtful : State::kOff;
}

DriftMonitor::DriftMonitor(const DriftConfig& config)
    : window_(static_cast<std::size_t>(std::max(0, config.window))), pattern_(makePattern(config)) {
  if (!(config.rotation_tolerance_deg > 0.0) || !(config.translation_tolerance_m > 0.0) || window_ == 0)
    throw Error(ErrorCause::kParameter, "monitor: tolerances and window must be above 0");
}

DriftMonitor::Scores DriftMonitor::score(const Evaluator& evaluator,
                                         const Eigen::Isometry3d& T_camera_lidar) const {
  const auto* const edges = dynamic_cast<const ConsistencyEdgesEvaluator*>(&evaluator);
  if (edges == nullptr || edges->edgeCount() == 0) return {};
  // As in the score of all frames together, each weighs by its edges.
  const auto weight = static_cast<double>(edges->edgeCount());
  const auto at = [&](const Eigen::Isometry3d& T) {
    return weight * edges->edgeScore(T, ConsistencyEdgesEvaluator::kScoreLevel);
  };
  Scores scores{at(T_camera_lidar)};
  for (const Eigen::Isometry3d& step : pattern_) scores.push_back(at(step * T_camera_lidar));
  return scores;
}

DriftVerdict DriftMonitor::add(const Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar,
                               bool keep) {
  Scores scores = score(evaluator, T_camera_lidar);
  if (scores.empty()) return {};
  const DriftVerdict alone = judge({scores});
  if (!keep) return alone;
  if (T_camera_lidar.matrix() != T_camera_lidar_.matrix()) reset();
  T_camera_lidar_ = T_camera_lidar;
  frames_.push_back(std::move(scores));
  if (frames_.size() > window_) frames_.pop_front();
  return alone;
}

DriftVerdict DriftMonitor::window(const Eigen::Isometry3d& T_camera_lidar) const {
  if (frames_.empty() || T_camera_lidar.matrix() != T_camera_lidar_.matrix()) return {};
  return judge({frames_.begin(), frames_.end()});
}

DriftVerdict DriftMonitor::judge(const std::vector<Scores>& frames) {
  if (frames.empty()) return {};
  Scores sums(frames.front().size(), 0.0);
  for (const Scores& frame : frames)
    std::transform(sums.begin(), sums.end(), frame.begin(), sums.begin(), std::plus<>());
  const double here = sums.front(), around = *std::max_element(sums.begin() + 1, sums.end());
  const double scale = std::abs(here) + std::abs(around);
  DriftVerdict verdict;
  verdict.frames = frames.size();
  verdict.statistic = scale > 0.0 ? (around - here) / scale : 0.0;
  verdict.probability = probabilityOf(verdict.statistic, verdict.frames);
  return verdict;
}

std::string describe(const DriftVerdict& verdict, const DriftConfig& config) {
  const auto state = verdict.state();
  if (state == DriftVerdict::State::kUnknown)
    return "too few frames have told yet whether the extrinsic fits";
  char text[200];
  std::snprintf(text, sizeof text,
                "%s: off by more than %g deg or %g m with a probability of %.0f %% (%zu frames)",
                state == DriftVerdict::State::kFits       ? "the extrinsic fits"
                : state == DriftVerdict::State::kDoubtful ? "the extrinsic may have drifted"
                                                          : "the extrinsic has drifted, recalibrate",
                config.rotation_tolerance_deg, config.translation_tolerance_m, 100.0 * verdict.probability,
                verdict.frames);
  return text;
}

}  // namespace lidar_camera_recalibration

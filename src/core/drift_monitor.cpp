#include "lidar_camera_recalibration/drift_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "consistency_edges_objective.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

// Above these probabilities an extrinsic is doubtful, and off.
constexpr double kDoubtful = 0.5, kOff = 0.9;

/// Perturbations by one, two and four times the tolerance: on each axis, and on pairs of axes that move
/// the image alike, so that one can hide the other, or that turn about a slanted axis.
std::vector<Eigen::Isometry3d> makePattern(const DriftConfig& config) {
  constexpr int kNone = -1;
  constexpr int kAxes[][2] = {{0, kNone}, {1, kNone}, {2, kNone}, {3, kNone}, {4, kNone}, {5, kNone},
                              {1, 3},     {0, 4},     {0, 1},     {1, 2},     {0, 2}};
  std::vector<Eigen::Isometry3d> pattern;
  for (const double size : {1.0, 2.0, 4.0}) {
    const auto step = [&](int axis) {
      return size * (axis < 3 ? config.rotation_tolerance_deg * kDegree : config.translation_tolerance_m);
    };
    for (const auto& [first, second] : kAxes) {
      for (const double a : {-1.0, 1.0}) {
        Vector6d xi = Vector6d::Zero();
        xi[first] = a * step(first);
        if (second == kNone) pattern.push_back(exp(xi));
        for (const double b : {-1.0, 1.0}) {
          if (second == kNone) break;
          xi[second] = b * step(second);
          pattern.push_back(exp(xi));
        }
      }
    }
  }
  return pattern;
}

/// Logistic model of the statistic; more frames make it steeper.
double probabilityOf(double statistic, std::size_t frames) {
  constexpr double kSlope = 30.0, kCentre = 0.1;
  return 1.0 / (1.0 + std::exp(-kSlope * std::sqrt(static_cast<double>(frames)) * (statistic - kCentre)));
}

}  // namespace

DriftVerdict::State DriftVerdict::state() const {
  if (frames == 0) return State::kUnknown;
  return probability < kDoubtful ? State::kFits : probability < kOff ? State::kDoubtful : State::kOff;
}

DriftMonitor::DriftMonitor(const DriftConfig& config)
    : window_(static_cast<std::size_t>(std::max(0, config.window))), pattern_(makePattern(config)) {
  if (!(config.rotation_tolerance_deg > 0.0) || !(config.translation_tolerance_m > 0.0) || window_ == 0)
    throw Error(ErrorCause::kParameter, "monitor: tolerances and window must be above 0");
}

DriftVerdict DriftMonitor::add(const Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar) {
  const auto* const edges = dynamic_cast<const ConsistencyEdgesEvaluator*>(&evaluator);
  if (edges == nullptr || edges->edgeCount() == 0) return {};
  if (T_camera_lidar.matrix() != T_camera_lidar_.matrix()) reset();
  T_camera_lidar_ = T_camera_lidar;
  // As in the score of all frames together, each weighs by its edges.
  const auto weight = static_cast<double>(edges->edgeCount());
  const auto score = [&](const Eigen::Isometry3d& T) {
    return weight * edges->edgeScore(T, ConsistencyEdgesEvaluator::kScoreLevel);
  };
  Scores scores{score(T_camera_lidar)};
  for (const Eigen::Isometry3d& perturbation : pattern_)
    scores.push_back(score(perturbation * T_camera_lidar));
  const DriftVerdict verdict = judge(scores, 1);
  frames_.push_back(std::move(scores));
  if (frames_.size() > window_) frames_.pop_front();
  return verdict;
}

DriftVerdict DriftMonitor::window(const Eigen::Isometry3d& T_camera_lidar) const {
  if (frames_.empty() || T_camera_lidar.matrix() != T_camera_lidar_.matrix()) return {};
  Scores sums(frames_.front().size(), 0.0);
  for (const Scores& frame : frames_)
    std::transform(sums.begin(), sums.end(), frame.begin(), sums.begin(), std::plus<>());
  return judge(sums, frames_.size());
}

DriftVerdict DriftMonitor::judge(const Scores& sums, std::size_t frames) {
  const double here = sums.front(), around = *std::max_element(sums.begin() + 1, sums.end());
  const double scale = std::abs(here) + std::abs(around);
  DriftVerdict verdict;
  verdict.frames = frames;
  verdict.statistic = scale > 0.0 ? (around - here) / scale : 0.0;
  verdict.probability = probabilityOf(verdict.statistic, frames);
  return verdict;
}

std::string describe(const DriftVerdict& verdict, const DriftConfig& config) {
  const auto state = verdict.state();
  if (state == DriftVerdict::State::kUnknown) return "no frame has told yet whether the extrinsic fits";
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

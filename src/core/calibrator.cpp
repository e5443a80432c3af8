#include "lidar_camera_recalibration/calibrator.hpp"

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {

namespace {

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// How far the result would move with other frames of the same kind: the scatter of independent refinements
/// on disjoint groups of frames, divided by the number of groups. Blind to an error that all frames share.
std::optional<Matrix6d> covarianceFromGroups(const Search& search, const Objective& objective,
                                             const Frames& frames, const Eigen::Isometry3d& result,
                                             const Progress& progress) {
  constexpr std::size_t kMinGroups = 4, kMaxGroups = 6;
  const std::size_t groups = std::min(frames.size(), kMaxGroups);
  if (groups < kMinGroups) return std::nullopt;
  std::vector<Vector6d> deviations;
  for (std::size_t g = 0; g < groups; ++g) {
    Frames group;
    for (std::size_t i = g; i < frames.size(); i += groups) group.push_back(frames[i]);
    const auto group_progress = [&](double fraction, double best) {
      return !progress || progress((static_cast<double>(g) + fraction) / static_cast<double>(groups), best);
    };
    const SearchResult refined = search.refine(objective, group, result, group_progress);
    if (refined.cancelled) return std::nullopt;
    deviations.push_back(log(refined.T_camera_lidar * result.inverse()));
  }
  Vector6d mean = Vector6d::Zero();
  for (const Vector6d& d : deviations) mean += d / static_cast<double>(groups);
  Matrix6d scatter = Matrix6d::Zero();
  for (const Vector6d& d : deviations) scatter += (d - mean) * (d - mean).transpose();
  return Matrix6d(scatter / static_cast<double>((groups - 1) * groups));
}

/// Share of the frames whose own score is higher at `b` than at `a`.
double frameAgreement(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& a,
                      const Eigen::Isometry3d& b) {
  std::size_t better = 0;
  for (const FramePtr& frame : frames) {
    const std::unique_ptr<Evaluator> evaluator = objective.evaluator({frame}, {a, b});
    better += (*evaluator)(b).total > (*evaluator)(a).total;
  }
  return static_cast<double>(better) / static_cast<double>(frames.size());
}

bool onBorder(const CalibrationOutcome& result, const SearchRange& range) {
  const Vector6d xi = log(result.T_camera_lidar * result.start.inverse());
  constexpr double kAlmost = 0.99;
  return xi.head<3>().cwiseAbs().maxCoeff() > kAlmost * range.rotation_deg * kDegree;
}

/// Sets accepted and reason.
void judge(CalibrationOutcome& result, const CalibratorConfig& config) {
  const GateConfig& gate = config.gate;
  const double gain = result.after.total - result.before.total;
  result.accepted = false;
  if (result.cancelled) {
    result.reason = "cancelled";
  } else if (result.after.masks == 0) {
    result.reason =
        "rejected: no LiDAR point falls into any mask; check the initial guess and the mask topic";
  } else if (!(gain >= gate.min_gain)) {
    result.reason = format(
        "rejected: the score rises by only %.4f (gate/min_gain is %.4f), so the extrinsic in use is as good",
        gain, gate.min_gain);
  } else if (onBorder(result, config.range)) {
    result.reason = format(
        "rejected: the best rotation lies on the border of the search range of %.1f deg; the truth may be "
        "outside of it",
        config.range.rotation_deg);
  } else if (result.frame_agreement < gate.min_frame_agreement) {
    result.reason =
        format("rejected: only %.0f %% of the frames score higher (gate/min_frame_agreement is %.0f %%)",
               100.0 * result.frame_agreement, 100.0 * gate.min_frame_agreement);
  } else if (result.validity < gate.min_validity) {
    result.reason = format(
        "rejected: %.0f %% of the extrinsics around the result score worse (gate/min_validity is %.0f %%): "
        "no clear optimum",
        100.0 * result.validity, 100.0 * gate.min_validity);
  } else {
    result.accepted = true;
    result.reason =
        format("accepted: the score rises from %.4f to %.4f, on %.0f %% of %zu frames", result.before.total,
               result.after.total, 100.0 * result.frame_agreement, result.frames);
  }
}

}  // namespace

double validityIndex(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar) {
  const double here = evaluator(T_camera_lidar).total;
  int worse = 0, count = 0;
  for (int axis = 0; axis < 6; ++axis) {
    const std::array<double, 2> steps =
        axis < 3 ? std::array<double, 2>{0.5 * kDegree, 1.0 * kDegree} : std::array<double, 2>{0.1, 0.2};
    for (const double step : steps) {
      for (const double sign : {-1.0, 1.0}) {
        Vector6d xi = Vector6d::Zero();
        xi[axis] = sign * step;
        worse += evaluator(exp(xi) * T_camera_lidar).total < here;
        ++count;
      }
    }
  }
  return static_cast<double>(worse) / count;
}

CalibrationOutcome calibrate(const Frames& frames, const Eigen::Isometry3d& start,
                             const CalibratorConfig& config, const Progress& progress) {
  if (frames.empty()) throw Error(ErrorCause::kNotEnough, "calibration: there is no frame");
  const auto begin = std::chrono::steady_clock::now();
  const std::unique_ptr<Objective> objective = makeObjective(config.objective);
  const std::unique_ptr<Search> search = makeSearch(config.search);

  // 1. The search itself takes most of the time.
  constexpr double kSearchShare = 0.8;
  const auto search_progress = [&](double fraction, double best) {
    return !progress || progress(kSearchShare * fraction, best);
  };
  const SearchResult found = search->run(*objective, frames, start, config.range, search_progress);
  CalibrationOutcome result;
  result.start = start;
  result.T_camera_lidar = found.T_camera_lidar;
  result.evaluations = found.evaluations;
  result.cancelled = found.cancelled;
  result.frames = frames.size();

  // 2. What it is worth, measured on the points that both extrinsics bring into the image.
  const std::unique_ptr<Evaluator> evaluator = objective->evaluator(frames, {start, result.T_camera_lidar});
  result.before = (*evaluator)(start);
  result.after = (*evaluator)(result.T_camera_lidar);
  if (!result.cancelled) {
    result.validity = validityIndex(*evaluator, result.T_camera_lidar);
    result.frame_agreement = frameAgreement(*objective, frames, start, result.T_camera_lidar);
    const auto covariance_progress = [&](double fraction, double best) {
      return !progress || progress(kSearchShare + (1.0 - kSearchShare) * fraction, best);
    };
    result.covariance =
        covarianceFromGroups(*search, *objective, frames, result.T_camera_lidar, covariance_progress);
  }
  const Intrinsics& camera = frames.front()->camera.intrinsics();
  for (std::size_t i = 0; i < kShiftDistances.size(); ++i) {
    result.pixel_shift[i] =
        pixelShift(start, result.T_camera_lidar, kShiftDistances[i], camera.fx, camera.width);
  }

  // 3. Whether it may be used.
  judge(result, config);
  result.duration = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

}  // namespace lidar_camera_recalibration

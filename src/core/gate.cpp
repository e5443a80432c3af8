#include "gate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace lidar_camera_recalibration {
namespace {

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[400];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// The same limit on the axes of rotation, and on those of translation. [rad, m]
Vector6d limits(double rotation_deg, double translation_m) {
  Vector6d result;
  result << Eigen::Vector3d::Constant(rotation_deg * kDegree), Eigen::Vector3d::Constant(translation_m);
  return result;
}

Vector6d sigmaLimits(const GateConfig& gate) {
  return limits(gate.max_rotation_sigma_deg, gate.max_translation_sigma_m);
}

/// Of each axis; by searches on parts of the frames where there is no covariance.
Vector6d sigmas(const CalibrationOutcome& result) {
  return result.covariance ? Vector6d(result.covariance->diagonal().cwiseSqrt()) : result.unseen.scatter;
}

/// "0.12 deg" or "0.034 m".
std::string amount(Eigen::Index axis, double value) {
  return axis < 3 ? format("%.2f deg", value / kDegree) : format("%.3f m", value);
}

const char* nameOf(Eigen::Index axis) {
  constexpr const char* kNames[] = {"rotation about x",    "rotation about y",    "rotation about z",
                                    "translation along x", "translation along y", "translation along z"};
  return kNames[axis];
}

/// Of the corrected axes the one where `values` is the largest share of `limits`.
Eigen::Index worstAxis(const CalibrationOutcome& result, const Vector6d& values, const Vector6d& limits) {
  Vector6d shares = values.cwiseAbs().cwiseQuotient(limits.cwiseMax(1e-12));
  for (Eigen::Index axis = 0; axis < 6; ++axis) {
    if (result.kept[static_cast<std::size_t>(axis)]) shares[axis] = -1.0;
  }
  Eigen::Index worst = 0;
  shares.maxCoeff(&worst);
  return worst;
}

bool allKept(const CalibrationOutcome& result) {
  return std::all_of(result.kept.begin(), result.kept.end(), [](bool kept) { return kept; });
}

std::string borderObjection(const CalibrationOutcome& result, const Vector6d& correction,
                            const SearchRange& range) {
  // Searches look a little further than the range, so that its outermost places are inside of what they see.
  constexpr double kBeyond = 1.05;
  const Vector6d reach = limits(range.rotation_deg, range.translation_m);
  const Vector6d sigma = sigmas(result);
  for (Eigen::Index axis = 0; axis < 6; ++axis) {
    const bool far = std::abs(correction[axis]) > reach[axis] + 3.0 * sigma[axis];
    const bool at_end = axis < 3 && std::abs(correction[axis]) > kBeyond * reach[axis];
    if (!far && !at_end) continue;
    return format(
        "the %s is corrected by %s, on the border of the search range of %s; the truth may be outside of it",
        nameOf(axis), amount(axis, std::abs(correction[axis])).c_str(), amount(axis, reach[axis]).c_str());
  }
  return "";
}

/// Whether the frames found a true optimum and agree on it.
std::string doubt(const CalibrationOutcome& result, const GateConfig& gate) {
  const UnseenEvidence& unseen = result.unseen;
  if (unseen.distinctness && !(*unseen.distinctness >= gate.min_distinctness)) {
    return format(
        "on frames that the search did not see the result stands out by only %.1f standard deviations of the "
        "scores "
        "around it (gate/min_distinctness is %.1f): it may be a wrong optimum; take more frames or a better "
        "start",
        *unseen.distinctness, gate.min_distinctness);
  }
  if (allKept(result)) {
    return format(
        "the frames determine no axis to %.2f deg or %.3f m (gate/max_rotation_sigma_deg, "
        "gate/max_translation_sigma_m); take more frames",
        gate.max_rotation_sigma_deg, gate.max_translation_sigma_m);
  }
  const Vector6d most = sigmaLimits(gate);
  const Eigen::Index worst = worstAxis(result, unseen.scatter, most);
  if (unseen.scatter[worst] > most[worst]) {
    return format(
        "searches on parts of the frames disagree: the standard deviation of the %s is %s (gate/max_%s is "
        "%s); take "
        "more frames or a better start",
        nameOf(worst), amount(worst, unseen.scatter[worst]).c_str(),
        worst < 3 ? "rotation_sigma_deg" : "translation_sigma_m", amount(worst, most[worst]).c_str());
  }
  return "";
}

/// Whether the start is worse than the result, beyond the noise of both.
std::string asGood(const CalibrationOutcome& result, const Vector6d& correction, const GateConfig& gate) {
  const UnseenEvidence& unseen = result.unseen;
  if (!(unseen.gain > 0.0 && unseen.gain >= gate.min_significance * unseen.gain_sigma &&
        result.after.total > result.before.total)) {
    return format(
        "on frames that the search did not see the score rises by %.4f +- %.4f, less than %.1f standard "
        "deviations "
        "(gate/min_significance), so the extrinsic in use is as good",
        unseen.gain, unseen.gain_sigma, gate.min_significance);
  }
  const Vector6d needed = (gate.min_significance * sigmas(result))
                              .cwiseMax(limits(gate.min_rotation_deg, gate.min_translation_m));
  const Eigen::Index most = worstAxis(result, correction, needed);
  if (std::abs(correction[most]) < needed[most]) {
    return format(
        "no axis is corrected by more than what it takes; most is the %s with %s of %s "
        "(gate/min_significance, "
        "gate/min_rotation_deg, gate/min_translation_m), so the extrinsic in use is as good",
        nameOf(most), amount(most, std::abs(correction[most])).c_str(), amount(most, needed[most]).c_str());
  }
  return "";
}

/// Why the result must not be used; empty if it may.
std::string objection(const CalibrationOutcome& result, const CalibratorConfig& config) {
  if (result.after.masks == 0) {
    return "no LiDAR point falls into any mask; check the initial guess and the mask topic";
  }
  const Vector6d correction = log(result.T_camera_lidar * result.start.inverse());
  std::string problem = borderObjection(result, correction, config.range);
  if (problem.empty()) problem = doubt(result, config.gate);
  if (problem.empty()) problem = asGood(result, correction, config.gate);
  return problem;
}

/// A part of the reason; empty if all axes were corrected.
std::string keptText(const CalibrationOutcome& result) {
  const Vector6d sigma = sigmas(result);
  std::string axes;
  for (Eigen::Index axis = 0; axis < 6; ++axis) {
    if (!result.kept[static_cast<std::size_t>(axis)]) continue;
    axes += format("%s%s (%s)", axes.empty() ? "" : ", ", nameOf(axis), amount(axis, sigma[axis]).c_str());
  }
  return axes.empty() ? "" : "; kept as it was, as the frames do not determine it: " + axes;
}

/// The end of the reason; empty if no frame was left out.
std::string leftOutText(const CalibrationOutcome& result) {
  constexpr std::size_t kNamed = 5;
  const std::size_t count = result.left_out.size(), given = result.frames + count;
  if (count == 0) return "";
  std::string stamps;
  for (std::size_t i = 0; i < std::min(count, kNamed); ++i) {
    stamps += (i == 0 ? "" : ", ") + format("%.2f", result.left_out_stamps[i]);
  }
  if (count > kNamed) stamps += ", ...";
  return count == 1
             ? format("; 1 of %zu frames was left out because it contradicts the others (stamp ", given) +
                   stamps + ")"
             : format("; %zu of %zu frames were left out because they contradict the others (stamps ", count,
                      given) +
                   stamps + ")";
}

}  // namespace

Determined keepUndetermined(const Eigen::Isometry3d& result, const Matrix6d& covariance,
                            const Eigen::Isometry3d& start, const GateConfig& config) {
  const Vector6d most = sigmaLimits(config);
  Determined determined{result, covariance, {}};
  Vector6d xi = log(result * start.inverse());
  Matrix6d& left = determined.covariance;  // of the axes not kept, given the values of the kept ones
  for (;;) {
    Vector6d shares = left.diagonal().cwiseSqrt().cwiseQuotient(most.cwiseMax(1e-12));
    for (std::size_t axis = 0; axis < 6; ++axis) {
      if (determined.kept[axis]) shares[static_cast<Eigen::Index>(axis)] = 0.0;
    }
    Eigen::Index worst = 0;
    if (shares.maxCoeff(&worst) <= 1.0) break;
    determined.kept[static_cast<std::size_t>(worst)] = true;
    const double variance = left(worst, worst);
    const Vector6d gain = left.col(worst) / variance;
    xi -= gain * xi[worst];
    left -= gain * gain.transpose() * variance;
    left.row(worst).setZero();
    left.col(worst).setZero();
    left(worst, worst) = covariance(worst, worst);
  }
  determined.T_camera_lidar = exp(xi) * start;
  return determined;
}

void judge(CalibrationOutcome& result, const CalibratorConfig& config) {
  result.accepted = false;
  result.reason = "cancelled";
  if (result.cancelled) return;
  const std::string problem = objection(result, config);
  result.accepted = problem.empty();
  result.reason =
      result.accepted
          ? format("accepted: on frames that the search did not see the score rises by %.4f +- %.4f",
                   result.unseen.gain, result.unseen.gain_sigma)
          : "rejected: " + problem;
  result.reason += keptText(result) + leftOutText(result);
}

}  // namespace lidar_camera_recalibration

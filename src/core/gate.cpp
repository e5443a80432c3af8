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

/// The rest of the parameter's name.
const char* limitOf(Eigen::Index axis) { return axis < 3 ? "rotation_sigma_deg" : "translation_sigma_m"; }

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

GateCheck masksCheck(const CalibrationOutcome& result) {
  return {"Masks that hold points", format("%zu", result.after.masks), "at least 1", result.after.masks > 0,
          "no LiDAR point falls into any mask; check the initial guess and the mask topic"};
}

GateCheck borderCheck(const CalibrationOutcome& result, const Vector6d& correction,
                      const SearchRange& range) {
  // Searches look a little further than the range, so that its outermost places are inside of what they see;
  // refinements move the translation as far as they like.
  constexpr double kBeyond = 1.05, kSigmas = 3.0;
  const Vector6d reach = limits(range.rotation_deg, range.translation_m);
  Vector6d most = reach + kSigmas * sigmas(result);
  most.head<3>() = most.head<3>().cwiseMin(kBeyond * reach.head<3>());
  const Eigen::Index worst = worstAxis(result, correction, most);
  const std::string moved = amount(worst, std::abs(correction[worst]));
  return {"Correction inside of the search range", std::string(nameOf(worst)) + " " + moved,
          "at most " + amount(worst, most[worst]), std::abs(correction[worst]) <= most[worst],
          format("the %s is corrected by %s, on the border of the search range of %s; the truth may be "
                 "outside of it",
                 nameOf(worst), moved.c_str(), amount(worst, reach[worst]).c_str())};
}

GateCheck distinctnessCheck(double distinctness, const GateConfig& gate) {
  return {"Stands out on unseen frames by", format("%.1f \u03c3", distinctness),
          format("at least %.1f \u03c3", gate.min_distinctness), distinctness >= gate.min_distinctness,
          format("on frames that the search did not see the result stands out by only %.1f standard "
                 "deviations of the "
                 "scores around it (gate/min_distinctness is %.1f): it may be a wrong optimum; take more "
                 "frames or a "
                 "better start",
                 distinctness, gate.min_distinctness)};
}

GateCheck determinedCheck(const CalibrationOutcome& result, const GateConfig& gate) {
  const Vector6d most = sigmaLimits(gate), sigma = sigmas(result);
  const Eigen::Index worst = worstAxis(result, sigma, most);
  const std::string known = amount(worst, sigma[worst]), needed = amount(worst, most[worst]);
  return {"Corrected axes are determined (\u03c3)", std::string(nameOf(worst)) + " " + known,
          "at most " + needed, sigma[worst] <= most[worst],
          format("the frames determine the %s to only %s (gate/max_%s is %s); take more frames",
                 nameOf(worst), known.c_str(), limitOf(worst), needed.c_str())};
}

GateCheck agreementCheck(const CalibrationOutcome& result, const GateConfig& gate) {
  const Vector6d most = sigmaLimits(gate), &scatter = result.unseen.scatter;
  const Eigen::Index worst = worstAxis(result, scatter, most);
  const std::string found = amount(worst, scatter[worst]), needed = amount(worst, most[worst]);
  return {
      "Parts of the frames agree (\u03c3)", std::string(nameOf(worst)) + " " + found, "at most " + needed,
      scatter[worst] <= most[worst],
      format(
          "searches on parts of the frames disagree: the standard deviation of the %s is %s (gate/max_%s is "
          "%s); take more frames or a better start",
          nameOf(worst), found.c_str(), limitOf(worst), needed.c_str())};
}

GateCheck gainCheck(const CalibrationOutcome& result, const GateConfig& gate) {
  const UnseenEvidence& unseen = result.unseen;
  const double needed = gate.min_significance * unseen.gain_sigma;
  return {
      "Gain of the score on unseen frames", format("%.4f", unseen.gain),
      format("at least %.1f \u03c3 = %.4f", gate.min_significance, needed),
      unseen.gain > 0.0 && unseen.gain >= needed && result.after.total > result.before.total,
      format("on frames that the search did not see the score rises by %.4f +- %.4f, less than %.1f standard "
             "deviations (gate/min_significance), so the extrinsic in use is as good",
             unseen.gain, unseen.gain_sigma, gate.min_significance)};
}

GateCheck correctionCheck(const CalibrationOutcome& result, const Vector6d& correction,
                          const GateConfig& gate) {
  const Vector6d needed = (gate.min_significance * sigmas(result))
                              .cwiseMax(limits(gate.min_rotation_deg, gate.min_translation_m));
  const Eigen::Index most = worstAxis(result, correction, needed);
  const std::string moved = amount(most, std::abs(correction[most])), least = amount(most, needed[most]);
  return {"Correction beyond its noise", std::string(nameOf(most)) + " " + moved, "at least " + least,
          std::abs(correction[most]) >= needed[most],
          format("no axis is corrected by more than what it takes; most is the %s with %s of %s "
                 "(gate/min_significance, gate/min_rotation_deg, gate/min_translation_m), so the extrinsic "
                 "in use is "
                 "as good",
                 nameOf(most), moved.c_str(), least.c_str())};
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
    shares.head<3>().setZero();
    for (std::size_t axis = 3; axis < 6; ++axis) {
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

std::vector<GateCheck> gateChecks(const CalibrationOutcome& result, const CalibratorConfig& config) {
  const GateConfig& gate = config.gate;
  const Vector6d correction = log(result.T_camera_lidar * result.start.inverse());
  std::vector<GateCheck> checks = {masksCheck(result), borderCheck(result, correction, config.range)};
  if (result.unseen.distinctness) checks.push_back(distinctnessCheck(*result.unseen.distinctness, gate));
  checks.push_back(determinedCheck(result, gate));
  checks.push_back(agreementCheck(result, gate));
  checks.push_back(gainCheck(result, gate));
  checks.push_back(correctionCheck(result, correction, gate));
  return checks;
}

void judge(CalibrationOutcome& result, const CalibratorConfig& config) {
  result.accepted = false;
  result.reason = "cancelled";
  if (result.cancelled) return;
  const std::vector<GateCheck> checks = gateChecks(result, config);
  const auto failed =
      std::find_if(checks.begin(), checks.end(), [](const GateCheck& check) { return !check.passed; });
  result.accepted = failed == checks.end();
  result.reason =
      result.accepted
          ? format("accepted: on frames that the search did not see the score rises by %.4f +- %.4f",
                   result.unseen.gain, result.unseen.gain_sigma)
          : "rejected: " + failed->objection;
  result.reason += keptText(result) + leftOutText(result);
}

}  // namespace lidar_camera_recalibration

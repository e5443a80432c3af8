#pragma once

#include <Eigen/Geometry>
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

/// When a result may replace the current extrinsic. In the result's own standard deviations where nothing
/// else is said.
struct GateConfig {
  /// The score must rise by so much on frames that the search did not see, and one axis at least must be
  /// corrected by so much.
  double min_significance = 2.0;
  double min_distinctness = 4.0;  ///< least UnseenEvidence::distinctness
  // One axis at least must be corrected by so much: wrong intrinsics or stamps make errors of this size that
  // no standard deviation knows of.
  double min_rotation_deg = 0.05;
  double min_translation_m = 0.02;
  // Largest standard deviations. An axis of the translation that is known less well keeps the value of the
  // start; parts of the frames must agree on the others to this.
  double max_rotation_sigma_deg = 0.3;
  double max_translation_sigma_m = 0.1;
};

struct CalibratorConfig {
  ObjectiveConfig objective;
  SearchConfig search;
  SearchRange range;
  GateConfig gate;
};

constexpr std::array<double, 3> kShiftDistances = {10.0, 20.0, 40.0};  ///< [m]

/// What frames say about results that were found without them: see crossValidate().
struct UnseenEvidence {
  double gain = 0.0, gain_sigma = 0.0;  ///< by how much the score rises over the start; mean over the frames
  /// By how many standard deviations of the scores around them (rotations by up to 4 deg on each axis) the
  /// results stand out, all frames together: chance reaches 2 to 3. Nothing if the objective is not peaked.
  std::optional<double> distinctness;
  /// Standard deviation of the result on each axis, from how far searches on parts of the frames disagree
  /// [rad, m]; half the difference if these are halves.
  Vector6d scatter = Vector6d::Zero();
};

struct CalibrationOutcome {
  /// What the search found, accepted or not; the start's values on the axes that are kept.
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d start = Eigen::Isometry3d::Identity();
  /// Covariance of the perturbation xi (see extrinsic.hpp) [rad^2, m^2], from refinements on parts of the
  /// frames (bootstrap or disjoint groups). Blind to an error that all frames share. Nothing below 5 frames
  /// with a random search.
  std::optional<Matrix6d> covariance;
  std::array<bool, 6> kept = {};  ///< axes of xi that the frames do not determine
  Score before, after;
  UnseenEvidence unseen;
  std::array<double, 3> pixel_shift = {0.0, 0.0, 0.0};  ///< between start and result at kShiftDistances [px]
  bool accepted = false;
  bool cancelled = false;
  std::string reason;                 ///< one sentence, also when accepted
  std::size_t frames = 0;             ///< used: those given but those left out
  std::vector<std::size_t> left_out;  ///< indices of the frames that contradict the others and were not used
  std::vector<double> left_out_stamps;  ///< of their images [s]
  std::size_t contradicting = 0;        ///< frames that contradict the result, those left out included
  std::size_t evaluations = 0;
  double duration = 0.0;  ///< wall time of the search [s]
};

/// One thing that a result is asked, for people.
struct GateCheck {
  std::string what, measured, needed;
  bool passed;
  std::string objection;  ///< a sentence without full stop, in case it is not passed
};

/// All that a result is asked, in the order in which it counts: the first one that it does not pass is the
/// reason of the rejection.
std::vector<GateCheck> gateChecks(const CalibrationOutcome& result, const CalibratorConfig& config);

/// Share of a fixed pattern of perturbations (+-0.5 and 1 deg, +-10 and 20 cm on each axis) that scores worse
/// than T: 1 at a clean optimum, about 0.5 at an arbitrary place.
double validityIndex(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar);

/// By how many standard deviations of the scores around it (rotations by up to 4 deg on each axis) T stands
/// out from them. A true optimum rises far above; wrong ones are merely the highest of many random ups and
/// downs.
double distinctness(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar);

/// Frames and a start become a judged result: search, consensus of the frames, covariance, cross-validation,
/// gate. Stateless; one call, one calibration.
/// @throw Error(kNotEnough) without frames, Error(kParameter) for a bad configuration.
CalibrationOutcome calibrate(const Frames& frames, const Eigen::Isometry3d& start,
                             const CalibratorConfig& config, const Progress& progress = nullptr);

}  // namespace lidar_camera_recalibration

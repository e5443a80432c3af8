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

/// When a result may replace the current extrinsic.
struct GateConfig {
  double min_gain = 0.002;            ///< the score must rise by this much ...
  double min_frame_agreement = 0.65;  ///< ... and on at least this share of the frames
  double min_validity = 0.7;          ///< share of perturbed extrinsics that must score worse than the result
  double min_distinctness = 4.0;      ///< least distinctness() of the result
  // Largest standard deviations of the result on any axis, where there is a covariance.
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

struct CalibrationOutcome {
  Eigen::Isometry3d T_camera_lidar =
      Eigen::Isometry3d::Identity();  ///< what the search found, accepted or not
  Eigen::Isometry3d start = Eigen::Isometry3d::Identity();
  /// Covariance of the perturbation xi (see extrinsic.hpp) [rad^2, m^2], from refinements on parts of
  /// the frames (bootstrap or disjoint groups); nothing below 5 frames. Blind to an error that all frames
  /// share.
  std::optional<Matrix6d> covariance;
  Score before, after;
  double validity = 0.0;               ///< share of small perturbations of the result that score worse, 0..1
  double frame_agreement = 0.0;        ///< share of the frames whose own score rose
  std::optional<double> distinctness;  ///< see distinctness(); nothing if the objective is not peaked
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

/// Share of a fixed pattern of perturbations (+-0.5 and 1 deg, +-10 and 20 cm on each axis) that scores worse
/// than T: 1 at a clean optimum, about 0.5 at an arbitrary place.
double validityIndex(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar, int threads = 1);

/// By how many standard deviations of the scores around it (rotations by up to 4 deg on each axis) T stands
/// out from them. A true optimum rises far above; wrong ones are merely the highest of many random ups and
/// downs.
double distinctness(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar, int threads = 1);

/// Frames and a start become a judged result: search, consensus of the frames, covariance, validity, gate.
/// Stateless; one call, one calibration.
/// @throw Error(kNotEnough) without frames, Error(kParameter) for a bad configuration.
CalibrationOutcome calibrate(const Frames& frames, const Eigen::Isometry3d& start,
                             const CalibratorConfig& config, const Progress& progress = nullptr);

}  // namespace lidar_camera_recalibration

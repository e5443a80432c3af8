#pragma once

#include <array>
#include <optional>

#include "evaluation/trials.hpp"

namespace lidar_camera_recalibration::evaluation {

constexpr double kSuccessRotation = 0.3;      ///< [deg]
constexpr double kSuccessTranslation = 0.05;  ///< [m]

/// One of the two errors over all trials of a cell; [deg] or [m].
struct ErrorFigures {
  double start_mean = 0.0;
  // Of the norm: rotation angle or distance.
  double mean = 0.0;  ///< what the paper calls L2
  double median = 0.0, p90 = 0.0;
  double huber = 0.0;  ///< see huberMean
  // Per axis x, y, z of the optical frame.
  std::array<double, 3> axis_mean{}, axis_mean_absolute{};
};

struct CellFigures {
  ErrorFigures rotation, translation;  ///< [deg], [m]
  double success = 0.0;                ///< share of the trials below both limits
  double accepted = 0.0;               ///< share of the trials, all runs of which the gate accepted
  double spoilt = 0.0;                 ///< share: accepted, and a larger shift in the image than at the start
  /// Root of the mean square of error / standard deviation, rx ry rz tx ty tz: 1 if the covariance is right.
  /// With Plan::halves the difference of both results against the sum of both covariances. Of the trials that
  /// have them.
  std::optional<std::array<double, 6>> normalised_error;
  double left_out = 0.0;     ///< frames of a run that contradict the others
  double evaluations = 0.0;  ///< extrinsics scored in a run
  double cpu_seconds = 0.0,
         preparation_seconds = 0.0;  ///< of a run, preparation included; of the preparation alone
  std::size_t refused = 0;           ///< frames, in all trials
};

CellFigures figuresOf(const Cell& cell);

bool accepted(const Trial& trial);

}  // namespace lidar_camera_recalibration::evaluation

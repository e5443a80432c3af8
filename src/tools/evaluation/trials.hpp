#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "evaluation/inputs.hpp"
#include "evaluation/methods.hpp"
#include "evaluation/starts.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration::evaluation {

constexpr int kAllFrames = 0;  ///< as a number of frames: all that can be used

/// Everything that is to be measured: each method with each number of frames from each start.
struct Plan {
  std::vector<Method> methods;
  std::vector<int> frame_counts;
  std::vector<Start> starts;
  int trials = 20;
  std::uint64_t seed = 1;
  /// Two disjoint sets of frames a trial, each with its own start; the two results are compared with each
  /// other instead of with the reference.
  bool halves = false;
  double range_rotation = 0.0, range_translation = 0.0;  ///< search range [deg], [m]; 0: as the start
  int threads = 1;                                       ///< does not change the results
};

/// One calibration.
struct Run {
  std::vector<std::string> frames;  ///< their names
  std::size_t refused = 0;          ///< frames that could not be prepared, others took their places
  CalibrationOutcome outcome;
  double preparation_seconds = 0.0, calibration_seconds = 0.0;  ///< CPU
};

struct Trial {
  std::vector<Run> runs;         ///< one, or two with Plan::halves
  ExtrinsicError start, result;  ///< against the reference; with Plan::halves of one run against the other
  double start_shift = 0.0, result_shift = 0.0;  ///< the same errors as pixelShift() at kErrorDistance [px]
};

constexpr double kErrorDistance = 10.0;  ///< [m]

/// One row of the table.
struct Cell {
  std::string method;
  int frames = 0;  ///< of a run; kAllFrames
  Start start;
  std::vector<Trial> trials;
};

/// Runs all trials and hands over each cell when it is complete. Trials of one number have the same start and
/// the same frames in all methods, and more frames contain the fewer; what is prepared around a start serves
/// all cells of this start. Results depend on the plan and the inputs only, not on the threads.
/// @throw Error(kNotEnough) if a trial finds too few usable frames
void runTrials(const Plan& plan, const std::vector<Input>& inputs, const Camera& camera,
               const Eigen::Isometry3d& reference, const std::function<void(const Cell&)>& done);

}  // namespace lidar_camera_recalibration::evaluation

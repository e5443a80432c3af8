#include "lidar_camera_recalibration/calibrator.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "confidence.hpp"
#include "consensus.hpp"
#include "cross_validation.hpp"
#include "gate.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "progress_part.hpp"

namespace lidar_camera_recalibration {

namespace {

/// The frames that agree, and the result refined on them.
Frames agreeingFrames(const Search& search, const Objective& objective, const Frames& frames,
                      CalibrationOutcome& result, int threads, const Progress& progress) {
  const Consensus consensus =
      findConsensus(search, objective, frames, result.T_camera_lidar, threads, progress);
  result.T_camera_lidar = consensus.T_camera_lidar;
  result.left_out = consensus.left_out;
  for (const std::size_t i : consensus.left_out) result.left_out_stamps.push_back(frames[i]->stamp);
  result.contradicting = consensus.contradicting;
  result.evaluations += consensus.evaluations;
  result.cancelled = consensus.cancelled;
  return without(frames, consensus.left_out);
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

  // 1. The search itself, on all frames.
  constexpr double kSearched = 0.4, kAgreed = 0.5, kResampled = 0.6;  // of the progress
  const SearchResult found =
      search->run(*objective, frames, start, config.range, partOf(progress, 0.0, kSearched));
  CalibrationOutcome result;
  result.start = start;
  result.T_camera_lidar = found.T_camera_lidar;
  result.evaluations = found.evaluations;
  result.cancelled = found.cancelled;

  // 2. Frames that contradict the others are left out.
  Frames used = frames;
  if (!result.cancelled) {
    used = agreeingFrames(*search, *objective, frames, result, config.search.threads,
                          partOf(progress, kSearched, kAgreed));
  }
  result.frames = used.size();

  // 3. How much it depends on the frames that it was given, and the mean over others like them.
  if (!result.cancelled) {
    const Resampling resampling = resample(*search, *objective, used, result.T_camera_lidar,
                                           config.search.threads, partOf(progress, kAgreed, kResampled));
    result.T_camera_lidar = resampling.T_camera_lidar;
    result.covariance = resampling.covariance;
    result.evaluations += resampling.evaluations;
    result.cancelled = resampling.cancelled;
  }

  // 4. Whether frames that a search did not see agree with what it found.
  const auto determined = [&start, &config, covariance = result.covariance](const Eigen::Isometry3d& T) {
    return covariance ? keepUndetermined(T, *covariance, start, config.gate) : Determined{T, {}, {}};
  };
  if (!result.cancelled) {
    const CrossValidation validation = crossValidate(
        *search, *objective, used, start, config.range, result.T_camera_lidar,
        [&](const Eigen::Isometry3d& T) { return determined(T).T_camera_lidar; }, config.search.threads,
        partOf(progress, kResampled, 1.0));
    result.unseen = validation.evidence;
    result.evaluations += validation.evaluations;
    result.cancelled = validation.cancelled;
  }

  // 5. What it is worth, measured on the points that both extrinsics bring into the image.
  if (result.covariance) {
    const Determined corrected = determined(result.T_camera_lidar);
    result.T_camera_lidar = corrected.T_camera_lidar;
    result.covariance = corrected.covariance;
    result.kept = corrected.kept;
  }
  const std::unique_ptr<Evaluator> evaluator = objective->evaluator(used, {start, result.T_camera_lidar});
  result.before = (*evaluator)(start);
  result.after = (*evaluator)(result.T_camera_lidar);
  const Intrinsics& camera = frames.front()->camera.intrinsics();
  for (std::size_t i = 0; i < kShiftDistances.size(); ++i) {
    result.pixel_shift[i] =
        pixelShift(start, result.T_camera_lidar, kShiftDistances[i], camera.fx, camera.width);
  }

  // 6. Whether it may be used.
  judge(result, config);
  result.duration = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

}  // namespace lidar_camera_recalibration

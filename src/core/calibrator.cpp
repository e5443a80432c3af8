#include "lidar_camera_recalibration/calibrator.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>

#include "confidence.hpp"
#include "consensus.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "parallel.hpp"
#include "progress_part.hpp"
#include "search_space.hpp"

namespace lidar_camera_recalibration {

namespace {

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// Share of the frames whose own score is higher at `b` than at `a`.
double frameAgreement(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& a,
                      const Eigen::Isometry3d& b, int threads) {
  std::atomic<std::size_t> better{0};
  parallelFor(frames.size(), static_cast<std::size_t>(threads), [&](std::size_t, std::size_t i) {
    const std::unique_ptr<Evaluator> evaluator = objective.evaluator({frames[i]}, {a, b});
    better += (*evaluator)(b).total > (*evaluator)(a).total;
  });
  return static_cast<double>(better) / static_cast<double>(frames.size());
}

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

bool onBorder(const CalibrationOutcome& result, const SearchRange& range) {
  const Vector6d xi = log(result.T_camera_lidar * result.start.inverse());
  constexpr double kAlmost = 0.99;
  return xi.head<3>().cwiseAbs().maxCoeff() > kAlmost * range.rotation_deg * kDegree;
}

/// The largest standard deviation of three neighbouring axes, the first of which is `axis`.
double largestSigma(const Matrix6d& covariance, Eigen::Index axis) {
  return std::sqrt(covariance.diagonal().segment<3>(axis).maxCoeff());
}

/// Why the result must not be used; empty if it may.
std::string objection(const CalibrationOutcome& result, const CalibratorConfig& config) {
  const GateConfig& gate = config.gate;
  const double gain = result.after.total - result.before.total;
  if (result.after.masks == 0) {
    return "no LiDAR point falls into any mask; check the initial guess and the mask topic";
  }
  if (!(gain >= gate.min_gain)) {
    return format("the score rises by only %.4f (gate/min_gain is %.4f), so the extrinsic in use is as good",
                  gain, gate.min_gain);
  }
  if (onBorder(result, config.range)) {
    return format(
        "the best rotation lies on the border of the search range of %.1f deg; the truth may be outside of "
        "it",
        config.range.rotation_deg);
  }
  if (result.contradicting > result.left_out.size()) {
    return format("%zu of %zu frames contradict the others, too many to leave them out", result.contradicting,
                  result.frames + result.left_out.size());
  }
  if (result.frame_agreement < gate.min_frame_agreement) {
    return format("only %.0f %% of the frames score higher (gate/min_frame_agreement is %.0f %%)",
                  100.0 * result.frame_agreement, 100.0 * gate.min_frame_agreement);
  }
  if (result.validity < gate.min_validity) {
    return format(
        "%.0f %% of the extrinsics around the result score worse (gate/min_validity is %.0f %%): no clear "
        "optimum",
        100.0 * result.validity, 100.0 * gate.min_validity);
  }
  if (result.distinctness && *result.distinctness < gate.min_distinctness) {
    return format(
        "the result stands out by only %.1f standard deviations of the scores around it "
        "(gate/min_distinctness is %.1f): it may be a wrong optimum; take more frames or a better start",
        *result.distinctness, gate.min_distinctness);
  }
  if (!result.covariance) return "";
  const double rotation = largestSigma(*result.covariance, 0) / kDegree,
               translation = largestSigma(*result.covariance, 3);
  if (rotation > gate.max_rotation_sigma_deg || translation > gate.max_translation_sigma_m) {
    return format(
        "the frames determine it to only %.2f deg and %.3f m (gate/max_rotation_sigma_deg is %.2f, "
        "gate/max_translation_sigma_m %.3f); take more frames",
        rotation, translation, gate.max_rotation_sigma_deg, gate.max_translation_sigma_m);
  }
  return "";
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

/// Sets accepted and reason.
void judge(CalibrationOutcome& result, const CalibratorConfig& config) {
  result.accepted = false;
  result.reason = "cancelled";
  if (result.cancelled) return;
  const std::string problem = objection(result, config);
  result.accepted = problem.empty();
  result.reason =
      result.accepted
          ? format("accepted: the score rises from %.4f to %.4f, on %.0f %% of %zu frames",
                   result.before.total, result.after.total, 100.0 * result.frame_agreement, result.frames)
          : "rejected: " + problem;
  result.reason += leftOutText(result);
}

}  // namespace

double validityIndex(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar, int threads) {
  std::vector<Eigen::Isometry3d> extrinsics{T_camera_lidar};
  for (int axis = 0; axis < 6; ++axis) {
    const std::array<double, 2> steps =
        axis < 3 ? std::array<double, 2>{0.5 * kDegree, 1.0 * kDegree} : std::array<double, 2>{0.1, 0.2};
    for (const double step : steps) {
      for (const double sign : {-1.0, 1.0}) {
        Vector6d xi = Vector6d::Zero();
        xi[axis] = sign * step;
        extrinsics.push_back(exp(xi) * T_camera_lidar);
      }
    }
  }
  const std::vector<Score> scores = evaluator.scores(extrinsics, threads);
  const auto worse = std::count_if(scores.begin() + 1, scores.end(),
                                   [&](const Score& score) { return score.total < scores.front().total; });
  return static_cast<double>(worse) / static_cast<double>(scores.size() - 1);
}

double distinctness(Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar, int threads) {
  constexpr int kSteps = 2;
  constexpr double kStep = 2.0 * kDegree;
  std::vector<Eigen::Isometry3d> extrinsics{T_camera_lidar};
  for (const Eigen::Isometry3d& T : rotationGrid(T_camera_lidar, kSteps, kStep)) {
    if (extrinsicError(T, T_camera_lidar).angle() < 0.5 * kStep) continue;  // the middle of the grid
    extrinsics.push_back(T);
  }
  const std::vector<Score> scores = evaluator.scores(extrinsics, threads);
  double sum = 0.0, squares = 0.0;
  for (std::size_t i = 1; i < scores.size(); ++i) {
    sum += scores[i].total;
    squares += scores[i].total * scores[i].total;
  }
  const auto count = static_cast<double>(scores.size() - 1);
  const double mean = sum / count, sigma = std::sqrt(std::max(0.0, squares / count - mean * mean));
  return sigma > 0.0 ? (scores.front().total - mean) / sigma : 0.0;
}

CalibrationOutcome calibrate(const Frames& frames, const Eigen::Isometry3d& start,
                             const CalibratorConfig& config, const Progress& progress) {
  if (frames.empty()) throw Error(ErrorCause::kNotEnough, "calibration: there is no frame");
  const auto begin = std::chrono::steady_clock::now();
  const std::unique_ptr<Objective> objective = makeObjective(config.objective);
  const std::unique_ptr<Search> search = makeSearch(config.search);

  // 1. The search itself, on all frames.
  constexpr double kSearched = 0.7, kAgreed = 0.85;  // of the progress
  const SearchResult found =
      search->run(*objective, frames, start, config.range, partOf(progress, 0.0, kSearched));
  CalibrationOutcome result;
  result.start = start;
  result.T_camera_lidar = found.T_camera_lidar;
  result.evaluations = found.evaluations;
  result.cancelled = found.cancelled;

  // 2. Frames that contradict the others are left out.
  Frames used = frames;
  if (!result.cancelled)
    used = agreeingFrames(*search, *objective, frames, result, config.search.threads,
                          partOf(progress, kSearched, kAgreed));
  result.frames = used.size();

  // 3. How much it depends on the frames that it was given, and the mean over others like them.
  if (!result.cancelled) {
    const Resampling resampling = resample(*search, *objective, used, result.T_camera_lidar,
                                           config.search.threads, partOf(progress, kAgreed, 1.0));
    result.T_camera_lidar = resampling.T_camera_lidar;
    result.covariance = resampling.covariance;
    result.evaluations += resampling.evaluations;
    result.cancelled = resampling.cancelled;
  }

  // 4. What it is worth, measured on the points that both extrinsics bring into the image.
  const std::unique_ptr<Evaluator> evaluator = objective->evaluator(used, {start, result.T_camera_lidar});
  result.before = (*evaluator)(start);
  result.after = (*evaluator)(result.T_camera_lidar);
  if (!result.cancelled) {
    result.validity = validityIndex(*evaluator, result.T_camera_lidar, config.search.threads);
    if (objective->isPeaked()) {
      const std::unique_ptr<Evaluator> around = objective->evaluator(used, {result.T_camera_lidar});
      result.distinctness = distinctness(*around, result.T_camera_lidar, config.search.threads);
    }
    result.frame_agreement =
        frameAgreement(*objective, used, start, result.T_camera_lidar, config.search.threads);
  }
  const Intrinsics& camera = frames.front()->camera.intrinsics();
  for (std::size_t i = 0; i < kShiftDistances.size(); ++i) {
    result.pixel_shift[i] =
        pixelShift(start, result.T_camera_lidar, kShiftDistances[i], camera.fx, camera.width);
  }

  // 5. Whether it may be used.
  judge(result, config);
  result.duration = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return result;
}

}  // namespace lidar_camera_recalibration

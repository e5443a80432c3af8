#include "evaluation/figures.hpp"

#include <algorithm>
#include <cmath>

#include "statistics.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

template <typename Value>
std::vector<double> collect(const Cell& cell, const Value& value) {
  std::vector<double> values;
  for (const Trial& trial : cell.trials) values.push_back(value(trial));
  return values;
}

template <typename Value>
double runMean(const Cell& cell, const Value& value) {
  std::vector<double> values;
  for (const Trial& trial : cell.trials) {
    for (const Run& run : trial.runs) values.push_back(value(run));
  }
  return mean(values);
}

/// @param part  the rotation or the translation of an ExtrinsicError
ErrorFigures errorFigures(const Cell& cell, Eigen::Vector3d ExtrinsicError::*part, double unit) {
  ErrorFigures figures;
  figures.start_mean =
      mean(collect(cell, [&](const Trial& trial) { return (trial.start.*part).norm() / unit; }));
  const std::vector<double> norms =
      collect(cell, [&](const Trial& trial) { return (trial.result.*part).norm() / unit; });
  figures.mean = mean(norms);
  figures.median = quantile(norms, 0.5);
  figures.p90 = quantile(norms, 0.9);
  figures.huber = huberMean(norms);
  for (int i = 0; i < 3; ++i) {
    std::vector<double> values =
        collect(cell, [&](const Trial& trial) { return (trial.result.*part)[i] / unit; });
    figures.axis_mean[i] = mean(values);
    for (double& value : values) value = std::abs(value);
    figures.axis_mean_absolute[i] = mean(values);
  }
  return figures;
}

/// Diagonal of the covariance of a trial's error: of its run, or the sum of both. Nothing if one has none.
std::optional<Vector6d> variances(const Trial& trial) {
  Vector6d sum = Vector6d::Zero();
  for (const Run& run : trial.runs) {
    if (!run.outcome.covariance) return std::nullopt;
    sum += run.outcome.covariance->diagonal();
  }
  return sum;
}

std::optional<std::array<double, 6>> normalisedError(const Cell& cell) {
  Vector6d sum = Vector6d::Zero();
  int count = 0;
  for (const Trial& trial : cell.trials) {
    const std::optional<Vector6d> variance = variances(trial);
    if (!variance) continue;
    Vector6d error;
    error << trial.result.rotation, trial.result.translation;
    sum += error.cwiseAbs2().cwiseQuotient(*variance);
    ++count;
  }
  if (count == 0) return std::nullopt;
  std::array<double, 6> figures{};
  for (std::size_t i = 0; i < 6; ++i) figures[i] = std::sqrt(sum[static_cast<Eigen::Index>(i)] / count);
  return figures;
}

bool succeeded(const Trial& trial) {
  return trial.result.angle() < kSuccessRotation * kDegree && trial.result.distance() < kSuccessTranslation;
}

}  // namespace

bool accepted(const Trial& trial) {
  return std::all_of(trial.runs.begin(), trial.runs.end(),
                     [](const Run& run) { return run.outcome.accepted; });
}

CellFigures figuresOf(const Cell& cell) {
  CellFigures figures;
  figures.rotation = errorFigures(cell, &ExtrinsicError::rotation, kDegree);
  figures.translation = errorFigures(cell, &ExtrinsicError::translation, 1.0);
  figures.success = mean(collect(cell, [](const Trial& trial) { return double(succeeded(trial)); }));
  figures.accepted = mean(collect(cell, [](const Trial& trial) { return double(accepted(trial)); }));
  figures.spoilt = mean(collect(cell, [](const Trial& trial) {
    return double(accepted(trial) && trial.result_shift > trial.start_shift);
  }));
  figures.normalised_error = normalisedError(cell);
  figures.left_out = runMean(cell, [](const Run& run) { return double(run.outcome.left_out.size()); });
  figures.evaluations = runMean(cell, [](const Run& run) { return double(run.outcome.evaluations); });
  figures.preparation_seconds = runMean(cell, [](const Run& run) { return run.preparation_seconds; });
  figures.cpu_seconds =
      figures.preparation_seconds + runMean(cell, [](const Run& run) { return run.calibration_seconds; });
  for (const Trial& trial : cell.trials) {
    for (const Run& run : trial.runs) figures.refused += run.refused;
  }
  return figures;
}

}  // namespace lidar_camera_recalibration::evaluation

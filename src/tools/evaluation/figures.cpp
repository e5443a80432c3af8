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

#include "evaluation/output.hpp"

#include <yaml-cpp/yaml.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <sstream>

#include "command_line.hpp"
#include "statistics.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

std::string frameText(int frames) { return frames == kAllFrames ? "all" : std::to_string(frames); }

// --- CSV ---

std::string text(double value) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.9g", value);
  return buffer;
}

/// In quotes, as reasons hold commas.
std::string inQuotes(const std::string& value) {
  std::string result = "\"";
  for (const char c : value) result += c == '"' ? "\"\"" : std::string(1, c);
  return result + '"';
}

/// Of the runs of a trial: one value, or the mean of two.
template <typename Value>
std::string runMean(const Trial& trial, const Value& value) {
  std::vector<double> values;
  for (const Run& run : trial.runs) values.push_back(value(run));
  return text(mean(values));
}

/// Of the runs of a trial, one after the other.
template <typename Value>
std::string joined(const Trial& trial, const Value& value) {
  std::string result;
  for (const Run& run : trial.runs) result += (result.empty() ? "" : " / ") + value(run);
  return inQuotes(result);
}

std::string frameNames(const Run& run) {
  std::string names;
  for (const std::string& name : run.frames) names += (names.empty() ? "" : " ") + name;
  return names;
}

/// Names of the axes that were left as they were.
std::string keptAxes(const Run& run) {
  const char* const names[] = {"rx", "ry", "rz", "tx", "ty", "tz"};
  std::string axes;
  for (std::size_t i = 0; i < 6; ++i) {
    if (run.outcome.kept[i]) axes += (axes.empty() ? "" : " ") + std::string(names[i]);
  }
  return axes;
}

struct Column {
  std::string name;
  std::function<std::string(const Cell&, std::size_t)> text;  ///< of the trial with this number
};

/// A column that does not depend on the cell.
template <typename Value>
Column ofTrial(const std::string& name, const Value& value) {
  return {name, [value](const Cell& cell, std::size_t number) { return value(cell.trials[number]); }};
}

/// A number of the outcome, see runMean.
template <typename Value>
Column ofRuns(const std::string& name, const Value& value) {
  return ofTrial(name, [value](const Trial& trial) { return runMean(trial, value); });
}

void addErrorColumns(const std::string& prefix, ExtrinsicError Trial::*error, std::vector<Column>& columns) {
  const char* const axes[] = {"x", "y", "z"};
  for (int i = 0; i < 3; ++i) {
    columns.push_back(ofTrial(prefix + "r" + axes[i] + "_deg", [=](const Trial& trial) {
      return text((trial.*error).rotation[i] / kDegree);
    }));
  }
  for (int i = 0; i < 3; ++i) {
    columns.push_back(ofTrial(prefix + "t" + axes[i] + "_m",
                              [=](const Trial& trial) { return text((trial.*error).translation[i]); }));
  }
  columns.push_back(ofTrial(prefix + "rotation_deg",
                            [=](const Trial& trial) { return text((trial.*error).angle() / kDegree); }));
  columns.push_back(
      ofTrial(prefix + "translation_m", [=](const Trial& trial) { return text((trial.*error).distance()); }));
}

/// Empty where a run has too few frames for a covariance.
void addSigmaColumns(std::vector<Column>& columns) {
  const char* const names[] = {"sigma_rx_deg", "sigma_ry_deg", "sigma_rz_deg",
                               "sigma_tx_m",   "sigma_ty_m",   "sigma_tz_m"};
  for (int i = 0; i < 6; ++i) {
    columns.push_back(ofTrial(names[i], [i](const Trial& trial) -> std::string {
      for (const Run& run : trial.runs) {
        if (!run.outcome.covariance) return "";
      }
      const double unit = i < 3 ? kDegree : 1.0;
      return runMean(trial,
                     [=](const Run& run) { return std::sqrt((*run.outcome.covariance)(i, i)) / unit; });
    }));
  }
}

/// By searches on parts of the frames.
void addScatterColumns(std::vector<Column>& columns) {
  const char* const names[] = {"scatter_rx_deg", "scatter_ry_deg", "scatter_rz_deg",
                               "scatter_tx_m",   "scatter_ty_m",   "scatter_tz_m"};
  for (int i = 0; i < 6; ++i) {
    const double unit = i < 3 ? kDegree : 1.0;
    columns.push_back(ofRuns(names[i], [=](const Run& run) { return run.outcome.unseen.scatter[i] / unit; }));
  }
}

std::vector<Column> makeColumns() {
  std::vector<Column> columns = {
      {"method", [](const Cell& cell, std::size_t) { return inQuotes(cell.method); }},
      {"frames", [](const Cell& cell, std::size_t) { return frameText(cell.frames); }},
      {"start", [](const Cell& cell, std::size_t) { return inQuotes(cell.start.name); }},
      {"trial", [](const Cell&, std::size_t number) { return std::to_string(number); }},
      ofTrial("frame_names", [](const Trial& trial) { return joined(trial, frameNames); }),
      ofRuns("frames_refused", [](const Run& run) { return double(run.refused); })};
  addErrorColumns("start_", &Trial::start, columns);
  addErrorColumns("", &Trial::result, columns);
  const std::vector<Column> others = {
      ofTrial("start_shift_px", [](const Trial& trial) { return text(trial.start_shift); }),
      ofTrial("shift_px", [](const Trial& trial) { return text(trial.result_shift); }),
      ofTrial("accepted", [](const Trial& trial) { return std::to_string(accepted(trial)); }),
      ofRuns("score_before", [](const Run& run) { return run.outcome.before.total; }),
      ofRuns("score_after", [](const Run& run) { return run.outcome.after.total; }),
      ofRuns("unseen_gain", [](const Run& run) { return run.outcome.unseen.gain; }),
      ofRuns("unseen_gain_sigma", [](const Run& run) { return run.outcome.unseen.gain_sigma; }),
      ofRuns("distinctness", [](const Run& run) { return run.outcome.unseen.distinctness.value_or(-1.0); }),
      ofTrial("kept", [](const Trial& trial) { return joined(trial, keptAxes); }),
      ofRuns("left_out", [](const Run& run) { return double(run.outcome.left_out.size()); }),
      ofRuns("contradicting", [](const Run& run) { return double(run.outcome.contradicting); })};
  columns.insert(columns.end(), others.begin(), others.end());
  addSigmaColumns(columns);
  addScatterColumns(columns);
  columns.push_back(ofRuns("evaluations", [](const Run& run) { return double(run.outcome.evaluations); }));
  columns.push_back(ofTrial("reason", [](const Trial& trial) {
    return joined(trial, [](const Run& run) { return run.outcome.reason; });
  }));
  // Last, as they are the only ones that differ from call to call.
  columns.push_back(ofRuns("cpu_preparation_s", [](const Run& run) { return run.preparation_seconds; }));
  columns.push_back(ofRuns("cpu_calibration_s", [](const Run& run) { return run.calibration_seconds; }));
  return columns;
}

// --- JSON ---

void emitErrors(YAML::Emitter& out, const char* key, const ErrorFigures& figures) {
  out << YAML::Key << key << YAML::Value << YAML::BeginMap;
  const std::vector<std::pair<const char*, double>> values = {{"mean", figures.mean},
                                                              {"median", figures.median},
                                                              {"p90", figures.p90},
                                                              {"huber", figures.huber},
                                                              {"start_mean", figures.start_mean}};
  for (const auto& [name, value] : values) out << YAML::Key << name << YAML::Value << value;
  for (const auto& [name, axes] : {std::pair("axis_mean_absolute", &figures.axis_mean_absolute),
                                   std::pair("axis_mean", &figures.axis_mean)}) {
    out << YAML::Key << name << YAML::Value << YAML::BeginSeq;
    for (const double value : *axes) out << value;
    out << YAML::EndSeq;
  }
  out << YAML::EndMap;
}

/// Left out where no trial has a covariance: yaml-cpp's null is no JSON.
void emitNormalisedErrors(YAML::Emitter& out, const CellFigures& figures) {
  if (!figures.normalised_error) return;
  out << YAML::Key << "normalised_error_rms" << YAML::Value << YAML::BeginSeq;
  for (const double value : *figures.normalised_error) out << value;
  out << YAML::EndSeq;
}

void emitCell(YAML::Emitter& out, const Cell& cell) {
  const CellFigures figures = figuresOf(cell);
  out << YAML::BeginMap;
  out << YAML::Key << "method" << YAML::Value << cell.method;
  out << YAML::Key << "frames" << YAML::Value << frameText(cell.frames);
  out << YAML::Key << "start" << YAML::Value << cell.start.name;
  emitErrors(out, "rotation_deg", figures.rotation);
  emitErrors(out, "translation_m", figures.translation);
  const std::vector<std::pair<const char*, double>> values = {
      {"success_rate", figures.success},
      {"accepted_rate", figures.accepted},
      {"spoilt_rate", figures.spoilt},
      {"evaluations_per_run", figures.evaluations},
      {"cpu_seconds_per_run", figures.cpu_seconds},
      {"cpu_seconds_preparation", figures.preparation_seconds},
      {"left_out_per_run", figures.left_out},
      {"frames_refused", double(figures.refused)}};
  for (const auto& [name, value] : values) out << YAML::Key << name << YAML::Value << value;
  emitNormalisedErrors(out, figures);
  out << YAML::EndMap;
}

// --- table ---

void printErrors(const ErrorFigures& figures, double scale, int digits) {
  for (const double value : {figures.mean, figures.median, figures.p90, figures.huber})
    std::printf(" %6.*f", digits, scale * value);
  std::printf(" ");
  for (const double value : figures.axis_mean_absolute) std::printf(" %5.*f", digits - 1, scale * value);
}

}  // namespace

void printHead(const Plan& plan, const Circumstances& circumstances) {
  const InputChoice& choice = circumstances.choice;
  const std::string frames = choice.frame_set == "all" ? "all frames" : "the " + choice.frame_set + " frames";
  const std::string rings =
      choice.every_ring == 1 ? "" : ", one of " + std::to_string(choice.every_ring) + " rings";
  std::printf("%s dataset %s, %s%s; %d trials a row, seed %llu\n", circumstances.layout.c_str(),
              circumstances.folder.c_str(), frames.c_str(), rings.c_str(), plan.trials,
              static_cast<unsigned long long>(plan.seed));
  if (plan.halves)
    std::printf("disjoint sets of frames: errors are differences between the results of both\n");
  std::printf("\n%-20s %6s %-10s |%35s%-11s |%35s%-11s |\n", "", "", "", "rotation [deg]", "",
              "translation [cm]", "");
  std::printf("%-20s %6s %-10s |", "method", "frames", "start");
  for (int part = 0; part < 2; ++part)
    std::printf(" %6s %6s %6s %6s  %5s %5s %5s |", "mean", "median", "p90", "Huber", "|x|", "|y|", "|z|");
  std::printf(" success accepted spoilt scored CPU [s]\n");
  std::fflush(stdout);
}

void printRow(const Cell& cell) {
  const CellFigures figures = figuresOf(cell);
  std::printf("%-20s %6s %-10s |", cell.method.c_str(), frameText(cell.frames).c_str(),
              cell.start.name.c_str());
  printErrors(figures.rotation, 1.0, 3);
  std::printf(" |");
  printErrors(figures.translation, 100.0, 2);
  std::printf(" | %5.1f %% %6.1f %% %4.0f %% %6.0f %7.2f\n", 100.0 * figures.success,
              100.0 * figures.accepted, 100.0 * figures.spoilt, figures.evaluations, figures.cpu_seconds);
  if (figures.normalised_error) {
    std::printf("%-20s rms of error / standard deviation, rx ry rz tx ty tz:", "");
    for (const double value : *figures.normalised_error) std::printf(" %.2f", value);
    std::printf("\n");
  }
  if (figures.left_out > 0.0) std::printf("%-20s frames left out in a run: %.2f\n", "", figures.left_out);
  if (figures.refused > 0) std::printf("%-20s frames refused: %zu\n", "", figures.refused);
  std::fflush(stdout);
}

void printLegend(const Plan& plan) {
  std::printf(
      "\nErrors %s; rejected results count with what the search found. mean (the paper's L2), median, p90\n"
      "and Huber (M-estimate of location, limit 1.345 robust standard deviations) are of the norm; |x| |y| "
      "|z| are mean\n"
      "absolute errors on the axes of the optical frame, x right, y down, z forward. Success: < %g deg and < "
      "%g cm.\n"
      "Spoilt: accepted although the image at %g m moves further from the reference than at the start. "
      "Scored:\n"
      "extrinsics in a run. CPU: of a run, %s included.\n",
      plan.halves ? "of one result against the other" : "against the dataset's reference", kSuccessRotation,
      100.0 * kSuccessTranslation, kErrorDistance, "preparation of its frames");
}

std::string toCsv(const std::vector<Cell>& cells) {
  const std::vector<Column> columns = makeColumns();
  std::ostringstream out;
  for (std::size_t i = 0; i < columns.size(); ++i) out << (i == 0 ? "" : ",") << columns[i].name;
  out << '\n';
  for (const Cell& cell : cells) {
    for (std::size_t number = 0; number < cell.trials.size(); ++number) {
      for (std::size_t i = 0; i < columns.size(); ++i)
        out << (i == 0 ? "" : ",") << columns[i].text(cell, number);
      out << '\n';
    }
  }
  return out.str();
}

std::string toJson(const Plan& plan, const Circumstances& circumstances, const std::vector<Cell>& cells) {
  YAML::Emitter out;
  useJson(out);
  out << YAML::BeginMap;
  out << YAML::Key << "dataset" << YAML::Value << circumstances.folder;
  out << YAML::Key << "layout" << YAML::Value << circumstances.layout;
  out << YAML::Key << "frame_set" << YAML::Value << circumstances.choice.frame_set;
  out << YAML::Key << "every_ring" << YAML::Value << circumstances.choice.every_ring;
  out << YAML::Key << "trials" << YAML::Value << plan.trials;
  out << YAML::Key << "seed" << YAML::Value << plan.seed;
  out << YAML::Key << "halves" << YAML::Value << plan.halves;
  out << YAML::Key << "cells" << YAML::Value << YAML::BeginSeq;
  for (const Cell& cell : cells) emitCell(out, cell);
  out << YAML::EndSeq << YAML::EndMap;
  return out.c_str();
}

}  // namespace lidar_camera_recalibration::evaluation

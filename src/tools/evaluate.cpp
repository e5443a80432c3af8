// Monte-Carlo evaluation of a method on a dataset with a reference extrinsic.

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <iostream>
#include <mutex>
#include <numeric>
#include <sstream>
#include <thread>

#include "command_line.hpp"
#include "dataset.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "parallel.hpp"
#include "parameters.hpp"
#include "perturbation.hpp"
#include "statistics.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

constexpr double kSuccessRotation = 0.3;      ///< [deg]
constexpr double kSuccessTranslation = 0.05;  ///< [m]

struct Options {
  std::string folder, method, frame_set = "all", csv, json, config;
  std::vector<std::string> assignments;
  int frames = 5, trials = 20, threads = 0;
  double start_rotation = 2.5, start_translation = 0.1;  ///< [deg], [m]
  double range_rotation = 0.0, range_translation = 0.0;  ///< [deg], [m]; 0: as the start
  std::uint64_t seed = 1;
};

/// A frame as it comes from the disk; prepared anew in each trial.
struct Input {
  std::string name;
  double stamp;  ///< [s]
  cv::Mat image;
  std::vector<cv::Mat> layers;
  PointCloud cloud;
};

struct Trial {
  std::vector<std::string> frames;
  std::size_t refused = 0;  ///< frames that could not be prepared, others took their places
  ExtrinsicError start, result;
  CalibrationOutcome outcome;
  double preparation_seconds = 0.0;  ///< CPU
};

struct Evaluation {
  std::vector<Trial> trials;
  double cpu_seconds = 0.0;  ///< of all trials
};

std::vector<Input> readInputs(const Dataset& dataset, const std::string& frame_set) {
  std::vector<Input> inputs;
  ProgressBar progress;
  for (std::size_t i = 0; i < dataset.size(); ++i) {
    if ((frame_set == "even" && i % 2 != 0) || (frame_set == "odd" && i % 2 == 0)) continue;
    progress.show("reading frames", double(i) / double(dataset.size()));
    inputs.push_back(
        {dataset.name(i), dataset.stamp(i), dataset.image(i), dataset.maskLayers(i), dataset.cloud(i)});
    if (inputs.back().layers.empty()) {
      throw Error(ErrorCause::kMasks, "frame " + dataset.name(i) +
                                          " has no masks; make them and put them into masks/" +
                                          dataset.name(i) + "/");
    }
  }
  progress.show("reading frames", 1.0);
  return inputs;
}

double threadCpuSeconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Takes frames in a random order until `count` could be prepared around the start, as the node would.
Frames prepareFrames(const std::vector<Input>& inputs, const Camera& camera, const Eigen::Isometry3d& start,
                     const FrameConfig& config, std::size_t count, std::mt19937_64& random, Trial& trial) {
  std::vector<std::size_t> order(inputs.size());
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), random);
  Frames frames;
  std::string problem;
  for (std::size_t i = 0; i < order.size() && frames.size() < count; ++i) {
    const Input& input = inputs[order[i]];
    try {
      frames.push_back(makeFrame(input.stamp, camera, input.image, input.layers, input.cloud, start, config));
      trial.frames.push_back(input.name);
    } catch (const Error& error) {
      ++trial.refused;
      problem = input.name + ": " + error.what();
    }
  }
  if (frames.size() < count) {
    throw Error(ErrorCause::kNotEnough, "only " + std::to_string(frames.size()) + " of " +
                                            std::to_string(count) + " frames could be used" +
                                            (problem.empty() ? "" : "; " + problem));
  }
  return frames;
}

Trial runTrial(const Options& options, const std::vector<Input>& inputs, const Dataset& dataset,
               const Camera& camera, const ServerConfig& config, std::uint64_t number) {
  // Each trial has its own sequence, so trials may run in any order and on any number of threads.
  std::seed_seq seed{options.seed, number};
  std::mt19937_64 random(seed);
  const Eigen::Isometry3d& reference = *dataset.reference();
  const Eigen::Isometry3d start =
      perturbedWithin(reference, options.start_rotation * kDegree, options.start_translation, random);
  Trial trial;
  const double before = threadCpuSeconds();
  const Frames frames = prepareFrames(inputs, camera, start, config.frame,
                                      static_cast<std::size_t>(options.frames), random, trial);
  trial.preparation_seconds = threadCpuSeconds() - before;
  trial.outcome = calibrate(frames, start, config.calibrator);
  trial.start = extrinsicError(start, reference);
  trial.result = extrinsicError(trial.outcome.T_camera_lidar, reference);
  return trial;
}

Evaluation runTrials(const Options& options, const std::vector<Input>& inputs, const Dataset& dataset,
                     ServerConfig config) {
  const int threads =
      options.threads > 0 ? options.threads : std::max(1, int(std::thread::hardware_concurrency()));
  const int workers = std::min(threads, options.trials);
  config.calibrator.search.threads = std::max(1, threads / workers);
  const Camera camera(dataset.intrinsics());
  Evaluation evaluation;
  evaluation.trials.resize(static_cast<std::size_t>(options.trials));
  std::size_t done = 0;
  std::mutex mutex;
  std::exception_ptr problem;
  std::atomic<bool> failed{false};
  ProgressBar progress;
  progress.show("trials", 0.0);
  const std::clock_t cpu_before = std::clock();
  parallelFor(evaluation.trials.size(), static_cast<std::size_t>(workers), [&](std::size_t, std::size_t i) {
    if (failed) return;
    try {
      evaluation.trials[i] = runTrial(options, inputs, dataset, camera, config, i);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex);
      problem = std::current_exception();
      failed = true;
    }
    const std::lock_guard<std::mutex> lock(mutex);
    progress.show("trials", double(++done) / double(options.trials));
  });
  if (problem) std::rethrow_exception(problem);
  evaluation.cpu_seconds = double(std::clock() - cpu_before) / CLOCKS_PER_SEC;
  return evaluation;
}

// --- figures ---

template <typename Value>
std::vector<double> collect(const Evaluation& evaluation, const Value& value) {
  std::vector<double> values;
  for (const Trial& trial : evaluation.trials) values.push_back(value(trial));
  return values;
}

/// One of the two errors, in the unit in which it is shown.
struct Errors {
  std::vector<double> start, norm;
  std::array<std::vector<double>, 3> axis;  ///< signed, x y z of the optical frame
};

Errors rotationErrors(const Evaluation& evaluation) {
  Errors errors;
  errors.start = collect(evaluation, [](const Trial& trial) { return trial.start.angle() / kDegree; });
  errors.norm = collect(evaluation, [](const Trial& trial) { return trial.result.angle() / kDegree; });
  for (int i = 0; i < 3; ++i) {
    errors.axis[i] =
        collect(evaluation, [i](const Trial& trial) { return trial.result.rotation[i] / kDegree; });
  }
  return errors;
}

Errors translationErrors(const Evaluation& evaluation) {
  Errors errors;
  errors.start = collect(evaluation, [](const Trial& trial) { return trial.start.distance(); });
  errors.norm = collect(evaluation, [](const Trial& trial) { return trial.result.distance(); });
  for (int i = 0; i < 3; ++i) {
    errors.axis[i] = collect(evaluation, [i](const Trial& trial) { return trial.result.translation[i]; });
  }
  return errors;
}

double meanAbsolute(std::vector<double> values) {
  for (double& value : values) value = std::abs(value);
  return mean(values);
}

double successRate(const Evaluation& evaluation) {
  return mean(collect(evaluation, [](const Trial& trial) {
    return double(trial.result.angle() < kSuccessRotation * kDegree &&
                  trial.result.distance() < kSuccessTranslation);
  }));
}

double acceptedRate(const Evaluation& evaluation) {
  return mean(collect(evaluation, [](const Trial& trial) { return double(trial.outcome.accepted); }));
}

double meanEvaluations(const Evaluation& evaluation) {
  return mean(collect(evaluation, [](const Trial& trial) { return double(trial.outcome.evaluations); }));
}

double meanPreparation(const Evaluation& evaluation) {
  return mean(collect(evaluation, [](const Trial& trial) { return trial.preparation_seconds; }));
}

double cpuSecondsPerRun(const Evaluation& evaluation) {
  return evaluation.cpu_seconds / double(evaluation.trials.size());
}

// --- output ---

void printErrors(const char* label, const char* unit, const Errors& errors, double scale) {
  std::printf("%-12s %-4s", label, unit);
  for (const double value : {mean(errors.start), mean(errors.norm), quantile(errors.norm, 0.5),
                             quantile(errors.norm, 0.9), huberMean(errors.norm)}) {
    std::printf(" %8.3f", scale * value);
  }
  for (const auto& axis : errors.axis)
    std::printf(" %7.3f (%+.3f)", scale * meanAbsolute(axis), scale * mean(axis));
  std::printf("\n");
}

void print(const Options& options, const Dataset& dataset, const Evaluation& evaluation) {
  const std::size_t refused = static_cast<std::size_t>(std::lround(
      options.trials * mean(collect(evaluation, [](const Trial& trial) { return double(trial.refused); }))));
  std::printf("method %s on a %s dataset, %d frames a trial (of %s), %d trials, seed %llu\n",
              options.method.c_str(), dataset.layout().c_str(), options.frames,
              options.frame_set == "all" ? "all" : ("the " + options.frame_set + " ones").c_str(),
              options.trials, static_cast<unsigned long long>(options.seed));
  std::printf("start: uniform in +-%g deg and +-%g m on each axis\n\n", options.start_rotation,
              options.start_translation);
  std::printf("%-17s %8s %8s %8s %8s %8s   %s\n", "", "start", "mean=L2", "median", "p90", "Huber",
              "mean absolute error (mean error) about/along x, y, z");
  printErrors("rotation", "deg", rotationErrors(evaluation), 1.0);
  printErrors("translation", "cm", translationErrors(evaluation), 100.0);
  std::printf("\nsuccess (< %g deg and < %g cm): %.1f %%\n", kSuccessRotation, 100.0 * kSuccessTranslation,
              100.0 * successRate(evaluation));
  std::printf("accepted by the gate: %.1f %%\n", 100.0 * acceptedRate(evaluation));
  std::printf("extrinsics scored a run: %.0f\n", meanEvaluations(evaluation));
  std::printf("CPU a run: %.2f s, %.2f s of it to prepare the frames\n", cpuSecondsPerRun(evaluation),
              meanPreparation(evaluation));
  if (refused > 0) std::printf("frames refused and replaced: %zu\n", refused);
  std::printf(
      "\nL2: mean of the error's norm. Huber: M-estimate of location of the norm (limit 1.345 robust "
      "standard\n"
      "deviations). Axes: optical frame, x right, y down, z forward. Errors against the dataset's "
      "reference;\n"
      "rejected results count with what the search found.\n");
}

void writeErrors(YAML::Emitter& out, const char* key, const Errors& errors) {
  out << YAML::Key << key << YAML::Value << YAML::BeginMap;
  const std::vector<std::pair<const char*, double>> figures = {{"mean", mean(errors.norm)},
                                                               {"median", quantile(errors.norm, 0.5)},
                                                               {"p90", quantile(errors.norm, 0.9)},
                                                               {"huber", huberMean(errors.norm)},
                                                               {"start_mean", mean(errors.start)}};
  for (const auto& [name, value] : figures) out << YAML::Key << name << YAML::Value << value;
  out << YAML::Key << "axis_mean_absolute" << YAML::Value << YAML::BeginSeq;
  for (const auto& axis : errors.axis) out << meanAbsolute(axis);
  out << YAML::EndSeq << YAML::Key << "axis_mean" << YAML::Value << YAML::BeginSeq;
  for (const auto& axis : errors.axis) out << mean(axis);
  out << YAML::EndSeq << YAML::EndMap;
}

std::string toJson(const Options& options, const Evaluation& evaluation) {
  YAML::Emitter out;
  useJson(out);
  out << YAML::BeginMap;
  out << YAML::Key << "method" << YAML::Value << options.method;
  out << YAML::Key << "frames" << YAML::Value << options.frames;
  out << YAML::Key << "trials" << YAML::Value << options.trials;
  writeErrors(out, "rotation_deg", rotationErrors(evaluation));
  writeErrors(out, "translation_m", translationErrors(evaluation));
  out << YAML::Key << "success_rate" << YAML::Value << successRate(evaluation);
  out << YAML::Key << "cpu_seconds_per_run" << YAML::Value << cpuSecondsPerRun(evaluation);
  out << YAML::Key << "cpu_seconds_preparation" << YAML::Value << meanPreparation(evaluation);
  out << YAML::Key << "accepted_rate" << YAML::Value << acceptedRate(evaluation);
  out << YAML::Key << "evaluations_per_run" << YAML::Value << meanEvaluations(evaluation);
  out << YAML::Key << "start_rotation_deg" << YAML::Value << options.start_rotation;
  out << YAML::Key << "start_translation_m" << YAML::Value << options.start_translation;
  out << YAML::Key << "frame_set" << YAML::Value << options.frame_set;
  out << YAML::Key << "seed" << YAML::Value << options.seed;
  out << YAML::EndMap;
  return out.c_str();
}

void writeCsv(const std::string& file, const Evaluation& evaluation) {
  std::ostringstream out;
  out << "trial,frames,start_rx_deg,start_ry_deg,start_rz_deg,start_tx_m,start_ty_m,start_tz_m,"
         "rx_deg,ry_deg,rz_deg,tx_m,ty_m,tz_m,rotation_deg,translation_m,score_before,score_after,accepted,"
         "evaluations\n";
  for (std::size_t i = 0; i < evaluation.trials.size(); ++i) {
    const Trial& trial = evaluation.trials[i];
    out << i << ',';
    for (std::size_t k = 0; k < trial.frames.size(); ++k) out << (k ? " " : "") << trial.frames[k];
    for (const ExtrinsicError* error : {&trial.start, &trial.result}) {
      for (int axis = 0; axis < 3; ++axis) out << ',' << error->rotation[axis] / kDegree;
      for (int axis = 0; axis < 3; ++axis) out << ',' << error->translation[axis];
    }
    out << ',' << trial.result.angle() / kDegree << ',' << trial.result.distance() << ','
        << trial.outcome.before.total << ',' << trial.outcome.after.total << ',' << trial.outcome.accepted
        << ',' << trial.outcome.evaluations << '\n';
  }
  writeFileAtomically(file, out.str());
}

int evaluate(const Options& options) {
  ServerConfig config = loadServerConfig(options.config, options.assignments);
  if (!options.method.empty()) {
    config.calibrator.objective.objective = options.method;
    config.calibrator.search.search = options.method == "edges" ? "coarse_to_fine" : options.method;
  }
  config.calibrator.range.rotation_deg =
      options.range_rotation > 0.0 ? options.range_rotation : options.start_rotation;
  config.calibrator.range.translation_m =
      options.range_translation > 0.0 ? options.range_translation : options.start_translation;
  makeObjective(config.calibrator.objective);  // complain before the frames are read
  makeSearch(config.calibrator.search);
  const auto dataset = Dataset::open(options.folder);
  if (!dataset->reference())
    throw Error(ErrorCause::kExtrinsic, "\"" + options.folder + "\" has no reference extrinsic");
  const std::vector<Input> inputs = readInputs(*dataset, options.frame_set);
  const Evaluation evaluation = runTrials(options, inputs, *dataset, config);
  print(options, *dataset, evaluation);
  if (!options.csv.empty()) writeCsv(options.csv, evaluation);
  if (!options.json.empty()) writeFileAtomically(options.json, toJson(options, evaluation) + "\n");
  return kExitOk;
}

}  // namespace

int evaluateMain(int argc, char** argv) {
  Options options;
  CommandLine line{"evaluate FOLDER [options]",
                   "Calibrates again and again from random wrong starts on random frames of a dataset, and "
                   "compares the results with\n"
                   "the dataset's reference extrinsic. Each trial prepares its frames anew around its own "
                   "wrong start, as a vehicle\n"
                   "would; the reference is used for the start and the comparison only. Same options and "
                   "seed, same figures, whatever\n"
                   "the number of threads.",
                   po::options_description("Options"), "folder"};
  line.options.add_options()("folder", po::value(&options.folder)->required()->value_name("FOLDER"),
                             "the dataset")("method", po::value(&options.method)->default_value("paper"),
                                            "paper, or edges (with search coarse_to_fine)")(
      "frames", atLeast(1, &options.frames, "frames")->value_name("K"), "frames of a trial (default 5)")(
      "trials", atLeast(1, &options.trials, "trials")->value_name("N"), "default 20")(
      "starts", atLeast(1, &options.trials, "starts")->value_name("N"), "another name of --trials")(
      "start-rotation-deg", atLeast(0.0, &options.start_rotation, "start-rotation-deg")->value_name("R"),
      "largest error of the start about each axis [deg] (default 2.5)")(
      "start-translation-m", atLeast(0.0, &options.start_translation, "start-translation-m")->value_name("T"),
      "largest error of the start along each axis [m] (default 0.1)")(
      "range-rotation-deg", atLeast(0.0, &options.range_rotation, "range-rotation-deg")->value_name("R"),
      "search range about each axis [deg] (default: as the start)")(
      "range-translation-m", atLeast(0.0, &options.range_translation, "range-translation-m")->value_name("T"),
      "search range along each axis [m] (default: as the start)")(
      "seed", po::value(&options.seed)->value_name("S"), "of starts and frames (default 1)")(
      "frame-set", po::value(&options.frame_set)->value_name("SET"),
      "all, or the frames at even or odd positions: to tune on one half and measure on the other")(
      "threads", atLeast(0, &options.threads, "threads")->value_name("N"),
      "trials at once (default: one a core)")("csv", po::value(&options.csv)->value_name("FILE"),
                                              "a line for each trial")(
      "json", po::value(&options.json)->value_name("FILE"), "the figures as one object")(
      "config", po::value(&options.config)->value_name("YAML"),
      "parameters of the node (frames, search, gate)")(
      "set", po::value(&options.assignments)->composing()->value_name("NAME=VALUE"),
      "one parameter, such as gate/min_gain=0.01; may be repeated");
  return runTool(argc, argv, line, [&options](const po::variables_map&) {
    if (options.frame_set != "all" && options.frame_set != "even" && options.frame_set != "odd") {
      throw po::error("--frame-set " + options.frame_set + ": must be all, even or odd");
    }
    return evaluate(options);
  });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::evaluateMain(argc, argv); }

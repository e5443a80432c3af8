// Monte-Carlo evaluation of methods on a dataset with a reference extrinsic.

#include <algorithm>
#include <sstream>
#include <thread>

#include "command_line.hpp"
#include "dataset.hpp"
#include "evaluation/drift.hpp"
#include "evaluation/output.hpp"
#include "evaluation/slices.hpp"
#include "evaluation/trials.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/result_file.hpp"

namespace lidar_camera_recalibration {

namespace po = boost::program_options;

namespace {

using namespace evaluation;

struct Options {
  std::string folder, csv, json, slices, monitor;
  std::vector<std::string> methods, starts;
  std::string frames = "5", halves;
  CommonParameters parameters;
  InputChoice choice;
  double start_rotation = 2.5, start_translation = 0.1;  ///< [deg], [m]; without a start
  Plan plan;                                             ///< but methods, frames and starts

  Options() { plan.threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency())); }
};

std::vector<std::string> splitAtCommas(const std::string& text) {
  std::vector<std::string> words;
  std::istringstream stream(text);
  for (std::string word; std::getline(stream, word, ',');) words.push_back(word);
  return words;
}

std::vector<int> frameCounts(const std::string& option, const std::string& text) {
  std::vector<int> counts;
  for (const std::string& word : splitAtCommas(text)) {
    const bool number =
        !word.empty() && word.size() < 7 && word.find_first_not_of("0123456789") == std::string::npos;
    const int count = number ? std::stoi(word) : 0;
    if (count < 1 && word != "all")
      throw po::error("--" + option + " " + text +
                      ": must be numbers of frames with commas between them, or all");
    counts.push_back(word == "all" ? kAllFrames : count);
  }
  return counts;
}

Plan makePlan(const Options& options) {
  Plan plan = options.plan;
  for (const std::string& word : options.methods) {
    plan.methods.push_back(parseMethod(word, options.parameters));
    const auto same = [&](const Method& method) { return method.name == plan.methods.back().name; };
    if (std::count_if(plan.methods.begin(), plan.methods.end(), same) > 1)
      throw po::error("--method " + word + ": there is another one of this name");
  }
  plan.halves = !options.halves.empty();
  plan.frame_counts =
      plan.halves ? frameCounts("halves", options.halves) : frameCounts("frames", options.frames);
  if (plan.halves && std::count(plan.frame_counts.begin(), plan.frame_counts.end(), kAllFrames) > 0)
    throw po::error("--halves all: two sets of all frames have frames in common");
  for (const std::string& words : options.starts) {
    for (const std::string& word : splitAtCommas(words)) plan.starts.push_back(parseStart(word));
  }
  if (plan.starts.empty()) {
    std::ostringstream word;
    word << options.start_rotation << ' ' << options.start_translation;
    plan.starts.push_back(parseStart(word.str()));
  }
  return plan;
}

int evaluate(const Options& options) {
  const Plan plan = makePlan(options);  // complain before the frames are read
  const auto dataset = Dataset::open(options.folder);
  if (!dataset->reference())
    throw Error(ErrorCause::kExtrinsic, "\"" + options.folder + "\" has no reference extrinsic");
  const std::vector<Input> inputs = readInputs(*dataset, options.choice);
  const Camera camera(dataset->intrinsics());
  if (!options.slices.empty()) {
    writeFileAtomically(options.slices, scoreSlices(plan.methods, inputs, camera, *dataset->reference()));
    return kExitOk;
  }
  if (!options.monitor.empty()) {
    writeFileAtomically(options.monitor,
                        driftWindows(plan.methods.front(), inputs, camera, *dataset->reference(),
                                     plan.frame_counts, plan.trials, plan.seed));
    return kExitOk;
  }
  const Circumstances circumstances{options.folder, dataset->layout(), options.choice};
  std::vector<Cell> cells;
  printHead(plan, circumstances);
  runTrials(plan, inputs, camera, *dataset->reference(), [&](const Cell& cell) {
    printRow(cell);
    cells.push_back(cell);
    // Again after each cell, so that a long run may be stopped.
    if (!options.csv.empty()) writeFileAtomically(options.csv, toCsv(cells));
    if (!options.json.empty()) writeFileAtomically(options.json, toJson(plan, circumstances, cells) + "\n");
  });
  printLegend(plan);
  return kExitOk;
}

}  // namespace

int evaluateMain(int argc, char** argv) {
  Options options;
  Plan& plan = options.plan;
  CommandLine line{"evaluate FOLDER [options]",
                   "Calibrates again and again from random wrong starts on random frames of a dataset, and "
                   "compares the results "
                   "with\n"
                   "the dataset's reference extrinsic: each method with each number of frames from each "
                   "start, a row each. A trial\n"
                   "prepares its frames around its own wrong start, as a vehicle would; the reference is "
                   "used for the start and "
                   "the\n"
                   "comparison only. Trials of one number have the same start and frames in all methods. "
                   "Same options and seed, "
                   "same\n"
                   "figures, whatever the number of threads.",
                   po::options_description("Options"), "folder"};
  const auto add = [&line](const char* name, po::value_semantic* value, const char* what) {
    line.options.add_options()(name, value, what);
  };
  add("folder", po::value(&options.folder)->required()->value_name("FOLDER"), "the dataset");
  add("method",
      po::value(&options.methods)->composing()->default_value({"paper"}, "paper")->value_name("NAME"),
      ("one of " + knownMethods() +
       "; or a variant NAME:param=value,param=value of the method NAME or, if there is none, of the best "
       "one; may be "
       "repeated")
          .c_str());
  add("frames", po::value(&options.frames)->value_name("K,K,..."), "frames of a trial, or all (default 5)");
  add("start", po::value(&options.starts)->composing()->value_name("S,S,..."),
      "how wrong the start is, uniform on each axis: E1 (+-1 deg, +-5 cm), E2 (+-2.5, +-10), E3 (+-5, +-20), "
      "\"R T\" [deg, m], or AXIS=VALUE (rx, ry, rz [deg], tx, ty, tz [m]): so much on this axis, E1 on the "
      "others; may "
      "be repeated");
  add("start-rotation-deg", atLeast(0.0, &options.start_rotation, "start-rotation-deg")->value_name("R"),
      "without --start: largest error about each axis [deg] (default 2.5)");
  add("start-translation-m", atLeast(0.0, &options.start_translation, "start-translation-m")->value_name("T"),
      "without --start: largest error along each axis [m] (default 0.1)");
  add("halves", po::value(&options.halves)->value_name("K,K,..."),
      "instead of --frames: each trial calibrates on two disjoint sets of K frames from two starts, and the "
      "errors are "
      "the differences between both results");
  add("slices", po::value(&options.slices)->value_name("FILE"),
      "no trials: write the scores along each axis through the reference, on all frames, as CSV");
  add("monitor", po::value(&options.monitor)->value_name("FILE"),
      "no calibration: write what the drift monitor says about extrinsics that are off by a known amount, "
      "--trials windows of --frames frames of each, as CSV; with the first --method, which needs edges");
  add("trials", atLeast(1, &plan.trials, "trials")->value_name("N"), "of each row (default 20)");
  add("starts", atLeast(1, &plan.trials, "starts")->value_name("N"), "another name of --trials");
  add("seed", po::value(&plan.seed)->value_name("S"), "of starts and frames (default 1)");
  add("range-rotation-deg", atLeast(0.0, &plan.range_rotation, "range-rotation-deg")->value_name("R"),
      "search range about each axis [deg] (default: as the start)");
  add("range-translation-m", atLeast(0.0, &plan.range_translation, "range-translation-m")->value_name("T"),
      "search range along each axis [m] (default: as the start)");
  add("frame-set", po::value(&options.choice.frame_set)->value_name("SET"),
      "all, or the frames at even or odd positions: to tune on one half and measure on the other");
  add("every-ring", inRange(1, 64, &options.choice.every_ring, "every-ring")->value_name("N"),
      "keep one of N rings of the clouds: a LiDAR with fewer beams (default 1)");
  add("masks", po::value(&options.choice.masks)->value_name("WHICH"),
      "the masks as given, or spoilt: the 6 largest of each image, garbage, or those of another image");
  add("threads", atLeast(1, &plan.threads, "threads")->value_name("N"),
      "trials at once (default: one a core)");
  add("csv", po::value(&options.csv)->value_name("FILE"), "a line for each trial");
  add("json", po::value(&options.json)->value_name("FILE"), "the figures of all rows");
  add("config", po::value(&options.parameters.yaml_file)->value_name("YAML"),
      "parameters of the node (frames, search, gate)");
  add("set", po::value(&options.parameters.assignments)->composing()->value_name("NAME=VALUE"),
      "one parameter, such as gate/min_distinctness=6; may be repeated");
  return runTool(argc, argv, line, [&options](const po::variables_map&) {
    const std::string& set = options.choice.frame_set;
    if (set != "all" && set != "even" && set != "odd")
      throw po::error("--frame-set " + set + ": must be all, even or odd");
    return evaluate(options);
  });
}

}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) { return lidar_camera_recalibration::evaluateMain(argc, argv); }

#include "evaluation/trials.hpp"

#include <algorithm>
#include <atomic>
#include <ctime>
#include <exception>
#include <mutex>
#include <numeric>
#include <random>
#include <tuple>

#include "command_line.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "parallel.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

/// Of this thread, or of all if it is the only one that runs trials and so has helpers.
double cpuSeconds(bool of_all_threads) {
  timespec time{};
  clock_gettime(of_all_threads ? CLOCK_PROCESS_CPUTIME_ID : CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Does not compile once FrameConfig gets a member that is not listed here.
auto asTuple(const FrameConfig& config) {
  const auto& [features, edges, crop, min_range, max_range, cull, min_points, min_masks] = config;
  const auto& [neighbours, quantile, distance, plane_points, planes, tolerance, slope, cluster_points] =
      features;
  return std::make_tuple(edges, crop, min_range, max_range, cull, min_points, min_masks, neighbours, quantile,
                         distance, plane_points, planes, tolerance, slope, cluster_points);
}

/// Frames around one start, in the order in which a trial wants them; each is prepared when it is first asked
/// for.
class FrameStore {
 public:
  FrameStore(const std::vector<Input>& inputs, const Camera& camera, Eigen::Isometry3d start,
             std::vector<std::size_t> order, bool count_all_threads)
      : inputs_(inputs),
        camera_(camera),
        start_(std::move(start)),
        order_(std::move(order)),
        count_all_threads_(count_all_threads) {}

  const Eigen::Isometry3d& start() const { return start_; }

  /// The first `count` usable frames, as the node would take them, and what they cost. `places` receives how
  /// much of the order that took.
  Frames take(int count, const FrameConfig& config, Run& run, std::size_t& places) {
    const std::size_t wanted = count == kAllFrames ? order_.size() : static_cast<std::size_t>(count);
    Frames frames;
    std::string problem;
    for (places = 0; places < order_.size() && frames.size() < wanted; ++places) {
      const Entry& entry = prepared(places, config);
      run.preparation_seconds += entry.seconds;
      if (entry.frame) {
        frames.push_back(entry.frame);
        run.frames.push_back(inputs_[order_[places]].name);
      } else {
        ++run.refused;
        problem = entry.problem;
      }
    }
    if (frames.empty() || (count != kAllFrames && frames.size() < wanted)) {
      throw Error(ErrorCause::kNotEnough, "only " + std::to_string(frames.size()) + " of " +
                                              std::to_string(wanted) + " frames could be used" +
                                              (problem.empty() ? "" : "; " + problem));
    }
    return frames;
  }

 private:
  struct Entry {
    FramePtr frame;       ///< nothing if it was refused
    std::string problem;  ///< why
    double seconds = 0.0;
  };
  struct Prepared {
    FrameConfig config;
    std::vector<Entry> entries;
  };

  const Entry& prepared(std::size_t place, const FrameConfig& config) {
    auto same = std::find_if(sets_.begin(), sets_.end(), [&config](const Prepared& set) {
      return asTuple(set.config) == asTuple(config);
    });
    if (same == sets_.end()) same = sets_.insert(sets_.end(), Prepared{config, {}});
    while (same->entries.size() <= place) same->entries.push_back(prepare(same->entries.size(), config));
    return same->entries[place];
  }

  Entry prepare(std::size_t place, const FrameConfig& config) const {
    const Input& input = inputs_[order_[place]];
    Entry entry;
    const double before = cpuSeconds(count_all_threads_);
    try {
      entry.frame = makeFrame(input.stamp, camera_, input.image, input.layers, input.cloud, start_, config);
    } catch (const Error& error) {
      entry.problem = input.name + ": " + error.what();
    }
    entry.seconds = cpuSeconds(count_all_threads_) - before;
    return entry;
  }

  const std::vector<Input>& inputs_;
  const Camera& camera_;
  Eigen::Isometry3d start_;
  std::vector<std::size_t> order_;
  bool count_all_threads_;
  std::vector<Prepared> sets_;
};

/// The trials of one start.
class StartTrials {
 public:
  StartTrials(const Plan& plan, const Start& start, const std::vector<Input>& inputs, const Camera& camera,
              const Eigen::Isometry3d& reference)
      : plan_(plan), start_(start), inputs_(inputs), camera_(camera), reference_(reference) {
    range_ = start.range();
    if (plan.range_rotation > 0.0) range_.rotation_deg = plan.range_rotation;
    if (plan.range_translation > 0.0) range_.translation_m = plan.range_translation;
    workers_ = std::max(1, std::min(plan.threads, plan.trials));
    for (const int frames : plan.frame_counts) {
      for (const Method& method : plan.methods) {
        cells_.push_back({method.name, frames, start, {}});
        cells_.back().trials.resize(static_cast<std::size_t>(plan.trials));
      }
    }
  }

  const std::vector<Cell>& run() {
    std::size_t finished = 0;
    std::mutex mutex;
    std::exception_ptr problem;
    std::atomic<bool> failed{false};
    ProgressBar progress;
    const std::string label = "trials from " + start_.name;
    progress.show(label, 0.0);
    const auto count = static_cast<std::size_t>(plan_.trials);
    parallelFor(count, static_cast<std::size_t>(workers_), [&](std::size_t, std::size_t number) {
      if (failed) return;
      try {
        runTrial(number);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        problem = std::current_exception();
        failed = true;
      }
      const std::lock_guard<std::mutex> lock(mutex);
      progress.show(label, double(++finished) / double(count));
    });
    if (problem) std::rethrow_exception(problem);
    return cells_;
  }

 private:
  void runTrial(std::size_t number) {
    // Each trial has its own sequence, so trials may run in any order and on any number of threads.
    std::seed_seq seed{plan_.seed, static_cast<std::uint64_t>(number)};
    std::mt19937_64 random(seed);
    const Eigen::Isometry3d start = start_.draw(reference_, random);
    std::vector<std::size_t> order(inputs_.size());
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), random);
    std::vector<FrameStore> stores;
    stores.emplace_back(inputs_, camera_, start, order, alone());
    if (plan_.halves) {
      // The other half takes its frames from the other end.
      std::reverse(order.begin(), order.end());
      stores.emplace_back(inputs_, camera_, start_.draw(reference_, random), order, alone());
    }
    std::size_t cell = 0;
    for (const int frames : plan_.frame_counts) {
      for (const Method& method : plan_.methods)
        cells_[cell++].trials[number] = measure(method, frames, stores);
    }
  }

  Trial measure(const Method& method, int frames, std::vector<FrameStore>& stores) const {
    Trial trial;
    std::size_t places = 0;
    for (FrameStore& store : stores) {
      std::size_t taken = 0;
      trial.runs.push_back(calibrateOnce(method, frames, store, taken));
      places += taken;
    }
    if (plan_.halves && places > inputs_.size()) {
      throw Error(ErrorCause::kNotEnough, "after the refused frames there are not two disjoint sets of " +
                                              std::to_string(frames) + " frames");
    }
    const auto& first = trial.runs.front().outcome;
    const Eigen::Isometry3d& true_start = plan_.halves ? trial.runs.back().outcome.start : reference_;
    const Eigen::Isometry3d& true_result =
        plan_.halves ? trial.runs.back().outcome.T_camera_lidar : reference_;
    trial.start = extrinsicError(first.start, true_start);
    trial.result = extrinsicError(first.T_camera_lidar, true_result);
    trial.start_shift = shift(first.start, true_start);
    trial.result_shift = shift(first.T_camera_lidar, true_result);
    return trial;
  }

  Run calibrateOnce(const Method& method, int count, FrameStore& store, std::size_t& places) const {
    Run run;
    const Frames frames = store.take(count, method.config.frame, run, places);
    CalibratorConfig config = method.config.calibrator;
    config.range = range_;
    config.search.threads = alone() ? plan_.threads : 1;
    const double before = cpuSeconds(alone());
    run.outcome = calibrate(frames, store.start(), config);
    run.calibration_seconds = cpuSeconds(alone()) - before;
    return run;
  }

  double shift(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) const {
    const Intrinsics& intrinsics = camera_.intrinsics();
    return pixelShift(a, b, kErrorDistance, intrinsics.fx, intrinsics.width);
  }

  /// Then the search itself may use all threads.
  bool alone() const { return workers_ == 1; }

  const Plan& plan_;
  const Start& start_;
  const std::vector<Input>& inputs_;
  const Camera& camera_;
  const Eigen::Isometry3d& reference_;
  SearchRange range_;
  int workers_ = 1;
  std::vector<Cell> cells_;
};

}  // namespace

void runTrials(const Plan& plan, const std::vector<Input>& inputs, const Camera& camera,
               const Eigen::Isometry3d& reference, const std::function<void(const Cell&)>& done) {
  const std::size_t sets = plan.halves ? 2 : 1;
  for (const int frames : plan.frame_counts) {
    if (sets * static_cast<std::size_t>(frames) <= inputs.size()) continue;
    throw Error(ErrorCause::kNotEnough, "there are " + std::to_string(inputs.size()) +
                                            " frames, too few for " + (plan.halves ? "two sets of " : "") +
                                            std::to_string(frames));
  }
  for (const Start& start : plan.starts) {
    StartTrials trials(plan, start, inputs, camera, reference);
    for (const Cell& cell : trials.run()) done(cell);
  }
}

}  // namespace lidar_camera_recalibration::evaluation

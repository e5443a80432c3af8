#include "server.hpp"

#include <ros/console.h>
#include <ros/time.h>

#include <algorithm>
#include <atomic>
#include <boost/make_shared.hpp>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "automatic_policy.hpp"
#include "camera_info_file.hpp"
#include "extrinsic_keeper.hpp"
#include "frame_pipeline.hpp"
#include "lidar_camera_recalibration/calibrator.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "repeat_filter.hpp"
#include "result_messages.hpp"
#include "tf_output.hpp"

namespace lidar_camera_recalibration {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxQueued = 200;
constexpr std::size_t kMaxQueuedBytes = 256u * 1024 * 1024;
constexpr auto kStatePeriod = std::chrono::seconds(1);

/// Zero where no clock runs (no node, or simulated time not started).
ros::Time now() { return ros::Time::isValid() ? ros::Time::now() : ros::Time(); }

Clock::duration fromSeconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

Recalibrate::Response answer(bool success, const std::string& message) {
  Recalibrate::Response response;
  response.success = success;
  response.message = message;
  return response;
}

/// What is wrong with a request; empty if nothing.
std::string refusal(const Recalibrate::Request& request, const ServerConfig& config) {
  const auto isBad = [](double value, double max) { return !(value >= 0.0 && value <= max); };
  constexpr double kMaxTranslation = 5.0;  // [m]
  // Points further out than this were dropped when the frames were prepared.
  if (isBad(request.rotation_range_deg, config.frame.crop_margin_deg))
    return "rotation_range_deg is " + std::to_string(request.rotation_range_deg) + "; allowed is 0 to " +
           std::to_string(config.frame.crop_margin_deg) + ", the parameter frame/crop_margin_deg";
  if (isBad(request.translation_range_m, kMaxTranslation))
    return "translation_range_m is " + std::to_string(request.translation_range_m) + "; allowed is 0 to 5";
  if (isBad(request.timeout, 1e6))
    return "timeout is " + std::to_string(request.timeout) + "; allowed is 0 to 1e6";
  if (request.min_frames > static_cast<std::uint32_t>(config.frames_max))
    return "min_frames is " + std::to_string(request.min_frames) + ", but no more than " +
           std::to_string(config.frames_max) + " frames are held (parameter frames/max)";
  return "";
}

std::string framesOf(std::size_t held, std::size_t required) {
  return std::to_string(held) + " of " + std::to_string(required) + " frames held";
}

}  // namespace

class RecalibrationServer::Impl {
 public:
  Impl(const ServerConfig& config, const tf2::BufferCore& tf, const std::string& name, ServerOutputs outputs);
  ~Impl() { stop(); }

  enum class Kind { kImage, kOther };
  void add(Kind kind, std::size_t bytes, std::function<void(FramePipeline&)> input);
  void clearCaches();
  Recalibrate::Response recalibrate(const Recalibrate::Request& request);
  bool save(const std::string& path, const std::string& format, std::string& message) const;
  void setParameters(const Parameters& values);
  void reset();
  bool cancel(std::string& message);
  bool restore(std::string& message);
  RecalibrationState state() const;
  std::string extrinsicSource() const { return keeper_.source(); }
  sensor_msgs::CameraInfoConstPtr infoFor(const std_msgs::Header& header) const;
  void waitUntilIdle();
  void stop();

 private:
  struct Input {
    Kind kind;
    std::size_t bytes;
    std::function<void(FramePipeline&)> add;
  };
  /// One recalibration, from its request to its answer. Guarded by mutex_.
  struct Job {
    Recalibrate::Request request;
    std::size_t frames_required = 0;
    std::optional<Clock::time_point> deadline;
    std::string stop_reason;  ///< why it ends before its time; empty: it goes on
    bool searching = false;
    bool finished = false;
    Recalibrate::Response response;
  };
  using JobPtr = std::shared_ptr<Job>;
  struct SearchDone {
    CalibrationOutcome outcome;
    Frames frames;      ///< that it had
    std::string error;  ///< of a search that failed
  };

  void clearQueue();  ///< with mutex_ held
  JobPtr makeJob(const Recalibrate::Request& request) const;
  void wake();  ///< with mutex_ held

  // The worker's side: only run() and what it calls.
  void run();
  std::deque<Input> takeInputs();
  bool waitForWork();
  void watchDrift();
  void finishSearch();
  void advanceJob();
  void startSearch(const JobPtr& job);
  void endJob(JobPtr job, bool success, const CalibrationOutcome& outcome, const std::string& note);
  std::string applyAccepted(const CalibrationOutcome& outcome);
  void publishTransform();
  void updateState();
  std::string summary(const RecalibrationState& state) const;
  std::string describe(const RecalibrationState& state) const;
  void shutDown();
  template <typename Action>
  void guarded(const char* what, const Action& action);

  ServerConfig config_;  ///< the worker changes its live members, which nobody else reads
  const tf2::BufferCore& tf_;
  const std::string name_;
  const ServerOutputs outputs_;
  std::optional<sensor_msgs::CameraInfo> info_;  ///< from a file
  ExtrinsicKeeper keeper_;

  mutable std::mutex mutex_;
  std::condition_variable work_arrived_, job_finished_, became_idle_;
  std::deque<Input> queue_;
  std::size_t queued_bytes_ = 0, queued_images_ = 0;
  std::uint64_t images_ = 0;  ///< received since the start
  std::uint64_t dropped_images_ = 0, dropped_others_ = 0, forgotten_images_ = 0;  ///< out of the queue
  std::size_t waiting_callers_ = 0;
  bool has_work_ = false, idle_ = false, stopping_ = false;
  Parameters changes_;  ///< of live parameters, checked
  bool clear_caches_ = false, clear_frames_ = false, restored_ = false;
  JobPtr job_;
  std::optional<SearchDone> search_done_;
  RecalibrationState state_;

  std::atomic<bool> abort_search_{false};
  std::atomic<double> progress_{0.0};

  // Owned by the worker.
  FramePipeline pipeline_;
  RepeatFilter repeat_filter_;
  AutomaticPolicy policy_;
  ros::Time watched_stamp_;  ///< of the frame that the policy saw last
  std::thread search_;
  ros::Time search_stamp_;
  bool transform_due_ = false, edge_published_ = false;
  RecalibrationState published_state_;
  std::string last_outcome_;  ///< in a word or two; empty before the first result
  Clock::time_point next_state_ = Clock::now();

  std::once_flag stop_once_;
  std::thread worker_;  // last: starts when everything else is there
};

RecalibrationServer::Impl::Impl(const ServerConfig& config, const tf2::BufferCore& tf,
                                const std::string& name, ServerOutputs outputs)
    : config_(config),
      tf_(tf),
      name_(name),
      outputs_(std::move(outputs)),
      keeper_(config_, tf, name),
      pipeline_(config_, tf, keeper_, name, outputs_),
      policy_(config_.automatic_min_interval) {
  if (!config_.camera_info_file.empty()) info_ = readCameraInfoFile(config_.camera_info_file);
  makeSearch(config_.calibrator.search);  // its complaint belongs here, not into the first search
  worker_ = std::thread([this] { run(); });
}

// --- called from any thread ---

void RecalibrationServer::Impl::wake() {
  has_work_ = true;
  idle_ = false;
  work_arrived_.notify_one();
}

void RecalibrationServer::Impl::add(Kind kind, std::size_t bytes, std::function<void(FramePipeline&)> input) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (stopping_) return;
  queue_.push_back({kind, bytes, std::move(input)});
  queued_bytes_ += bytes;
  if (kind == Kind::kImage) ++images_, ++queued_images_;
  while (queue_.size() > kMaxQueued || (queue_.size() > 1 && queued_bytes_ > kMaxQueuedBytes)) {
    const bool is_image = queue_.front().kind == Kind::kImage;
    queued_bytes_ -= queue_.front().bytes;
    queued_images_ -= is_image ? 1 : 0;
    queue_.pop_front();
    ++(is_image ? dropped_images_ : dropped_others_);
  }
  wake();
}

void RecalibrationServer::Impl::clearQueue() {
  forgotten_images_ += queued_images_;
  queue_.clear();
  queued_bytes_ = queued_images_ = 0;
}

void RecalibrationServer::Impl::clearCaches() {
  const std::lock_guard<std::mutex> lock(mutex_);
  clearQueue();
  clear_caches_ = true;
  wake();
}

void RecalibrationServer::Impl::reset() {
  const std::lock_guard<std::mutex> lock(mutex_);
  clearQueue();
  clear_caches_ = clear_frames_ = true;
  wake();
}

void RecalibrationServer::Impl::setParameters(const Parameters& values) {
  ServerConfig checked;  // what is allowed depends on no other parameter
  setLiveParameters(values, checked);
  const std::lock_guard<std::mutex> lock(mutex_);
  for (const auto& [name, value] : values) changes_[name] = value;
  wake();
}

RecalibrationServer::Impl::JobPtr RecalibrationServer::Impl::makeJob(
    const Recalibrate::Request& request) const {
  auto job = std::make_shared<Job>();
  job->request = request;
  job->frames_required =
      request.min_frames > 0 ? request.min_frames : static_cast<std::size_t>(config_.frames_min);
  if (request.wait)
    job->deadline =
        Clock::now() + fromSeconds(request.timeout > 0.0 ? request.timeout : config_.service_timeout);
  return job;
}

Recalibrate::Response RecalibrationServer::Impl::recalibrate(const Recalibrate::Request& request) {
  const std::string problem = refusal(request, config_);
  if (!problem.empty()) return answer(false, problem);

  std::unique_lock<std::mutex> lock(mutex_);
  if (stopping_) return answer(false, "the node is shutting down");
  if (request.wait && waiting_callers_ >= kMaxWaitingCallers)
    return answer(false,
                  std::to_string(waiting_callers_) +
                      " callers wait already for the recalibration that is under way; its outcome comes on "
                      "~result, also for whoever calls without wait");
  const bool joined = job_ != nullptr;
  if (!joined) job_ = makeJob(request);
  const JobPtr job = job_;
  wake();
  const std::string prefix =
      joined ? "joined the recalibration that is already under way (its settings apply): " : "";
  if (!request.wait) {
    const bool ready = state_.frames >= job->frames_required;
    return answer(true, prefix + (ready || job->searching ? "search started" : "waits for frames") + ", " +
                            framesOf(state_.frames, job->frames_required) + "; the outcome comes on ~result");
  }
  // A joined caller only stops waiting; the deadline of the job itself is its first caller's.
  const auto finished = [&] { return job->finished; };
  bool in_time = true;
  ++waiting_callers_;
  if (!joined) {
    job_finished_.wait(lock, finished);
  } else {
    in_time = job_finished_.wait_until(lock, *makeJob(request)->deadline, finished);
  }
  --waiting_callers_;
  if (!in_time) return answer(false, prefix + "it was not finished within the timeout");
  Recalibrate::Response response = job->response;
  response.message = prefix + response.message;
  return response;
}

bool RecalibrationServer::Impl::save(const std::string& path, const std::string& format,
                                     std::string& message) const {
  return keeper_.save(path, format, message);
}

bool RecalibrationServer::Impl::cancel(std::string& message) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!job_) {
    message = "there is no recalibration to cancel";
    return false;
  }
  job_->stop_reason = "cancelled on request";
  abort_search_ = true;
  wake();
  message = job_->searching ? "the search is being cancelled" : "the waiting recalibration is cancelled";
  return true;
}

bool RecalibrationServer::Impl::restore(std::string& message) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (job_ && job_->searching) {
      message = "a search is running and would replace the extrinsic again; cancel it first";
      return false;
    }
  }
  const bool restored = keeper_.restore(message);  // writes a file: inputs must not wait for that
  const std::lock_guard<std::mutex> lock(mutex_);
  restored_ = restored_ || restored;
  wake();
  return restored;
}

/// What the driver would have published with an image; null if it does so itself.
sensor_msgs::CameraInfoConstPtr RecalibrationServer::Impl::infoFor(const std_msgs::Header& header) const {
  if (!info_) return nullptr;
  const auto info = boost::make_shared<sensor_msgs::CameraInfo>(*info_);
  info->header = header;
  return info;
}

RecalibrationState RecalibrationServer::Impl::state() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return state_;
}

void RecalibrationServer::Impl::waitUntilIdle() {
  std::unique_lock<std::mutex> lock(mutex_);
  became_idle_.wait(lock, [this] { return idle_ || stopping_; });
}

void RecalibrationServer::Impl::stop() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    abort_search_ = true;
    wake();
    became_idle_.notify_all();
  }
  std::call_once(stop_once_, [this] { worker_.join(); });
}

// --- the worker thread ---

template <typename Action>
void RecalibrationServer::Impl::guarded(const char* what, const Action& action) {
  try {
    action();
  } catch (const std::exception& e) {
    const std::string text = std::string(what) + " failed: " + e.what();
    if (repeat_filter_.isDue(text)) ROS_ERROR_STREAM_NAMED(name_, name_ << ": " << text);
  }
}

/// Inputs become frames, frames are scored and kept, a requested search is started and its outcome applied.
void RecalibrationServer::Impl::run() {
  while (waitForWork()) {
    for (const Input& input : takeInputs()) guarded("taking a message", [&] { input.add(pipeline_); });
    guarded("processing a frame", [&] { pipeline_.step(); });
    watchDrift();
    finishSearch();
    advanceJob();
    guarded("publishing the transform", [&] { publishTransform(); });
    guarded("publishing the state", [&] { updateState(); });
    guarded("drawing the pictures", [&] { pipeline_.publishPictures(summary(state_)); });
  }
  shutDown();
}

/// Sleeps until something is to be done or the state is due. @return false to stop.
bool RecalibrationServer::Impl::waitForWork() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (!has_work_ && !pipeline_.hasReady()) {
    idle_ = !(job_ && job_->searching);
    if (idle_) became_idle_.notify_all();
    const auto deadline = job_ && job_->deadline && job_->stop_reason.empty() ? *job_->deadline : next_state_;
    work_arrived_.wait_until(lock, std::min(next_state_, deadline), [this] { return has_work_; });
  }
  has_work_ = false;
  return !stopping_;
}

std::deque<RecalibrationServer::Impl::Input> RecalibrationServer::Impl::takeInputs() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (std::exchange(clear_caches_, false)) pipeline_.clearCaches();
  if (std::exchange(clear_frames_, false)) pipeline_.clearFrames();
  if (!changes_.empty()) {
    setLiveParameters(std::exchange(changes_, {}), config_);
    pipeline_.requestPictures();
  }
  queued_bytes_ = queued_images_ = 0;
  return std::exchange(queue_, {});
}

/// Mode `automatic`: a confirmed drift is a request.
void RecalibrationServer::Impl::watchDrift() {
  if (config_.mode != "automatic") return;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (std::exchange(restored_, false)) policy_.restored();
  }
  const ros::Time stamp = pipeline_.newestStamp();
  if (stamp == watched_stamp_) return;
  watched_stamp_ = stamp;
  const DriftVerdict drift = pipeline_.drift();
  if (drift.frames < static_cast<std::size_t>(config_.monitor.window)) return;
  if (!policy_.judge(drift.state(), stamp.toSec())) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (job_) return;  // somebody was faster
  ROS_WARN_STREAM_NAMED(name_, name_ << ": a search starts by itself: "
                                     << lidar_camera_recalibration::describe(drift, config_.monitor));
  // Frames from before the drift would vote for the extrinsic that held then.
  pipeline_.dropFramesOlderThan(ros::Time(*policy_.doubtfulSince()));
  job_ = makeJob(Recalibrate::Request());
}

void RecalibrationServer::Impl::finishSearch() {
  std::unique_lock<std::mutex> lock(mutex_);
  if (!search_done_) return;
  SearchDone done = *std::exchange(search_done_, std::nullopt);
  JobPtr job = job_;
  const std::string stop_reason = job->stop_reason;
  lock.unlock();
  search_.join();

  CalibrationOutcome& outcome = done.outcome;
  if (!done.error.empty()) {
    outcome.accepted = false;
    outcome.reason = "the search failed: " + done.error;
    ROS_ERROR_STREAM_NAMED(name_, name_ << ": " << outcome.reason);
    return endJob(std::move(job), false, outcome, "");
  }
  if (!stop_reason.empty() || outcome.cancelled) {  // also where it was stopped just after the end
    outcome.cancelled = true;
    outcome.accepted = false;
    outcome.reason = stop_reason.empty() ? outcome.reason : stop_reason;
    return endJob(std::move(job), false, outcome, "");
  }
  std::string note;
  if (outcome.accepted && job->request.dry_run) {
    outcome.accepted = false;
    outcome.reason = "dry run, nothing was changed: would be " + outcome.reason;
  } else if (outcome.accepted) {
    note = applyAccepted(outcome);
  }
  guarded("handing out the outcome", [&] {
    if (outputs_.outcome) outputs_.outcome(outcome, done.frames);
  });
  endJob(std::move(job), true, outcome, note);
}

/// @return what went wrong with the result file, otherwise empty.
std::string RecalibrationServer::Impl::applyAccepted(const CalibrationOutcome& outcome) {
  StoredCalibration calibration = keeper_.current().value_or(StoredCalibration());
  calibration.T_camera_lidar = outcome.T_camera_lidar;
  calibration.covariance = outcome.covariance;
  calibration.score_before = outcome.before.total;
  calibration.score_after = outcome.after.total;
  calibration.accepted = true;
  calibration.reason = outcome.reason;
  calibration.frames = outcome.frames;
  calibration.frames_left_out = outcome.left_out.size();
  calibration.stamp = search_stamp_.toSec();
  calibration.source = name_;
  pipeline_.setComparison(outcome.start);
  return keeper_.accept(calibration);
}

/// Starts the search as soon as enough frames are held; gives up a job that was cancelled or whose time is
/// over.
void RecalibrationServer::Impl::advanceJob() {
  std::unique_lock<std::mutex> lock(mutex_);
  JobPtr job = job_;
  if (!job) return;
  const bool late = job->deadline && Clock::now() >= *job->deadline && job->stop_reason.empty();
  if (late) {
    job->stop_reason = job->searching ? "given up at the timeout, before the search was done"
                                      : "given up at the timeout, " +
                                            framesOf(pipeline_.buffer().size(), job->frames_required);
    abort_search_ = true;
  }
  if (job->searching) return;
  const std::string stop_reason = job->stop_reason;
  lock.unlock();

  if (!stop_reason.empty()) {
    CalibrationOutcome outcome;
    if (const auto current = keeper_.current())
      outcome.start = outcome.T_camera_lidar = current->T_camera_lidar;
    outcome.cancelled = true;
    outcome.reason = stop_reason;
    if (!pipeline_.lastProblem().empty())
      outcome.reason += "; last frame refused: " + pipeline_.lastProblem();
    endJob(std::move(job), false, outcome, "");
  } else if (pipeline_.buffer().size() >= job->frames_required) {
    startSearch(job);
  }
}

void RecalibrationServer::Impl::startSearch(const JobPtr& job) {
  CalibratorConfig config = config_.calibrator;
  if (job->request.rotation_range_deg > 0.0) config.range.rotation_deg = job->request.rotation_range_deg;
  if (job->request.translation_range_m > 0.0) config.range.translation_m = job->request.translation_range_m;
  const Eigen::Isometry3d start = keeper_.current()->T_camera_lidar;  // known, or there would be no frames
  search_stamp_ = pipeline_.buffer().newestStamp();
  progress_ = 0.0;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    abort_search_ = !job->stop_reason.empty();
    job->searching = true;
  }
  ROS_INFO_STREAM_NAMED(name_, name_ << ": search started with " << pipeline_.buffer().size() << " frames, +-"
                                     << config.range.rotation_deg << " deg and +-"
                                     << config.range.translation_m << " m");
  search_ = std::thread([this, frames = pipeline_.buffer().frames(), start, config] {
    SearchDone done;
    done.frames = frames;
    try {
      done.outcome = calibrate(frames, start, config, [this](double fraction, double) {
        progress_ = fraction;
        return !abort_search_;
      });
    } catch (const std::exception& e) {
      done.outcome.start = done.outcome.T_camera_lidar = start;
      done.outcome.frames = frames.size();
      done.error = e.what();
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    search_done_ = std::move(done);
    wake();
  });
}

/// Publishes the outcome and answers whoever waits for it.
void RecalibrationServer::Impl::endJob(JobPtr job, bool success, const CalibrationOutcome& outcome,
                                       const std::string& note) {
  FrameIds frames;
  if (const auto current = keeper_.current()) frames = {current->camera_frame, current->lidar_frame};
  CalibrationResult result = toMessage(outcome, frames, search_stamp_);
  if (!note.empty()) result.reason += "; " + note;
  ROS_INFO_STREAM_NAMED(name_, name_ << ": recalibration " << result.reason);
  // The transform first: whoever acts on the answer finds it in tf.
  guarded("publishing the transform", [&] { publishTransform(); });
  guarded("publishing the result", [&] {
    if (outputs_.result) outputs_.result(result);
  });
  last_outcome_ = result.accepted ? "accepted" : "not accepted";
  policy_.searchEnded();
  pipeline_.requestPictures();
  const std::lock_guard<std::mutex> lock(mutex_);
  job->response = answer(success, result.reason);
  job->response.result = result;
  job->finished = true;
  job_.reset();
  job.reset();  // under the lock: whoever waits is the last owner
  job_finished_.notify_all();
}

void RecalibrationServer::Impl::publishTransform() {
  if (keeper_.takeChanged()) transform_due_ = config_.tf_publish;
  if (!transform_due_) return;
  const auto current = keeper_.current();
  // What tf told us itself is no news on the vehicle's own edge, until we have changed that edge.
  const bool own_edge = !config_.tf_correct_child.empty();
  if (own_edge && keeper_.isFromTf() && !edge_published_) {
    transform_due_ = false;
    return;
  }
  auto message =
      outputTransform(tf_, config_, {current->camera_frame, current->lidar_frame}, current->T_camera_lidar);
  message.header.stamp = now();
  transform_due_ = false;
  edge_published_ = true;
  if (outputs_.transform) outputs_.transform(message);
}

void RecalibrationServer::Impl::updateState() {
  RecalibrationState state;
  state.header.stamp = now();
  pipeline_.describe(state);
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    state.frames_required = static_cast<std::uint32_t>(job_ ? job_->frames_required
                                                            : static_cast<std::size_t>(config_.frames_min));
    state.state = job_ && job_->searching                        ? RecalibrationState::SEARCHING
                  : job_ || state.frames < state.frames_required ? RecalibrationState::COLLECTING
                                                                 : RecalibrationState::IDLE;
    state.progress = state.state == RecalibrationState::SEARCHING ? static_cast<float>(progress_) : 0.0f;
    state.images = images_;
    state.waiting += queued_images_;
    state.dropped_memory += dropped_images_;
    state.dropped_unused += dropped_others_;
    state.dropped_forgotten += forgotten_images_;
    state.memory += queued_bytes_;
    state.text = describe(state);
    state_ = state;
  }
  const auto time = Clock::now();
  const bool changed = state.state != published_state_.state || state.frames != published_state_.frames ||
                       state.frames_required != published_state_.frames_required;
  if (!changed && time < next_state_) return;
  published_state_ = state;
  next_state_ = time + kStatePeriod;
  if (outputs_.state) outputs_.state(state);
}

/// Short enough for the title of the overlay.
std::string RecalibrationServer::Impl::summary(const RecalibrationState& state) const {
  if (state.state == RecalibrationState::SEARCHING)
    return "searching, " + std::to_string(std::lround(100.0f * state.progress)) + " % done";
  if (state.state == RecalibrationState::COLLECTING)
    return "collecting, " + framesOf(state.frames, state.frames_required);
  const std::string last = last_outcome_.empty() ? "" : ", last result " + last_outcome_;
  return "ready, " + std::to_string(state.frames) + " frames held" + last;
}

std::string RecalibrationServer::Impl::describe(const RecalibrationState& state) const {
  std::string text = summary(state);
  if (job_ && !job_->searching) text += ", a recalibration waits for frames";
  if (state.pending > 0) text += ", " + std::to_string(state.pending) + " images wait for their masks";
  if (!pipeline_.lastProblem().empty()) text += "; last frame refused: " + pipeline_.lastProblem();
  return text;
}

void RecalibrationServer::Impl::shutDown() {
  if (search_.joinable()) search_.join();
  const std::lock_guard<std::mutex> lock(mutex_);
  if (job_) {
    job_->response = answer(false, "the node is shutting down");
    job_->finished = true;
    job_.reset();
  }
  job_finished_.notify_all();
}

// --- the public face ---

RecalibrationServer::RecalibrationServer(const ServerConfig& config, const tf2::BufferCore& tf,
                                         const std::string& name, ServerOutputs outputs)
    : impl_(std::make_unique<Impl>(config, tf, name, std::move(outputs))) {}

RecalibrationServer::~RecalibrationServer() = default;

void RecalibrationServer::addImage(const sensor_msgs::ImageConstPtr& image) {
  impl_->add(Impl::Kind::kImage, image->data.size(),
             [image](FramePipeline& pipeline) { pipeline.synchroniser().addImage(image); });
  if (const auto info = impl_->infoFor(image->header)) addCameraInfo(info);
}

void RecalibrationServer::addImage(const sensor_msgs::CompressedImageConstPtr& image) {
  impl_->add(Impl::Kind::kImage, image->data.size(),
             [image](FramePipeline& pipeline) { pipeline.addImage(*image); });
  if (const auto info = impl_->infoFor(image->header)) addCameraInfo(info);
}

void RecalibrationServer::addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  impl_->add(Impl::Kind::kOther, sizeof *info,
             [info](FramePipeline& pipeline) { pipeline.synchroniser().addCameraInfo(info); });
}

void RecalibrationServer::addCloud(const sensor_msgs::PointCloud2ConstPtr& cloud) {
  impl_->add(Impl::Kind::kOther, cloud->data.size(),
             [cloud](FramePipeline& pipeline) { pipeline.synchroniser().addCloud(cloud); });
}

void RecalibrationServer::addMasks(const sensor_msgs::ImageConstPtr& masks) {
  impl_->add(Impl::Kind::kOther, masks->data.size(),
             [masks](FramePipeline& pipeline) { pipeline.synchroniser().addMasks(masks); });
}

void RecalibrationServer::addMasks(const sensor_msgs::CompressedImageConstPtr& masks) {
  impl_->add(Impl::Kind::kOther, masks->data.size(),
             [masks](FramePipeline& pipeline) { pipeline.addMasks(*masks); });
}

void RecalibrationServer::flush() {
  impl_->add(Impl::Kind::kOther, 0, [](FramePipeline& pipeline) { pipeline.synchroniser().flush(); });
}

void RecalibrationServer::timeJumpedBack() { impl_->clearCaches(); }

Recalibrate::Response RecalibrationServer::recalibrate(const Recalibrate::Request& request) {
  return impl_->recalibrate(request);
}

bool RecalibrationServer::save(const std::string& path, const std::string& format, std::string& message) {
  return impl_->save(path, format, message);
}

void RecalibrationServer::setParameters(const Parameters& values) { impl_->setParameters(values); }

void RecalibrationServer::reset() { impl_->reset(); }

bool RecalibrationServer::cancel(std::string& message) { return impl_->cancel(message); }

bool RecalibrationServer::restore(std::string& message) { return impl_->restore(message); }

RecalibrationState RecalibrationServer::state() const { return impl_->state(); }

std::string RecalibrationServer::extrinsicSource() const { return impl_->extrinsicSource(); }

void RecalibrationServer::waitUntilIdle() { impl_->waitUntilIdle(); }

void RecalibrationServer::stop() { impl_->stop(); }

}  // namespace lidar_camera_recalibration

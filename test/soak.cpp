// The nodelet under the load of a vehicle, for as long as wanted. This program is a nodelet manager that
// holds the recalibration, a nodelet that plays a drive (images, clouds, masks), and one with nothing but a
// heartbeat. It ends with a table, and with status 1 if images are unaccounted for, memory grows, or the
// manager stood still. scripts/soak.py starts it with a master of its own.
#include <diagnostic_msgs/DiagnosticArray.h>
#include <lidar_camera_recalibration/CalibrationResult.h>
#include <lidar_camera_recalibration/Recalibrate.h>
#include <lidar_camera_recalibration/RecalibrationState.h>
#include <nodelet/loader.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>
#include <pluginlib/class_loader.hpp>

#include <algorithm>
#include <atomic>
#include <boost/program_options.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <deque>
#include <functional>
#include <iostream>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "process_memory.hpp"
#include "ros_rig.hpp"

namespace lidar_camera_recalibration {
namespace {

const std::string kNode = "/recalibration";

struct Options {
  double duration, rate, mask_period, mask_delay, search_period;  // [s], rate [1/s]
  int width, height, points, frames;
};

double cpuTime(clockid_t clock) {
  timespec time{};
  clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(at), values.end());
  return values[at];
}

/// How late something was that should have happened at a fixed rate [s].
class Lateness {
 public:
  void add(double late) {
    const std::lock_guard<std::mutex> lock(mutex_);
    values_.push_back(late);
  }
  double of(double share) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return quantile(values_, share);
  }

 private:
  mutable std::mutex mutex_;
  std::vector<double> values_;
};

constexpr double kHeartbeat = 0.02;  // [s]

/// Its timer runs in the manager's threads like every nodelet's callbacks: it is late if others hold them.
class Heartbeat : public nodelet::Nodelet {
 public:
  explicit Heartbeat(Lateness& lateness) : lateness_(lateness) {}

 private:
  void onInit() override {
    timer_ = getNodeHandle().createWallTimer(
        ros::WallDuration(kHeartbeat), [this](const ros::WallTimerEvent& event) {
          lateness_.add((event.current_real - event.current_expected).toSec());
        });
  }
  Lateness& lateness_;
  ros::WallTimer timer_;
};

/// What the machine itself makes late: the same beat in a thread of its own.
class Reference {
 public:
  ~Reference() {
    stop_ = true;
    thread_.join();
  }
  Lateness lateness;

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_{[this] {
    ros::WallTime next = ros::WallTime::now();
    while (!stop_) {
      next += ros::WallDuration(kHeartbeat);
      ros::WallTime::sleepUntil(next);
      lateness.add((ros::WallTime::now() - next).toSec());
    }
  }};
};

/// Drivers and a segmenter: publishes copies of a few scenes with new stamps.
class Drive : public nodelet::Nodelet {
 public:
  explicit Drive(const Options& options) : options_(options) {
    constexpr unsigned kScenes = 4;
    constexpr int kBoxes = 40, kRings = 64;
    const Camera camera = SyntheticScene::camera(options.width, options.height);
    for (unsigned seed = 1; seed <= kScenes; ++seed) {
      const SyntheticScene scene(seed, kBoxes);
      FrameMessages messages = syntheticMessages(
          scene, camera, scene.cloud(M_PI, 2.0 * M_PI * kRings / options.points), ros::Time());
      // Rays without an echo lie at the origin, as many drivers have it.
      auto cloud = boost::make_shared<sensor_msgs::PointCloud2>(*messages.cloud);
      sensor_msgs::PointCloud2Modifier(*cloud).resize(static_cast<std::size_t>(options.points));
      messages.cloud = cloud;
      scenes_.push_back(messages);
    }
  }
  /// Before the manager ends, to which the publishers belong.
  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    for (ros::Publisher* publisher : {&image_, &info_, &points_, &masks_}) publisher->shutdown();
  }
  /// Of the scenes, which belong to no vehicle's process [MB].
  double memory() const {
    std::size_t bytes = 0;
    for (const FrameMessages& scene : scenes_)
      bytes += scene.image->data.size() + scene.cloud->data.size() + scene.masks->data.size();
    return static_cast<double>(bytes) / 1048576.0;
  }
  std::uint64_t images() const { return images_; }
  double cpu() const { return cpu_; }  ///< of making the messages [s]

 private:
  void onInit() override {
    ros::NodeHandle& node = getNodeHandle();
    image_ = node.advertise<sensor_msgs::Image>("/camera/image_raw", 10);
    info_ = node.advertise<sensor_msgs::CameraInfo>("/camera/camera_info", 10);
    points_ = node.advertise<sensor_msgs::PointCloud2>("/lidar/points", 10);
    masks_ = node.advertise<sensor_msgs::Image>("/camera/masks", 10);
    thread_ = std::thread([this] { run(); });
  }

  void run() {
    for (const ros::Publisher* publisher : {&image_, &info_, &points_, &masks_})
      while (publisher->getNumSubscribers() == 0 && !stop_) ros::WallDuration(0.01).sleep();
    ros::WallRate rate(options_.rate);
    std::deque<std::pair<ros::Time, std::size_t>> segmented;
    ros::Time next_masks;
    for (std::size_t i = 0; !stop_; ++i, rate.sleep()) {
      const ros::Time now = ros::Time::now();
      const std::size_t scene = i % scenes_.size();
      image_.publish(stamped(scenes_[scene].image, now));
      info_.publish(stamped(scenes_[scene].info, now));
      points_.publish(stamped(scenes_[scene].cloud, now));
      ++images_;
      if (now >= next_masks) {  // the segmenter takes this one
        segmented.emplace_back(now, scene);
        next_masks = now + ros::Duration(options_.mask_period);
      }
      while (!segmented.empty() && segmented.front().first + ros::Duration(options_.mask_delay) <= now) {
        masks_.publish(stamped(scenes_[segmented.front().second].masks, segmented.front().first));
        segmented.pop_front();
      }
      cpu_ = cpuTime(CLOCK_THREAD_CPUTIME_ID);
    }
  }

  const Options options_;
  std::vector<FrameMessages> scenes_;
  ros::Publisher image_, info_, points_, masks_;
  std::atomic<std::uint64_t> images_{0};
  std::atomic<double> cpu_{0.0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

/// What the node says of itself, collected.
class Listener {
 public:
  Listener() {
    state_ = handle_.subscribe<RecalibrationState>(kNode + "/state", 100,
                                                   [this](const RecalibrationState::ConstPtr& state) {
                                                     const std::lock_guard<std::mutex> lock(mutex_);
                                                     if (states_++ == 0) first_state_ = ros::WallTime::now();
                                                     if (!addsUp(*state)) ++unbalanced_;
                                                     last_ = *state;
                                                   });
    result_ = handle_.subscribe<CalibrationResult>(kNode + "/result", 10,
                                                   [this](const CalibrationResult::ConstPtr& result) {
                                                     const std::lock_guard<std::mutex> lock(mutex_);
                                                     ++results_;
                                                     last_result_ = result->reason;
                                                   });
    diagnostics_ = handle_.subscribe<diagnostic_msgs::DiagnosticArray>(
        "/diagnostics", 100, [this](const diagnostic_msgs::DiagnosticArray::ConstPtr& array) {
          const std::lock_guard<std::mutex> lock(mutex_);
          for (const auto& status : array->status)
            if (status.name.find("inputs") != std::string::npos) inputs_ = status;
        });
  }

  template <typename T>
  T get(T Listener::*member) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return this->*member;
  }

  ros::WallTime first_state_;
  RecalibrationState last_;
  std::uint64_t states_ = 0, unbalanced_ = 0, results_ = 0;
  std::string last_result_ = "none";
  diagnostic_msgs::DiagnosticStatus inputs_;

 private:
  mutable std::mutex mutex_;
  ros::NodeHandle handle_;
  ros::Subscriber state_, result_, diagnostics_;
};

class Report {
 public:
  template <typename... Values>
  void row(const std::string& name, const char* format, Values... values) {
    char text[512];
    std::snprintf(text, sizeof text, format, values...);
    std::printf("%-46s %s\n", name.c_str(), text);
  }
  void require(bool holds, const std::string& violation) {
    if (holds) return;
    std::printf("VIOLATION: %s\n", violation.c_str());
    good_ = false;
  }
  bool good() const { return good_; }

 private:
  bool good_ = true;
};

/// Once a second: memory and CPU, and a search from time to time.
struct Samples {
  std::vector<double> quiet_memory;   // [MB]
  double peak_memory = 0.0;           // [MB], searches included
  double cpu = 0.0, quiet_cpu = 0.0;  // [s]; quiet: no search runs
  std::uint64_t images = 0, quiet_images = 0, scored = 0, quiet_scored = 0;
};

Samples observe(const Options& options, const Listener& listener, const Drive& drive) {
  Samples samples;
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(options.duration);
  ros::WallTime next_search = ros::WallTime::now() + ros::WallDuration(options.search_period);
  double cpu = cpuTime(CLOCK_PROCESS_CPUTIME_ID) - drive.cpu();
  std::uint64_t images = drive.images();
  RecalibrationState before = listener.get(&Listener::last_);
  while (ros::WallTime::now() < end && ros::ok()) {
    ros::WallDuration(1.0).sleep();
    const double memory = residentMemory();
    samples.peak_memory = std::max(samples.peak_memory, memory);
    const double new_cpu = cpuTime(CLOCK_PROCESS_CPUTIME_ID) - drive.cpu();
    const std::uint64_t new_images = drive.images();
    const RecalibrationState state = listener.get(&Listener::last_);
    samples.cpu += new_cpu - cpu;
    samples.images += new_images - images;
    samples.scored += state.scored - before.scored;
    if (before.state != RecalibrationState::SEARCHING && state.state != RecalibrationState::SEARCHING) {
      samples.quiet_cpu += new_cpu - cpu;
      samples.quiet_images += new_images - images;
      samples.quiet_scored += state.scored - before.scored;
      samples.quiet_memory.push_back(memory);
    }
    cpu = new_cpu;
    images = new_images;
    before = state;
    if (options.search_period > 0.0 && ros::WallTime::now() >= next_search) {
      Recalibrate service;
      service.request.dry_run = true;
      ros::service::call(kNode + "/recalibrate", service);
      next_search = ros::WallTime::now() + ros::WallDuration(options.search_period);
    }
  }
  return samples;
}

void reportImages(const RecalibrationState& state, std::uint64_t published, std::uint64_t unbalanced,
                  Report& report) {
  const auto number = [](std::uint64_t value) { return static_cast<unsigned long>(value); };
  report.row("images published", "%lu", number(published));
  report.row("  received", "%lu", number(state.images));
  report.row("  scored", "%lu", number(state.scored));
  report.row("  waiting at the end", "%lu", number(state.waiting));
  report.row("  dropped", "%lu", number(imagesDropped(state)));
  const std::pair<const char*, std::uint64_t> causes[] = {
      {"unmatched", state.dropped_unmatched}, {"no masks", state.dropped_no_masks},
      {"invalid", state.dropped_invalid},     {"poor", state.dropped_poor},
      {"memory", state.dropped_memory},       {"no extrinsic", state.dropped_no_extrinsic},
      {"no motion", state.dropped_no_motion}};
  for (const auto& [cause, count] : causes)
    if (count > 0) report.row(std::string("    ") + cause, "%lu", number(count));
  report.row("masks of unknown images", "%lu", number(state.dropped_unknown_masks));
  report.row("other messages given up", "%lu", number(state.dropped_unused));
  report.require(state.images == published, "images were lost on the way to the node");
  report.require(addsUp(state), "images received are neither scored nor dropped nor waiting");
  report.require(unbalanced == 0, std::to_string(unbalanced) + " states in between did not add up");
  report.require(state.scored > 0, "no frame was scored");
}

/// @param scenes  that this program holds for itself [MB]
void reportMemory(const Samples& samples, double empty, double scenes, Report& report) {
  // The caches fill during the first half; then nothing may grow any more. The lower quartile, since the
  // frame that is just prepared comes and goes.
  const std::vector<double>& memory = samples.quiet_memory;
  const auto part = [&](double from, double to) {
    const auto at = [&](double share) {
      return memory.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(memory.size()));
    };
    return quantile({at(from), at(to)}, 0.25);
  };
  const double early = part(0.5, 0.75), late = part(0.75, 1.0);
  report.row("resident memory before the nodelet was there",
             "%.0f MB; like all below without the %.0f MB of this program's scenes", empty - scenes, scenes);
  report.row("  third quarter of the time, no search running", "%.0f MB", early - scenes);
  report.row("  last quarter", "%.0f MB", late - scenes);
  report.row("  maximum", "%.0f MB", samples.peak_memory - scenes);
  constexpr double kNoise = 16.0;  // [MB] of the allocator
  report.require(late < early + kNoise, "memory grows");
}

int soak(const Options& options) {
  Listener listener;
  Lateness heartbeat;
  const auto drive = boost::make_shared<Drive>(options);
  pluginlib::ClassLoader<nodelet::Nodelet> plugins("nodelet", "nodelet::Nodelet");
  nodelet::Loader manager([&](const std::string& type) -> boost::shared_ptr<nodelet::Nodelet> {
    if (type == "heartbeat") return boost::make_shared<Heartbeat>(heartbeat);
    if (type == "drive") return drive;
    return plugins.createInstance(type);
  });
  const nodelet::M_string remappings = {{"/image", "/camera/image_raw"},
                                        {"/camera_info", "/camera/camera_info"},
                                        {"/points", "/lidar/points"},
                                        {"/masks", "/camera/masks"}};
  const double empty = residentMemory();
  const ros::WallTime start = ros::WallTime::now();
  const bool loaded = manager.load(kNode, "lidar_camera_recalibration/RecalibrationNodelet", remappings, {});
  if (!loaded || !RosRig::eventually([&] { return listener.get(&Listener::states_) > 0; }, 20.0)) {
    std::fprintf(stderr, "the nodelet did not start\n");
    return 1;
  }
  const double startup = (listener.get(&Listener::first_state_) - start).toSec();
  manager.load("/heartbeat", "heartbeat", {}, {});
  const Reference reference;
  manager.load("/drive", "drive", {}, {});

  const Samples samples = observe(options, listener, *drive);
  const double held = static_cast<double>(listener.get(&Listener::last_).memory) / 1e6;
  drive->stop();
  const bool arrived = RosRig::eventually(
      [&] {
        const RecalibrationState state = listener.get(&Listener::last_);
        return state.images == drive->images() && state.waiting == state.pending &&
               state.state != RecalibrationState::SEARCHING;
      },
      30.0);

  Report report;
  report.row("duration",
             "%.0f s, images %d x %d and clouds of %d points at %.0f Hz, masks every %.1f s, %.1f s late",
             options.duration, options.width, options.height, options.points, options.rate,
             options.mask_period, options.mask_delay);
  report.row("nodelet loaded to first ~state", "%.2f s", startup);
  reportImages(listener.get(&Listener::last_), drive->images(), listener.get(&Listener::unbalanced_), report);
  report.row("recalibrations", "%lu, the last one: %s",
             static_cast<unsigned long>(listener.get(&Listener::results_)),
             listener.get(&Listener::last_result_).c_str());
  const auto milliseconds = [](double time, std::uint64_t count) {
    return count > 0 ? 1e3 * time / static_cast<double>(count) : 0.0;
  };
  report.row("CPU time per image, no search running", "%.1f ms (%.0f ms per frame scored)",
             milliseconds(samples.quiet_cpu, samples.quiet_images),
             milliseconds(samples.quiet_cpu, samples.quiet_scored));
  report.row("CPU time per image, searches included", "%.1f ms", milliseconds(samples.cpu, samples.images));
  for (const auto& value : listener.get(&Listener::inputs_).values)
    report.row("  " + value.key, "%s", value.value.c_str());
  const std::pair<const char*, const Lateness*> beats[] = {
      {"heartbeat in the manager", &heartbeat}, {"  the same in a thread of its own", &reference.lateness}};
  for (const auto& [name, lateness] : beats)
    report.row(name, "late by %.1f ms (median), %.1f ms (99th percentile), %.0f ms (worst)",
               1e3 * lateness->of(0.5), 1e3 * lateness->of(0.99), 1e3 * lateness->of(1.0));
  reportMemory(samples, empty, drive->memory(), report);
  report.row("  messages and frames held, as ~state counts them", "%.0f MB", held);

  report.require(arrived, "the node did not come to rest when the drive was over");
  constexpr double kStandstill = 5.0;  // [s]; no load of the machine explains that
  report.require(heartbeat.of(1.0) < kStandstill, "the manager stood still");
  std_srvs::Trigger reset;
  ros::service::call(kNode + "/reset", reset);
  report.require(RosRig::eventually([&] { return listener.get(&Listener::last_).waiting == 0; }, 10.0),
                 "~reset left images waiting");
  const RecalibrationState state = listener.get(&Listener::last_);
  report.require(state.images == state.scored + imagesDropped(state),
                 "after ~reset images are unaccounted for");
  report.row("resident memory after ~reset", "%.0f MB", residentMemory() - drive->memory());
  report.require(manager.clear(), "the nodelets could not be unloaded");
  std::printf("%s\n", report.good() ? "no violation" : "FAILED");
  return report.good() ? 0 : 1;
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) {
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  namespace po = boost::program_options;
  using namespace lidar_camera_recalibration;
  ros::init(argc, argv, "soak", ros::init_options::NoSigintHandler);
  Options options{};
  po::options_description description("options");
  description.add_options()("help", "this text")("duration",
                                                 po::value(&options.duration)->default_value(120.0), "[s]")(
      "width", po::value(&options.width)->default_value(1920), "of the images [px]")(
      "height", po::value(&options.height)->default_value(1200), "[px]")(
      "points", po::value(&options.points)->default_value(120000), "of the clouds")(
      "frames", po::value(&options.frames)->default_value(15), "in the buffer; fewer ones fill it sooner")(
      "rate", po::value(&options.rate)->default_value(10.0), "of images and clouds [1/s]")(
      "mask-period", po::value(&options.mask_period)->default_value(1.0), "between masks [s]")(
      "mask-delay", po::value(&options.mask_delay)->default_value(2.0), "of the masks after their image [s]")(
      "search-period", po::value(&options.search_period)->default_value(30.0),
      "between searches [s]; 0: none");
  try {
    po::variables_map values;
    po::store(po::parse_command_line(argc, argv, description), values);
    po::notify(values);
    if (values.count("help") > 0) {
      std::cout << description;
      return 0;
    }
  } catch (const po::error& error) {
    std::cerr << error.what() << '\n' << description;
    return 2;
  }
  // What a driver's tf would say; ~recalibrate then finds the way to the scene's truth.
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> guess = wrongGuess().matrix();
  ros::param::set(kNode + "/initial/T_camera_lidar", std::vector<double>(guess.data(), guess.data() + 16));
  ros::param::set(kNode + "/frames/max", options.frames);
  ros::param::set(kNode + "/frames/min_view_change", 0.0);  // the same views again and again fill the buffer
  ros::AsyncSpinner spinner(1);
  spinner.start();
  return soak(options);
}

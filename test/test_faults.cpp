// What a vehicle does to its inputs and its operator to the services, one fault at a time. This program is
// the nodelet manager itself, so it sees which messages its nodelets hold and how much memory they take.
// After each fault the node must live, hold nothing of it, and have published no other transform than the
// start and the accepted results.
#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>
#include <lidar_camera_recalibration/SaveCalibration.h>
#include <nodelet/loader.h>
#include <signal.h>
#include <spawn.h>
#include <std_srvs/Trigger.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <tf2_msgs/TFMessage.h>
#include <tf2_ros/transform_broadcaster.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <future>
#include <iterator>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/result_file.hpp"
#include "process_memory.hpp"
#include "ros_rig.hpp"
#include "server.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

nodelet::Loader* manager = nullptr;
constexpr double kMemoryTolerance = 2.0;  // [MB]; a frame of this size has 1 to 2 MB

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

/// One nodelet of the manager, with a camera of its own.
class Node {
 public:
  explicit Node(const std::string& name = "/recalibration", const std::string& camera = "/camera")
      : name_(name), camera_(camera) {
    ros::param::del(name);
    set("frames/min", 2);
    set("frames/max", 5);
    set("frames/min_interval", 0.5);
    set("frames/min_view_change", 0.0);  // the camera stands still
    set("features/normal_neighbours", 10);
    set("search_range/rotation_deg", 2.0);
    set("search_range/translation_m", 0.08);
    set("tf/child_frame", camera.substr(1) + "_recalibrated");
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> guess = wrongGuess().matrix();
    set("initial/T_camera_lidar", std::vector<double>(guess.data(), guess.data() + 16));
  }
  ~Node() { unload(); }

  template <typename Value>
  void set(const std::string& parameter, const Value& value) {
    ros::param::set(name_ + "/" + parameter, value);
  }
  /// A search that takes minutes.
  void searchSlowly() {
    set("objective", "paper");
    set("search", "paper");
    set("paper/refine_evaluations", 1000000);
  }

  bool load() {
    rig = std::make_unique<RosRig>(name_, camera_);
    const nodelet::M_string remappings = {{"/image", camera_ + "/image_raw"},
                                          {"/camera_info", camera_ + "/camera_info"},
                                          {"/points", "/lidar/points"},
                                          {"/masks", camera_ + "/masks"}};
    loaded_ = manager->load(name_, "lidar_camera_recalibration/RecalibrationNodelet", remappings, {});
    return loaded_ && rig->connect();
  }
  void unload() {
    if (loaded_) {
      EXPECT_TRUE(manager->unload(name_));
    }
    loaded_ = false;
  }
  bool isLoaded() const { return loaded_; }

  FrameMessages next() { return syntheticMessages(++seed_ % 4 + 1, ros::Time(stamp += 1.0)); }
  /// Publishes an image, its CameraInfo and a cloud, for which masks may come later.
  FrameMessages withoutMasks() {
    FrameMessages messages = next();
    FrameMessages published = messages;
    published.masks.reset();
    rig->publish(published);
    return messages;
  }
  void masksOf(const FrameMessages& messages) {
    FrameMessages masks;
    masks.masks = messages.masks;
    rig->publish(masks);
  }
  CalibrationScore frame(const RosRig::Edit& edit = nullptr) {
    stamp += 1.0;
    return rig->frame(++seed_ % 4 + 1, ros::Time(stamp), edit);
  }
  bool used(const FrameMessages& messages) const {
    return RosRig::eventually([&] { return rig->score(messages.image->header.stamp).used; });
  }
  /// What the node says of its inputs in /diagnostics.
  std::string inputs() const { return rig->diagnostic(name_.substr(1) + ": inputs").message; }
  /// For counters that are published once a second.
  bool becomes(const std::function<bool(const RecalibrationState&)>& condition) const {
    return RosRig::eventually([&] { return condition(rig->state()); });
  }
  Recalibrate::Response recalibrate(bool wait) {
    Recalibrate service;
    service.request.wait = wait;
    EXPECT_TRUE(rig->call("recalibrate", service));
    return service.response;
  }
  std_srvs::Trigger::Response trigger(const std::string& name) {
    std_srvs::Trigger service;
    EXPECT_TRUE(rig->call(name, service)) << name;
    return service.response;
  }

  std::unique_ptr<RosRig> rig;
  double stamp = 5000.0;  // [s], of the last frame

 private:
  const std::string name_, camera_;
  unsigned seed_ = 0;
  bool loaded_ = false;
};

class Faults : public testing::Test {
 protected:
  Faults() {
    const auto keep = [this](const tf2_msgs::TFMessage::ConstPtr& message) {
      const std::lock_guard<std::mutex> lock(mutex_);
      for (const auto& transform : message->transforms) transforms_.push_back(transform);
    };
    tf_ = handle_.subscribe<tf2_msgs::TFMessage>("/tf_static", 100, keep);
    result_ = handle_.subscribe<CalibrationResult>("/recalibration/result", 10,
                                                   [this](const CalibrationResult::ConstPtr& result) {
                                                     const std::lock_guard<std::mutex> lock(mutex_);
                                                     results_.push_back(*result);
                                                   });
  }

  void start() { ASSERT_TRUE(node_.load()); }

  void TearDown() override {
    if (!node_.isLoaded()) {
      ASSERT_TRUE(node_.load()) << "it cannot be loaded again";
    }
    expectLife(node_);
    node_.unload();
    EXPECT_TRUE(manager->listLoadedNodelets().empty());
    expectOnlyTrustedTransforms();
    const double memory = allocatedMemory();
    static const double first = memory;
    EXPECT_LT(memory, first + kMemoryTolerance) << "memory does not come back";
  }

  /// A good frame is used, and after ~reset nothing is held.
  void expectLife(Node& node) {
    node.trigger("reset");
    EXPECT_TRUE(RosRig::eventually([&] { return node.frame().used; })) << node.rig->state().text;
    EXPECT_TRUE(node.becomes([](const auto& state) { return state.frames > 0; }));
    EXPECT_EQ(node.rig->state().state, RecalibrationState::COLLECTING) << node.rig->state().text;
    EXPECT_TRUE(node.trigger("reset").success);
    EXPECT_TRUE(node.becomes([](const auto& state) {
      return state.frames == 0 && state.waiting == 0 && state.memory == 0;
    })) << node.rig->state();
    EXPECT_TRUE(node.rig->statesAddUp()) << node.rig->state();
  }

  void expectOnlyTrustedTransforms() {
    std::vector<Eigen::Isometry3d> trusted = {wrongGuess()};
    for (const CalibrationResult& result : results())
      if (result.accepted) trusted.push_back(tf2::transformToEigen(result.transform));
    const std::lock_guard<std::mutex> lock(mutex_);
    EXPECT_FALSE(transforms_.empty());
    for (const auto& transform : transforms_) {
      if (!contains(transform.child_frame_id, "_recalibrated")) continue;
      EXPECT_EQ(transform.header.frame_id, "lidar");
      const Eigen::Isometry3d T_camera_lidar = tf2::transformToEigen(transform).inverse();
      EXPECT_TRUE(std::any_of(trusted.begin(), trusted.end(), [&](const auto& T) {
        return T.isApprox(T_camera_lidar, 1e-6);
      })) << transform;
    }
  }

  std::vector<CalibrationResult> results() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return results_;
  }

  Node node_;

 private:
  ros::NodeHandle handle_;
  ros::Subscriber tf_, result_;
  std::mutex mutex_;
  std::vector<geometry_msgs::TransformStamped> transforms_;
  std::vector<CalibrationResult> results_;
};

// --- no fault: what the manager's other nodelets rely on ---

TEST_F(Faults, TheVeryMessagesArePassedOnWithoutCopies) {
  start();
  FrameMessages messages = node_.next();
  messages.masks.reset();
  ASSERT_EQ(messages.image.use_count(), 1);
  node_.rig->publish(messages);
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.pending == 1; }));
  EXPECT_GT(messages.image.use_count(), 1) << "the node waits for masks with a copy of the image";
  EXPECT_GT(messages.cloud.use_count(), 1) << "the node waits for masks with a copy of the cloud";
  node_.trigger("reset");
  EXPECT_TRUE(
      RosRig::eventually([&] { return messages.image.use_count() == 1 && messages.cloud.use_count() == 1; }));
}

// --- masks ---

/// A process that may be killed: it makes masks of every image. (The scene's colours are its ids.)
class Segmenter {
 public:
  static int run(int argc, char** argv) {
    ros::init(argc, argv, "segmenter");
    ros::NodeHandle handle;
    const ros::Publisher publisher = handle.advertise<sensor_msgs::Image>("/camera/masks", 10);
    const ros::Subscriber subscriber = handle.subscribe<sensor_msgs::Image>(
        "/camera/image_raw", 10, [&](const sensor_msgs::Image::ConstPtr& image) {
          const cv::Mat colours = cv_bridge::toCvCopy(image, "bgr8")->image;
          cv::Mat ids(colours.size(), CV_32SC1);
          constexpr int kInverseOf37 = 173;  // modulo 256
          for (int v = 0; v < ids.rows; ++v)
            for (int u = 0; u < ids.cols; ++u)
              ids.at<int>(v, u) = colours.at<cv::Vec3b>(v, u)[0] * kInverseOf37 % 256;
          publisher.publish(toMaskMessage(image->header, {ids}));
        });
    ros::spin();
    return 0;
  }

  Segmenter() {
    std::string self = fs::read_symlink("/proc/self/exe").string(), flag = "--segmenter";
    char* arguments[] = {self.data(), flag.data(), nullptr};
    EXPECT_EQ(posix_spawn(&process_, self.c_str(), nullptr, nullptr, arguments, environ), 0);
  }
  ~Segmenter() { kill(); }
  /// Like a crash: it says goodbye to nobody.
  void kill() {
    if (process_ <= 0) return;
    ::kill(process_, SIGKILL);
    waitpid(process_, nullptr, 0);
    process_ = 0;
  }

 private:
  pid_t process_ = 0;
};

TEST_F(Faults, TheSegmenterDiesAndReturns) {
  start();
  const auto segments = [&] {
    return RosRig::eventually([&] {
      const FrameMessages messages = node_.withoutMasks();
      return RosRig::eventually([&] { return node_.rig->score(messages.image->header.stamp).used; }, 1.0);
    });
  };
  {
    const Segmenter segmenter;
    ASSERT_TRUE(segments());
    ASSERT_TRUE(node_.becomes([](const auto& state) { return state.frames > 0; }));
  }
  const RecalibrationState before = node_.rig->state();
  for (int i = 0; i < 5; ++i) {
    node_.withoutMasks();
    ros::WallDuration(0.05).sleep();
  }
  EXPECT_TRUE(node_.becomes([&](const auto& state) { return state.pending >= before.pending + 5; }));
  EXPECT_EQ(node_.rig->state().frames, before.frames) << "what was gathered stays";
  const Segmenter again;
  EXPECT_TRUE(segments());
}

TEST_F(Faults, MasksHalfAMinuteLate) {
  start();
  std::vector<FrameMessages> frames;
  for (int i = 0; i <= 30; ++i) {
    frames.push_back(node_.withoutMasks());
    ros::WallDuration(0.02).sleep();
  }
  ASSERT_TRUE(node_.becomes([](const auto& state) { return state.pending == 31; }));
  node_.masksOf(frames[0]);
  EXPECT_TRUE(node_.used(frames[0]));
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.pending == 30 && state.frames == 1; }));
  EXPECT_EQ(imagesDropped(node_.rig->state()), 0u);
}

TEST_F(Faults, MasksOutOfOrderAndTwice) {
  start();
  std::vector<FrameMessages> frames;
  for (int i = 0; i < 5; ++i) {
    frames.push_back(node_.withoutMasks());
    ros::WallDuration(0.02).sleep();
  }
  ASSERT_TRUE(node_.becomes([](const auto& state) { return state.pending == 5; }));
  for (const std::size_t i : {4u, 0u, 2u, 2u, 1u, 3u, 0u}) {
    node_.masksOf(frames[i]);
    EXPECT_TRUE(node_.used(frames[i])) << i;
  }
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.frames == 5 && state.pending == 0; }));
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(node_.frame().used) << "newer images tell that nothing will match";
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.dropped_unknown_masks == 2; }));
  EXPECT_EQ(imagesDropped(node_.rig->state()), 0u);
  EXPECT_EQ(node_.rig->state().scored, 8u);
}

TEST_F(Faults, MasksWithNonsense) {
  start();
  const auto masks = [&](const std::function<cv::Mat(const cv::Mat&)>& change) {
    return node_.frame([&](FrameMessages& messages) {
      const cv::Mat ids = change(toMaskLayers(*messages.masks).front());
      messages.masks = boost::make_shared<sensor_msgs::Image>(toMaskMessage(messages.masks->header, {ids}));
    });
  };
  const CalibrationScore empty = masks([](const cv::Mat& ids) { return cv::Mat(ids * 0); });
  EXPECT_FALSE(empty.used);
  EXPECT_TRUE(contains(empty.reason, "holds no mask")) << empty.reason;

  const CalibrationScore small =
      masks([](const cv::Mat& ids) { return ids.rowRange(0, ids.rows / 2).clone(); });
  EXPECT_FALSE(small.used);
  EXPECT_TRUE(contains(small.reason, "masks: is 320 x 120 px")) << small.reason;

  int count = 0;
  const CalibrationScore many = masks([&](const cv::Mat& ids) {
    cv::Mat tiles = ids.clone();  // 5 x 3 px each
    for (int v = 0; v < ids.rows; ++v)
      for (int u = 0; u < ids.cols; ++u)
        count = std::max(count, tiles.at<int>(v, u) = 1 + v / 3 * (ids.cols / 5) + u / 5);
    return tiles;
  });
  EXPECT_GT(count, 5000);
  EXPECT_TRUE(many.used) << many.reason;
  EXPECT_TRUE(std::isfinite(many.score));

  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.scored == 1; }));
  EXPECT_EQ(node_.rig->state().dropped_invalid, 2u);
}

TEST_F(Faults, MasksOfImagesThatWereDropped) {
  node_.set("sync/mask_timeout", 3.0);
  start();
  const FrameMessages early = node_.withoutMasks();
  ros::WallDuration(0.02).sleep();
  for (int i = 0; i < 6; ++i) EXPECT_TRUE(node_.frame().used);
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.dropped_no_masks == 1; }));
  node_.masksOf(early);
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.dropped_unknown_masks == 1; }));
  EXPECT_TRUE(node_.rig->score(early.image->header.stamp).header.stamp.isZero());
}

// --- topics and stamps ---

/// Publishes what is left of the frames ten times a second until the node complains.
bool complains(Node& node, const std::string& problem, const std::function<void(FrameMessages&)>& silence) {
  const FrameMessages messages = node.next();
  double stamp = node.stamp;
  const bool heard = RosRig::eventually([&] {
    FrameMessages copy;
    copy.image = stamped(messages.image, ros::Time(stamp += 0.1));
    copy.info = stamped(messages.info, ros::Time(stamp));
    copy.cloud = stamped(messages.cloud, ros::Time(stamp));
    silence(copy);
    node.rig->publish(copy);
    ros::WallDuration(0.08).sleep();
    return contains(node.inputs(), problem);
  });
  node.stamp = stamp;
  return heard;
}

TEST_F(Faults, CloudsStop) {
  start();
  ASSERT_TRUE(node_.frame().used);
  EXPECT_TRUE(complains(node_, "no message on /lidar/points", [](auto& frame) { frame.cloud.reset(); }))
      << node_.inputs();
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.dropped_unmatched > 10; }));
  const RecalibrationState state = node_.rig->state();
  EXPECT_LE(state.waiting, 20u) << "sync/max_unmatched";
  EXPECT_EQ(state.frames, 1u) << "what was gathered stays";
  EXPECT_TRUE(node_.frame().used);
}

TEST_F(Faults, ImagesOfOneOfTwoCamerasStop) {
  start();
  Node right("/right", "/right_camera");
  ASSERT_TRUE(right.load());
  // Each cloud goes to both nodelets, so the other camera's stamps are far away.
  right.stamp = 90000.0;
  ASSERT_TRUE(right.frame().used);
  ASSERT_TRUE(node_.frame().used);
  EXPECT_TRUE(complains(right, "no message on /right_camera/image_raw", [](auto& frame) {
    frame.image.reset();
  })) << right.inputs();
  EXPECT_TRUE(right.becomes([](const auto& state) { return state.dropped_unused > 10; }));
  EXPECT_EQ(right.rig->state().frames, 1u);
  EXPECT_TRUE(node_.frame().used) << "the left camera goes on";
  EXPECT_TRUE(right.frame().used) << "images are back";

  right.searchSlowly();
  right.unload();
  ASSERT_TRUE(right.load());
  EXPECT_TRUE(right.frame().used && right.frame().used);
  EXPECT_TRUE(right.recalibrate(false).success);
  EXPECT_TRUE(right.becomes([](const auto& state) { return state.state == state.SEARCHING; }));
  EXPECT_TRUE(node_.frame().used) << "while the other one searches";
  right.unload();
  EXPECT_TRUE(node_.frame().used) << "the other one is gone";
}

TEST_F(Faults, StampsJump) {
  start();
  ASSERT_TRUE(node_.frame().used);
  // One image from an hour ahead is a bad stamp: what waits goes on waiting.
  const FrameMessages waiting = node_.withoutMasks();
  ros::WallDuration(0.02).sleep();
  const double now = node_.stamp;
  node_.stamp += 3600.0;
  node_.withoutMasks();
  ros::WallDuration(0.02).sleep();
  node_.stamp = now;
  EXPECT_TRUE(node_.frame().used);
  node_.masksOf(waiting);
  EXPECT_TRUE(node_.used(waiting));

  // Several are a jump.
  node_.stamp += 7200.0;
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(node_.frame().used);
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.waiting == 0; })) << node_.rig->state();
  EXPECT_EQ(node_.rig->state().dropped_no_masks, 1u) << "the one from an hour ahead";

  // A bag plays again.
  node_.withoutMasks();
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.pending == 1; }));
  node_.stamp = 3000.0;
  EXPECT_TRUE(node_.frame().used);
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.dropped_forgotten == 1; }));
  EXPECT_EQ(node_.rig->state().pending, 0u);
  EXPECT_TRUE(node_.frame().used) << "one jump is noticed once";
}

TEST_F(Faults, StampsOfAnUnsetClock) {
  start();
  for (const ros::Time& stamp :
       {ros::Time(0, 0), ros::Time(std::numeric_limits<std::uint32_t>::max(), 999999999), ros::Time(0, 1),
        ros::Time(3000000000u, 0)}) {
    node_.rig->publish(syntheticMessages(1, stamp));
    ros::WallDuration(0.05).sleep();
    const CalibrationScore score = node_.frame();
    EXPECT_TRUE(score.used || contains(score.reason, "not kept")) << score.reason;
  }
}

// --- tf ---

TEST_F(Faults, TfDisappearsAndReturns) {
  ros::param::del("/recalibration/initial");
  start();
  CalibrationScore score = node_.frame();
  EXPECT_FALSE(score.used);
  EXPECT_TRUE(contains(score.reason, "tf has no transform")) << score.reason;
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.dropped_no_extrinsic == 1; }));

  tf2_ros::TransformBroadcaster broadcaster;
  const auto broadcast = [&](const Eigen::Isometry3d& T_camera_lidar) {
    auto transform = stampedTransform(T_camera_lidar.inverse(), "lidar", "camera");
    transform.header.stamp = ros::Time::now();
    broadcaster.sendTransform(transform);
  };
  EXPECT_TRUE(RosRig::eventually([&] {
    broadcast(wrongGuess());
    return node_.frame().used;
  }));
  ros::WallDuration(0.5).sleep();  // gone
  EXPECT_TRUE(node_.frame().used) << "the extrinsic was taken once and holds";
  // It comes back with another value: the extrinsic in force is the node's own by now. TearDown looks at tf.
  for (int i = 0; i < 5; ++i) {
    broadcast(Eigen::Isometry3d::Identity());
    ros::WallDuration(0.05).sleep();
  }
  EXPECT_TRUE(node_.frame().used);
}

// --- services ---

TEST_F(Faults, FiftyCallersAtOnceAndDuringASearch) {
  node_.searchSlowly();
  start();
  ASSERT_TRUE(node_.frame().used && node_.frame().used);
  const auto fifty = [&](bool wait) {
    std::vector<std::future<Recalibrate::Response>> calls;
    for (int i = 0; i < 50; ++i)
      calls.push_back(std::async(std::launch::async, [this, wait] { return node_.recalibrate(wait); }));
    return calls;
  };
  const auto isAnswered = [](const std::future<Recalibrate::Response>& call) {
    return call.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  };
  for (auto& call : fifty(false)) EXPECT_TRUE(call.get().success) << "started or joined";
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.state == state.SEARCHING; }));

  auto waiting = fifty(true);
  EXPECT_TRUE(RosRig::eventually([&] {
    return std::count_if(waiting.begin(), waiting.end(), isAnswered) ==
           50 - static_cast<long>(RecalibrationServer::kMaxWaitingCallers);
  })) << "whoever cannot wait is told at once";
  EXPECT_TRUE(node_.frame().used) << "inputs go on";
  EXPECT_TRUE(node_.trigger("cancel").success);
  for (auto& call : waiting) {
    const Recalibrate::Response response = call.get();
    EXPECT_FALSE(response.success);
    EXPECT_TRUE(contains(response.message, "cancelled") || contains(response.message, "callers wait already"))
        << response.message;
  }
  EXPECT_TRUE(node_.becomes([](const auto& state) { return state.state == state.IDLE; }));
  ros::WallDuration(1.0).sleep();
  EXPECT_EQ(results().size(), 1u) << "a hundred calls, one search";
  EXPECT_EQ(node_.rig->state().state, RecalibrationState::IDLE);
}

TEST_F(Faults, CancelledUnloadedAndLoadedDuringASearch) {
  node_.searchSlowly();
  for (int round = 0; round < 20; ++round) {
    ASSERT_TRUE(node_.load()) << round;
    ASSERT_TRUE(node_.frame().used && node_.frame().used) << round;
    ASSERT_TRUE(node_.recalibrate(false).success) << round;
    ASSERT_TRUE(node_.becomes([](const auto& state) { return state.state == state.SEARCHING; })) << round;
    if (round % 2 == 0) {
      EXPECT_TRUE(node_.trigger("cancel").success);
      EXPECT_TRUE(node_.becomes([](const auto& state) { return state.state == state.IDLE; })) << round;
      EXPECT_TRUE(node_.recalibrate(false).success) << round;
    }
    node_.unload();
    ASSERT_TRUE(manager->listLoadedNodelets().empty()) << round;
  }
  for (const CalibrationResult& result : results()) EXPECT_FALSE(result.accepted) << result.reason;
}

/// No file of this process can grow beyond a few bytes, as on a full disk.
class FullDisk {
 public:
  FullDisk() {
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = 100;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FullDisk() { setrlimit(RLIMIT_FSIZE, &before_); }

 private:
  rlimit before_{};
};

template <typename Message>
std::string textOf(const Message& message) {
  std::ostringstream stream;
  stream << message;
  return stream.str();
}

TEST_F(Faults, NonsenseThroughDynamicReconfigure) {
  using dynamic_reconfigure::Config;
  start();
  const auto set = [&](const Config& config) {
    dynamic_reconfigure::Reconfigure service;
    service.request.config = config;
    EXPECT_TRUE(node_.rig->call("set_parameters", service));
    return service.response.config;
  };
  const auto number = [](const std::string& name, double value) {
    Config config;
    config.doubles.resize(1);
    config.doubles[0].name = name;
    config.doubles[0].value = value;
    return config;
  };
  const auto word = [](const std::string& name, const std::string& value) {
    Config config;
    config.strs.resize(1);
    config.strs[0].name = name;
    config.strs[0].value = value;
    return config;
  };
  const Config initial = set(Config());
  ASSERT_FALSE(initial.doubles.empty());
  Config half_good = number("gate/min_significance", 4.0);
  half_good.strs = word("overlay/color", "mauve").strs;
  for (const Config& nonsense :
       {number("gate/min_significance", std::nan("")), number("gate/min_significance", -1.0),
        number("gate/max_rotation_sigma_deg", 1e300), number("gate/no_such_thing", 1.0),
        number("search_range/rotation_deg", 1.0), number("overlay/color", 1.0),
        word("gate/min_significance", "a lot"), word("", ""), half_good}) {
    EXPECT_EQ(textOf(set(nonsense)), textOf(initial));
  }
  double kept = 0.0;
  EXPECT_FALSE(ros::param::get("/recalibration/gate/no_such_thing", kept));

  // No result can be as significant as that: what is allowed reaches the gate.
  set(number("gate/min_significance", 100.0));
  EXPECT_TRUE(ros::param::get("/recalibration/gate/min_significance", kept));
  EXPECT_EQ(kept, 100.0);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(node_.frame().used);
  EXPECT_FALSE(node_.recalibrate(true).result.accepted);
  set(initial);
  EXPECT_TRUE(node_.recalibrate(true).result.accepted);
}

TEST_F(Faults, DiskFullOrUnwritable) {
  const fs::path folder = fs::temp_directory_path() / ("faults_" + std::to_string(getpid()));
  fs::create_directories(folder);
  const std::string file = (folder / "result.yaml").string();
  node_.set("result_file", file);
  start();
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(node_.frame().used);
  const Recalibrate::Response response = node_.recalibrate(true);
  ASSERT_TRUE(response.result.accepted) << response.message;
  const Eigen::Isometry3d found = tf2::transformToEigen(response.result.transform);
  ASSERT_TRUE(readCalibration(file).T_camera_lidar.isApprox(found, 1e-9));

  const auto save = [&](const std::string& path) {
    SaveCalibration service;
    service.request.path = path;
    EXPECT_TRUE(node_.rig->call("save", service));
    return service.response;
  };
  {
    const FullDisk full;
    const auto saved = save("");
    EXPECT_FALSE(saved.success);
    EXPECT_TRUE(contains(saved.message, file)) << saved.message;
    const auto restored = node_.trigger("restore");
    EXPECT_TRUE(restored.success) << "tf can be put right, the file cannot";
    EXPECT_TRUE(contains(restored.message, "not written")) << restored.message;
  }
  EXPECT_TRUE(readCalibration(file).T_camera_lidar.isApprox(found, 1e-9)) << "the old content stays whole";
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1)
      << "nothing half-written";

  for (const std::string& path : {folder.string(), std::string("/proc/nowhere/result.yaml"),
                                  (folder / "missing" / "result.yaml").string(), file + "/result.yaml"}) {
    const auto saved = save(path);
    EXPECT_FALSE(saved.success) << path;
    EXPECT_TRUE(contains(saved.message, path)) << saved.message;
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder), fs::directory_iterator()), 1);
  EXPECT_TRUE(save("").success) << "there is room again";
  EXPECT_TRUE(readCalibration(file).T_camera_lidar.isApprox(wrongGuess(), 1e-9));
  fs::remove_all(folder);
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) {
  using namespace lidar_camera_recalibration;
  if (argc > 1 && std::string(argv[1]) == "--segmenter") return Segmenter::run(argc, argv);
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_faults");
  signal(SIGXFSZ, SIG_IGN);  // a full disk is an error of write(), not the end of the process
  ros::AsyncSpinner spinner(1);
  spinner.start();
  nodelet::Loader loader(false);
  manager = &loader;
  return RUN_ALL_TESTS();
}

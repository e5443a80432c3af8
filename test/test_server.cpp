#include <gtest/gtest.h>
#include <tf2/buffer_core.h>
#include <tf2_eigen/tf2_eigen.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "extrinsic_keeper.hpp"
#include "frame_buffer.hpp"
#include "frame_builder.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "repeat_filter.hpp"
#include "server.hpp"
#include "synthetic_messages.hpp"
#include "tf_output.hpp"

namespace lidar_camera_recalibration {
namespace {

using std::chrono::steady_clock;

ServerConfig quickConfig() {
  ServerConfig config;
  config.initial_T_camera_lidar = wrongGuess();
  config.frames_min = 2;
  config.frames_min_interval = 0.5;
  config.frame.features.normal_neighbours = 10;
  config.calibrator.range = {2.0, 0.08};
  return config;
}

/// A search that takes minutes, to be interrupted.
ServerConfig slowConfig() {
  ServerConfig config = quickConfig();
  config.calibrator.objective.objective = "paper";
  config.calibrator.search.search = "paper";
  config.calibrator.search.refine_evaluations = 1000000;
  return config;
}

/// A server with its outputs collected.
class Rig {
 public:
  explicit Rig(const ServerConfig& config) {
    ServerOutputs outputs;
    outputs.score = [this](const CalibrationScore& score) {
      collect(scores_, score);
      while (hold_scores) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    };
    outputs.result = [this](const CalibrationResult& result) { collect(results_, result); };
    outputs.state = [this](const RecalibrationState& state) { collect(states_, state); };
    outputs.transform = [this](const geometry_msgs::TransformStamped& transform) {
      collect(transforms_, transform);
    };
    outputs.wants_overlay = outputs.wants_colored_points = [this] { return wants_pictures.load(); };
    outputs.overlay = [this](const sensor_msgs::ImageConstPtr& image) { collect(overlays_, image); };
    outputs.colored_points = [this](const sensor_msgs::PointCloud2ConstPtr& cloud) {
      collect(clouds_, cloud);
    };
    server = std::make_unique<RecalibrationServer>(config, tf, "test", outputs);
  }

  void add(const FrameMessages& messages) {
    send(messages);
    server->waitUntilIdle();
  }
  void send(const FrameMessages& messages) {
    server->addImage(messages.image);
    server->addCameraInfo(messages.info);
    server->addCloud(messages.cloud);
    server->addMasks(messages.masks);
  }
  void addFrames(unsigned count) {
    for (unsigned i = 1; i <= count; ++i) add(syntheticMessages(i, ros::Time(100 + i)));
  }

  std::vector<CalibrationScore> scores() { return copy(scores_); }
  std::vector<CalibrationResult> results() { return copy(results_); }
  std::vector<RecalibrationState> states() { return copy(states_); }
  std::vector<geometry_msgs::TransformStamped> transforms() { return copy(transforms_); }
  std::vector<sensor_msgs::ImageConstPtr> overlays() { return copy(overlays_); }
  std::vector<sensor_msgs::PointCloud2ConstPtr> clouds() { return copy(clouds_); }

  std::atomic<bool> wants_pictures{false}, hold_scores{false};
  tf2::BufferCore tf;

 private:
  template <typename T>
  void collect(std::vector<T>& list, const T& item) {
    const std::lock_guard<std::mutex> lock(mutex_);
    list.push_back(item);
  }
  template <typename T>
  std::vector<T> copy(const std::vector<T>& list) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return list;
  }

  std::mutex mutex_;
  std::vector<CalibrationScore> scores_;
  std::vector<CalibrationResult> results_;
  std::vector<RecalibrationState> states_;
  std::vector<geometry_msgs::TransformStamped> transforms_;
  std::vector<sensor_msgs::ImageConstPtr> overlays_;
  std::vector<sensor_msgs::PointCloud2ConstPtr> clouds_;

 public:
  std::unique_ptr<RecalibrationServer> server;  // last: its thread writes into the lists above
};

Recalibrate::Request waiting() {
  Recalibrate::Request request;
  request.wait = true;
  return request;
}

bool eventually(const std::function<bool()>& condition, double seconds = 10.0) {
  const auto end = steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!condition()) {
    if (steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

std::string temporaryFile(const std::string& name) {
  const std::string path = "server_test_" + std::to_string(::getpid()) + "_" + name;
  std::remove(path.c_str());
  return path;
}

template <typename Message>
boost::shared_ptr<Message> editable(const boost::shared_ptr<const Message>& message) {
  return boost::make_shared<Message>(*message);
}

// --- frames ---

TEST(Server, ScoresAndKeepsFrames) {
  Rig rig(quickConfig());
  EXPECT_EQ(rig.server->extrinsicSource(), "none yet");
  rig.addFrames(2);
  const RecalibrationState state = rig.server->state();
  EXPECT_EQ(state.frames, 2u);
  EXPECT_EQ(state.frames_required, 2u);
  EXPECT_EQ(state.state, RecalibrationState::IDLE);
  EXPECT_GT(state.memory, 100000u);
  ASSERT_EQ(rig.scores().size(), 2u);
  const CalibrationScore score = rig.scores()[1];
  EXPECT_TRUE(score.used) << score.reason;
  EXPECT_EQ(score.header.stamp, ros::Time(102));
  EXPECT_GT(score.score, 0.1);
  EXPECT_GT(score.points, 1000u);
  EXPECT_GT(score.masks, 5u);
  EXPECT_DOUBLE_EQ(score.stamp_gap, 0.0);
}

TEST(Server, TellsHowLikelyTheExtrinsicIsOff) {
  Rig rig(quickConfig());
  rig.addFrames(3);
  ASSERT_EQ(rig.scores().size(), 3u);
  const CalibrationScore score = rig.scores()[2];
  EXPECT_GT(score.drift_probability, 0.5) << "the guess is wrong";
  EXPECT_LE(score.drift_probability, 1.0);
  EXPECT_GE(score.drift_probability_frame, 0.0);
  EXPECT_LE(score.drift_probability_frame, 1.0);
  EXPECT_EQ(score.drift_frames, 3u);
  EXPECT_EQ(score.drift_state, CalibrationScore::DRIFT_OFF);
  EXPECT_TRUE(contains(score.drift, "has drifted")) << score.drift;
  EXPECT_EQ(rig.server->state().drift_state, CalibrationScore::DRIFT_OFF);
  EXPECT_EQ(rig.server->state().drift, score.drift);

  ASSERT_TRUE(rig.server->recalibrate(waiting()).result.accepted);
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().drift_state, CalibrationScore::DRIFT_UNKNOWN)
      << "no frame yet under the new one";
  rig.addFrames(1);
  EXPECT_EQ(rig.scores().back().drift_frames, 1u);
  EXPECT_LT(rig.scores().back().drift_probability, score.drift_probability);
}

TEST(Server, WithoutEdgesNothingIsKnownOfDrift) {
  Rig rig(slowConfig());
  rig.addFrames(1);
  ASSERT_EQ(rig.scores().size(), 1u);
  EXPECT_TRUE(std::isnan(rig.scores()[0].drift_probability));
  EXPECT_EQ(rig.scores()[0].drift_frames, 0u);
  EXPECT_EQ(rig.scores()[0].drift_state, CalibrationScore::DRIFT_UNKNOWN);
}

TEST(Server, PublishesTheTransformAsChildOfTheLidar) {
  Rig rig(quickConfig());
  rig.addFrames(2);
  ASSERT_EQ(rig.transforms().size(), 1u) << "once, not with every frame";
  const auto transform = rig.transforms()[0];
  EXPECT_EQ(transform.header.frame_id, "lidar");
  EXPECT_EQ(transform.child_frame_id, "camera_recalibrated");
  EXPECT_TRUE(tf2::transformToEigen(transform).isApprox(wrongGuess().inverse(), 1e-9));
}

TEST(Server, KeepsNoTwoFramesOfOneMoment) {
  Rig rig(quickConfig());
  rig.add(syntheticMessages(1, ros::Time(101.0)));
  rig.add(syntheticMessages(2, ros::Time(101.3)));
  ASSERT_EQ(rig.scores().size(), 2u);
  EXPECT_FALSE(rig.scores()[1].used);
  EXPECT_TRUE(contains(rig.scores()[1].reason, "0.50 s")) << rig.scores()[1].reason;
  EXPECT_TRUE(std::isfinite(rig.scores()[1].score)) << "it is scored all the same";
  EXPECT_EQ(rig.server->state().frames, 1u);
}

TEST(Server, TheOldestFrameLeaves) {
  ServerConfig config = quickConfig();
  config.frames_max = 3;
  Rig rig(config);
  rig.addFrames(5);
  EXPECT_EQ(rig.server->state().frames, 3u);
}

TEST(Server, ResetForgetsFramesAndKeepsTheExtrinsic) {
  Rig rig(quickConfig());
  rig.addFrames(2);
  rig.server->reset();
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().frames, 0u);
  EXPECT_EQ(rig.server->state().state, RecalibrationState::COLLECTING);
  EXPECT_EQ(rig.server->extrinsicSource(), "the parameter initial/T_camera_lidar");
}

TEST(Server, TimeJumpClearsCachesAndKeepsFrames) {
  Rig rig(quickConfig());
  rig.addFrames(1);
  const FrameMessages pending = syntheticMessages(2, ros::Time(200));
  rig.server->addImage(pending.image);
  rig.server->addCameraInfo(pending.info);
  rig.server->addCloud(pending.cloud);
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().pending, 1u);
  rig.server->timeJumpedBack();
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().pending, 0u);
  EXPECT_EQ(rig.server->state().frames, 1u);
  rig.add(syntheticMessages(3, ros::Time(50)));
  EXPECT_EQ(rig.server->state().frames, 2u) << "a frame from before the jump's stamp is welcome";
}

TEST(Server, FlushEndsTheWaitForANearerCloud) {
  Rig rig(quickConfig());
  const FrameMessages last = syntheticMessages(1, ros::Time(100));
  sensor_msgs::PointCloud2 earlier = *last.cloud;
  earlier.header.stamp = ros::Time(99.97);
  rig.server->addImage(last.image);
  rig.server->addCameraInfo(last.info);
  rig.server->addCloud(boost::make_shared<sensor_msgs::PointCloud2>(earlier));
  rig.server->addMasks(last.masks);
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().frames, 0u);
  rig.server->flush();
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().frames, 1u);
}

TEST(Server, PicturesOnlyIfSomebodyLooks) {
  Rig rig(quickConfig());
  rig.addFrames(1);
  EXPECT_TRUE(rig.overlays().empty());
  EXPECT_TRUE(rig.clouds().empty());
  rig.wants_pictures = true;
  rig.add(syntheticMessages(2, ros::Time(105)));
  ASSERT_EQ(rig.overlays().size(), 1u);
  EXPECT_EQ(rig.overlays()[0]->encoding, "bgr8");
  EXPECT_EQ(rig.overlays()[0]->header.stamp, ros::Time(105));
  ASSERT_EQ(rig.clouds().size(), 1u);
  const auto cloud = rig.clouds()[0];
  EXPECT_EQ(cloud->header.frame_id, "lidar");
  EXPECT_GT(cloud->width * cloud->height, 1000u);
  // Each colour must be the image's at the point's projection.
  const cv::Mat image = SyntheticScene(2).image();
  sensor_msgs::PointCloud2ConstIterator<float> x(*cloud, "x");
  sensor_msgs::PointCloud2ConstIterator<std::uint8_t> rgb(*cloud, "rgb");
  for (; x != x.end(); ++x, ++rgb) {
    const Eigen::Vector3d p = wrongGuess() * Eigen::Vector3d(x[0], x[1], x[2]);
    const cv::Vec3b color =
        image.at<cv::Vec3b>(cvRound(250.0 * p.y() / p.z() + 120.0), cvRound(250.0 * p.x() / p.z() + 160.0));
    ASSERT_EQ(cv::Vec3b(rgb[0], rgb[1], rgb[2]), color);
  }
}

// --- the extrinsic in force ---

TEST(Server, WaitsForTfAndGoesOn) {
  ServerConfig config = quickConfig();
  config.initial_T_camera_lidar.reset();
  Rig rig(config);
  rig.addFrames(1);
  EXPECT_EQ(rig.server->state().dropped_no_extrinsic, 1u);
  ASSERT_EQ(rig.scores().size(), 1u);
  for (const char* word : {"'lidar'", "'camera'", "tf"})
    EXPECT_TRUE(contains(rig.scores()[0].reason, word)) << rig.scores()[0].reason;
  EXPECT_TRUE(contains(rig.server->state().text, "no initial extrinsic")) << rig.server->state().text;

  rig.tf.setTransform(stampedTransform(wrongGuess().inverse(), "lidar", "camera"), "test", true);
  rig.add(syntheticMessages(2, ros::Time(110)));
  EXPECT_EQ(rig.server->state().frames, 1u);
  EXPECT_TRUE(contains(rig.server->extrinsicSource(), "tf")) << rig.server->extrinsicSource();
  ASSERT_EQ(rig.transforms().size(), 1u);
  EXPECT_TRUE(tf2::transformToEigen(rig.transforms()[0]).isApprox(wrongGuess().inverse(), 1e-6));
}

TEST(Server, RefusesFramesOfAnotherCamera) {
  Rig rig(quickConfig());
  rig.addFrames(1);
  FrameMessages other = syntheticMessages(2, ros::Time(110));
  auto image = editable(other.image);
  image->header.frame_id = "rear_camera";
  other.image = image;
  rig.add(other);
  EXPECT_EQ(rig.server->state().frames, 1u);
  EXPECT_TRUE(contains(rig.scores().back().reason, "rear_camera")) << rig.scores().back().reason;
}

TEST(Server, TakesTheSavedResultFirst) {
  ServerConfig config = quickConfig();
  config.result_file = temporaryFile("saved.yaml");
  StoredCalibration saved;
  saved.T_camera_lidar = SyntheticScene::T_camera_lidar();
  saved.camera_frame = "camera";
  saved.lidar_frame = "lidar";
  writeCalibration(config.result_file, saved);
  {
    Rig rig(config);
    rig.addFrames(1);
    EXPECT_TRUE(contains(rig.server->extrinsicSource(), config.result_file)) << rig.server->extrinsicSource();
    EXPECT_TRUE(tf2::transformToEigen(rig.transforms().at(0)).isApprox(saved.T_camera_lidar.inverse(), 1e-9));
  }
  {
    ServerConfig other = config;
    other.initial_from_saved = false;
    Rig rig(other);
    rig.addFrames(1);
    EXPECT_TRUE(contains(rig.server->extrinsicSource(), "parameter"));
  }
  saved.camera_frame = "rear_camera";  // somebody else's file
  writeCalibration(config.result_file, saved);
  Rig rig(config);
  rig.addFrames(1);
  EXPECT_TRUE(contains(rig.server->extrinsicSource(), "parameter")) << rig.server->extrinsicSource();
  std::remove(config.result_file.c_str());
}

TEST(Server, ABrokenSavedResultIsNoObstacle) {
  ServerConfig config = quickConfig();
  config.result_file = temporaryFile("broken.yaml");
  std::ofstream(config.result_file) << "T_camera_lidar: [1, 2";
  Rig rig(config);
  rig.addFrames(1);
  EXPECT_EQ(rig.server->state().frames, 1u);
  EXPECT_TRUE(contains(rig.server->extrinsicSource(), "parameter")) << rig.server->extrinsicSource();
  std::remove(config.result_file.c_str());
}

TEST(Server, SavesWhereAsked) {
  Rig rig(quickConfig());
  std::string message;
  const std::string path = temporaryFile("asked.yaml");
  EXPECT_FALSE(rig.server->save(path, "", message));
  EXPECT_TRUE(contains(message, "no extrinsic is known")) << message;
  rig.addFrames(1);
  EXPECT_FALSE(rig.server->save("", "", message));
  EXPECT_TRUE(contains(message, "result_file")) << message;
  EXPECT_FALSE(rig.server->save(path, "toml", message));
  EXPECT_TRUE(contains(message, "toml")) << message;
  EXPECT_FALSE(rig.server->save("/nonexistent/folder/x.yaml", "yaml", message));
  EXPECT_TRUE(contains(message, "/nonexistent/folder")) << message;
  ASSERT_TRUE(rig.server->save(path, "yaml", message)) << message;
  EXPECT_EQ(message, path);
  EXPECT_TRUE(readCalibration(path).T_camera_lidar.isApprox(wrongGuess(), 1e-9));
  std::remove(path.c_str());
}

// --- recalibration ---

TEST(Server, FindsTheExtrinsicPublishesItAndRestores) {
  ServerConfig config = quickConfig();
  config.result_file = temporaryFile("result.yaml");
  Rig rig(config);
  rig.addFrames(3);
  const Recalibrate::Response response = rig.server->recalibrate(waiting());
  ASSERT_TRUE(response.success) << response.message;
  const CalibrationResult& result = response.result;
  ASSERT_TRUE(result.accepted) << result.reason;
  EXPECT_EQ(result.frames, 3u);
  EXPECT_EQ(result.header.stamp, ros::Time(103));
  EXPECT_EQ(result.transform.header.frame_id, "camera");
  EXPECT_EQ(result.transform.child_frame_id, "lidar");
  EXPECT_GT(result.score_after, result.score_before);
  EXPECT_GT(result.evaluations, 500u);
  EXPECT_GT(result.covariance[0], 0.0);
  const Eigen::Isometry3d found = tf2::transformToEigen(result.transform);
  const auto before = extrinsicError(wrongGuess(), SyntheticScene::T_camera_lidar());
  const auto after = extrinsicError(found, SyntheticScene::T_camera_lidar());
  EXPECT_LT(after.angle(), 0.4 * before.angle());
  EXPECT_TRUE(tf2::transformToEigen(result.start).isApprox(wrongGuess(), 1e-9));

  ASSERT_EQ(rig.results().size(), 1u);
  ASSERT_EQ(rig.transforms().size(), 2u);
  EXPECT_TRUE(tf2::transformToEigen(rig.transforms()[1]).isApprox(found.inverse(), 1e-9));
  EXPECT_TRUE(readCalibration(config.result_file).T_camera_lidar.isApprox(found, 1e-9));
  EXPECT_EQ(readCalibration(config.result_file).frames, 3u);

  std::string message;
  ASSERT_TRUE(rig.server->restore(message)) << message;
  rig.server->waitUntilIdle();
  ASSERT_EQ(rig.transforms().size(), 3u);
  EXPECT_TRUE(tf2::transformToEigen(rig.transforms()[2]).isApprox(wrongGuess().inverse(), 1e-9));
  EXPECT_TRUE(readCalibration(config.result_file).T_camera_lidar.isApprox(wrongGuess(), 1e-9));
  EXPECT_FALSE(rig.server->restore(message));
  EXPECT_TRUE(contains(message, "nothing to restore")) << message;
  std::remove(config.result_file.c_str());
}

TEST(Server, DryRunChangesNothing) {
  Rig rig(quickConfig());
  rig.addFrames(2);
  Recalibrate::Request request = waiting();
  request.dry_run = true;
  const auto response = rig.server->recalibrate(request);
  ASSERT_TRUE(response.success) << response.message;
  EXPECT_FALSE(response.result.accepted);
  EXPECT_TRUE(contains(response.result.reason, "dry run")) << response.result.reason;
  EXPECT_GT(response.result.score_after, response.result.score_before);
  EXPECT_EQ(rig.transforms().size(), 1u);
  EXPECT_TRUE(contains(rig.server->extrinsicSource(), "parameter"));
}

TEST(Server, AResultThatCannotBeWrittenStillCounts) {
  ServerConfig config = quickConfig();
  config.result_file = "/nonexistent/folder/result.yaml";
  Rig rig(config);
  rig.addFrames(2);
  const auto response = rig.server->recalibrate(waiting());
  ASSERT_TRUE(response.result.accepted) << response.message;
  EXPECT_TRUE(contains(response.message, "/nonexistent/folder")) << response.message;
  EXPECT_EQ(rig.transforms().size(), 2u);
}

TEST(Server, WaitsForEnoughFrames) {
  Rig rig(quickConfig());
  rig.addFrames(1);
  Recalibrate::Request request;
  const auto queued = rig.server->recalibrate(request);  // no wait
  EXPECT_TRUE(queued.success);
  EXPECT_TRUE(contains(queued.message, "1 of 2 frames")) << queued.message;
  EXPECT_TRUE(eventually([&] { return contains(rig.server->state().text, "a recalibration waits"); }));
  EXPECT_EQ(rig.server->state().state, RecalibrationState::COLLECTING);
  rig.add(syntheticMessages(7, ros::Time(120)));
  ASSERT_TRUE(eventually([&] { return rig.results().size() == 1; }, 30.0));
  EXPECT_TRUE(rig.results()[0].accepted) << rig.results()[0].reason;
  const auto states = rig.states();
  EXPECT_TRUE(std::any_of(states.begin(), states.end(), [](const RecalibrationState& state) {
    return state.state == RecalibrationState::SEARCHING;
  }));
}

TEST(Server, GivesUpAtTheTimeout) {
  Rig rig(quickConfig());
  rig.addFrames(1);
  Recalibrate::Request request = waiting();
  request.timeout = 0.2;
  const auto start = steady_clock::now();
  const auto response = rig.server->recalibrate(request);
  EXPECT_LT(steady_clock::now() - start, std::chrono::seconds(5));
  EXPECT_FALSE(response.success);
  EXPECT_TRUE(contains(response.message, "1 of 2 frames")) << response.message;
  EXPECT_TRUE(response.result.cancelled);
  EXPECT_EQ(rig.server->state().frames, 1u) << "the frame stays for the next request";
}

TEST(Server, ASearchThatTakesTooLongIsCancelled) {
  Rig rig(slowConfig());
  rig.addFrames(2);
  Recalibrate::Request request = waiting();
  request.timeout = 0.5;
  const auto response = rig.server->recalibrate(request);
  EXPECT_FALSE(response.success);
  EXPECT_TRUE(contains(response.message, "timeout")) << response.message;
  EXPECT_FALSE(response.result.accepted);
  EXPECT_EQ(rig.transforms().size(), 1u);
}

TEST(Server, CancelEndsASearch) {
  Rig rig(slowConfig());
  rig.addFrames(2);
  std::string message;
  EXPECT_FALSE(rig.server->cancel(message));
  EXPECT_TRUE(rig.server->recalibrate(Recalibrate::Request()).success);
  ASSERT_TRUE(eventually([&] { return rig.server->state().state == RecalibrationState::SEARCHING; }));
  EXPECT_FALSE(rig.server->restore(message)) << "not during a search";
  rig.send(syntheticMessages(9, ros::Time(130)));  // inputs are taken while it searches
  EXPECT_TRUE(eventually([&] { return rig.server->state().frames == 3; }));
  ASSERT_TRUE(rig.server->cancel(message));
  rig.server->waitUntilIdle();
  ASSERT_EQ(rig.results().size(), 1u);
  EXPECT_TRUE(rig.results()[0].cancelled);
  EXPECT_FALSE(rig.results()[0].accepted);
  EXPECT_EQ(rig.server->state().state, RecalibrationState::IDLE);
  EXPECT_EQ(rig.transforms().size(), 1u);
}

TEST(Server, ASecondCallerJoins) {
  Rig rig(quickConfig());
  rig.addFrames(1);
  Recalibrate::Response first, second;
  std::thread caller([&] { first = rig.server->recalibrate(waiting()); });
  ASSERT_TRUE(eventually([&] { return contains(rig.server->state().text, "waits"); }));
  std::thread joiner([&] { second = rig.server->recalibrate(waiting()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  rig.addFrames(3);
  caller.join();
  joiner.join();
  EXPECT_TRUE(first.success) << first.message;
  EXPECT_TRUE(second.success) << second.message;
  EXPECT_TRUE(contains(second.message, "joined")) << second.message;
  EXPECT_EQ(rig.results().size(), 1u);
  EXPECT_EQ(first.result.score_after, second.result.score_after);
}

TEST(Server, OnlySoManyCallersWait) {
  Rig rig(slowConfig());
  rig.addFrames(2);
  std::vector<Recalibrate::Response> responses(10);
  std::vector<std::thread> callers;
  std::atomic<std::size_t> answered{0};
  for (Recalibrate::Response& response : responses) {
    callers.emplace_back([&] {
      response = rig.server->recalibrate(waiting());
      ++answered;
    });
  }
  const std::size_t refused = responses.size() - RecalibrationServer::kMaxWaitingCallers;
  EXPECT_TRUE(eventually([&] { return answered == refused; })) << answered;
  EXPECT_TRUE(rig.server->recalibrate(Recalibrate::Request()).success) << "without wait it joins";
  std::string message;
  EXPECT_TRUE(rig.server->cancel(message));
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(std::count_if(responses.begin(), responses.end(),
                          [](const auto& response) { return contains(response.message, "callers wait"); }),
            static_cast<std::ptrdiff_t>(refused));
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.results().size(), 1u);
}

TEST(Server, RefusesRequestsThatCannotBeMet) {
  Rig rig(quickConfig());
  const auto refused = [&](const std::function<void(Recalibrate::Request&)>& edit, const std::string& word) {
    Recalibrate::Request request = waiting();
    edit(request);
    const auto response = rig.server->recalibrate(request);
    EXPECT_FALSE(response.success);
    EXPECT_TRUE(contains(response.message, word)) << response.message;
  };
  refused([](auto& request) { request.rotation_range_deg = -1.0; }, "rotation_range_deg");
  refused([](auto& request) { request.rotation_range_deg = 60.0; }, "crop_margin_deg");
  refused([](auto& request) { request.translation_range_m = std::nan(""); }, "translation_range_m");
  refused([](auto& request) { request.timeout = -5.0; }, "timeout");
  refused([](auto& request) { request.min_frames = 21; }, "min_frames");
}

TEST(Server, EndsDuringASearchAndFreesWhoeverWaits) {
  for (int round = 0; round < 3; ++round) {
    Rig rig(slowConfig());
    rig.addFrames(2);
    Recalibrate::Response response;
    std::thread caller([&] { response = rig.server->recalibrate(waiting()); });
    ASSERT_TRUE(eventually([&] { return rig.server->state().state == RecalibrationState::SEARCHING; }));
    const auto start = steady_clock::now();
    rig.server->stop();
    caller.join();
    rig.server.reset();
    EXPECT_LT(steady_clock::now() - start, std::chrono::seconds(5));
    EXPECT_FALSE(response.success);
    EXPECT_TRUE(contains(response.message, "shutting down")) << response.message;
  }
}

TEST(Server, UnknownObjectiveIsRefusedAtOnce) {
  ServerConfig config = quickConfig();
  config.calibrator.objective.objective = "magic";
  EXPECT_THROW(Rig{config}, Error);
  config = quickConfig();
  config.calibrator.search.search = "magic";
  EXPECT_THROW(Rig{config}, Error);
}

// --- bad input ---

class BadInput : public ::testing::Test {
 protected:
  BadInput() : rig_(quickConfig()) { rig_.addFrames(1); }

  /// The reason given for a frame that was edited into something bad; one kept frame must still be there.
  std::string refused(const std::function<void(FrameMessages&)>& edit) {
    FrameMessages messages = syntheticMessages(5, ros::Time(++stamp_));
    edit(messages);
    rig_.add(messages);
    EXPECT_EQ(rig_.server->state().frames, 1u);
    EXPECT_FALSE(rig_.scores().back().used);
    EXPECT_TRUE(std::isnan(rig_.scores().back().score));
    return rig_.scores().back().reason;
  }
  template <typename Message>
  void edit(boost::shared_ptr<const Message>& message, const std::function<void(Message&)>& change) {
    auto copy = editable(message);
    change(*copy);
    message = copy;
  }

  void TearDown() override {
    rig_.add(syntheticMessages(6, ros::Time(500)));
    EXPECT_EQ(rig_.server->state().frames, 2u) << "good input works again";
  }

  Rig rig_;
  std::uint32_t stamp_ = 200;
};

TEST_F(BadInput, EmptyCloud) {
  const std::string reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::PointCloud2>(m.cloud, [](auto& cloud) {
      cloud.width = 0;
      cloud.row_step = 0;
      cloud.data.clear();
    });
  });
  EXPECT_TRUE(contains(reason, "points")) << reason;
  EXPECT_EQ(rig_.server->state().dropped_invalid, 1u);
}

TEST_F(BadInput, OnlyNanPoints) {
  refused([&](FrameMessages& m) {
    edit<sensor_msgs::PointCloud2>(m.cloud, [](auto& cloud) {
      for (sensor_msgs::PointCloud2Iterator<float> x(cloud, "x"); x != x.end(); ++x) x[0] = NAN;
    });
  });
  EXPECT_EQ(rig_.server->state().dropped_invalid, 1u);
}

TEST_F(BadInput, FewPoints) {
  refused([&](FrameMessages& m) {
    edit<sensor_msgs::PointCloud2>(m.cloud,
                                   [](auto& cloud) { sensor_msgs::PointCloud2Modifier(cloud).resize(100); });
  });
  EXPECT_EQ(rig_.server->state().dropped_poor, 1u);
  EXPECT_EQ(rig_.server->state().dropped_invalid, 0u);
}

TEST_F(BadInput, Masks) {
  std::string reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::Image>(m.masks, [](auto& masks) { masks.encoding = "yuv422"; });
  });
  EXPECT_TRUE(contains(reason, "masks") && contains(reason, "yuv422")) << reason;
  reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::Image>(m.masks, [](auto& masks) {
      masks.height = 120;
      masks.data.resize(masks.data.size() / 2);
    });
  });
  EXPECT_TRUE(contains(reason, "masks") && contains(reason, "120")) << reason;
  reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::Image>(m.masks, [](auto& masks) { masks.data.resize(10); });
  });
  EXPECT_TRUE(contains(reason, "masks")) << reason;
  EXPECT_EQ(rig_.server->state().dropped_invalid, 3u);
}

TEST_F(BadInput, MasksWithoutAnyMaskAreRefused) {
  refused([&](FrameMessages& m) {
    edit<sensor_msgs::Image>(m.masks,
                             [](auto& masks) { std::fill(masks.data.begin(), masks.data.end(), 0); });
  });
}

TEST_F(BadInput, MasksOfAnUnseenImage) {
  rig_.server->addMasks(syntheticMessages(5, ros::Time(50)).masks);
  rig_.add(
      syntheticMessages(6, ros::Time(400)));  // the stamps tell that the masks' image will not come any more
  EXPECT_GE(rig_.server->state().dropped_unknown_masks, 1u);
  rig_.server->reset();
  rig_.server->waitUntilIdle();
  rig_.addFrames(1);
}

TEST_F(BadInput, CameraInfo) {
  std::string reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::CameraInfo>(m.info, [](auto& info) { info.K.assign(0.0); });
  });
  EXPECT_TRUE(contains(reason, "camera_info")) << reason;
  reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::CameraInfo>(m.info, [](auto& info) { info.distortion_model = "omni"; });
  });
  EXPECT_TRUE(contains(reason, "omni")) << reason;
  EXPECT_EQ(rig_.server->state().dropped_invalid, 2u);
}

TEST_F(BadInput, Image) {
  std::string reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::Image>(m.image, [](auto& image) { image.data.resize(7); });
  });
  EXPECT_TRUE(contains(reason, "image")) << reason;
  reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::Image>(m.image, [](auto& image) { image.encoding = "jpeg"; });
  });
  EXPECT_TRUE(contains(reason, "jpeg")) << reason;
}

TEST_F(BadInput, NoFrameId) {
  const std::string reason = refused([&](FrameMessages& m) {
    edit<sensor_msgs::PointCloud2>(m.cloud, [](auto& cloud) { cloud.header.frame_id.clear(); });
  });
  EXPECT_TRUE(contains(reason, "lidar_frame")) << reason;
}

TEST_F(BadInput, CompressedImagesAndMasks) {
  auto broken = boost::make_shared<sensor_msgs::CompressedImage>();
  broken->header.stamp = ros::Time(300);
  broken->format = "jpeg";
  broken->data = {0xff, 0xd8, 0xff};
  rig_.server->addImage(broken);
  rig_.server->waitUntilIdle();
  RecalibrationState state = rig_.server->state();
  EXPECT_TRUE(contains(state.text, "neither PNG nor JPEG")) << state.text;
  rig_.server->addMasks(broken);
  rig_.server->waitUntilIdle();
  state = rig_.server->state();
  EXPECT_EQ(state.dropped_invalid, 1u);
  EXPECT_EQ(state.dropped_unknown_masks, 1u);
  EXPECT_EQ(state.images, 2u);
  EXPECT_TRUE(contains(state.text, "a JPEG, which changes the ids")) << state.text;
}

// --- mode automatic ---

ServerConfig automaticConfig(const std::string& result_file) {
  ServerConfig config = quickConfig();
  config.mode = "automatic";
  config.automatic_min_interval = 20.0;
  config.monitor.window = 3;
  config.frames_min = 3;
  config.result_file = result_file;
  return config;
}

TEST(Automatic, ADriftIsNoticedCorrectedSavedAndRestored) {
  const std::string file = temporaryFile("automatic.yaml");
  Rig rig(automaticConfig(file));
  unsigned frame = 0;
  const auto drive = [&](unsigned count) {
    for (unsigned i = 0; i < count; ++i, ++frame)
      rig.add(syntheticMessages(1 + frame % 12, ros::Time(101 + frame)));
  };
  drive(4);
  EXPECT_TRUE(rig.results().empty()) << "a full window that says so three times is asked for";
  drive(4);
  ASSERT_EQ(rig.results().size(), 1u) << rig.server->state().drift;
  EXPECT_TRUE(rig.results()[0].accepted) << rig.results()[0].reason;
  const Eigen::Isometry3d found = tf2::transformToEigen(rig.results()[0].transform);
  EXPECT_LT(extrinsicError(found, SyntheticScene::T_camera_lidar()).angle(), 0.3 * kDegree);
  ASSERT_EQ(rig.transforms().size(), 2u);
  EXPECT_TRUE(tf2::transformToEigen(rig.transforms()[1]).isApprox(found.inverse(), 1e-9));
  EXPECT_TRUE(readCalibration(file).T_camera_lidar.isApprox(found, 1e-9)) << "the guess of the next start";

  drive(40);
  EXPECT_EQ(rig.results().size(), 1u) << "the extrinsic fits now: " << rig.server->state().drift;

  std::string message;
  ASSERT_TRUE(rig.server->restore(message)) << message;
  rig.server->waitUntilIdle();
  EXPECT_TRUE(tf2::transformToEigen(rig.transforms().back()).isApprox(wrongGuess().inverse(), 1e-9));
  EXPECT_TRUE(readCalibration(file).T_camera_lidar.isApprox(wrongGuess(), 1e-9));
  drive(40);
  EXPECT_EQ(rig.results().size(), 1u) << "whoever restores knows better";
  std::remove(file.c_str());
}

TEST(Automatic, RejectedResultsChangeNothingAndAreNotRepeatedAtOnce) {
  ServerConfig config = automaticConfig("");
  config.calibrator.gate.min_distinctness = 100.0;
  Rig rig(config);
  for (unsigned frame = 0; frame < 55; ++frame)
    rig.add(syntheticMessages(1 + frame % 12, ros::Time(101 + frame)));
  // After 5 frames, 20 s later; the next one would be 40 s later.
  ASSERT_EQ(rig.results().size(), 2u);
  EXPECT_FALSE(rig.results()[0].accepted);
  EXPECT_EQ(rig.transforms().size(), 1u) << "that of the start";
}

TEST(Automatic, TheOtherModesOnlyWatch) {
  for (const char* mode : {"manual", "monitor"}) {
    ServerConfig config = automaticConfig("");
    config.mode = mode;
    Rig rig(config);
    rig.addFrames(10);
    EXPECT_TRUE(rig.results().empty()) << mode;
    EXPECT_EQ(rig.server->state().state, RecalibrationState::IDLE) << mode;
  }
}

// --- frames that are worth keeping ---

TEST(Selection, StandingAtATrafficLightDoesNotFillTheBuffer) {
  Rig rig(quickConfig());
  rig.addFrames(2);
  for (int i = 0; i < 30; ++i) rig.add(syntheticMessages(2, ros::Time(110 + i)));
  EXPECT_EQ(rig.server->state().frames, 2u);
  EXPECT_TRUE(contains(rig.scores().back().reason, "view differs")) << rig.scores().back().reason;
  EXPECT_TRUE(std::isfinite(rig.scores().back().score)) << "it is scored all the same";
  rig.add(syntheticMessages(3, ros::Time(150)));
  EXPECT_EQ(rig.server->state().frames, 3u);
}

FramePtr frameOf(const PointCloud& cloud, unsigned seed) {
  const SyntheticScene scene(seed);
  FrameConfig config;
  config.features.normal_neighbours = 10;
  const Camera camera = SyntheticScene::camera();
  return makeFrame(0.0, camera, cv::Mat(), {scene.labels(camera)}, cloud, SyntheticScene::T_camera_lidar(),
                   config);
}

TEST(Selection, OfTheTwoMostAlikeTheOlderLeaves) {
  ServerConfig config = quickConfig();
  config.frames_max = 3;
  config.frames_min_view_change = 0.0;
  FrameBuffer buffer(config);
  const auto add = [&](unsigned seed, double stamp) {
    EXPECT_EQ(buffer.add(frameOf(SyntheticScene(seed).cloud(), seed), ros::Time(stamp), 0.0), "");
  };
  add(1, 101.0);
  add(2, 102.0);
  add(3, 103.0);
  const Frames before = buffer.frames();
  add(2, 104.0);
  const Frames after = buffer.frames();
  ASSERT_EQ(after.size(), 3u);
  EXPECT_EQ(after[0], before[0]) << "the oldest one shows what no other one does";
  EXPECT_EQ(after[1], before[2]);
  EXPECT_EQ(buffer.newestStamp(), ros::Time(104.0));
  buffer.dropOlderThan(ros::Time(103.0));
  EXPECT_EQ(buffer.size(), 2u);
  buffer.dropOlderThan(ros::Time(200.0));
  EXPECT_EQ(buffer.size(), 0u);
  EXPECT_EQ(buffer.bytes(), 0u);
}

TEST(Selection, NoiseIsNoNewView) {
  const SyntheticScene scene(1);
  PointCloud cloud = scene.cloud(), other_turn = cloud;
  std::mt19937 random(3);
  std::normal_distribution<float> noise(0.0F, 0.02F);
  for (Eigen::Vector3f& point : other_turn.points) point *= 1.0F + noise(random) / point.norm();
  const FrameView view(*frameOf(cloud, 1));
  EXPECT_EQ(view.changeFrom(view), 0.0);
  EXPECT_LT(FrameView(*frameOf(other_turn, 1)).changeFrom(view), 0.01);
  EXPECT_GT(FrameView(*frameOf(SyntheticScene(2).cloud(), 2)).changeFrom(view), 0.1);
}

// --- a vehicle in motion ---

/// 12 m/s in a bend, 8 deg/s.
Eigen::Isometry3d T_odom_lidar(double stamp) {
  Vector6d twist;
  twist << 0.0, 0.0, 8.0 * kDegree, 12.0, 0.0, 0.0;
  return exp((stamp - 100.0) * twist);
}

void addOdometry(tf2::BufferCore& tf, double from, double to) {
  for (double stamp = from; stamp <= to + 1e-6; stamp += 0.02) {
    auto message = stampedTransform(T_odom_lidar(stamp), "odom", "lidar");
    message.header.stamp = ros::Time(stamp);
    tf.setTransform(message, "test");
  }
}

/// The scene's points as a LiDAR fires them that turns once in 0.1 s around `middle`, while it moves.
FrameMessages movingMessages(unsigned seed, double image_stamp, double middle) {
  FrameMessages messages = syntheticMessages(seed, ros::Time(image_stamp));
  sensor_msgs::PointCloud2 cloud;
  cloud.header = messages.cloud->header;
  cloud.header.stamp = ros::Time(middle);
  sensor_msgs::PointCloud2Modifier modifier(cloud);
  using sensor_msgs::PointField;
  modifier.setPointCloud2Fields(5, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                PointField::FLOAT32, "intensity", 1, PointField::FLOAT32, "time", 1,
                                PointField::FLOAT32);
  modifier.resize(messages.cloud->width * messages.cloud->height);
  sensor_msgs::PointCloud2ConstIterator<float> from(*messages.cloud, "x");
  sensor_msgs::PointCloud2Iterator<float> to(cloud, "x");
  for (; from != from.end(); ++from, ++to) {
    const double time = 0.05 * std::atan2(from[1], from[0]) / M_PI;
    const Eigen::Vector3d standing(from[0], from[1], from[2]);
    const Eigen::Vector3d fired =
        T_odom_lidar(middle + time).inverse() * T_odom_lidar(image_stamp) * standing;
    for (int k = 0; k < 3; ++k) to[k] = static_cast<float>(fired[k]);
    to[3] = from[3];
    to[4] = static_cast<float>(time);
  }
  messages.cloud = boost::make_shared<sensor_msgs::PointCloud2>(cloud);
  return messages;
}

double scoreOf(const FrameMessages& messages, const std::string& fixed_frame, bool deskew = true) {
  ServerConfig config = quickConfig();
  config.initial_T_camera_lidar = SyntheticScene::T_camera_lidar();
  config.fixed_frame = fixed_frame;
  config.deskew = deskew;
  Rig rig(config);
  addOdometry(rig.tf, 99.0, 102.0);
  rig.send(messages);
  rig.server->flush();  // the cloud is earlier than the image: a nearer one could come
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.scores().size(), 1u);
  return rig.scores().empty() ? NAN : rig.scores()[0].score;
}

TEST(Motion, WithTheFixedFrameAMovingCloudScoresLikeAStandingOne) {
  const FrameMessages standing = syntheticMessages(1, ros::Time(101)),
                      moving = movingMessages(1, 101.0, 100.97);
  const double best = scoreOf(standing, "");
  EXPECT_NEAR(scoreOf(moving, "odom"), best, 0.01 * best);
  EXPECT_LT(scoreOf(moving, ""), 0.9 * best);
  EXPECT_LT(scoreOf(moving, "odom", false), 0.995 * best) << "moved as a whole, but still skewed";
}

TEST(Motion, FramesOfAFastTurnAreNotKept) {
  for (const double limit : {7.5, 8.5}) {
    ServerConfig config = quickConfig();
    config.fixed_frame = "odom";
    config.frames_max_turn_rate_deg = limit;
    Rig rig(config);
    addOdometry(rig.tf, 99.0, 102.0);
    rig.add(movingMessages(1, 101.0, 101.0));
    ASSERT_EQ(rig.scores().size(), 1u);
    EXPECT_EQ(rig.scores()[0].used, limit > 8.0);
    EXPECT_EQ(contains(rig.scores()[0].reason, "8.0 deg/s"), limit < 8.0) << rig.scores()[0].reason;
  }
}

TEST(Motion, AFrameThatTfDoesNotCoverIsRefused) {
  ServerConfig config = quickConfig();
  config.fixed_frame = "odom";
  Rig rig(config);
  rig.add(movingMessages(1, 101.0, 101.0));
  EXPECT_EQ(rig.server->state().dropped_no_motion, 1u);
  addOdometry(rig.tf, 101.5, 102.01);
  rig.add(movingMessages(2, 102.0, 102.0));  // the points in view are taken up to 102.02
  EXPECT_EQ(rig.server->state().dropped_no_motion, 2u);
  const auto scores = rig.scores();
  ASSERT_EQ(scores.size(), 2u);
  EXPECT_TRUE(contains(scores[0].reason, "fixed_frame") && contains(scores[0].reason, "odom"))
      << scores[0].reason;
  addOdometry(rig.tf, 102.05, 104.0);
  rig.add(movingMessages(3, 103.0, 103.0));
  EXPECT_EQ(rig.server->state().frames, 1u) << "it goes on as soon as tf is there";
}

TEST(Server, EveryImageIsAccountedForAtEveryMoment) {
  ServerConfig config = quickConfig();
  config.synchroniser.mask_timeout = 3.0;
  config.synchroniser.max_bytes = 2500000;  // three pairs or so
  Rig rig(config);
  std::uint64_t sent = 0;
  for (unsigned i = 0; i < 30; ++i) {
    FrameMessages messages = syntheticMessages(1, ros::Time(100 + 0.5 * i));
    if (i % 3 == 0) rig.server->addMasks(messages.masks);
    if (i % 7 == 0) messages.masks = nullptr;
    if (i % 5 == 1) rig.server->addImage(messages.image), ++sent;  // twice
    if (i % 4 != 3) rig.server->addCameraInfo(messages.info);
    if (i % 10 == 9) {
      auto unreadable = editable(messages.image);
      unreadable->encoding = "jpeg";
      messages.image = unreadable;
    }
    rig.server->addImage(messages.image), ++sent;
    rig.server->addCloud(messages.cloud);
    if (i == 15) rig.server->timeJumpedBack();
    if (i % 2 == 0) rig.server->waitUntilIdle();
    if (i == 22) rig.server->reset();
    if (i > 10) rig.server->addMasks(syntheticMessages(1, ros::Time(100 + 0.5 * (i - 2))).masks);
  }
  rig.server->waitUntilIdle();
  const auto accounted = [](const RecalibrationState& state) {
    return state.scored + state.waiting + state.dropped_unmatched + state.dropped_no_masks +
           state.dropped_invalid + state.dropped_poor + state.dropped_no_extrinsic + state.dropped_no_motion +
           state.dropped_memory + state.dropped_forgotten;
  };
  for (const RecalibrationState& state : rig.states()) EXPECT_EQ(state.images, accounted(state)) << state;
  const RecalibrationState state = rig.server->state();
  EXPECT_EQ(state.images, sent);
  EXPECT_EQ(accounted(state), sent);
  EXPECT_GT(state.scored, 0u) << state;
  EXPECT_GT(state.dropped_unmatched, 0u) << state;
  EXPECT_GT(state.dropped_forgotten, 0u) << state;
}

TEST(Server, WorksWithoutIntensity) {
  Rig rig(quickConfig());
  FrameMessages messages = syntheticMessages(1, ros::Time(100));
  auto cloud = editable(messages.cloud);
  cloud->fields.pop_back();
  messages.cloud = cloud;
  rig.add(messages);
  ASSERT_EQ(rig.scores().size(), 1u);
  EXPECT_TRUE(rig.scores()[0].used) << rig.scores()[0].reason;
}

TEST(Server, TheInputQueueIsBounded) {
  Rig rig(quickConfig());
  rig.hold_scores = true;  // the worker stands still in its first output
  rig.send(syntheticMessages(1, ros::Time(100)));
  ASSERT_TRUE(eventually([&] { return rig.scores().size() == 1; }));
  const FrameMessages messages = syntheticMessages(2, ros::Time(110));
  for (int i = 0; i < 1000; ++i) rig.server->addImage(messages.image);
  rig.hold_scores = false;
  rig.server->waitUntilIdle();
  EXPECT_EQ(rig.server->state().dropped_memory, 800u) << "the queue holds 200";
  rig.add(messages);
  EXPECT_EQ(rig.server->state().frames, 2u);
}

// --- parts ---

/// base -> mount -> camera and base -> lidar; the edge base -> mount is the one to correct.
class Edge : public ::testing::Test {
 protected:
  Edge() {
    add(rotated(0.1, 1.0), "base", "mount");
    add(rotated(-0.4, 0.2), "mount", "camera");
    add(rotated(0.3, -0.5), "base", "lidar");
    config_.tf_correct_parent = "base";
    config_.tf_correct_child = "mount";
  }
  static Eigen::Isometry3d rotated(double angle, double shift) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() = Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
    T.translation() << shift, 2.0 * shift, -shift;
    return T;
  }
  void add(const Eigen::Isometry3d& T, const std::string& parent, const std::string& child) {
    tf_.setTransform(stampedTransform(T, parent, child), "test", true);
  }
  /// The vehicle's own chain must give the new extrinsic once the edge is replaced.
  void expectChainGives(const Eigen::Isometry3d& T_camera_lidar) {
    tf_.setTransform(outputTransform(tf_, config_, frames_, T_camera_lidar), "test", true);
    EXPECT_TRUE(tf2::transformToEigen(tf_.lookupTransform("camera", "lidar", ros::Time(0)))
                    .isApprox(T_camera_lidar, 1e-9));
  }
  std::string refusal() {
    try {
      outputTransform(tf_, config_, frames_, rotated(0.7, 0.3));
    } catch (const Error& e) {
      EXPECT_EQ(e.cause(), ErrorCause::kExtrinsic);
      return e.what();
    }
    return "";
  }

  tf2::BufferCore tf_;
  ServerConfig config_;
  FrameIds frames_{"camera", "lidar"};
};

TEST_F(Edge, AboveTheCamera) { expectChainGives(rotated(0.7, 0.3)); }

TEST_F(Edge, AboveTheLidar) {
  config_.tf_correct_child = "lidar";
  expectChainGives(rotated(0.7, 0.3));
}

TEST_F(Edge, TheCameraFrameItself) {
  config_.tf_correct_parent = "mount";
  config_.tf_correct_child = "camera";
  expectChainGives(rotated(0.7, 0.3));
}

TEST_F(Edge, ThatNobodyPublishesYet) {
  tf2::BufferCore fresh;
  fresh.setTransform(stampedTransform(rotated(-0.4, 0.2), "mount", "camera"), "test", true);
  fresh.setTransform(stampedTransform(rotated(0.3, -0.5), "base", "lidar"), "test", true);
  fresh.setTransform(outputTransform(fresh, config_, frames_, rotated(0.7, 0.3)), "test", true);
  EXPECT_TRUE(tf2::transformToEigen(fresh.lookupTransform("camera", "lidar", ros::Time(0)))
                  .isApprox(rotated(0.7, 0.3), 1e-9));
}

TEST_F(Edge, ThatLiesElsewhereIsRefused) {
  add(rotated(0.1, 1.0), "base", "wheel");
  config_.tf_correct_child = "wheel";
  EXPECT_TRUE(contains(refusal(), "does not lie between")) << refusal();
  add(rotated(0.1, 1.0), "map", "base");
  config_.tf_correct_parent = "map";
  config_.tf_correct_child = "base";
  EXPECT_TRUE(contains(refusal(), "both")) << refusal();
  config_.tf_correct_parent = "map";
  config_.tf_correct_child = "mount";
  EXPECT_TRUE(contains(refusal(), "the parent of 'mount' in tf is 'base'")) << refusal();
}

TEST(Server, CorrectsTheVehiclesEdgeOnlyAfterAResult) {
  ServerConfig config = quickConfig();
  config.initial_T_camera_lidar.reset();
  config.tf_correct_parent = "lidar";
  config.tf_correct_child = "camera";
  Rig rig(config);
  rig.tf.setTransform(stampedTransform(wrongGuess().inverse(), "lidar", "camera"), "test", true);
  rig.addFrames(2);
  EXPECT_TRUE(rig.transforms().empty()) << "tf told us this very transform";
  const auto response = rig.server->recalibrate(waiting());
  ASSERT_TRUE(response.result.accepted) << response.message;
  ASSERT_EQ(rig.transforms().size(), 1u);
  EXPECT_EQ(rig.transforms()[0].child_frame_id, "camera");
  EXPECT_TRUE(tf2::transformToEigen(rig.transforms()[0])
                  .isApprox(tf2::transformToEigen(response.result.transform).inverse(), 1e-9));
}

TEST(StartupCheck, TellsWhatIsWrong) {
  const FrameInputs inputs = readMessages(syntheticMessages(1, ros::Time(1)), ServerConfig());
  const FrameIds frames{"camera", "lidar"};
  const Eigen::Isometry3d T = SyntheticScene::T_camera_lidar();
  EXPECT_TRUE(checkProjection(inputs, T, frames).plausible);

  // A camera frame with x forward, as camera_link has.
  Eigen::Isometry3d T_body_optical = Eigen::Isometry3d::Identity();
  T_body_optical.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const StartupCheck body = checkProjection(inputs, T_body_optical * T, frames);
  EXPECT_FALSE(body.plausible);
  EXPECT_TRUE(contains(body.text, "no optical frame")) << body.text;

  Eigen::Isometry3d backwards = T;
  backwards.prerotate(Eigen::AngleAxisd(M_PI, Eigen::Vector3d::UnitY()));
  const StartupCheck behind = checkProjection(inputs, backwards, frames);
  EXPECT_FALSE(behind.plausible);
  EXPECT_TRUE(contains(behind.text, "0.0 %")) << behind.text;
}

TEST(RepeatFilter, KnowsMessagesApart) {
  RepeatFilter filter(std::chrono::seconds(3600));
  EXPECT_TRUE(filter.isDue("cloud of 12 points"));
  EXPECT_FALSE(filter.isDue("cloud of 31 points"));
  EXPECT_TRUE(filter.isDue("image of 12 points"));
  RepeatFilter impatient(std::chrono::seconds(0));
  EXPECT_TRUE(impatient.isDue("x"));
  EXPECT_TRUE(impatient.isDue("x"));
}

}  // namespace
}  // namespace lidar_camera_recalibration

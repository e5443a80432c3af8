// The node as a vehicle sees it. Run against the nodelet and against the standalone node; the tests are one
// story, in order.
#include <gtest/gtest.h>
#include <lidar_camera_recalibration/SaveCalibration.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <future>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "ros_rig.hpp"

namespace lidar_camera_recalibration {
namespace {

RosRig* rig = nullptr;
constexpr double kFirstStamp = 1000.0;
double last_stamp = kFirstStamp;

ros::Time nextStamp() { return ros::Time(last_stamp += 1.0); }

CalibrationScore goodFrame() { return rig->frame(1 + static_cast<unsigned>(last_stamp) % 5, nextStamp()); }

std_srvs::Trigger::Response trigger(const std::string& name) {
  std_srvs::Trigger service;
  EXPECT_TRUE(rig->call(name, service)) << name;
  return service.response;
}

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

template <typename Message>
boost::shared_ptr<const Message> latest(const std::string& topic, double seconds = 20.0) {
  return ros::topic::waitForMessage<Message>(topic, ros::Duration(seconds));
}

TEST(RosInterface, NamesTheFramesThatTfDoesNotKnow) {
  ASSERT_TRUE(rig->connect()) << "the node does not subscribe to all of its inputs";
  const CalibrationScore score = goodFrame();
  ASSERT_FALSE(score.header.stamp.isZero()) << "no score came";
  EXPECT_FALSE(score.used);
  EXPECT_TRUE(contains(score.reason, "'lidar'") && contains(score.reason, "'camera'")) << score.reason;
  EXPECT_TRUE(RosRig::eventually([] { return rig->state().dropped_no_extrinsic == 1; }));

  static tf2_ros::StaticTransformBroadcaster broadcaster;
  broadcaster.sendTransform(stampedTransform(wrongGuess().inverse(), "lidar", "camera"));
  EXPECT_TRUE(RosRig::eventually([] { return goodFrame().used; })) << "tf is there now";
}

TEST(RosInterface, ScoresAndCounts) {
  const auto before = rig->state().frames;
  const CalibrationScore score = goodFrame();
  EXPECT_TRUE(score.used) << score.reason;
  EXPECT_EQ(score.header.frame_id, "camera");
  EXPECT_GT(score.score, 0.1);
  EXPECT_GT(score.points, 1000u);
  EXPECT_TRUE(RosRig::eventually([&] { return rig->state().frames == before + 1; }));
  EXPECT_FALSE(rig->state().text.empty());
  EXPECT_TRUE(latest<RecalibrationState>("/recalibration/state")) << "latched";
}

TEST(RosInterface, Diagnostics) {
  EXPECT_TRUE(RosRig::eventually([] {
    return contains(rig->diagnostic("inputs").message, "all inputs arrive");
  })) << rig->diagnostic("inputs").message;
  EXPECT_TRUE(RosRig::eventually([] {
    return contains(rig->diagnostic("recalibration: recalibration").message, "ready");
  })) << rig->diagnostic("recalibration: recalibration").message;
  const auto status = rig->diagnostic("recalibration: recalibration");
  EXPECT_EQ(status.level, diagnostic_msgs::DiagnosticStatus::OK);
  std::map<std::string, std::string> values;
  for (const auto& value : status.values) values[value.key] = value.value;
  EXPECT_TRUE(contains(values["extrinsic"], "tf")) << values["extrinsic"];
  EXPECT_EQ(values["last result"], "none yet");
  bool has_rate = false;
  for (const auto& value : rig->diagnostic("inputs").values)
    has_rate |= value.key == "/camera/masks" && contains(value.value, "Hz");
  EXPECT_TRUE(has_rate);
}

TEST(RosInterface, DiagnosticsTellOfDrift) {
  const auto drift = [] { return rig->diagnostic("recalibration: drift"); };
  EXPECT_TRUE(RosRig::eventually([&] {
    const auto state = rig->state();
    const bool fine = state.drift_state <= CalibrationScore::DRIFT_FITS;
    return !state.drift.empty() && drift().message == state.drift &&
           (drift().level == diagnostic_msgs::DiagnosticStatus::OK) == fine;
  })) << drift().message;
}

TEST(RosInterface, PublishesTheGuessAsTransform) {
  tf2_ros::Buffer buffer;
  const tf2_ros::TransformListener listener(buffer);
  ASSERT_TRUE(buffer.canTransform("lidar", "camera_recalibrated", ros::Time(0), ros::Duration(10.0)));
  const auto T_lidar_camera =
      tf2::transformToEigen(buffer.lookupTransform("lidar", "camera_recalibrated", ros::Time(0)));
  EXPECT_TRUE(T_lidar_camera.isApprox(wrongGuess().inverse(), 1e-6));
}

TEST(RosInterface, DrawsForWhoeverLooks) {
  ros::NodeHandle handle;
  sensor_msgs::ImageConstPtr overlay;
  sensor_msgs::PointCloud2ConstPtr cloud;
  const ros::Subscriber overlays = handle.subscribe<sensor_msgs::Image>(
      "/recalibration/overlay", 1, [&](const sensor_msgs::ImageConstPtr& message) { overlay = message; });
  const ros::Subscriber clouds = handle.subscribe<sensor_msgs::PointCloud2>(
      "/recalibration/colored_points", 1,
      [&](const sensor_msgs::PointCloud2ConstPtr& message) { cloud = message; });
  ASSERT_TRUE(
      RosRig::eventually([&] { return overlays.getNumPublishers() > 0 && clouds.getNumPublishers() > 0; }));
  ASSERT_TRUE(RosRig::eventually([&] {
    goodFrame();
    return overlay && cloud;
  }));
  EXPECT_EQ(overlay->encoding, "bgr8");
  EXPECT_GE(overlay->width, 320u);
  EXPECT_EQ(cloud->header.frame_id, "lidar");
}

TEST(RosInterface, EveryBadInputIsRefusedInWordsAndForgiven) {
  struct Case {
    const char* word;
    RosRig::Edit edit;
  };
  const auto cloudCase = [](const char* word, std::function<void(sensor_msgs::PointCloud2&)> change) {
    return Case{word, [change](FrameMessages& messages) {
                  const auto copy = boost::make_shared<sensor_msgs::PointCloud2>(*messages.cloud);
                  change(*copy);
                  messages.cloud = copy;
                }};
  };
  const auto masksCase = [](const char* word, std::function<void(sensor_msgs::Image&)> change) {
    return Case{word, [change](FrameMessages& messages) {
                  const auto copy = boost::make_shared<sensor_msgs::Image>(*messages.masks);
                  change(*copy);
                  messages.masks = copy;
                }};
  };
  const auto infoCase = [](const char* word, std::function<void(sensor_msgs::CameraInfo&)> change) {
    return Case{word, [change](FrameMessages& messages) {
                  const auto copy = boost::make_shared<sensor_msgs::CameraInfo>(*messages.info);
                  change(*copy);
                  messages.info = copy;
                }};
  };
  const std::vector<Case> cases = {
      cloudCase("points",
                [](auto& cloud) {
                  cloud.width = cloud.row_step = 0;
                  cloud.data.clear();
                }),
      cloudCase("points", [](auto& cloud) { cloud.fields.clear(); }),
      cloudCase("points", [](auto& cloud) { cloud.data.resize(100); }),
      cloudCase("points",
                [](auto& cloud) {
                  for (sensor_msgs::PointCloud2Iterator<float> x(cloud, "x"); x != x.end(); ++x) x[0] = NAN;
                }),
      masksCase("masks", [](auto& masks) { masks.encoding = "rgb8"; }),
      masksCase("masks",
                [](auto& masks) {
                  masks.height /= 2;
                  masks.data.resize(masks.data.size() / 2);
                }),
      infoCase("camera_info", [](auto& info) { info.K.assign(0.0); }),
      infoCase("unheard_of", [](auto& info) { info.distortion_model = "unheard_of"; }),
  };
  RosRig::eventually([] { return rig->state().pending == 0; });
  ASSERT_TRUE(goodFrame().used);
  RosRig::eventually([] { return false; }, 1.5);  // the state comes once a second
  const auto before = rig->state();
  std::uint64_t expected = before.dropped_invalid;
  for (const Case& bad : cases) {
    const CalibrationScore score = rig->frame(1, nextStamp(), bad.edit);
    ASSERT_FALSE(score.header.stamp.isZero()) << "no answer to the bad input that should name " << bad.word;
    EXPECT_FALSE(score.used);
    EXPECT_TRUE(std::isnan(score.score));
    EXPECT_TRUE(contains(score.reason, bad.word)) << score.reason;
    ++expected;
  }
  EXPECT_TRUE(RosRig::eventually([&] { return rig->state().dropped_invalid == expected; }))
      << rig->state().dropped_invalid << " instead of " << expected;
  EXPECT_EQ(rig->state().frames, before.frames) << "what was gathered stays";
  EXPECT_TRUE(goodFrame().used);
}

TEST(RosInterface, IntensityOfAnyTypeOrNone) {
  using sensor_msgs::PointField;
  for (const auto type : {PointField::UINT8, PointField::UINT16, PointField::FLOAT64}) {
    const CalibrationScore score = rig->frame(2, nextStamp(), [&](FrameMessages& messages) {
      const auto cloud = boost::make_shared<sensor_msgs::PointCloud2>();
      cloud->header = messages.cloud->header;
      sensor_msgs::PointCloud2Modifier modifier(*cloud);
      modifier.setPointCloud2Fields(4, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                    PointField::FLOAT32, "intensity", 1, type);
      modifier.resize(messages.cloud->width);
      sensor_msgs::PointCloud2ConstIterator<float> from(*messages.cloud, "x");
      sensor_msgs::PointCloud2Iterator<float> to(*cloud, "x");
      sensor_msgs::PointCloud2Iterator<std::uint8_t> intensity(*cloud, "intensity");
      for (; from != from.end(); ++from, ++to, ++intensity) {
        std::copy(&from[0], &from[0] + 3, &to[0]);
        if (type == PointField::UINT8) intensity[0] = static_cast<std::uint8_t>(from[3]);
        const auto two_bytes = static_cast<std::uint16_t>(from[3]);
        if (type == PointField::UINT16) std::memcpy(&intensity[0], &two_bytes, sizeof two_bytes);
        const double eight_bytes = from[3];
        if (type == PointField::FLOAT64) std::memcpy(&intensity[0], &eight_bytes, sizeof eight_bytes);
      }
      messages.cloud = cloud;
    });
    EXPECT_TRUE(score.used) << score.reason;
    EXPECT_NE(score.edges, 0.0);
    EXPECT_GT(score.region, 0.1);
    EXPECT_NEAR(score.score, score.edges + score.region, 1e-9);
    EXPECT_EQ(score.reflectivity, 0.0) << "a term of objective paper";
  }
  const CalibrationScore score = rig->frame(2, nextStamp(), [](FrameMessages& messages) {
    const auto cloud = boost::make_shared<sensor_msgs::PointCloud2>(*messages.cloud);
    cloud->fields.pop_back();
    messages.cloud = cloud;
  });
  EXPECT_TRUE(score.used) << score.reason;
  EXPECT_GT(score.score, 0.1);
}

TEST(RosInterface, MasksOfAnUnseenImageAreCounted) {
  const auto before = rig->state().dropped_unknown_masks;
  FrameMessages only_masks;
  only_masks.masks = syntheticMessages(1, ros::Time(kFirstStamp - 500.0)).masks;
  rig->publish(only_masks);
  goodFrame();
  EXPECT_TRUE(RosRig::eventually([&] { return rig->state().dropped_unknown_masks > before; }));
}

TEST(RosInterface, ResetForgetsFrames) {
  EXPECT_TRUE(trigger("reset").success);
  EXPECT_TRUE(RosRig::eventually([] { return rig->state().frames == 0; }));
  EXPECT_EQ(rig->state().state, RecalibrationState::COLLECTING);
}

TEST(RosInterface, WaitsWithoutBlockingAndCanBeCancelled) {
  EXPECT_FALSE(trigger("cancel").success) << "nothing to cancel";
  Recalibrate service;
  service.request.wait = true;
  auto answered = std::async(std::launch::async, [&] { return rig->call("recalibrate", service); });
  EXPECT_TRUE(
      RosRig::eventually([] { return contains(rig->state().text, "a recalibration waits for frames"); }));
  EXPECT_TRUE(goodFrame().used) << "inputs go on while a caller waits";
  EXPECT_TRUE(trigger("cancel").success);
  ASSERT_TRUE(answered.get());
  EXPECT_FALSE(service.response.success);
  EXPECT_TRUE(service.response.result.cancelled);
  EXPECT_TRUE(contains(service.response.message, "cancelled")) << service.response.message;
}

TEST(RosInterface, RecalibratesWithoutWaiting) {
  for (int i = 0; i < 3; ++i) goodFrame();
  Recalibrate service;
  service.request.dry_run = true;
  ASSERT_TRUE(rig->call("recalibrate", service));
  EXPECT_TRUE(service.response.success) << service.response.message;
  CalibrationResult::ConstPtr result;
  EXPECT_TRUE(RosRig::eventually(
      [&] {
        result = latest<CalibrationResult>("/recalibration/result", 1.0);
        return result && contains(result->reason, "dry run");
      },
      60.0))
      << (result ? result->reason : "no result");
}

TEST(RosInterface, RecalibratesSavesAndRestores) {
  Recalibrate service;
  service.request.wait = true;
  ASSERT_TRUE(rig->call("recalibrate", service));
  ASSERT_TRUE(service.response.success) << service.response.message;
  const CalibrationResult& result = service.response.result;
  ASSERT_TRUE(result.accepted) << result.reason;
  const Eigen::Isometry3d found = tf2::transformToEigen(result.transform);
  EXPECT_LT(extrinsicError(found, SyntheticScene::T_camera_lidar()).angle(),
            0.5 * extrinsicError(wrongGuess(), SyntheticScene::T_camera_lidar()).angle());

  tf2_ros::Buffer buffer;
  const tf2_ros::TransformListener listener(buffer);
  const auto inTf = [&](const Eigen::Isometry3d& T_camera_lidar) {
    return RosRig::eventually([&] {
      return buffer.canTransform("camera_recalibrated", "lidar", ros::Time(0)) &&
             tf2::transformToEigen(buffer.lookupTransform("camera_recalibrated", "lidar", ros::Time(0)))
                 .isApprox(T_camera_lidar, 1e-6);
    });
  };
  EXPECT_TRUE(inTf(found));

  char folder[] = "/tmp/recalibration_testXXXXXX";
  ASSERT_NE(mkdtemp(folder), nullptr);
  SaveCalibration save;
  save.request.path = std::string(folder) + "/result.yaml";
  ASSERT_TRUE(rig->call("save", save));
  ASSERT_TRUE(save.response.success) << save.response.message;
  EXPECT_TRUE(readCalibration(save.request.path).T_camera_lidar.isApprox(found, 1e-9));
  std::remove(save.request.path.c_str());
  rmdir(folder);

  EXPECT_TRUE(trigger("restore").success);
  EXPECT_TRUE(inTf(wrongGuess()));
  EXPECT_FALSE(trigger("restore").success) << "only once";
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_ros_interface");
  ros::AsyncSpinner spinner(1);
  spinner.start();
  lidar_camera_recalibration::RosRig ros_rig;
  lidar_camera_recalibration::rig = &ros_rig;
  return RUN_ALL_TESTS();
}

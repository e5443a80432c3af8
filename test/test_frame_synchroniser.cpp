#include "frame_synchroniser.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <boost/make_shared.hpp>
#include <cmath>
#include <deque>
#include <memory>
#include <random>

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kImageBytes = 1000, kCloudBytes = 2000, kMaskBytes = 500;
constexpr double kStart = 1600000000.0;  // [s], as stamps of a real drive

ros::Time stampAt(double seconds) {
  ros::Time time;
  return time.fromNSec(static_cast<std::uint64_t>(std::llround((kStart + seconds) * 1e9)));
}

template <class Message>
boost::shared_ptr<Message> message(double seconds) {
  auto result = boost::make_shared<Message>();
  result->header.stamp = stampAt(seconds);
  return result;
}
sensor_msgs::ImageConstPtr image(double seconds, std::size_t bytes = kImageBytes) {
  auto result = message<sensor_msgs::Image>(seconds);
  result->data.resize(bytes);
  return result;
}
sensor_msgs::CameraInfoConstPtr info(double seconds) { return message<sensor_msgs::CameraInfo>(seconds); }
sensor_msgs::PointCloud2ConstPtr cloud(double seconds) {
  auto result = message<sensor_msgs::PointCloud2>(seconds);
  result->data.resize(kCloudBytes);
  return result;
}

double seconds(const ros::Time& time) {
  return static_cast<double>(static_cast<std::int64_t>(time.toNSec()) -
                             static_cast<std::int64_t>(stampAt(0).toNSec())) *
         1e-9;
}

class FrameSynchroniserTest : public testing::Test {
 protected:
  void reset(const SynchroniserConfig& config) { sync_ = std::make_unique<FrameSynchroniser>(config); }

  void addImageAndInfo(double stamp) {
    sync_->addImage(image(stamp));
    sync_->addCameraInfo(info(stamp));
  }
  void addMasks(double stamp) { sync_->addMasks(image(stamp, kMaskBytes)); }
  void addPair(double stamp) {
    addImageAndInfo(stamp);
    sync_->addCloud(cloud(stamp));
  }
  // Stamp of the cloud that the image got, NaN if the image is no pair. Consumes the frame.
  double cloudOf(double image_stamp) {
    addMasks(image_stamp);
    const auto frame = sync_->next();
    if (!frame || std::abs(seconds(frame->image->header.stamp) - image_stamp) > 1e-6) return std::nan("");
    return seconds(frame->cloud->header.stamp);
  }

  std::unique_ptr<FrameSynchroniser> sync_ = std::make_unique<FrameSynchroniser>(SynchroniserConfig());
};

TEST_F(FrameSynchroniserTest, anyOrderOfTheFourMessagesMakesOneFrame) {
  std::array<int, 4> order = {0, 1, 2, 3};
  do {
    reset(SynchroniserConfig());
    for (int i = 0; i < 4; ++i) {
      EXPECT_FALSE(sync_->next());
      if (order[i] == 0) sync_->addImage(image(1.0));
      if (order[i] == 1) sync_->addCameraInfo(info(1.0));
      if (order[i] == 2) sync_->addCloud(cloud(1.02));
      if (order[i] == 3) addMasks(1.0);
    }
    const auto frame = sync_->next();
    ASSERT_TRUE(frame) << order[0] << order[1] << order[2] << order[3];
    EXPECT_EQ(stampAt(1.0), frame->image->header.stamp);
    EXPECT_EQ(kImageBytes, frame->image->data.size());
    EXPECT_EQ(stampAt(1.0), frame->info->header.stamp);
    EXPECT_EQ(stampAt(1.02), frame->cloud->header.stamp);
    EXPECT_EQ(stampAt(1.0), frame->masks->header.stamp);
    EXPECT_EQ(kMaskBytes, frame->masks->data.size());
    EXPECT_FALSE(sync_->next());
    EXPECT_EQ(0u, sync_->bytes());
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_F(FrameSynchroniserTest, cameraInfoWithinOneMillisecondBelongsToTheImage) {
  sync_->addImage(image(1.0));
  sync_->addCameraInfo(info(1.0008));
  sync_->addCloud(cloud(1.0));
  EXPECT_EQ(1u, sync_->pending());

  sync_->addImage(image(2.0));
  sync_->addCameraInfo(info(2.002));
  sync_->addCloud(cloud(2.0));
  EXPECT_EQ(1u, sync_->pending());
}

TEST_F(FrameSynchroniserTest, waitsForTheNearerCloud) {
  sync_->addCloud(cloud(0.95));
  addImageAndInfo(1.0);
  EXPECT_EQ(0u, sync_->pending()) << "a nearer cloud may still come";
  sync_->addCloud(cloud(1.02));
  EXPECT_EQ(1u, sync_->pending());
  EXPECT_NEAR(1.02, cloudOf(1.0), 1e-6);
}

TEST_F(FrameSynchroniserTest, takesTheEarlierCloudWhenTheLaterOneIsFurther) {
  sync_->addCloud(cloud(0.98));
  addImageAndInfo(1.0);
  sync_->addCloud(cloud(1.05));
  EXPECT_NEAR(0.98, cloudOf(1.0), 1e-6);
}

TEST_F(FrameSynchroniserTest, cloudOutsideOfTheGapIsNoPartner) {
  addImageAndInfo(1.0);
  sync_->addCloud(cloud(1.061));
  EXPECT_EQ(0u, sync_->pending());
}

TEST_F(FrameSynchroniserTest, oneCloudServesTheNearestImageOnly) {
  addImageAndInfo(1.000);
  addImageAndInfo(1.033);
  sync_->addCloud(cloud(1.04));
  EXPECT_EQ(1u, sync_->pending());
  EXPECT_NEAR(1.04, cloudOf(1.033), 1e-6);
  EXPECT_TRUE(std::isnan(cloudOf(1.000)));
}

TEST_F(FrameSynchroniserTest, neighbouringImagesEachGetACloud) {
  // 1.03 is nearer to the second image, but that one has a still nearer cloud.
  addImageAndInfo(1.00);
  addImageAndInfo(1.05);
  sync_->addCloud(cloud(1.05));
  sync_->addCloud(cloud(1.03));
  EXPECT_EQ(2u, sync_->pending());
  EXPECT_NEAR(1.03, cloudOf(1.00), 1e-6);
  EXPECT_NEAR(1.05, cloudOf(1.05), 1e-6);
}

TEST_F(FrameSynchroniserTest, cloudWaitsForTheInfoOfTheNearestImage) {
  addImageAndInfo(1.000);
  sync_->addImage(image(1.033));
  sync_->addCloud(cloud(1.04));
  EXPECT_EQ(0u, sync_->pending());
  sync_->addCameraInfo(info(1.033));
  EXPECT_NEAR(1.04, cloudOf(1.033), 1e-6);
}

TEST_F(FrameSynchroniserTest, aLaterPairEndsTheWaiting) {
  sync_->addCloud(cloud(0.97));
  addImageAndInfo(1.0);
  EXPECT_EQ(0u, sync_->pending());
  addImageAndInfo(1.1);
  sync_->addCloud(cloud(1.1));
  EXPECT_EQ(2u, sync_->pending());
  EXPECT_NEAR(0.97, cloudOf(1.0), 1e-6);
}

TEST_F(FrameSynchroniserTest, aFullQueueEndsTheWaiting) {
  SynchroniserConfig config;
  config.max_unmatched = 3;
  reset(config);
  sync_->addCloud(cloud(0.97));
  addImageAndInfo(1.0);
  for (double stamp : {1.2, 1.4, 1.6}) addImageAndInfo(stamp);
  EXPECT_EQ(1u, sync_->pending());
  EXPECT_NEAR(0.97, cloudOf(1.0), 1e-6);
  EXPECT_EQ(0u, sync_->counts().unmatched);
}

TEST_F(FrameSynchroniserTest, flushPairsTheLastImageOfABag) {
  sync_->addCloud(cloud(0.97));
  addImageAndInfo(1.0);
  EXPECT_EQ(0u, sync_->pending());
  sync_->flush();
  EXPECT_NEAR(0.97, cloudOf(1.0), 1e-6);
}

TEST_F(FrameSynchroniserTest, messagesWithoutPartnerAreBoundedAndCounted) {
  SynchroniserConfig config;
  config.max_unmatched = 5;
  reset(config);
  for (int i = 0; i < 100; ++i) sync_->addImage(image(i));
  EXPECT_EQ(95u, sync_->counts().unmatched);
  reset(config);
  for (int i = 0; i < 100; ++i) sync_->addCameraInfo(info(i));
  EXPECT_EQ(95u, sync_->counts().unused);
  reset(config);
  for (int i = 0; i < 100; ++i) sync_->addCloud(cloud(i));
  EXPECT_EQ(95u, sync_->counts().unused);
  reset(config);
  for (int i = 0; i < 100; ++i) addMasks(i);
  EXPECT_EQ(95u, sync_->counts().unknown_masks);
  // A pair still gets through afterwards.
  addPair(200.0);
  EXPECT_EQ(1u, sync_->pending());
}

TEST_F(FrameSynchroniserTest, infosForOnlySomeImagesDoNotStarveTheRest) {
  for (int i = 0; i < 100; ++i) {
    // The images without info are the nearer ones.
    addImageAndInfo(0.1 * i);
    sync_->addImage(image(0.1 * i + 0.04));
    sync_->addCloud(cloud(0.1 * i + 0.03));
  }
  EXPECT_GT(sync_->pending(), 80u);
}

TEST_F(FrameSynchroniserTest, masksOfAMinuteAgoAndOutOfOrder) {
  for (int i = 0; i <= 600; ++i) addPair(0.1 * i);
  EXPECT_EQ(601u, sync_->pending());
  for (int i : {600, 0, 300, 7}) {
    addMasks(0.1 * i);
    const auto frame = sync_->next();
    ASSERT_TRUE(frame) << i;
    EXPECT_NEAR(0.1 * i, seconds(frame->image->header.stamp), 1e-6);
  }
  EXPECT_EQ(0u, sync_->counts().unknown_masks);
}

TEST_F(FrameSynchroniserTest, severalCompleteFramesComeOldestFirst) {
  for (double stamp : {1.0, 2.0, 3.0}) addPair(stamp);
  for (double stamp : {3.0, 1.0, 2.0}) addMasks(stamp);
  for (double stamp : {1.0, 2.0, 3.0}) EXPECT_EQ(stampAt(stamp), sync_->next()->image->header.stamp);
  EXPECT_FALSE(sync_->next());
}

TEST_F(FrameSynchroniserTest, pairsWithoutMasksExpire) {
  for (int i = 0; i < 100; ++i) addPair(i);
  // The age is that of the last image but one: 98 - 60 = 38 is the oldest that stays.
  EXPECT_EQ(38u, sync_->counts().no_masks);
  EXPECT_EQ(62u, sync_->pending());
  addMasks(37.0);
  EXPECT_FALSE(sync_->next());
  EXPECT_EQ(1u, sync_->counts().unknown_masks);
  addMasks(38.0);
  EXPECT_TRUE(sync_->next());
}

TEST_F(FrameSynchroniserTest, duplicates) {
  addPair(1.0);
  addPair(1.0);
  EXPECT_EQ(1u, sync_->pending());
  addMasks(1.0);
  addMasks(1.0);
  EXPECT_EQ(1u, sync_->counts().unknown_masks);
  EXPECT_TRUE(sync_->next());
  addMasks(1.0);
  EXPECT_FALSE(sync_->next());
  addPair(2.1);
  addPair(2.2);
  EXPECT_EQ(2u, sync_->counts().unknown_masks) << "masks of a frame that was handed out";
}

TEST_F(FrameSynchroniserTest, masksOfAnImageNeverSeenAreCountedAtOnce) {
  addPair(10.0);
  addPair(11.0);
  addMasks(5.0);
  EXPECT_EQ(1u, sync_->counts().unknown_masks);
  EXPECT_EQ(2u, sync_->pending());
}

TEST_F(FrameSynchroniserTest, imagesOutOfOrderMeetMasksThatWereAhead) {
  addMasks(1.0);
  addPair(1.1);
  addPair(1.2);
  addPair(1.0);
  const auto frame = sync_->next();
  ASSERT_TRUE(frame);
  EXPECT_EQ(stampAt(1.0), frame->masks->header.stamp);
}

TEST_F(FrameSynchroniserTest, oneBadStampAheadExpiresNothing) {
  for (int i = 0; i < 20; ++i) addPair(i);
  addPair(3600.0);
  EXPECT_EQ(21u, sync_->pending());
  for (int i = 20; i < 40; ++i) addPair(i);
  EXPECT_EQ(41u, sync_->pending());
  EXPECT_EQ(0u, sync_->counts().no_masks);
  EXPECT_NEAR(25.0, cloudOf(25.0), 1e-6);
  // Two in a row are believed, but the good ones after them live on.
  addPair(3601.0);
  addPair(3602.0);
  EXPECT_EQ(39u, sync_->counts().no_masks);
  for (int i = 50; i < 60; ++i) addPair(i);
  EXPECT_NEAR(55.0, cloudOf(55.0), 1e-6);
}

TEST_F(FrameSynchroniserTest, stampsAtTheEndsOfTheRangeAreHarmless) {
  for (const ros::Time& stamp : {ros::Time(0, 0), ros::Time(4294967295u, 999999999)}) {
    auto bad_image = boost::make_shared<sensor_msgs::Image>();
    bad_image->header.stamp = stamp;
    auto bad_info = boost::make_shared<sensor_msgs::CameraInfo>();
    bad_info->header.stamp = stamp;
    auto bad_cloud = boost::make_shared<sensor_msgs::PointCloud2>();
    bad_cloud->header.stamp = stamp;
    sync_->addImage(bad_image);
    sync_->addCameraInfo(bad_info);
    sync_->addCloud(bad_cloud);
    sync_->addMasks(bad_image);
    EXPECT_TRUE(sync_->next());
  }
  sync_->addImage(nullptr);
  sync_->addCameraInfo(nullptr);
  sync_->addCloud(nullptr);
  sync_->addMasks(nullptr);
  EXPECT_EQ(0u, sync_->bytes());
}

TEST_F(FrameSynchroniserTest, thinningKeepsOldAndNew) {
  SynchroniserConfig config;
  config.max_bytes = 40 * (kImageBytes + kCloudBytes + 1000);
  reset(config);
  for (int i = 0; i <= 590; ++i) {
    addPair(0.1 * i);
    ASSERT_LE(sync_->bytes(), config.max_bytes);
  }
  const std::size_t held = sync_->pending();
  EXPECT_GT(held, 25u);
  EXPECT_EQ(591u, held + sync_->counts().memory);

  std::vector<double> ages;
  for (int i = 0; i <= 590; ++i) {
    addMasks(0.1 * i);
    if (sync_->next()) ages.push_back(59.0 - 0.1 * i);
  }
  // The masks themselves need room, too: that may cost one pair.
  ASSERT_GE(ages.size() + 1, held);
  EXPECT_NEAR(59.0, ages.front(), 1e-6);
  EXPECT_NEAR(0.0, ages.back(), 1e-6);
  EXPECT_NEAR(0.1, ages[ages.size() - 2], 1e-6);
  // Every delay meets an image that is at most a third older or younger, or 0.3 s.
  for (std::size_t i = 1; i < ages.size(); ++i) EXPECT_LT(ages[i - 1] - ages[i], 0.3 + 0.34 * ages[i]);
  const auto older = [&](double age) {
    return std::count_if(ages.begin(), ages.end(), [&](double a) { return a > age; });
  };
  EXPECT_GE(older(20.0), 3);
  EXPECT_GT(static_cast<std::ptrdiff_t>(held) - older(5.0), older(5.0)) << "dense near the present";
}

/// Ten images a second for two minutes; the segmenter takes the newest one as soon as it is free.
/// @return the share of its masks that met their image
double shareOfMasksUsed(FrameSynchroniser& sync, double delay, int at_once) {
  struct Work {
    double image, done;
  };
  std::deque<Work> works;
  int sent = 0, used = 0;
  for (int i = 0; i < 1200; ++i) {
    const double now = 0.1 * i;
    if (!works.empty() && works.front().done <= now) {
      sync.addMasks(image(works.front().image, kMaskBytes));
      works.pop_front();
      ++sent;
      while (sync.next()) ++used;
    }
    const bool is_free = static_cast<int>(works.size()) < at_once &&
                         (works.empty() || now >= works.back().image + delay / at_once - 1e-6);
    if (is_free) works.push_back({0.1 * (i - 1), now + delay});  // the last one that came
    sync.addImage(image(now));
    sync.addCameraInfo(info(now));
    sync.addCloud(cloud(now));
  }
  return static_cast<double>(used) / sent;
}

TEST_F(FrameSynchroniserTest, aSmallCacheHoldsWhatTheSegmenterWorksOn) {
  SynchroniserConfig config;
  config.max_bytes = 12 * (kImageBytes + kCloudBytes + 1000);
  for (const double delay : {0.5, 2.0, 5.0, 20.0}) {
    reset(config);
    EXPECT_GE(shareOfMasksUsed(*sync_, delay, 1), 0.75) << delay << " s late";  // the first ones are luck
  }
  reset(config);
  EXPECT_GE(shareOfMasksUsed(*sync_, 4.0, 2), 0.75) << "two images at once";
}

TEST_F(FrameSynchroniserTest, bytesAreThoseOfTheMessagesHeld) {
  EXPECT_EQ(0u, sync_->bytes());
  addPair(1.0);
  const std::size_t one = sync_->bytes();
  EXPECT_GT(one, kImageBytes + kCloudBytes);
  EXPECT_LT(one, kImageBytes + kCloudBytes + 2000);
  addMasks(1.0);
  EXPECT_GT(sync_->bytes(), one + kMaskBytes);
  sync_->next();
  EXPECT_EQ(0u, sync_->bytes());
}

TEST_F(FrameSynchroniserTest, aMessageLargerThanTheBoundIsGivenUp) {
  SynchroniserConfig config;
  config.max_bytes = 500;
  reset(config);
  addPair(1.0);
  EXPECT_EQ(0u, sync_->bytes());
  EXPECT_EQ(1u, sync_->counts().memory);
  EXPECT_EQ(2u, sync_->counts().unused);
}

TEST_F(FrameSynchroniserTest, completeFramesNobodyFetchesAreBounded) {
  SynchroniserConfig config;
  config.max_bytes = 50000;
  reset(config);
  for (int i = 0; i < 100; ++i) {
    addPair(i);
    addMasks(i);
    EXPECT_LE(sync_->bytes(), config.max_bytes);
  }
  EXPECT_GT(sync_->counts().memory, 50u);
  EXPECT_TRUE(sync_->next());
}

TEST_F(FrameSynchroniserTest, clearForgetsButCounts) {
  addPair(1.0);
  addImageAndInfo(2.0);
  addMasks(3.0);
  sync_->clear();
  EXPECT_EQ(0u, sync_->bytes());
  EXPECT_EQ(0u, sync_->pending());
  EXPECT_EQ(2u, sync_->counts().forgotten);
  EXPECT_EQ(1u, sync_->counts().unused);
  EXPECT_EQ(1u, sync_->counts().unknown_masks);
  // A looped bag plays the same stamps again.
  addPair(1.0);
  addMasks(1.0);
  EXPECT_TRUE(sync_->next());
}

// A day on the road: jittered rates, lost, doubled, late and reordered messages, bytes that do not suffice.
TEST_F(FrameSynchroniserTest, countsAddUp) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  SynchroniserConfig config;
  config.mask_timeout = 5.0;
  config.max_bytes = 30 * (kImageBytes + kCloudBytes);
  reset(config);

  struct Event {
    double time;
    int kind;
    double stamp;
  };
  std::vector<Event> events;
  for (int i = 0; i < 2000; ++i) {
    const double stamp = 0.1 * i;
    const auto add = [&](int kind, double message_stamp, double latency) {
      if (uniform(random) < 0.1) return;  // lost
      events.push_back({stamp + latency * uniform(random), kind, message_stamp});
      if (uniform(random) < 0.05) events.push_back({stamp + latency * uniform(random), kind, message_stamp});
    };
    add(0, stamp, 0.15);
    add(1, stamp, 0.15);
    add(2, stamp + 0.12 * uniform(random) - 0.06, 0.3);
    if (i % 3 == 0) add(3, stamp, 8.0);
  }
  std::stable_sort(events.begin(), events.end(),
                   [](const Event& a, const Event& b) { return a.time < b.time; });
  std::uint64_t handed_out = 0, images = 0;
  for (const Event& event : events) {
    if (event.kind == 0) sync_->addImage(image(event.stamp));
    if (event.kind == 1) sync_->addCameraInfo(info(event.stamp));
    if (event.kind == 2) sync_->addCloud(cloud(event.stamp));
    if (event.kind == 3) addMasks(event.stamp);
    if (event.kind == 0) ++images;
    while (sync_->next()) ++handed_out;
    ASSERT_LE(sync_->bytes(), config.max_bytes);
    const SynchroniserCounts& counts = sync_->counts();
    ASSERT_EQ(images, handed_out + sync_->images() + counts.unmatched + counts.no_masks + counts.memory);
  }
  EXPECT_GT(handed_out, 100u);
  const std::uint64_t pairs = sync_->pending(), held = sync_->images();
  sync_->clear();
  const SynchroniserCounts& counts = sync_->counts();
  EXPECT_GT(counts.memory, 0u);
  EXPECT_EQ(counts.forgotten, held);
  // Of each image alone, of each pair its CameraInfo and cloud with it.
  EXPECT_EQ(events.size(), 4 * handed_out + counts.unmatched + counts.unused + counts.unknown_masks +
                               3 * (counts.no_masks + counts.memory + pairs) + (held - pairs));
}

}  // namespace
}  // namespace lidar_camera_recalibration

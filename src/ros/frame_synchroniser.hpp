#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

namespace lidar_camera_recalibration {

struct SynchroniserConfig {
  double max_stamp_gap = 0.06;                ///< between image and cloud [s]
  double mask_timeout = 60.0;                 ///< an image waits so long for its masks, in stamp time [s]
  std::size_t max_bytes = 48u * 1024 * 1024;  ///< of all messages held
  std::size_t max_unmatched = 20;  ///< images, infos, clouds and masks each that wait for their partners
};

/// The messages of one frame, as received.
struct FrameMessages {
  sensor_msgs::ImageConstPtr image;
  sensor_msgs::CameraInfoConstPtr info;
  sensor_msgs::PointCloud2ConstPtr cloud;
  sensor_msgs::ImageConstPtr masks;
};

/// Every image put in is handed out, still held or counted here once.
struct SynchroniserCounts {
  std::uint64_t unmatched = 0;      ///< images without CameraInfo or cloud, or duplicates
  std::uint64_t no_masks = 0;       ///< images whose masks did not come in time
  std::uint64_t memory = 0;         ///< images given up because the cache was full
  std::uint64_t forgotten = 0;      ///< images that clear() discarded
  std::uint64_t unknown_masks = 0;  ///< masks for an image never seen or already given up, or duplicates
  std::uint64_t unused = 0;         ///< infos and clouds given up without an image, or duplicates
};

/// Joins the four inputs of a frame. Image and CameraInfo belong together by equal stamps (1 ms is forgiven),
/// the cloud by the nearest stamp within the gap, the masks by exactly the image's stamp, up to a minute
/// later and in any order.
///
/// Knows messages but no node: no callbacks, threads or clock. Time is the stamps'. Not thread-safe; one
/// owner. Bounded in count, bytes and age. When bytes run out, waiting pairs are thinned by age, dense near
/// the present and sparse long ago, so that both prompt and very late masks still meet some of their images.
/// Those that the segmenter seems to work on leave last: whenever masks come, it takes the newest image next.
///
/// Age is judged by the older of the last two images, so that one bad stamp far ahead expires nothing; two in
/// a row do.
class FrameSynchroniser {
 public:
  explicit FrameSynchroniser(const SynchroniserConfig& config);

  void addImage(const sensor_msgs::ImageConstPtr& image);
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& cloud);
  void addMasks(const sensor_msgs::ImageConstPtr& masks);

  /// The oldest complete frame, each handed out once.
  std::optional<FrameMessages> next();

  /// No more messages will come (end of a bag): images that still wait for a nearer cloud take the one there
  /// is.
  void flush();

  /// Forgets all messages, keeps the counts.
  void clear();

  const SynchroniserCounts& counts() const { return counts_; }
  std::size_t pending() const { return pairs_.size(); }  ///< image/cloud pairs that wait for masks
  std::size_t images() const { return images_.size() + pairs_.size() + complete_.size(); }  ///< held
  std::size_t bytes() const;  ///< of all messages held

 private:
  using Stamp = std::int64_t;  ///< [ns]
  struct WaitingImage {
    sensor_msgs::ImageConstPtr image;
    sensor_msgs::CameraInfoConstPtr info;  ///< null until it came
  };
  using Match = std::pair<std::size_t, std::size_t>;  ///< index into images_, index into clouds_

  bool holdsImage(Stamp stamp) const;
  std::vector<Match> matches(bool only_with_info) const;
  bool decided(Stamp image_stamp) const;
  void makePair(const Match& match);
  void pairDecided();
  void giveUpOldestImage();
  void giveUpOldestCloud();
  void dropOldestImage(std::uint64_t& counter);
  void dropOldestCloud();
  void settle();
  void expire();
  void noteMasks(Stamp stamp);
  int expectation(Stamp stamp) const;
  std::map<Stamp, FrameMessages>::iterator mostRedundantPair();
  void freeMemory();

  SynchroniserConfig config_;
  SynchroniserCounts counts_;
  // In the order of arrival, so that a message with a bad stamp leaves like any other.
  std::deque<WaitingImage> images_;
  std::deque<sensor_msgs::CameraInfoConstPtr> infos_;
  std::deque<sensor_msgs::PointCloud2ConstPtr> clouds_;
  std::deque<sensor_msgs::ImageConstPtr> masks_;  ///< that came before their image and cloud were a pair
  std::map<Stamp, FrameMessages> pairs_;          ///< wait for masks
  std::map<Stamp, FrameMessages> complete_;
  std::optional<Stamp> last_image_, second_last_image_;  ///< in the order of arrival
  std::optional<Stamp> last_pair_;
  std::deque<Stamp> awaited_;  ///< images that the segmenter seems to work on
};

}  // namespace lidar_camera_recalibration

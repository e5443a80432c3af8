#pragma once

#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>

#include <cstdint>
#include <deque>
#include <map>
#include <optional>

namespace lidar_camera_recalibration {

struct SynchroniserConfig {
  double max_stamp_gap = 0.06;               ///< between image and cloud [s]
  double mask_timeout = 60.0;                ///< an image waits so long for its masks, in stamp time [s]
  std::size_t max_bytes = 512u * 1024 * 1024;  ///< of all messages held
  std::size_t max_unmatched = 10;            ///< images, infos and clouds each that wait for their partners
};

/// The messages of one frame, as received.
struct FrameMessages {
  sensor_msgs::ImageConstPtr image;
  sensor_msgs::CameraInfoConstPtr info;
  sensor_msgs::PointCloud2ConstPtr cloud;
  sensor_msgs::ImageConstPtr masks;
};

struct SynchroniserCounts {
  std::uint64_t unmatched = 0;      ///< images, infos, clouds given up without a partner
  std::uint64_t no_masks = 0;       ///< pairs whose masks did not come in time
  std::uint64_t unknown_masks = 0;  ///< masks for an image never seen or already given up
  std::uint64_t memory = 0;         ///< pairs given up because the cache was full
};

/// Joins the four inputs of a frame. Image and CameraInfo belong together by equal stamps, the cloud by the nearest stamp
/// within the gap, the masks by the image's stamp, up to a minute later and in any order.
///
/// Knows messages but no node: no callbacks, threads or clock. Time is the stamps'. Not thread-safe; one owner.
/// Bounded in count, bytes and age. When bytes run out, waiting pairs are thinned by age, dense near the present and sparse long ago,
/// so that both prompt and very late masks still meet some of their images.
class FrameSynchroniser {
 public:
  explicit FrameSynchroniser(const SynchroniserConfig& config);

  void addImage(const sensor_msgs::ImageConstPtr& image);
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info);
  void addCloud(const sensor_msgs::PointCloud2ConstPtr& cloud);
  void addMasks(const sensor_msgs::ImageConstPtr& masks);

  /// The oldest complete frame, each handed out once.
  std::optional<FrameMessages> next();

  void clear();

  const SynchroniserCounts& counts() const { return counts_; }
  std::size_t pending() const;  ///< image/cloud pairs that wait for masks
  std::size_t bytes() const;    ///< of all messages held

 private:
  SynchroniserConfig config_;
  SynchroniserCounts counts_;
};

}  // namespace lidar_camera_recalibration

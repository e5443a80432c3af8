#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/lidar_features.hpp"
#include "lidar_camera_recalibration/masks.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration {

class BoundaryField;

struct FrameConfig {
  LidarFeatureConfig features;
  bool edges =
      true;  ///< find the LiDAR's edges and the borders of the masks, for objective `consistency_edges`
  /// Points that no extrinsic within this angle of the guess brings into the image are dropped [deg].
  double crop_margin_deg = 12.0;
  double min_range = 1.0;    ///< nearer points belong to the vehicle [m]
  double max_range = 120.0;  ///< [m]
  bool cull_hidden = true;   ///< drop points that the LiDAR sees past an object but the camera does not
  int min_points = 500;      ///< a frame with fewer points after the crop is refused
  int min_masks = 5;         ///< a frame with fewer masks is refused
};

/// The points of a frame as structure of arrays, in the LiDAR frame.
struct FramePoints {
  std::vector<float> x, y, z;         ///< [m]
  std::vector<float> nx, ny, nz;      ///< unit normals; zero where unknown
  std::vector<float> reflectivity;    ///< 0..1; empty if the sensor gives none
  std::vector<std::int32_t> segment;  ///< class id, LidarFeatures::kNoSegment for isolated points
  std::int32_t segment_count = 0;

  std::size_t size() const { return x.size(); }
  bool hasReflectivity() const { return !reflectivity.empty(); }
};

/// Places where a camera should see an edge, in the LiDAR frame; what objective `consistency_edges` matches
/// with the borders of the masks. Empty if the cloud's points cannot be assigned to the LiDAR's rings.
struct EdgePoints {
  static constexpr std::size_t kKinds = 3;
  enum class Kind : std::uint8_t {
    kAzimuthGap,    ///< step of the range along a ring: an upright silhouette
    kRingGap,       ///< step of the range from ring to ring: a level silhouette
    kReflectivity,  ///< step of the reflectivity along a ring
  };
  std::vector<float> x, y, z;  ///< [m], on the nearer side
  std::vector<float> weight;   ///< how clear, the samples of one ring gap together; less in a crowd; 0..1
  std::vector<Kind> kind;
  double ring_step = 0.0;  ///< median angle from ring to ring [rad]; 0 without rings

  std::size_t size() const { return x.size(); }
};

/// One image's masks with one prepared cloud. Made once, immutable, shared by const pointer.
struct Frame {
  double stamp = 0.0;  ///< of the image [s]
  Camera camera;       ///< of the image as it was taken
  cv::Mat image;       ///< CV_8UC3, BGR, as it was taken; may be empty
  MaskSets masks;      ///< in the ideal image (see Camera)
  FramePoints points;
  /// Per point: 1 = the camera sees it from the guess. With FrameConfig::cull_hidden the hidden points are
  /// not in `points` and all flags are 1; without it they are there, and scored.
  std::vector<std::uint8_t> visible;
  EdgePoints edges{};
  /// Of the masks, in the ideal image; none without FrameConfig::edges.
  std::shared_ptr<const BoundaryField> borders{};
};
using FramePtr = std::shared_ptr<const Frame>;
using Frames = std::vector<FramePtr>;

/// Which points a camera at `T_camera_lidar` sees: a point is hidden if a surface that the LiDAR sampled runs
/// clearly in front of it. Surfaces end at their outermost samples, so points just outside of a silhouette
/// stay visible. Depends on the camera's position only, not on its orientation, so it holds over the whole
/// rotation search. Expects what spinning LiDARs deliver: up to 2.6 deg between samples along z, up to 1 deg
/// around z.
/// @return one flag per point, 1 = visible.
std::vector<std::uint8_t> visiblePoints(const std::vector<Eigen::Vector3f>& points,
                                        const Eigen::Isometry3d& T_camera_lidar);

/// @param image   as the camera took it, CV_8UC1 or CV_8UC3 (may be empty: then
///                nothing can be drawn, and the masks' borders are taken as they are)
/// @param layers  label images of the masks, CV_32SC1, of the image's size, as for MaskSets::fromLayers
/// @param guess   T_camera_lidar around which will be searched
/// @throw Error(kCloud, kMasks, kImage, kNotEnough) saying what is wrong with this frame.
FramePtr makeFrame(double stamp, const Camera& camera, const cv::Mat& image,
                   const std::vector<cv::Mat>& layers, const PointCloud& cloud,
                   const Eigen::Isometry3d& guess, const FrameConfig& config);

/// Bytes that a frame holds, for bounded buffers.
std::size_t memoryUse(const Frame& frame);

}  // namespace lidar_camera_recalibration

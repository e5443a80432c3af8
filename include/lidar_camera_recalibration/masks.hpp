#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "lidar_camera_recalibration/camera.hpp"

namespace lidar_camera_recalibration {

/// The masks of one image. Masks may overlap, so a pixel belongs to a *set* of masks; the few distinct sets
/// of an image are numbered, and one 16-bit image says which set each pixel has.
class MaskSets {
 public:
  MaskSets() = default;

  /// From label images of type CV_32SC1 and equal size, one per layer; 0 = no mask, other ids are arbitrary.
  /// The same id in two layers is the same mask.
  /// @throw Error(kMasks) if the layers differ in size or type, hold no mask at all, hold negative ids, or
  /// make more than 65535 distinct sets (noise, not masks).
  static MaskSets fromLayers(const std::vector<cv::Mat>& layers);

  /// In the ideal image of the camera that took the image; sets and masks that it does not show are left out.
  /// @throw Error(kImage) if the size is not the camera's.
  MaskSets toIdeal(const Camera& camera) const;

  int width() const { return set_of_pixel_.cols; }
  int height() const { return set_of_pixel_.rows; }
  std::size_t maskCount() const { return mask_count_; }
  std::size_t setCount() const { return set_begin_.empty() ? 0 : set_begin_.size() - 1; }

  /// CV_16UC1: index of the pixel's set; set 0 is the empty set.
  const cv::Mat& setOfPixel() const { return set_of_pixel_; }

  /// The masks of set s are setMasks()[setBegin()[s]] ... setMasks()[setBegin()[s + 1] - 1], each below
  /// maskCount(), ascending.
  const std::vector<std::uint32_t>& setBegin() const { return set_begin_; }
  const std::vector<std::uint32_t>& setMasks() const { return set_masks_; }

 private:
  cv::Mat set_of_pixel_;
  std::vector<std::uint32_t> set_begin_, set_masks_;
  std::size_t mask_count_ = 0;
};

/// Lays binary masks (CV_8UC1, non-zero = inside, all of one size) into as few label images (CV_32SC1) as the
/// order allows: each mask goes to the first layer where it overlaps nothing. Mask i gets the id i + 1. Empty
/// masks are left out.
/// @throw Error(kMasks) if sizes or types differ.
std::vector<cv::Mat> layersFromBinaryMasks(const std::vector<cv::Mat>& masks);

}  // namespace lidar_camera_recalibration

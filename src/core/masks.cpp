#include "lidar_camera_recalibration/masks.hpp"

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <unordered_map>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kMaxSets = 65535;  // beside the empty set; what fits into the 16-bit set image

using Ids = std::vector<std::int32_t>;

struct IdsHash {
  std::size_t operator()(const Ids& ids) const {
    std::uint64_t hash = 0;
    for (const std::int32_t id : ids) hash = (hash ^ static_cast<std::uint32_t>(id)) * 0x9E3779B97F4A7C15ULL;
    return static_cast<std::size_t>(hash ^ (hash >> 32));
  }
};

/// Numbers the sets of ids that pixels have. Different tuples of ids, one per layer, may be the same set.
class SetNumbers {
 public:
  SetNumbers() { numberOf({}); }

  std::uint16_t numberOf(const Ids& tuple) {
    const auto known = of_tuple_.find(tuple);
    if (known != of_tuple_.end()) return known->second;
    Ids set = tuple;
    std::sort(set.begin(), set.end());
    set.erase(std::unique(set.begin(), set.end()), set.end());
    set.erase(std::remove(set.begin(), set.end(), 0), set.end());
    const auto inserted = of_set_.emplace(std::move(set), sets_.size());
    if (inserted.second) {
      if (sets_.size() > kMaxSets) {
        throw Error(
            ErrorCause::kMasks,
            "the masks overlap in more than 65535 different ways, as noise would; check that the mask "
            "layers hold ids and were neither interpolated nor compressed with loss");
      }
      sets_.push_back(&inserted.first->first);
    }
    const auto number = static_cast<std::uint16_t>(inserted.first->second);
    of_tuple_.emplace(tuple, number);
    return number;
  }

  const std::vector<const Ids*>& sets() const { return sets_; }

 private:
  std::unordered_map<Ids, std::uint16_t, IdsHash> of_tuple_;
  std::map<Ids, std::size_t> of_set_;
  std::vector<const Ids*> sets_;  // keys of of_set_, which never move
};

std::string describe(const cv::Mat& image) {
  return std::to_string(image.cols) + "x" + std::to_string(image.rows) + " px, OpenCV type " +
         std::to_string(image.type());
}

// Negative if any value is.
std::int32_t signsOf(const std::int32_t* values, int count) {
  std::int32_t signs = 0;
  for (int i = 0; i < count; ++i) signs |= values[i];
  return signs;
}

void checkLayers(const std::vector<cv::Mat>& layers) {
  if (layers.empty() || layers.front().empty()) throw Error(ErrorCause::kMasks, "there is no mask layer");
  for (std::size_t l = 0; l < layers.size(); ++l) {
    if (layers[l].type() != CV_32SC1 || layers[l].size() != layers.front().size()) {
      throw Error(ErrorCause::kMasks, "mask layer " + std::to_string(l) + " is " + describe(layers[l]) +
                                          "; all layers must be CV_32SC1 and of one size, here " +
                                          describe(layers.front()) + " in the first");
    }
    std::int32_t signs = 0;
    for (int v = 0; v < layers[l].rows; ++v) signs |= signsOf(layers[l].ptr<std::int32_t>(v), layers[l].cols);
    if (signs >= 0) continue;
    double smallest = 0.0;
    cv::Point where;
    cv::minMaxLoc(layers[l], &smallest, nullptr, &where);
    std::ostringstream message;
    message << "mask layer " << l << " holds the negative id " << static_cast<std::int64_t>(smallest)
            << " at pixel " << where << "; use 0 for no mask and positive ids";
    throw Error(ErrorCause::kMasks, message.str());
  }
}

/// Fills the set image. Neighbouring pixels mostly have the same ids, so the table is asked at borders only.
cv::Mat numberPixels(const std::vector<cv::Mat>& layers, SetNumbers& numbers) {
  const std::size_t count = layers.size();
  cv::Mat set_of_pixel(layers.front().size(), CV_16UC1);
  const int width = set_of_pixel.cols;
  Ids ids(count);
  std::vector<std::int32_t> changes(static_cast<std::size_t>(width));  // not 0: other ids than to the left
  for (int v = 0; v < set_of_pixel.rows; ++v) {
    std::fill(changes.begin(), changes.end(), 0);
    changes.front() = 1;
    for (const cv::Mat& layer : layers) {
      const auto* const row = layer.ptr<std::int32_t>(v);
      for (int u = 1; u < width; ++u) changes[static_cast<std::size_t>(u)] |= row[u] ^ row[u - 1];
    }
    auto* const out = set_of_pixel.ptr<std::uint16_t>(v);
    std::uint16_t number = 0;
    for (int u = 0; u < width; ++u) {
      if (changes[static_cast<std::size_t>(u)] != 0) {
        for (std::size_t l = 0; l < count; ++l) ids[l] = layers[l].ptr<std::int32_t>(v)[u];
        number = numbers.numberOf(ids);
      }
      out[u] = number;
    }
  }
  return set_of_pixel;
}

}  // namespace

MaskSets MaskSets::fromLayers(const std::vector<cv::Mat>& layers) {
  checkLayers(layers);
  SetNumbers numbers;
  MaskSets result;
  result.set_of_pixel_ = numberPixels(layers, numbers);

  Ids ids;
  for (const Ids* set : numbers.sets()) ids.insert(ids.end(), set->begin(), set->end());
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  if (ids.empty()) throw Error(ErrorCause::kMasks, "the mask image holds no mask: every pixel is 0");
  result.mask_count_ = ids.size();

  result.set_begin_.push_back(0);
  for (const Ids* set : numbers.sets()) {
    for (const std::int32_t id : *set) {
      const auto index = std::lower_bound(ids.begin(), ids.end(), id) - ids.begin();
      result.set_masks_.push_back(static_cast<std::uint32_t>(index));
    }
    result.set_begin_.push_back(static_cast<std::uint32_t>(result.set_masks_.size()));
  }
  return result;
}

MaskSets MaskSets::toIdeal(const Camera& camera) const {
  MaskSets result;
  result.set_of_pixel_ = camera.toIdeal(set_of_pixel_, cv::INTER_NEAREST);
  // The sets that are left, in the order in which they appear.
  std::vector<std::uint32_t> old_number{0};
  std::vector<std::int32_t> new_number(setCount(), -1);
  new_number[0] = 0;
  for (int v = 0; v < height(); ++v) {
    auto* const row = result.set_of_pixel_.ptr<std::uint16_t>(v);
    for (int u = 0; u < width(); ++u) {
      std::int32_t& number = new_number[row[u]];
      if (number < 0) {
        number = static_cast<std::int32_t>(old_number.size());
        old_number.push_back(row[u]);
      }
      row[u] = static_cast<std::uint16_t>(number);
    }
  }
  // Likewise the masks.
  std::vector<std::uint32_t> mask_number(mask_count_, 0);
  for (const std::uint32_t s : old_number) {
    for (std::uint32_t k = set_begin_[s]; k < set_begin_[s + 1]; ++k) mask_number[set_masks_[k]] = 1;
  }
  for (std::uint32_t& number : mask_number) {
    const bool used = number != 0;
    number = static_cast<std::uint32_t>(result.mask_count_);
    result.mask_count_ += used;
  }
  result.set_begin_.push_back(0);
  for (const std::uint32_t s : old_number) {
    for (std::uint32_t k = set_begin_[s]; k < set_begin_[s + 1]; ++k) {
      result.set_masks_.push_back(mask_number[set_masks_[k]]);
    }
    result.set_begin_.push_back(static_cast<std::uint32_t>(result.set_masks_.size()));
  }
  return result;
}

std::vector<cv::Mat> layersFromBinaryMasks(const std::vector<cv::Mat>& masks) {
  std::vector<cv::Mat> layers;
  for (std::size_t i = 0; i < masks.size(); ++i) {
    if (masks[i].type() != CV_8UC1 || masks[i].size() != masks.front().size()) {
      throw Error(ErrorCause::kMasks, "binary mask " + std::to_string(i) + " is " + describe(masks[i]) +
                                          "; all masks must be CV_8UC1 and of one size, here " +
                                          describe(masks.front()) + " in the first");
    }
    const cv::Rect box = cv::boundingRect(masks[i]);
    if (box.empty()) continue;
    const cv::Mat inside = masks[i](box) != 0;
    const auto overlaps = [&](const cv::Mat& layer) {
      return cv::countNonZero(inside & (layer(box) != 0)) > 0;
    };
    auto layer = std::find_if_not(layers.begin(), layers.end(), overlaps);
    if (layer == layers.end()) layer = layers.insert(layer, cv::Mat::zeros(masks[i].size(), CV_32SC1));
    (*layer)(box).setTo(static_cast<double>(i + 1), inside);
  }
  return layers;
}

}  // namespace lidar_camera_recalibration

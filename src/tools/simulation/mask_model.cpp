#include "simulation/mask_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <set>

#include "simulation/random.hpp"

namespace lidar_camera_recalibration::simulation {

namespace {

constexpr int kLargeRegion = 3000;  ///< [px]

bool showsShadows(PartKind kind) {
  return kind == PartKind::kRoad || kind == PartKind::kPavement || kind == PartKind::kFacade ||
         kind == PartKind::kGrass;
}

bool isBackdrop(PartKind kind) {
  switch (kind) {
    case PartKind::kSky:
    case PartKind::kFacade:
    case PartKind::kSideWall:
    case PartKind::kRoof:
    case PartKind::kWindow:
    case PartKind::kCrown:
    case PartKind::kGrass:
    case PartKind::kPavement:
      return true;
    default:
      return false;
  }
}

/// Part indices with the holes of crowns closed: a segmenter takes a tree with the gaps between its leaves.
cv::Mat withClosedCrowns(const cv::Mat& part, const std::vector<Part>& parts) {
  cv::Mat result = part.clone();
  std::map<int, cv::Rect> crowns;
  for (int v = 0; v < part.rows; ++v) {
    for (int u = 0; u < part.cols; ++u) {
      const int id = part.at<int>(v, u);
      if (parts[static_cast<std::size_t>(id)].kind == PartKind::kCrown) crowns[id] |= cv::Rect(u, v, 1, 1);
    }
  }
  const cv::Mat element = cv::getStructuringElement(cv::MORPH_ELLIPSE, {7, 7});
  for (const auto& [id, box] : crowns) {
    cv::Mat crown = part(box) == id, closed;
    cv::morphologyEx(crown, closed, cv::MORPH_CLOSE, element, {-1, -1}, 1, cv::BORDER_CONSTANT,
                     cv::Scalar(0));
    cv::morphologyEx(closed, closed, cv::MORPH_OPEN, cv::getStructuringElement(cv::MORPH_ELLIPSE, {3, 3}));
    for (int v = 0; v < box.height; ++v) {
      for (int u = 0; u < box.width; ++u) {
        int& label = result.at<int>(box.y + v, box.x + u);
        if (closed.at<std::uint8_t>(v, u) && isBackdrop(parts[static_cast<std::size_t>(label)].kind))
          label = id;
      }
    }
  }
  return result;
}

struct Region {
  int label = 0;  ///< of the image it was taken from
  int area = 0;   ///< [px]
  cv::Rect box;
};

/// Connected areas of equal label (4-neighbours), numbered from 0 in reading order.
std::vector<Region> connectedRegions(const cv::Mat& labels, cv::Mat& region_of_pixel) {
  region_of_pixel = cv::Mat(labels.size(), CV_32SC1, cv::Scalar(-1));
  std::vector<Region> regions;
  std::vector<cv::Point> stack;
  for (int v = 0; v < labels.rows; ++v) {
    for (int u = 0; u < labels.cols; ++u) {
      if (region_of_pixel.at<int>(v, u) >= 0) continue;
      const int index = static_cast<int>(regions.size()), label = labels.at<int>(v, u);
      Region region{label, 0, {}};
      int left = u, right = u, top = v, bottom = v;
      region_of_pixel.at<int>(v, u) = index;
      stack.assign(1, {u, v});
      while (!stack.empty()) {
        const cv::Point p = stack.back();
        stack.pop_back();
        ++region.area;
        left = std::min(left, p.x), right = std::max(right, p.x), top = std::min(top, p.y),
        bottom = std::max(bottom, p.y);
        for (const cv::Point q :
             {p + cv::Point(1, 0), p - cv::Point(1, 0), p + cv::Point(0, 1), p - cv::Point(0, 1)}) {
          if (q.x < 0 || q.y < 0 || q.x >= labels.cols || q.y >= labels.rows) continue;
          if (region_of_pixel.at<int>(q) >= 0 || labels.at<int>(q) != label) continue;
          region_of_pixel.at<int>(q) = index;
          stack.push_back(q);
        }
      }
      region.box = {left, top, right - left + 1, bottom - top + 1};
      regions.push_back(region);
    }
  }
  return regions;
}

/// Smooth Gaussian noise of the given standard deviation.
cv::Mat smoothField(const cv::Size& size, double smoothness, double sigma, Random& random) {
  cv::Mat noise(size, CV_32FC1);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) noise.at<float>(v, u) = static_cast<float>(random.gaussian(1.0));
  }
  cv::GaussianBlur(noise, noise, {0, 0}, smoothness, smoothness, cv::BORDER_REFLECT);
  cv::Scalar mean, deviation;
  cv::meanStdDev(noise, mean, deviation);
  return noise * (sigma / std::max(deviation[0], 1e-9));
}

/// Shakes the borders of a label image.
cv::Mat displaced(const cv::Mat& labels, const MaskConfig& config, Random& random) {
  const cv::Mat dx = smoothField(labels.size(), config.border_smoothness, config.border_sigma, random);
  const cv::Mat dy = smoothField(labels.size(), config.border_smoothness, config.border_sigma, random);
  cv::Mat result(labels.size(), CV_32SC1);
  for (int v = 0; v < labels.rows; ++v) {
    for (int u = 0; u < labels.cols; ++u) {
      const int from_u =
          std::clamp(static_cast<int>(std::lround(u + dx.at<float>(v, u))), 0, labels.cols - 1);
      const int from_v =
          std::clamp(static_cast<int>(std::lround(v + dy.at<float>(v, u))), 0, labels.rows - 1);
      result.at<int>(v, u) = labels.at<int>(from_v, from_u);
    }
  }
  return result;
}

/// Grows from exact regions to what a segmenter would give, as one label image.
class Segmentation {
 public:
  Segmentation(const cv::Mat& labels, const MaskConfig& config, int max_masks, Random& random)
      : config_(config), max_masks_(max_masks), random_(random) {
    regions_ = connectedRegions(labels, of_pixel_);
    mask_.resize(regions_.size());
    std::iota(mask_.begin(), mask_.end(), 0);
    joinParts();
    joinNeighbours();
    dropSmall();
    split();
    leaveOut();
  }

  /// Mask number of each pixel, 0 = none; numbers from 1.
  cv::Mat labels() const { return of_pixel_; }

 private:
  bool small(std::size_t region) const { return regions_[region].area < config_.min_region; }

  /// Pieces of one part that something in front cuts apart become one mask in half of the cases.
  void joinParts() {
    std::map<int, int> first;
    for (std::size_t i = 0; i < regions_.size(); ++i) {
      if (small(i)) continue;
      const auto [entry, is_first] = first.emplace(regions_[i].label, static_cast<int>(i));
      if (!is_first && random_.chance(0.5)) mask_[i] = mask_[static_cast<std::size_t>(entry->second)];
    }
  }

  /// Under-segmentation: a region is taken together with the neighbour of the longest common border.
  void joinNeighbours() {
    std::vector<char> chosen(regions_.size());
    for (std::size_t i = 0; i < regions_.size(); ++i) {
      chosen[i] = !small(i) && regions_[i].area < 2 * kLargeRegion && random_.chance(config_.merge);
    }
    std::map<std::pair<int, int>, int> border;  // (chosen region, neighbour): common length
    const auto count = [&](int a, int b) {
      if (a == b) return;
      if (chosen[static_cast<std::size_t>(a)]) ++border[{a, b}];
      if (chosen[static_cast<std::size_t>(b)]) ++border[{b, a}];
    };
    for (int v = 0; v < of_pixel_.rows; ++v) {
      for (int u = 0; u < of_pixel_.cols; ++u) {
        if (u > 0) count(of_pixel_.at<int>(v, u - 1), of_pixel_.at<int>(v, u));
        if (v > 0) count(of_pixel_.at<int>(v - 1, u), of_pixel_.at<int>(v, u));
      }
    }
    std::map<int, std::pair<int, int>> longest;  // region: (length, neighbour)
    for (const auto& [pair, length] : border) {
      const auto neighbour = static_cast<std::size_t>(pair.second);
      if (small(neighbour) || regions_[neighbour].area > 2 * kLargeRegion) continue;
      auto& best = longest[pair.first];
      best = std::max(best, {length, pair.second});
    }
    for (const auto& [region, best] : longest) {
      mask_[static_cast<std::size_t>(region)] = mask_[static_cast<std::size_t>(best.second)];
    }
  }

  /// Rewrites of_pixel_ from regions to masks without the small ones.
  void dropSmall() {
    std::map<int, int> number;
    for (std::size_t i = 0; i < regions_.size(); ++i) {
      if (!small(i)) number.emplace(mask_[i], 0);
    }
    for (auto& [mask, value] : number) value = ++count_;
    area_.assign(static_cast<std::size_t>(count_) + 1, 0);
    for (int v = 0; v < of_pixel_.rows; ++v) {
      for (int u = 0; u < of_pixel_.cols; ++u) {
        int& label = of_pixel_.at<int>(v, u);
        const auto region = static_cast<std::size_t>(label);
        label = small(region) ? 0 : number.at(mask_[region]);
        ++area_[static_cast<std::size_t>(label)];
      }
    }
  }

  /// Over-segmentation without a visible reason: nearest of a few seeds.
  void split() {
    const int before = count_;
    for (int mask = 1; mask <= before; ++mask) {
      if (area_[static_cast<std::size_t>(mask)] > kLargeRegion && random_.chance(config_.split))
        splitMask(mask);
    }
    while (count_ < config_.min_masks) {
      const auto largest = std::max_element(area_.begin() + 1, area_.end());
      if (area_.size() < 2 || *largest < 4 * config_.min_region) break;
      splitMask(static_cast<int>(largest - area_.begin()));
    }
  }

  void splitMask(int mask) {
    std::vector<cv::Point> pixels;
    for (int v = 0; v < of_pixel_.rows; ++v) {
      for (int u = 0; u < of_pixel_.cols; ++u) {
        if (of_pixel_.at<int>(v, u) == mask) pixels.emplace_back(u, v);
      }
    }
    const cv::Point a =
        pixels[static_cast<std::size_t>(random_.integer(0, static_cast<int>(pixels.size()) - 1))];
    const cv::Point b =
        pixels[static_cast<std::size_t>(random_.integer(0, static_cast<int>(pixels.size()) - 1))];
    ++count_;
    area_.push_back(0);
    for (const cv::Point& p : pixels) {
      const cv::Point to_a = p - a, to_b = p - b;
      if (to_b.dot(to_b) >= to_a.dot(to_a)) continue;
      of_pixel_.at<int>(p) = count_;
      --area_[static_cast<std::size_t>(mask)];
      ++area_.back();
    }
  }

  /// Too small after the split, above the limit, or simply missed; large masks are missed more rarely.
  void leaveOut() {
    std::vector<int> order(static_cast<std::size_t>(count_));
    std::iota(order.begin(), order.end(), 1);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
      return area_[static_cast<std::size_t>(a)] > area_[static_cast<std::size_t>(b)];
    });
    std::vector<int> renumbered(static_cast<std::size_t>(count_) + 1, 0);
    int kept = 0;
    for (const int mask : order) {
      const int area = area_[static_cast<std::size_t>(mask)];
      const double chance = area > of_pixel_.size().area() / 25 ? 0.6 * config_.missing : config_.missing;
      if (area < config_.min_region || kept >= max_masks_ || random_.chance(chance)) continue;
      renumbered[static_cast<std::size_t>(mask)] = ++kept;
    }
    of_pixel_.forEach<int>(
        [&](int& label, const int*) { label = renumbered[static_cast<std::size_t>(label)]; });
    count_ = kept;
  }

  const MaskConfig& config_;
  int max_masks_;
  Random& random_;
  cv::Mat of_pixel_;
  std::vector<Region> regions_;
  std::vector<int> mask_;  ///< of each region
  std::vector<int> area_;  ///< of each mask [px]
  int count_ = 0;
};

/// Some parts fall apart where a shadow ends.
cv::Mat withShadows(const cv::Mat& part, const cv::Mat& shadow, const std::vector<Part>& parts,
                    Random& random) {
  std::vector<char> divided(parts.size());
  for (std::size_t i = 0; i < parts.size(); ++i)
    divided[i] = showsShadows(parts[i].kind) && random.chance(0.6);
  cv::Mat smooth_shadow;
  cv::medianBlur(shadow, smooth_shadow, 9);
  cv::Mat result = part * 2;
  for (int v = 0; v < part.rows; ++v) {
    for (int u = 0; u < part.cols; ++u) {
      if (divided[static_cast<std::size_t>(part.at<int>(v, u))] && smooth_shadow.at<std::uint8_t>(v, u))
        ++result.at<int>(v, u);
    }
  }
  return result;
}

/// Objects of several visible parts as one label each, 0 = none.
cv::Mat wholeThings(const cv::Mat& part, const std::vector<Part>& parts, const MaskConfig& config,
                    Random& random) {
  std::map<int, std::map<int, int>> area_of_part;  // object: part: pixels
  for (int v = 0; v < part.rows; ++v) {
    for (int u = 0; u < part.cols; ++u) {
      const int id = part.at<int>(v, u), object = parts[static_cast<std::size_t>(id)].object;
      if (object > 0) ++area_of_part[object][id];
    }
  }
  std::set<int> chosen;
  for (const auto& [object, areas] : area_of_part) {
    int total = 0, visible = 0;
    for (const auto& entry : areas) {
      total += entry.second;
      visible += entry.second >= config.min_region / 4;
    }
    if (total >= 2 * config.min_region && visible >= 2 && random.chance(config.whole)) chosen.insert(object);
  }
  cv::Mat result(part.size(), CV_32SC1);
  for (int v = 0; v < part.rows; ++v) {
    for (int u = 0; u < part.cols; ++u) {
      const int object = parts[static_cast<std::size_t>(part.at<int>(v, u))].object;
      result.at<int>(v, u) = chosen.count(object) ? object : 0;
    }
  }
  return result;
}

/// Leaves a thin gap along some stretches of the borders, as segmenters do.
void openGaps(cv::Mat& labels, Random& random) {
  const cv::Mat where = smoothField(labels.size(), 12.0, 1.0, random);
  const cv::Mat before = labels.clone();
  for (int v = 0; v + 1 < labels.rows; ++v) {
    for (int u = 0; u + 1 < labels.cols; ++u) {
      const int here = before.at<int>(v, u);
      const bool border = before.at<int>(v, u + 1) != here || before.at<int>(v + 1, u) != here;
      if (border && where.at<float>(v, u) > 0.3F) labels.at<int>(v, u) = 0;
    }
  }
}

/// Masks that the displacement has made too small go; the others get random ids that no mask of another layer
/// has.
void finish(cv::Mat& labels, int min_region, std::set<int>& used, Random& random) {
  std::map<int, int> area, id;
  for (int v = 0; v < labels.rows; ++v) {
    for (int u = 0; u < labels.cols; ++u) ++area[labels.at<int>(v, u)];
  }
  for (const auto& [label, pixels] : area) {
    int& value = id[label];
    if (label == 0 || pixels < min_region) continue;
    do {
      value = random.integer(1, 65535);
    } while (!used.insert(value).second);
  }
  labels.forEach<int>([&](int& label, const int*) { label = id.at(label); });
}

}  // namespace

std::vector<cv::Mat> simulateMasks(const Picture& picture, const std::vector<Part>& parts,
                                   const MaskConfig& config, std::uint64_t seed) {
  Random random(seed, 7);
  const cv::Mat closed = withClosedCrowns(picture.part, parts);
  std::set<int> used;
  cv::Mat wholes = displaced(wholeThings(closed, parts, config, random), config, random);
  finish(wholes, 2 * config.min_region, used, random);
  const int limit = random.integer(3 * config.max_masks / 4, config.max_masks);
  const int max_pieces = limit - static_cast<int>(used.size());
  const Segmentation segmentation(withShadows(closed, picture.shadow, parts, random), config, max_pieces,
                                  random);
  cv::Mat pieces = displaced(segmentation.labels(), config, random);
  openGaps(pieces, random);
  finish(pieces, config.min_region, used, random);
  return {pieces, wholes};
}

}  // namespace lidar_camera_recalibration::simulation

#include "frame_synchroniser.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <tuple>

namespace lidar_camera_recalibration {

namespace {

// Some drivers stamp CameraInfo a little later than the image.
constexpr std::int64_t kInfoTolerance = 1'000'000;  // [ns]
// Masks of an unknown image are given up when images so much newer have come.
constexpr std::int64_t kMaxDisorder = 1'000'000'000;  // [ns]
// The newest pairs that thinning leaves alone: their masks are still to be expected.
constexpr std::ptrdiff_t kNewestKept = 2;
// The segmenter may have got an image more or less than we have: one to each side at 10 Hz.
constexpr std::int64_t kAwaitedMargin = 150'000'000;  // [ns]
constexpr std::size_t kMaxAwaited = 16;

// Integers, because the difference of two ros::Time throws if a bad stamp makes it too large.
template <class Message>
std::int64_t stampOf(const Message& message) {
  return static_cast<std::int64_t>(message->header.stamp.toNSec());
}

std::int64_t nanoseconds(double seconds) { return static_cast<std::int64_t>(std::llround(seconds * 1e9)); }

std::size_t bytesOf(const sensor_msgs::ImageConstPtr& image) {
  return image ? sizeof(*image) + image->data.size() : 0;
}
std::size_t bytesOf(const sensor_msgs::PointCloud2ConstPtr& cloud) {
  return cloud ? sizeof(*cloud) + cloud->data.size() + cloud->fields.size() * sizeof(sensor_msgs::PointField)
               : 0;
}
std::size_t bytesOf(const sensor_msgs::CameraInfoConstPtr& info) {
  return info ? sizeof(*info) + info->D.size() * sizeof(double) : 0;
}
std::size_t bytesOf(const FrameMessages& frame) {
  return bytesOf(frame.image) + bytesOf(frame.info) + bytesOf(frame.cloud) + bytesOf(frame.masks);
}

template <class Messages>
bool holdsStamp(const Messages& messages, std::int64_t stamp) {
  return std::any_of(messages.begin(), messages.end(),
                     [&](const auto& message) { return stampOf(message) == stamp; });
}

}  // namespace

FrameSynchroniser::FrameSynchroniser(const SynchroniserConfig& config) : config_(config) {}

void FrameSynchroniser::addImage(const sensor_msgs::ImageConstPtr& image) {
  if (!image) return;
  const Stamp stamp = stampOf(image);
  if (holdsImage(stamp)) {
    ++counts_.unmatched;
    return;
  }
  WaitingImage waiting{image, nullptr};
  const auto gap = [&](const auto& info) { return std::abs(stampOf(info) - stamp); };
  const auto nearest = std::min_element(infos_.begin(), infos_.end(),
                                        [&](const auto& a, const auto& b) { return gap(a) < gap(b); });
  if (nearest != infos_.end() && gap(*nearest) <= kInfoTolerance) {
    waiting.info = *nearest;
    infos_.erase(nearest);
  }
  images_.push_back(waiting);
  second_last_image_ = last_image_;
  last_image_ = stamp;
  settle();
}

void FrameSynchroniser::addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) {
  if (!info) return;
  const Stamp stamp = stampOf(info);
  if (holdsStamp(infos_, stamp)) {
    ++counts_.unused;
    return;
  }
  WaitingImage* nearest = nullptr;
  Stamp smallest_gap = kInfoTolerance;
  for (WaitingImage& waiting : images_) {
    const Stamp gap = std::abs(stampOf(waiting.image) - stamp);
    if (waiting.info || gap > smallest_gap) continue;
    nearest = &waiting;
    smallest_gap = gap;
  }
  if (nearest != nullptr) {
    nearest->info = info;
  } else {
    infos_.push_back(info);
  }
  settle();
}

void FrameSynchroniser::addCloud(const sensor_msgs::PointCloud2ConstPtr& cloud) {
  if (!cloud) return;
  if (holdsStamp(clouds_, stampOf(cloud))) {
    ++counts_.unused;
    return;
  }
  clouds_.push_back(cloud);
  settle();
}

void FrameSynchroniser::addMasks(const sensor_msgs::ImageConstPtr& masks) {
  if (!masks) return;
  const Stamp stamp = stampOf(masks);
  noteMasks(stamp);
  const auto pair = pairs_.find(stamp);
  if (pair != pairs_.end()) {
    pair->second.masks = masks;
    complete_.insert(pairs_.extract(pair));
  } else if (complete_.count(stamp) > 0 || holdsStamp(masks_, stamp)) {
    ++counts_.unknown_masks;
  } else {
    masks_.push_back(masks);
  }
  settle();
}

std::optional<FrameMessages> FrameSynchroniser::next() {
  if (complete_.empty()) return std::nullopt;
  FrameMessages frame = std::move(complete_.begin()->second);
  complete_.erase(complete_.begin());
  return frame;
}

void FrameSynchroniser::flush() {
  for (auto waiting = matches(true); !waiting.empty(); waiting = matches(true)) makePair(waiting.front());
  settle();
}

void FrameSynchroniser::clear() {
  for (const WaitingImage& waiting : images_) counts_.unused += waiting.info ? 1 : 0;
  counts_.unused += infos_.size() + clouds_.size();
  counts_.unknown_masks += masks_.size();
  counts_.forgotten += images();
  const SynchroniserCounts counts = counts_;
  *this = FrameSynchroniser(config_);
  counts_ = counts;
}

std::size_t FrameSynchroniser::bytes() const {
  std::size_t sum = 0;
  for (const WaitingImage& waiting : images_) sum += bytesOf(waiting.image) + bytesOf(waiting.info);
  for (const auto& info : infos_) sum += bytesOf(info);
  for (const auto& cloud : clouds_) sum += bytesOf(cloud);
  for (const auto& masks : masks_) sum += bytesOf(masks);
  for (const auto& [stamp, frame] : pairs_) sum += bytesOf(frame);
  for (const auto& [stamp, frame] : complete_) sum += bytesOf(frame);
  return sum;
}

bool FrameSynchroniser::holdsImage(Stamp stamp) const {
  return pairs_.count(stamp) > 0 || complete_.count(stamp) > 0 ||
         std::any_of(images_.begin(), images_.end(),
                     [&](const WaitingImage& waiting) { return stampOf(waiting.image) == stamp; });
}

// Nearest first, each image and each cloud at most once: nobody gets a cloud that another image is nearer to.
// Images whose info has not come yet reserve their cloud, unless only_with_info.
std::vector<FrameSynchroniser::Match> FrameSynchroniser::matches(bool only_with_info) const {
  const Stamp max_gap = nanoseconds(config_.max_stamp_gap);
  std::vector<std::tuple<Stamp, Stamp, std::size_t, std::size_t>> candidates;  // gap, image stamp, indices
  for (std::size_t i = 0; i < images_.size(); ++i) {
    if (only_with_info && !images_[i].info) continue;
    const Stamp stamp = stampOf(images_[i].image);
    for (std::size_t c = 0; c < clouds_.size(); ++c) {
      const Stamp gap = std::abs(stampOf(clouds_[c]) - stamp);
      if (gap <= max_gap) candidates.emplace_back(gap, stamp, i, c);
    }
  }
  std::sort(candidates.begin(), candidates.end());
  std::vector<bool> image_taken(images_.size()), cloud_taken(clouds_.size());
  std::vector<Match> result;
  for (const auto& [gap, stamp, i, c] : candidates) {
    if (image_taken[i] || cloud_taken[c]) continue;
    image_taken[i] = cloud_taken[c] = true;
    result.emplace_back(i, c);
  }
  return result;
}

// Clouds come in the order of their stamps, so nothing nearer follows once one at or after the image is
// there.
bool FrameSynchroniser::decided(Stamp image_stamp) const {
  return (last_pair_ && *last_pair_ > image_stamp) ||
         std::any_of(clouds_.begin(), clouds_.end(),
                     [&](const auto& cloud) { return stampOf(cloud) >= image_stamp; });
}

void FrameSynchroniser::makePair(const Match& match) {
  const WaitingImage waiting = images_[match.first];
  const Stamp stamp = stampOf(waiting.image);
  FrameMessages frame{waiting.image, waiting.info, clouds_[match.second], nullptr};
  images_.erase(images_.begin() + static_cast<std::ptrdiff_t>(match.first));
  clouds_.erase(clouds_.begin() + static_cast<std::ptrdiff_t>(match.second));
  last_pair_ = stamp;

  const auto masks = std::find_if(masks_.begin(), masks_.end(),
                                  [&](const auto& candidate) { return stampOf(candidate) == stamp; });
  if (masks == masks_.end()) {
    pairs_.emplace(stamp, std::move(frame));
  } else {
    frame.masks = *masks;
    masks_.erase(masks);
    complete_.emplace(stamp, std::move(frame));
  }
}

void FrameSynchroniser::pairDecided() {
  for (bool again = true; again;) {
    const std::vector<Match> all = matches(false);
    const auto match = std::find_if(all.begin(), all.end(), [&](const Match& candidate) {
      const WaitingImage& waiting = images_[candidate.first];
      return waiting.info && decided(stampOf(waiting.image));
    });
    again = match != all.end();
    if (again) makePair(*match);
  }
}

void FrameSynchroniser::giveUpOldestImage() {
  for (const Match& match : matches(true)) {
    if (match.first == 0) return makePair(match);
  }
  dropOldestImage(counts_.unmatched);
}

void FrameSynchroniser::giveUpOldestCloud() {
  for (const Match& match : matches(true)) {
    if (match.second == 0) return makePair(match);
  }
  dropOldestCloud();
}

void FrameSynchroniser::settle() {
  pairDecided();
  while (images_.size() > config_.max_unmatched) giveUpOldestImage();
  while (clouds_.size() > config_.max_unmatched) giveUpOldestCloud();
  for (; infos_.size() > config_.max_unmatched; infos_.pop_front()) ++counts_.unused;
  for (; masks_.size() > config_.max_unmatched; masks_.pop_front()) ++counts_.unknown_masks;
  expire();
  while (bytes() > config_.max_bytes) freeMemory();
}

void FrameSynchroniser::expire() {
  if (!last_image_) return;
  const Stamp now = std::min(*last_image_, second_last_image_.value_or(*last_image_));
  while (!pairs_.empty() && now - pairs_.begin()->first > nanoseconds(config_.mask_timeout)) {
    pairs_.erase(pairs_.begin());
    ++counts_.no_masks;
  }
  for (auto masks = masks_.begin(); masks != masks_.end();) {
    const bool hopeless = now - stampOf(*masks) > kMaxDisorder && !holdsImage(stampOf(*masks));
    counts_.unknown_masks += hopeless ? 1 : 0;
    masks = hopeless ? masks_.erase(masks) : std::next(masks);
  }
}

// Masks come in the order of their images, from a segmenter that works on one image or on several at once.
void FrameSynchroniser::noteMasks(Stamp stamp) {
  while (!awaited_.empty() && awaited_.front() <= stamp + kAwaitedMargin) awaited_.pop_front();
  if (!last_image_) return;
  awaited_.push_back(*last_image_);
  if (awaited_.size() > kMaxAwaited) awaited_.pop_front();
}

// That masks of this image come: 2 = probably, 1 = possibly, 0 = nothing speaks for it.
int FrameSynchroniser::expectation(Stamp stamp) const {
  int result = 0;
  for (const Stamp awaited : awaited_) {
    if (awaited == stamp) return 2;
    if (std::abs(awaited - stamp) <= kAwaitedMargin) result = 1;
  }
  return result;
}

// The pair between whose neighbours the least is lost: the ratio of their ages, which spaces the remaining
// pairs logarithmically in age. The oldest and the newest few stay.
std::map<FrameSynchroniser::Stamp, FrameMessages>::iterator FrameSynchroniser::mostRedundantPair() {
  const auto size = static_cast<std::ptrdiff_t>(pairs_.size());
  if (size < kNewestKept + 2) return pairs_.begin();
  const Stamp newest = pairs_.rbegin()->first;
  auto best = pairs_.begin();
  std::pair<int, double> best_worth;
  const auto end = std::prev(pairs_.end(), kNewestKept);
  for (auto pair = std::next(pairs_.begin()); pair != end; ++pair) {
    const double ratio = static_cast<double>(newest - std::prev(pair)->first) /
                         static_cast<double>(newest - std::next(pair)->first);
    const std::pair<int, double> worth(expectation(pair->first), ratio);
    if (best != pairs_.begin() && worth >= best_worth) continue;
    best = pair;
    best_worth = worth;
  }
  return best;
}

void FrameSynchroniser::dropOldestImage(std::uint64_t& counter) {
  ++counter;
  counts_.unused += images_.front().info ? 1 : 0;
  images_.pop_front();
}

void FrameSynchroniser::dropOldestCloud() {
  ++counts_.unused;
  clouds_.pop_front();
}

// Least loss first: what a later pair has overtaken hardly finds a partner any more.
void FrameSynchroniser::freeMemory() {
  const auto overtaken = [&](const auto& message) { return last_pair_ && stampOf(message) < *last_pair_; };
  if (!images_.empty() && overtaken(images_.front().image)) {
    dropOldestImage(counts_.unmatched);
  } else if (!clouds_.empty() && overtaken(clouds_.front())) {
    dropOldestCloud();
  } else if (pairs_.size() > 1) {
    pairs_.erase(mostRedundantPair());
    ++counts_.memory;
  } else if (!masks_.empty()) {
    masks_.pop_front();
    ++counts_.unknown_masks;
  } else if (images_.size() > 1) {
    dropOldestImage(counts_.memory);
  } else if (clouds_.size() > 1) {
    dropOldestCloud();
  } else if (!complete_.empty()) {
    complete_.erase(complete_.begin());
    ++counts_.memory;
  } else if (!pairs_.empty()) {
    pairs_.erase(pairs_.begin());
    ++counts_.memory;
  } else {  // one message alone is larger than the bound
    if (!images_.empty()) dropOldestImage(counts_.memory);
    clear();
  }
}

}  // namespace lidar_camera_recalibration

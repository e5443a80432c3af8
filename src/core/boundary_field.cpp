#include "boundary_field.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "multiversion.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr float kClosenessScale = 127.0f;

double widthInPixels(std::size_t level, double fx) { return fx * kBoundaryWidths[level] * kDegree; }

/// A border of so many sigma needs no finer pixels.
int shrinkFactor(double sigma) { return std::clamp(static_cast<int>(sigma / 2.5), 1, 4); }

// A blur by a wide Gaussian, made on a smaller image.
cv::Mat wideBlur(const cv::Mat& image, double sigma) {
  const double shrink = std::max(1.0, std::floor(sigma / 4.0));
  const cv::Size small(std::max(1, cvRound(image.cols / shrink)), std::max(1, cvRound(image.rows / shrink)));
  cv::Mat blurred;
  cv::resize(image, blurred, small, 0.0, 0.0, cv::INTER_AREA);
  cv::GaussianBlur(blurred, blurred, cv::Size(), sigma / shrink);
  cv::resize(blurred, blurred, image.size(), 0.0, 0.0, cv::INTER_LINEAR);
  return blurred;
}

cv::Mat closenessImage(const cv::Mat& distance, double sigma) {
  const int shrink = shrinkFactor(sigma);
  cv::Mat near;
  if (shrink > 1) {
    // Whole blocks: then the places of the small image's pixels are known exactly.
    const cv::Size small(distance.cols / shrink, distance.rows / shrink);
    cv::resize(distance(cv::Rect(0, 0, small.width * shrink, small.height * shrink)), near, small, 0.0, 0.0,
               cv::INTER_AREA);
  } else {
    near = distance.clone();
  }
  cv::multiply(near, near, near, -0.5 / (sigma * sigma));
  cv::exp(near, near);
  near -= wideBlur(near, 5.0 * sigma / shrink);
  cv::Mat stored;
  near.convertTo(stored, CV_8SC1, kClosenessScale);
  return stored;
}

/// For bilinear interpolation of a block.
struct Corners {
  Block<std::int32_t> index;  ///< of the upper left one
  Block<float> a, b;          ///< how far to the right and down
  Block<float> scale;         ///< of the result; 0 outside of the image
};

/// To 0..most, also what is not a number.
inline float clamped(float value, float most) {
  const float positive = value > 0.0f ? value : 0.0f;
  return positive < most ? positive : most;
}

LCR_MULTIVERSION void findCorners(const float* u, const float* v, std::size_t count, float shrink,
                                  const cv::Size size, Corners& __restrict corners) {
  const auto right = static_cast<float>(size.width - 1), bottom = static_cast<float>(size.height - 1);
  const float last_u = std::nextafter(right, 0.0f), last_v = std::nextafter(bottom, 0.0f);
  const float scale = 1.0f / shrink;
  for (std::size_t i = 0; i < count; ++i) {
    const float pu = (u[i] + 0.5f) * scale - 0.5f, pv = (v[i] + 0.5f) * scale - 0.5f;
    const bool inside = (pu >= 0.0f) & (pv >= 0.0f) & (pu < right) & (pv < bottom);
    corners.scale[i] = inside ? 1.0f / kClosenessScale : 0.0f;
    const float safe_u = clamped(pu, last_u), safe_v = clamped(pv, last_v);
    const auto left = static_cast<std::int32_t>(safe_u), top = static_cast<std::int32_t>(safe_v);
    corners.index[i] = top * size.width + left;
    corners.a[i] = safe_u - static_cast<float>(left);
    corners.b[i] = safe_v - static_cast<float>(top);
  }
}

/// @param values  four signed bytes each: upper left, upper right, lower left, lower right
LCR_MULTIVERSION void interpolate(const std::uint32_t* values, const Corners& corners, std::size_t count,
                                  float* __restrict result) {
  const auto byte = [](std::uint32_t value, int shift) {
    return static_cast<float>(static_cast<std::int32_t>(value << shift) >> 24);
  };
  for (std::size_t i = 0; i < count; ++i) {
    const float upper_left = byte(values[i], 24), upper_right = byte(values[i], 16);
    const float lower_left = byte(values[i], 8), lower_right = byte(values[i], 0);
    const float upper = upper_left + corners.a[i] * (upper_right - upper_left);
    const float lower = lower_left + corners.a[i] * (lower_right - lower_left);
    result[i] = (upper + corners.b[i] * (lower - upper)) * corners.scale[i];
  }
}

/// The nearest pixel of each, as index; -1 outside of the image.
LCR_MULTIVERSION void findPixels(const float* u, const float* v, std::size_t count, const cv::Size size,
                                 std::int32_t* __restrict result) {
  const auto right = static_cast<float>(size.width - 1), bottom = static_cast<float>(size.height - 1);
  for (std::size_t i = 0; i < count; ++i) {
    const bool inside = (u[i] >= 0.0f) & (v[i] >= 0.0f) & (u[i] <= right) & (v[i] <= bottom);
    const auto column = static_cast<std::int32_t>(inside ? u[i] + 0.5f : 0.0f);
    const auto row = static_cast<std::int32_t>(inside ? v[i] + 0.5f : 0.0f);
    result[i] = inside ? row * size.width + column : -1;
  }
}

}  // namespace

BoundaryField::BoundaryField(const std::vector<Border>& borders, const cv::Size& size, double fx)
    : size_(size) {
  for (std::size_t level = 0; level < kScoreLevels; ++level) {
    shrink_[level] = static_cast<float>(shrinkFactor(widthInPixels(level, fx)));
  }
  std::vector<Border> upright, level;
  for (const Border& border : borders) {
    if (border.upright) upright.push_back(border);
    if (border.level) level.push_back(border);
  }
  channels_[kUpright] = makeChannel(std::move(upright), size, fx);
  channels_[kLevel] = makeChannel(std::move(level), size, fx);
}

BoundaryField::Channel BoundaryField::makeChannel(std::vector<Border> borders, const cv::Size& size,
                                                  double fx) {
  if (borders.empty()) return {};  // nothing to be drawn to
  cv::Mat no_border(size, CV_8UC1, cv::Scalar(255));
  for (const Border& border : borders) no_border.at<std::uint8_t>(border.pixel) = 0;
  cv::Mat distance, label;
  cv::distanceTransform(no_border, distance, label, cv::DIST_L2, cv::DIST_MASK_5, cv::DIST_LABEL_PIXEL);
  std::vector<int> border_of_label(borders.size() + 1, 0);
  for (std::size_t i = 0; i < borders.size(); ++i) {
    border_of_label[static_cast<std::size_t>(label.at<int>(borders[i].pixel))] = static_cast<int>(i);
  }
  for (int v = 0; v < size.height; ++v) {
    auto* const nearest = label.ptr<int>(v);
    auto* const from_nearest = distance.ptr<float>(v);
    for (int u = 0; u < size.width; ++u) {
      nearest[u] = border_of_label[static_cast<std::size_t>(nearest[u])];
      const Border& border = borders[static_cast<std::size_t>(nearest[u])];
      const float du = static_cast<float>(u) - border.u, dv = static_cast<float>(v) - border.v;
      from_nearest[u] = std::sqrt(du * du + dv * dv);
    }
  }
  Channel channel;
  if (borders.size() <= std::numeric_limits<std::uint16_t>::max()) {
    label.convertTo(channel.nearest, CV_16UC1);
  } else {
    channel.nearest = label;
  }
  for (std::size_t level = 0; level < kScoreLevels; ++level) {
    channel.closeness[level] = closenessImage(distance, widthInPixels(level, fx));
  }
  channel.lines.reserve(borders.size());
  for (const Border& border : borders) channel.lines.push_back({border.u, border.v, border.nu, border.nv});
  return channel;
}

void BoundaryField::closeness(Direction direction, std::size_t level, const PixelBlock& pixels,
                              std::size_t count, Block<float>& result) const {
  const cv::Mat& field = channels_[direction].closeness[level];
  if (field.cols < 2 || field.rows < 2) {
    std::fill_n(result.begin(), count, 0.0f);
    return;
  }
  Corners corners;
  findCorners(pixels.u.data(), pixels.v.data(), count, shrink_[level], field.size(), corners);
  const auto* data = field.ptr<std::uint8_t>();
  const auto stride = static_cast<std::size_t>(field.cols);
  Block<std::uint32_t> values;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* upper = data + corners.index[i];
    const std::uint8_t* lower = upper + stride;
    values[i] = std::uint32_t{upper[0]} | std::uint32_t{upper[1]} << 8 | std::uint32_t{lower[0]} << 16 |
                std::uint32_t{lower[1]} << 24;
  }
  interpolate(values.data(), corners, count, result.data());
}

void BoundaryField::nearest(Direction direction, const PixelBlock& pixels, std::size_t count,
                            Block<std::int32_t>& result) const {
  const cv::Mat& nearest = channels_[direction].nearest;
  if (nearest.empty()) {
    std::fill_n(result.begin(), count, -1);
    return;
  }
  findPixels(pixels.u.data(), pixels.v.data(), count, nearest.size(), result.data());
  const auto lookUp = [&](const auto* numbers) {
    for (std::size_t i = 0; i < count; ++i) {
      const bool inside = result[i] >= 0;
      const auto number = static_cast<std::int32_t>(numbers[inside ? result[i] : 0]);
      result[i] = inside ? number : -1;
    }
  };
  if (nearest.type() == CV_16UC1) {
    lookUp(nearest.ptr<std::uint16_t>());
  } else {
    lookUp(nearest.ptr<std::int32_t>());
  }
}

std::size_t BoundaryField::bytes() const {
  std::size_t sum = sizeof(BoundaryField);
  for (const Channel& channel : channels_) {
    sum += channel.lines.capacity() * sizeof(Line) + channel.nearest.total() * channel.nearest.elemSize();
    for (const cv::Mat& level : channel.closeness) sum += level.total() * level.elemSize();
  }
  return sum;
}

}  // namespace lidar_camera_recalibration

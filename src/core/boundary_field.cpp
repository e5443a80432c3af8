#include "boundary_field.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/extrinsic.hpp"

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
  channel.borders = std::move(borders);
  return channel;
}

float BoundaryField::closeness(Direction direction, std::size_t level, float u, float v) const {
  const cv::Mat& field = channels_[direction].closeness[level];
  const float shrink = shrink_[level];
  const float pu = (u + 0.5f) / shrink - 0.5f, pv = (v + 0.5f) / shrink - 0.5f;
  if (!(pu >= 0.0f && pv >= 0.0f && pu < static_cast<float>(field.cols - 1) &&
        pv < static_cast<float>(field.rows - 1))) {
    return 0.0f;
  }
  const int left = static_cast<int>(pu), top = static_cast<int>(pv);
  const float a = pu - static_cast<float>(left), b = pv - static_cast<float>(top);
  const auto* upper_row = field.ptr<std::int8_t>(top) + left;
  const auto* lower_row = field.ptr<std::int8_t>(top + 1) + left;
  const float upper = upper_row[0] + a * static_cast<float>(upper_row[1] - upper_row[0]);
  const float lower = lower_row[0] + a * static_cast<float>(lower_row[1] - lower_row[0]);
  return (upper + b * (lower - upper)) / kClosenessScale;
}

const Border* BoundaryField::nearest(Direction direction, float u, float v) const {
  const Channel& channel = channels_[direction];
  if (channel.borders.empty() || !(u >= 0.0f && v >= 0.0f && u <= static_cast<float>(size_.width - 1) &&
                                   v <= static_cast<float>(size_.height - 1))) {
    return nullptr;
  }
  const cv::Point pixel(static_cast<int>(u + 0.5f), static_cast<int>(v + 0.5f));
  const int index = channel.nearest.type() == CV_16UC1 ? channel.nearest.at<std::uint16_t>(pixel)
                                                       : channel.nearest.at<int>(pixel);
  return &channel.borders[static_cast<std::size_t>(index)];
}

std::size_t BoundaryField::bytes() const {
  std::size_t sum = sizeof(BoundaryField);
  for (const Channel& channel : channels_) {
    sum += channel.borders.capacity() * sizeof(Border) + channel.nearest.total() * channel.nearest.elemSize();
    for (const cv::Mat& level : channel.closeness) sum += level.total() * level.elemSize();
  }
  return sum;
}

}  // namespace lidar_camera_recalibration

#include "boundary_field.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr float kDistanceScale = 256.0f;  // of the stored distances: 0 to 255 px
constexpr float kClosenessScale = 127.0f;

// Borders, and how strongly the image changes along u and along v around each pixel.
struct Borders {
  cv::Mat pixels;              // CV_8UC1, 255 on borders
  cv::Mat change_u, change_v;  // CV_32FC1
};

// Both pixels at each change of the set of masks.
Borders maskBorders(const cv::Mat& sets) {
  Borders borders{cv::Mat::zeros(sets.size(), CV_8UC1), {}, {}};
  const int w = sets.cols, h = sets.rows;
  const auto changes = [&](const cv::Rect& here, const cv::Rect& there) {
    cv::Mat result = cv::Mat::zeros(sets.size(), CV_8UC1), differs = sets(here) != sets(there);
    cv::bitwise_or(result(here), differs, result(here));
    cv::bitwise_or(result(there), differs, result(there));
    cv::bitwise_or(borders.pixels, result, borders.pixels);
    result.convertTo(result, CV_32FC1);
    return result;
  };
  borders.change_u = changes({0, 0, w - 1, h}, {1, 0, w - 1, h});
  borders.change_v = changes({0, 0, w, h - 1}, {0, 1, w, h - 1});
  return borders;
}

Borders intensityEdges(const cv::Mat& ideal_image) {
  constexpr double kSigma = 1.0, kLow = 30.0, kHigh = 80.0;
  Borders edges;
  cv::Mat grey;
  cv::cvtColor(ideal_image, grey, cv::COLOR_BGR2GRAY);
  cv::GaussianBlur(grey, grey, cv::Size(), kSigma);
  cv::Canny(grey, edges.pixels, kLow, kHigh, 3, true);
  cv::Sobel(grey, edges.change_u, CV_32F, 1, 0);
  cv::Sobel(grey, edges.change_v, CV_32F, 0, 1);
  edges.change_u = edges.change_u.mul(edges.change_u);
  edges.change_v = edges.change_v.mul(edges.change_v);
  return edges;
}

cv::Mat distanceTo(const cv::Mat& pixels) {
  cv::Mat distance;
  cv::distanceTransform(pixels == 0, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  return distance;
}

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
  cv::Mat near;
  cv::multiply(distance, distance, near, -0.5 / (sigma * sigma));
  cv::exp(near, near);
  near -= wideBlur(near, 5.0 * sigma);
  cv::Mat stored;
  near.convertTo(stored, CV_8SC1, kClosenessScale);
  return stored;
}

// The four pixels around a place and their weights.
struct Bilinear {
  int u, v;
  float a, b;

  // Whether the place lies between pixels of the image
  bool set(const cv::Mat& image, float pu, float pv) {
    if (!(pu >= 0.0f && pv >= 0.0f && pu < static_cast<float>(image.cols - 1) &&
          pv < static_cast<float>(image.rows - 1))) {
      return false;
    }
    u = static_cast<int>(pu);
    v = static_cast<int>(pv);
    a = pu - static_cast<float>(u);
    b = pv - static_cast<float>(v);
    return true;
  }
};

}  // namespace

std::array<cv::Mat, BoundaryField::kDirections> maskBoundaries(const Frame& frame) {
  Borders borders = maskBorders(frame.masks.setOfPixel());
  if (!frame.image.empty()) {
    constexpr double kReach = 3.0;  // [px]
    const cv::Mat within = distanceTo(borders.pixels) <= kReach;
    borders = intensityEdges(frame.camera.distorted() ? frame.camera.toIdeal(frame.image, cv::INTER_LINEAR)
                                                      : frame.image);
    cv::bitwise_and(borders.pixels, within, borders.pixels);
  }
  // An upright border is one that is crossed along u.
  const cv::Size window(7, 7);
  cv::boxFilter(borders.change_u, borders.change_u, CV_32F, window);
  cv::boxFilter(borders.change_v, borders.change_v, CV_32F, window);
  std::array<cv::Mat, BoundaryField::kDirections> result;
  cv::bitwise_and(borders.pixels, borders.change_u >= borders.change_v, result[BoundaryField::kUpright]);
  cv::bitwise_and(borders.pixels, borders.change_u < borders.change_v, result[BoundaryField::kLevel]);
  return result;
}

BoundaryField::BoundaryField(const Frame& frame)
    : BoundaryField(maskBoundaries(frame), frame.camera.intrinsics().fx) {}

BoundaryField::BoundaryField(const std::array<cv::Mat, kDirections>& boundaries, double fx) {
  for (std::size_t d = 0; d < kDirections; ++d) {
    if (cv::countNonZero(boundaries[d]) == 0) continue;  // no field: nothing to be drawn to
    const cv::Mat distance = distanceTo(boundaries[d]);
    distance.convertTo(distance_[d], CV_16UC1, kDistanceScale);
    for (std::size_t level = 0; level < kBoundaryLevels; ++level) {
      closeness_[d][level] = closenessImage(distance, fx * kBoundaryWidths[level] * kDegree);
    }
  }
}

float BoundaryField::closeness(Direction direction, std::size_t level, float u, float v) const {
  const cv::Mat& field = closeness_[direction][level];
  Bilinear at;
  if (!at.set(field, u, v)) return 0.0f;
  const auto* top = field.ptr<std::int8_t>(at.v) + at.u;
  const auto* bottom = field.ptr<std::int8_t>(at.v + 1) + at.u;
  const float upper = top[0] + at.a * static_cast<float>(top[1] - top[0]);
  const float lower = bottom[0] + at.a * static_cast<float>(bottom[1] - bottom[0]);
  return (upper + at.b * (lower - upper)) / kClosenessScale;
}

BoundaryField::Distance BoundaryField::distance(Direction direction, float u, float v) const {
  const cv::Mat& field = distance_[direction];
  Bilinear at;
  if (!at.set(field, u, v)) return {};
  const auto* top = field.ptr<std::uint16_t>(at.v) + at.u;
  const auto* bottom = field.ptr<std::uint16_t>(at.v + 1) + at.u;
  const float top_du = static_cast<float>(top[1] - top[0]);
  const float bottom_du = static_cast<float>(bottom[1] - bottom[0]);
  const float upper = top[0] + at.a * top_du, lower = bottom[0] + at.a * bottom_du;
  return {(upper + at.b * (lower - upper)) / kDistanceScale,
          (top_du + at.b * (bottom_du - top_du)) / kDistanceScale, (lower - upper) / kDistanceScale, true};
}

}  // namespace lidar_camera_recalibration

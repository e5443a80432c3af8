#include "mask_borders.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace lidar_camera_recalibration {
namespace {

// The direction of a border is that of the changes in a window around it: a single pixel's is too rough.
constexpr int kDirectionWindow = 7;  // [px]
// Squared change along v to squared change along u, up to which a border counts as upright, or from which on
// as level. Rings cross borders down to some 15 deg from the horizontal, and such crossings tell the height
// best.
constexpr float kUprightUpTo = 10.0f, kLevelFrom = 0.5f;

constexpr double kReach = 2.0;  // how far a segmenter's borders are off, at most [px]
constexpr double kEdgeSigma = 1.0, kEdgeLow = 30.0, kEdgeHigh = 80.0;  // Canny: blur [px], gradients
constexpr double kPlaceSigma = 1.5;                                    // blur for the places of edges [px]

// How strongly something changes along u and along v around each pixel.
struct Changes {
  cv::Mat along_u, along_v;  // CV_32FC1
};

// Both pixels at each change of the set of masks.
struct SetChanges {
  cv::Mat pixels;  // CV_8UC1, 255 at changes
  Changes changes;
};

SetChanges changesOf(const cv::Mat& sets) {
  SetChanges result{cv::Mat::zeros(sets.size(), CV_8UC1), {}};
  const int w = sets.cols, h = sets.rows;
  const auto between = [&](const cv::Rect& here, const cv::Rect& there) {
    cv::Mat at = cv::Mat::zeros(sets.size(), CV_8UC1), differs = sets(here) != sets(there);
    cv::bitwise_or(at(here), differs, at(here));
    cv::bitwise_or(at(there), differs, at(there));
    cv::bitwise_or(result.pixels, at, result.pixels);
    at.convertTo(at, CV_32FC1);
    return at;
  };
  result.changes.along_u = between({0, 0, w - 1, h}, {1, 0, w - 1, h});
  result.changes.along_v = between({0, 0, w, h - 1}, {0, 1, w, h - 1});
  return result;
}

// The gradient of the blurred image, at each pixel that of the channel where it is strongest: many borders
// are between colours of the same brightness. CV_32FC1.
Changes gradientOf(const cv::Mat& image, double blur) {
  cv::Mat smooth, along_u, along_v, squares;
  cv::GaussianBlur(image, smooth, cv::Size(), blur);
  cv::Sobel(smooth, along_u, CV_32F, 1, 0);
  cv::Sobel(smooth, along_v, CV_32F, 0, 1);
  Changes result{cv::Mat(image.size(), CV_32FC1), cv::Mat(image.size(), CV_32FC1)};
  for (int v = 0; v < image.rows; ++v) {
    const auto* us = along_u.ptr<cv::Vec3f>(v);
    const auto* vs = along_v.ptr<cv::Vec3f>(v);
    for (int u = 0; u < image.cols; ++u) {
      int strongest = 0;
      float most = -1.0f;
      for (int c = 0; c < 3; ++c) {
        const float square = us[u][c] * us[u][c] + vs[u][c] * vs[u][c];
        if (square <= most) continue;
        most = square;
        strongest = c;
      }
      result.along_u.at<float>(v, u) = us[u][strongest];
      result.along_v.at<float>(v, u) = vs[u][strongest];
    }
  }
  return result;
}

// Between two masks: half a pixel from each, across the line between the middles of their pixels in a window.
class PlacesBetweenMasks {
 public:
  explicit PlacesBetweenMasks(const cv::Mat& sets) : sets_(sets) {}

  void operator()(Border& border) const {
    constexpr int kHalf = kDirectionWindow / 2;
    const cv::Rect window =
        cv::Rect(border.pixel.x - kHalf, border.pixel.y - kHalf, kDirectionWindow, kDirectionWindow) &
        cv::Rect(0, 0, sets_.cols, sets_.rows);
    const std::uint16_t own = sets_.at<std::uint16_t>(border.pixel);
    cv::Point2f sum[2];
    float count[2] = {};
    for (int v = window.y; v < window.y + window.height; ++v) {
      for (int u = window.x; u < window.x + window.width; ++u) {
        const bool other = sets_.at<std::uint16_t>(v, u) != own;
        sum[other] += cv::Point2f(static_cast<float>(u), static_cast<float>(v));
        ++count[other];
      }
    }
    const cv::Point2f across = sum[1] / count[1] - sum[0] / count[0];  // neither is 0 at a border
    const float length = std::hypot(across.x, across.y);
    if (length > 0.0f) {
      border.nu = across.x / length;
      border.nv = across.y / length;
    }
    const float half = 0.5f / std::max(std::abs(border.nu), std::abs(border.nv));
    border.u += half * border.nu;
    border.v += half * border.nv;
  }

 private:
  const cv::Mat& sets_;
};

// On an edge of the image: where the gradient is largest, by a parabola through it and its two neighbours
// across the edge.
class PlacesOnEdges {
 public:
  explicit PlacesOnEdges(const cv::Mat& image) {
    cv::Mat fine;  // than steps of 1: a parabola is laid through the gradient
    image.convertTo(fine, CV_32F);
    const Changes gradient = gradientOf(fine, kPlaceSigma);
    gradient_u_ = gradient.along_u;
    gradient_v_ = gradient.along_v;
    cv::magnitude(gradient_u_, gradient_v_, magnitude_);
  }

  void operator()(Border& border) const {
    const float here = magnitude_.at<float>(border.pixel);
    if (!(here > 0.0f)) return;
    border.nu = gradient_u_.at<float>(border.pixel) / here;
    border.nv = gradient_v_.at<float>(border.pixel) / here;
    const float before = magnitudeAt(border.u - border.nu, border.v - border.nv);
    const float after = magnitudeAt(border.u + border.nu, border.v + border.nv);
    const float curvature = before - 2.0f * here + after;
    if (!(curvature < 0.0f)) return;
    const float shift = std::clamp(0.5f * (before - after) / curvature, -1.0f, 1.0f);
    border.u += shift * border.nu;
    border.v += shift * border.nv;
  }

 private:
  float magnitudeAt(float u, float v) const {
    const int left = std::clamp(static_cast<int>(u), 0, magnitude_.cols - 2);
    const int top = std::clamp(static_cast<int>(v), 0, magnitude_.rows - 2);
    const float a = std::clamp(u - static_cast<float>(left), 0.0f, 1.0f);
    const float b = std::clamp(v - static_cast<float>(top), 0.0f, 1.0f);
    const float* upper = magnitude_.ptr<float>(top) + left;
    const float* lower = magnitude_.ptr<float>(top + 1) + left;
    return (1.0f - b) * (upper[0] + a * (upper[1] - upper[0])) + b * (lower[0] + a * (lower[1] - lower[0]));
  }

  cv::Mat gradient_u_, gradient_v_, magnitude_;  // CV_32FC1
};

template <typename Place>
std::vector<Border> collect(const cv::Mat& pixels, Changes changes, const Place& place) {
  const cv::Size window(kDirectionWindow, kDirectionWindow);
  cv::boxFilter(changes.along_u, changes.along_u, CV_32F, window);
  cv::boxFilter(changes.along_v, changes.along_v, CV_32F, window);
  std::vector<cv::Point> found;
  cv::findNonZero(pixels, found);
  std::vector<Border> borders;
  borders.reserve(found.size());
  for (const cv::Point& pixel : found) {
    Border border;
    border.pixel = pixel;
    border.u = static_cast<float>(pixel.x);
    border.v = static_cast<float>(pixel.y);
    const float along_u = changes.along_u.at<float>(pixel), along_v = changes.along_v.at<float>(pixel);
    border.upright = along_v <= kUprightUpTo * along_u;
    border.level = along_v > kLevelFrom * along_u;
    place(border);
    borders.push_back(border);
  }
  return borders;
}

}  // namespace

std::vector<Border> maskBorders(const cv::Mat& sets, const cv::Mat& image) {
  const SetChanges masks = changesOf(sets);
  if (image.empty()) return collect(masks.pixels, masks.changes, PlacesBetweenMasks(sets));
  if (cv::countNonZero(masks.pixels) == 0) return {};  // the distance to nothing is not defined
  Changes gradient = gradientOf(image, kEdgeSigma);
  cv::Mat along_u, along_v, edges, distance;
  gradient.along_u.convertTo(along_u, CV_16S);
  gradient.along_v.convertTo(along_v, CV_16S);
  cv::Canny(along_u, along_v, edges, kEdgeLow, kEdgeHigh, true);
  cv::distanceTransform(masks.pixels == 0, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::bitwise_and(edges, distance <= kReach, edges);
  gradient.along_u = gradient.along_u.mul(gradient.along_u);
  gradient.along_v = gradient.along_v.mul(gradient.along_v);
  return collect(edges, gradient, PlacesOnEdges(image));
}

}  // namespace lidar_camera_recalibration

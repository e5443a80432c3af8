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

// How strongly something changes along u and along v at each pixel.
struct Changes {
  cv::Mat along_u, along_v;  // CV_16SC1
};

// Of the set of masks: 1 at both pixels of a change.
Changes changesOf(const cv::Mat& sets) {
  Changes changes{cv::Mat::zeros(sets.size(), CV_16SC1), cv::Mat::zeros(sets.size(), CV_16SC1)};
  for (int v = 0; v < sets.rows; ++v) {
    const auto* const row = sets.ptr<std::uint16_t>(v);
    const auto* const below = sets.ptr<std::uint16_t>(std::min(v + 1, sets.rows - 1));
    auto* const along_u = changes.along_u.ptr<std::int16_t>(v);
    auto* const along_v = changes.along_v.ptr<std::int16_t>(v);
    auto* const along_v_below = changes.along_v.ptr<std::int16_t>(std::min(v + 1, sets.rows - 1));
    for (int u = 0; u + 1 < sets.cols; ++u) {
      if (row[u] != row[u + 1]) along_u[u] = along_u[u + 1] = 1;
    }
    for (int u = 0; u < sets.cols; ++u) {
      if (row[u] != below[u]) along_v[u] = along_v_below[u] = 1;
    }
  }
  return changes;
}

cv::Rect windowAround(const cv::Point& pixel, const cv::Size& size) {
  constexpr int kHalf = kDirectionWindow / 2;
  return cv::Rect(pixel.x - kHalf, pixel.y - kHalf, kDirectionWindow, kDirectionWindow) &
         cv::Rect(0, 0, size.width, size.height);
}

// The gradient of an image, at each pixel that of the channel where it is strongest: many borders are between
// colours of the same brightness.
Changes gradientOf(const cv::Mat& image) {
  cv::Mat along_u, along_v;
  cv::Sobel(image, along_u, CV_16S, 1, 0);
  cv::Sobel(image, along_v, CV_16S, 0, 1);
  Changes result{cv::Mat(image.size(), CV_16SC1), cv::Mat(image.size(), CV_16SC1)};
  for (int v = 0; v < image.rows; ++v) {
    const auto* us = along_u.ptr<cv::Vec3s>(v);
    const auto* vs = along_v.ptr<cv::Vec3s>(v);
    auto* strongest_u = result.along_u.ptr<std::int16_t>(v);
    auto* strongest_v = result.along_v.ptr<std::int16_t>(v);
    for (int u = 0; u < image.cols; ++u) {
      int most = -1;
      for (int c = 0; c < 3; ++c) {
        const int square = us[u][c] * us[u][c] + vs[u][c] * vs[u][c];
        if (square <= most) continue;
        most = square;
        strongest_u[u] = us[u][c];
        strongest_v[u] = vs[u][c];
      }
    }
  }
  return result;
}

// Between two masks: half a pixel from each, across the line between the middles of their pixels in a window.
class PlacesBetweenMasks {
 public:
  explicit PlacesBetweenMasks(const cv::Mat& sets) : sets_(sets) {}

  void operator()(Border& border) const {
    const cv::Rect window = windowAround(border.pixel, sets_.size());
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
    image.convertTo(smooth_, CV_32F);  // finer than steps of 1: a parabola is laid through the gradient
    cv::GaussianBlur(smooth_, smooth_, cv::Size(), kPlaceSigma);
  }

  void operator()(Border& border) const {
    const cv::Point2f gradient = gradientAt(border.pixel.x, border.pixel.y);
    const float here = magnitude(gradient);
    if (!(here > 0.0f)) return;
    border.nu = gradient.x / here;
    border.nv = gradient.y / here;
    const float before = magnitudeAt(border.u - border.nu, border.v - border.nv);
    const float after = magnitudeAt(border.u + border.nu, border.v + border.nv);
    const float curvature = before - 2.0f * here + after;
    if (!(curvature < 0.0f)) return;
    const float shift = std::clamp(0.5f * (before - after) / curvature, -1.0f, 1.0f);
    border.u += shift * border.nu;
    border.v += shift * border.nv;
  }

 private:
  // As gradientOf(), made where it is asked for: borders are few. The image is mirrored at its rim.
  cv::Point2f gradientAt(int u, int v) const {
    const int left = cv::borderInterpolate(u - 1, smooth_.cols, cv::BORDER_REFLECT_101);
    const int right = cv::borderInterpolate(u + 1, smooth_.cols, cv::BORDER_REFLECT_101);
    const int above = cv::borderInterpolate(v - 1, smooth_.rows, cv::BORDER_REFLECT_101);
    const int below = cv::borderInterpolate(v + 1, smooth_.rows, cv::BORDER_REFLECT_101);
    const auto *const upper = smooth_.ptr<cv::Vec3f>(above), *const row = smooth_.ptr<cv::Vec3f>(v),
                      *const lower = smooth_.ptr<cv::Vec3f>(below);
    cv::Point2f strongest;
    float most = -1.0f;
    for (int c = 0; c < 3; ++c) {
      const cv::Point2f gradient((upper[right][c] - upper[left][c]) + 2.0f * (row[right][c] - row[left][c]) +
                                     (lower[right][c] - lower[left][c]),
                                 (lower[left][c] - upper[left][c]) + 2.0f * (lower[u][c] - upper[u][c]) +
                                     (lower[right][c] - upper[right][c]));
      const float square = gradient.dot(gradient);
      if (square <= most) continue;
      most = square;
      strongest = gradient;
    }
    return strongest;
  }

  static float magnitude(const cv::Point2f& gradient) {
    return std::sqrt(gradient.x * gradient.x + gradient.y * gradient.y);
  }

  float magnitudeAt(float u, float v) const {
    const int left = std::clamp(static_cast<int>(u), 0, smooth_.cols - 2);
    const int top = std::clamp(static_cast<int>(v), 0, smooth_.rows - 2);
    const float a = std::clamp(u - static_cast<float>(left), 0.0f, 1.0f);
    const float b = std::clamp(v - static_cast<float>(top), 0.0f, 1.0f);
    const auto between = [&](int row) {
      const float first = magnitude(gradientAt(left, row)), second = magnitude(gradientAt(left + 1, row));
      return first + a * (second - first);
    };
    return (1.0f - b) * between(top) + b * between(top + 1);
  }

  cv::Mat smooth_;  // CV_32FC3
};

// Sum of squares in the window around a pixel.
float changeAround(const cv::Mat& changes, const cv::Rect& window) {
  float sum = 0.0f;
  for (int v = window.y; v < window.y + window.height; ++v) {
    const auto* const row = changes.ptr<std::int16_t>(v);
    for (int u = window.x; u < window.x + window.width; ++u) sum += static_cast<float>(row[u] * row[u]);
  }
  return sum;
}

template <typename Place>
std::vector<Border> collect(const std::vector<cv::Point>& pixels, const Changes& changes,
                            const Place& place) {
  std::vector<Border> borders;
  borders.reserve(pixels.size());
  for (const cv::Point& pixel : pixels) {
    Border border;
    border.pixel = pixel;
    border.u = static_cast<float>(pixel.x);
    border.v = static_cast<float>(pixel.y);
    const cv::Rect window = windowAround(pixel, changes.along_u.size());
    const float along_u = changeAround(changes.along_u, window),
                along_v = changeAround(changes.along_v, window);
    border.upright = along_v <= kUprightUpTo * along_u;
    border.level = along_v > kLevelFrom * along_u;
    place(border);
    borders.push_back(border);
  }
  return borders;
}

// Whether a mask's border runs within kReach of a pixel.
bool nearChange(const Changes& masks, const cv::Point& pixel) {
  constexpr int kHalf = static_cast<int>(kReach);
  for (int dv = -kHalf; dv <= kHalf; ++dv) {
    const int v = pixel.y + dv;
    if (v < 0 || v >= masks.along_u.rows) continue;
    const int half = static_cast<int>(std::sqrt(kReach * kReach - dv * dv));
    const auto* const along_u = masks.along_u.ptr<std::int16_t>(v);
    const auto* const along_v = masks.along_v.ptr<std::int16_t>(v);
    for (int u = std::max(0, pixel.x - half); u <= std::min(masks.along_u.cols - 1, pixel.x + half); ++u) {
      if ((along_u[u] | along_v[u]) != 0) return true;
    }
  }
  return false;
}

}  // namespace

std::vector<Border> maskBorders(const cv::Mat& sets, const cv::Mat& image) {
  const Changes masks = changesOf(sets);
  std::vector<cv::Point> pixels;
  if (image.empty()) {
    cv::findNonZero(masks.along_u | masks.along_v, pixels);
    return collect(pixels, masks, PlacesBetweenMasks(sets));
  }
  cv::Mat smooth, edges;
  cv::GaussianBlur(image, smooth, cv::Size(), kEdgeSigma);
  const Changes gradient = gradientOf(smooth);
  cv::Canny(gradient.along_u, gradient.along_v, edges, kEdgeLow, kEdgeHigh, true);
  cv::findNonZero(edges, pixels);
  pixels.erase(std::remove_if(pixels.begin(), pixels.end(),
                              [&](const cv::Point& pixel) { return !nearChange(masks, pixel); }),
               pixels.end());
  return collect(pixels, gradient, PlacesOnEdges(image));
}

}  // namespace lidar_camera_recalibration

#include "mask_borders.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <opencv2/imgproc.hpp>

#include "multiversion.hpp"

namespace lidar_camera_recalibration {
namespace {

// The direction of a border is that of the changes in a window around it: a single pixel's is too rough.
constexpr int kDirectionWindow = 7;  // [px]
// Squared change along v to squared change along u, up to which a border counts as upright, or from which on
// as level. Rings cross borders down to some 15 deg from the horizontal, and such crossings tell the height
// best.
constexpr float kUprightUpTo = 10.0f, kLevelFrom = 0.5f;

constexpr int kReach = 2;  // how far a segmenter's borders are off, at most [px]
constexpr double kEdgeSigma = 1.0, kEdgeLow = 30.0, kEdgeHigh = 80.0;  // Canny: blur [px], gradients
constexpr double kPlaceSigma = 1.5;                                    // blur for the places of edges [px]
constexpr int kPlaceRadius = 6;                                        // of its kernel [px]

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

// Sobel's gradient of one row of an image with three channels.
struct RowGradient {
  static constexpr int kChannels = 3;

  explicit RowGradient(int width) : size(static_cast<std::size_t>(kChannels * width)) {
    for (auto* sums : {&sum, &difference}) sums->resize(size + 2 * kChannels);
    for (auto* gradient : {&along_u, &along_v}) gradient->resize(size);
  }

  std::size_t size;                           // values of the row
  std::vector<std::int16_t> sum, difference;  // of the rows above and below, one pixel more on both sides
  std::vector<std::int16_t> along_u, along_v;
};

LCR_MULTIVERSION void addRows(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                              std::size_t size, std::int16_t* __restrict sum,
                              std::int16_t* __restrict difference) {
  for (std::size_t i = 0; i < size; ++i) {
    sum[i] = static_cast<std::int16_t>(above[i] + 2 * row[i] + below[i]);
    difference[i] = static_cast<std::int16_t>(below[i] - above[i]);
  }
}

LCR_MULTIVERSION void addColumns(const std::int16_t* sum, const std::int16_t* difference, std::size_t size,
                                 std::int16_t* __restrict along_u, std::int16_t* __restrict along_v) {
  constexpr std::size_t kNext = RowGradient::kChannels;
  for (std::size_t i = 0; i < size; ++i) {
    along_u[i] = static_cast<std::int16_t>(sum[i + 2 * kNext] - sum[i]);
    along_v[i] =
        static_cast<std::int16_t>(difference[i] + 2 * difference[i + kNext] + difference[i + 2 * kNext]);
  }
}

// Of each pixel's channels that with the strongest gradient, the first one of equals.
LCR_MULTIVERSION void chooseStrongest(const std::int16_t* us, const std::int16_t* vs, std::size_t width,
                                      std::int16_t* __restrict along_u, std::int16_t* __restrict along_v) {
  for (std::size_t u = 0; u < width; ++u) {
    const std::size_t i = RowGradient::kChannels * u;
    int strongest_u = us[i], strongest_v = vs[i];
    int most = strongest_u * strongest_u + strongest_v * strongest_v;
    for (std::size_t c = 1; c < RowGradient::kChannels; ++c) {
      const int channel_u = us[i + c], channel_v = vs[i + c];
      const int square = channel_u * channel_u + channel_v * channel_v;
      strongest_u = square > most ? channel_u : strongest_u;
      strongest_v = square > most ? channel_v : strongest_v;
      most = square > most ? square : most;
    }
    along_u[u] = static_cast<std::int16_t>(strongest_u);
    along_v[u] = static_cast<std::int16_t>(strongest_v);
  }
}

// The gradient of an image, at each pixel that of the channel where it is strongest: many borders are between
// colours of the same brightness. The image is mirrored at its rim.
Changes gradientOf(const cv::Mat& image) {
  constexpr std::size_t kChannels = RowGradient::kChannels;
  Changes result{cv::Mat(image.size(), CV_16SC1), cv::Mat(image.size(), CV_16SC1)};
  RowGradient gradient(image.cols);
  const std::size_t width = static_cast<std::size_t>(image.cols), size = gradient.size;
  const std::size_t mirrored =
      kChannels * static_cast<std::size_t>(cv::borderInterpolate(-1, image.cols, cv::BORDER_REFLECT_101));
  for (int v = 0; v < image.rows; ++v) {
    const int above = cv::borderInterpolate(v - 1, image.rows, cv::BORDER_REFLECT_101);
    const int below = cv::borderInterpolate(v + 1, image.rows, cv::BORDER_REFLECT_101);
    addRows(image.ptr(above), image.ptr(v), image.ptr(below), size, gradient.sum.data() + kChannels,
            gradient.difference.data() + kChannels);
    for (auto* sums : {&gradient.sum, &gradient.difference}) {
      const auto first = sums->begin() + kChannels, last = sums->end() - 2 * kChannels;
      std::copy_n(first + mirrored, kChannels, sums->begin());
      std::copy_n(last - mirrored, kChannels, sums->end() - kChannels);
    }
    addColumns(gradient.sum.data(), gradient.difference.data(), size, gradient.along_u.data(),
               gradient.along_v.data());
    chooseStrongest(gradient.along_u.data(), gradient.along_v.data(), width,
                    result.along_u.ptr<std::int16_t>(v), result.along_v.ptr<std::int16_t>(v));
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
// across the edge. Borders must come in the order of their rows: the image is made smooth some rows at a
// time.
class PlacesOnEdges {
 public:
  explicit PlacesOnEdges(const cv::Mat& image) : image_(image) {}

  void operator()(Border& border) {
    if (border.pixel.y >= end_) makeSmooth(border.pixel.y);
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
  // For borders from a row on.
  void makeSmooth(int first) {
    constexpr int kRows = 64;
    constexpr int kLooked = 3;  // rows around a border's pixel that its place depends on
    constexpr int kMargin = kLooked + kPlaceRadius;
    end_ = std::min(first + kRows, image_.rows);
    first_ = std::max(first - kMargin, 0);
    const int last = std::min(end_ + kMargin, image_.rows);
    // Finer than steps of 1: a parabola is laid through the gradient.
    image_.rowRange(first_, last).convertTo(smooth_, CV_32F);
    constexpr int kSize = 2 * kPlaceRadius + 1;
    cv::GaussianBlur(smooth_, smooth_, cv::Size(kSize, kSize), kPlaceSigma);
  }

  const cv::Vec3f* smoothRow(int v) const { return smooth_.ptr<cv::Vec3f>(v - first_); }

  // As gradientOf(), made where it is asked for: borders are few. The image is mirrored at its rim.
  cv::Point2f gradientAt(int u, int v) const {
    const int left = cv::borderInterpolate(u - 1, image_.cols, cv::BORDER_REFLECT_101);
    const int right = cv::borderInterpolate(u + 1, image_.cols, cv::BORDER_REFLECT_101);
    const int above = cv::borderInterpolate(v - 1, image_.rows, cv::BORDER_REFLECT_101);
    const int below = cv::borderInterpolate(v + 1, image_.rows, cv::BORDER_REFLECT_101);
    const cv::Vec3f *const upper = smoothRow(above), *const row = smoothRow(v),
                           *const lower = smoothRow(below);
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
    const int left = std::clamp(static_cast<int>(u), 0, image_.cols - 2);
    const int top = std::clamp(static_cast<int>(v), 0, image_.rows - 2);
    const float a = std::clamp(u - static_cast<float>(left), 0.0f, 1.0f);
    const float b = std::clamp(v - static_cast<float>(top), 0.0f, 1.0f);
    const auto between = [&](int row) {
      const float first = magnitude(gradientAt(left, row)), second = magnitude(gradientAt(left + 1, row));
      return first + a * (second - first);
    };
    return (1.0f - b) * between(top) + b * between(top + 1);
  }

  const cv::Mat& image_;
  int first_ = 0;   // row of the image that is the first one of smooth_
  int end_ = 0;     // smooth_ is for borders above this row
  cv::Mat smooth_;  // CV_32FC3
};

// Sum of squares in the window around a pixel.
float changeAround(const cv::Mat& changes, const cv::Rect& window) {
  int sum = 0;
  for (int v = window.y; v < window.y + window.height; ++v) {
    const auto* const row = changes.ptr<std::int16_t>(v);
    for (int u = window.x; u < window.x + window.width; ++u) sum += row[u] * row[u];
  }
  return static_cast<float>(sum);
}

template <typename Place>
std::vector<Border> collect(const std::vector<cv::Point>& pixels, const Changes& changes, Place place) {
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

// Whether a mask's border runs within kReach of a pixel: then not all pixels there and next to these have one
// set of masks.
bool nearBorder(const cv::Mat& sets, const cv::Point& pixel) {
  constexpr int kSteps = kReach + 1;
  const std::uint16_t own = sets.at<std::uint16_t>(pixel);
  const int top = std::max(pixel.y - kSteps, 0), bottom = std::min(pixel.y + kSteps, sets.rows - 1);
  for (int v = top; v <= bottom; ++v) {
    const auto* const row = sets.ptr<std::uint16_t>(v);
    const int half = kSteps - std::abs(v - pixel.y);
    const int left = std::max(pixel.x - half, 0), right = std::min(pixel.x + half, sets.cols - 1);
    for (int u = left; u <= right; ++u) {
      if (row[u] != own) return true;
    }
  }
  return false;
}

}  // namespace

std::vector<Border> maskBorders(const cv::Mat& sets, const cv::Mat& image) {
  std::vector<cv::Point> pixels;
  if (image.empty()) {
    const Changes masks = changesOf(sets);
    cv::findNonZero(masks.along_u | masks.along_v, pixels);
    return collect(pixels, masks, PlacesBetweenMasks(sets));
  }
  cv::Mat smooth, edges;
  cv::GaussianBlur(image, smooth, cv::Size(), kEdgeSigma);
  const Changes gradient = gradientOf(smooth);
  cv::Canny(gradient.along_u, gradient.along_v, edges, kEdgeLow, kEdgeHigh, true);
  cv::findNonZero(edges, pixels);
  pixels.erase(std::remove_if(pixels.begin(), pixels.end(),
                              [&](const cv::Point& pixel) { return !nearBorder(sets, pixel); }),
               pixels.end());
  return collect(pixels, gradient, PlacesOnEdges(image));
}

}  // namespace lidar_camera_recalibration

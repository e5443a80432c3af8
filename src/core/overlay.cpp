#include "lidar_camera_recalibration/overlay.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::array<const char*, 5> kNames = {"depth", "reflectivity", "normal", "segment", "mask"};

// Logarithmic, so that the near range has colours enough; fixed, so that pictures compare.
constexpr double kNearest = 2.5, kFarthest = 80.0;                                 // [m]
constexpr std::array<double, 6> kDepthTicks = {2.5, 5.0, 10.0, 20.0, 40.0, 80.0};  // [m]
constexpr std::array<double, 5> kUnitTicks = {0.0, 0.25, 0.5, 0.75, 1.0};

constexpr int kSubPixelBits = 4;  // of coordinates given to cv::fillConvexPoly()
constexpr int kFont = cv::FONT_HERSHEY_DUPLEX;
const cv::Vec3b kGrey(150, 150, 150);
const cv::Scalar kBarColor(32, 28, 26), kTextColor(240, 240, 240), kFaintTextColor(190, 190, 190);

struct Dot {
  cv::Point2d pixel;
  double depth;
  cv::Vec3b color;
};

// --- colours ---

/// BGR of 0..1, from blue to red.
cv::Vec3b rampColor(double value) {
  static const cv::Mat ramp = [] {
    cv::Mat values(1, 256, CV_8UC1), colors;
    for (int i = 0; i < 256; ++i) values.at<std::uint8_t>(0, i) = static_cast<std::uint8_t>(i);
    cv::applyColorMap(values, colors, cv::COLORMAP_TURBO);
    return colors;
  }();
  // Both ends of the map are nearly black, which the eye takes for a shadow.
  const double position = 0.06 + 0.89 * std::min(1.0, std::max(0.0, value));
  return ramp.at<cv::Vec3b>(0, cvRound(255.0 * position));
}

double depthPosition(double depth) { return std::log(depth / kNearest) / std::log(kFarthest / kNearest); }

/// Neighbouring numbers get very different hues.
cv::Vec3b numberColor(std::uint32_t number) {
  static const std::vector<cv::Vec3b> palette = [] {
    std::vector<cv::Vec3b> colors;
    for (int i = 0; i < 256; ++i) {
      const double hue = std::fmod(i * 0.618033988749895, 1.0);  // golden ratio
      const cv::Mat hsv(1, 1, CV_8UC3,
                        cv::Scalar(179.0 * hue, i % 3 == 1 ? 150 : 225, i % 2 == 0 ? 255 : 215));
      cv::Mat bgr;
      cv::cvtColor(hsv, bgr, cv::COLOR_HSV2BGR);
      colors.push_back(bgr.at<cv::Vec3b>(0, 0));
    }
    return colors;
  }();
  return palette[number % palette.size()];
}

/// Axes of the optical frame: x -> red, y -> green, z -> blue.
cv::Vec3b normalColor(const Eigen::Vector3d& normal) {
  if (normal.squaredNorm() < 0.25) return kGrey;  // unknown
  const auto channel = [](double value) { return cv::saturate_cast<std::uint8_t>(127.5 + 127.5 * value); };
  return {channel(normal.z()), channel(normal.y()), channel(normal.x())};
}

/// Of the first mask at the point's pixel in the ideal image.
cv::Vec3b maskColor(const Frame& frame, const Eigen::Vector3d& point) {
  const Intrinsics& i = frame.camera.intrinsics();
  const double u = i.fx * point.x() / point.z() + i.cx;
  const double v = i.fy * point.y() / point.z() + i.cy;
  const MaskSets& masks = frame.masks;
  if (!(u > -0.5 && v > -0.5 && u < masks.width() - 0.5 && v < masks.height() - 0.5)) return kGrey;
  const std::size_t set = masks.setOfPixel().at<std::uint16_t>(cvRound(v), cvRound(u));
  if (masks.setBegin()[set] == masks.setBegin()[set + 1]) return kGrey;
  return numberColor(masks.setMasks()[masks.setBegin()[set]]);
}

cv::Vec3b pointColor(const Frame& frame, std::size_t k, const Eigen::Vector3d& in_camera,
                     const Eigen::Matrix3d& rotation, OverlayColor color) {
  const FramePoints& points = frame.points;
  switch (color) {
    case OverlayColor::kDepth:
      return depthColor(in_camera.z());
    case OverlayColor::kReflectivity:
      return points.hasReflectivity() ? rampColor(points.reflectivity[k]) : kGrey;
    case OverlayColor::kNormal:
      return normalColor(rotation * Eigen::Vector3d(points.nx[k], points.ny[k], points.nz[k]));
    case OverlayColor::kSegment:
      return points.segment[k] < 0 ? kGrey : numberColor(static_cast<std::uint32_t>(points.segment[k]));
    case OverlayColor::kMask:
      return maskColor(frame, in_camera);
  }
  return kGrey;
}

// --- points ---

std::vector<Dot> visibleDots(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar,
                             OverlayColor color) {
  const cv::Rect2d image(-0.5, -0.5, frame.image.cols, frame.image.rows);
  const Eigen::Matrix3d rotation = T_camera_lidar.linear();
  std::vector<Dot> dots;
  for (std::size_t k = 0; k < frame.points.size(); ++k) {
    if (frame.visible[k] == 0) continue;
    const Eigen::Vector3d point =
        T_camera_lidar * Eigen::Vector3d(frame.points.x[k], frame.points.y[k], frame.points.z[k]);
    const auto pixel = frame.camera.project(point);
    if (!pixel || !image.contains({pixel->x(), pixel->y()})) continue;
    dots.push_back({{pixel->x(), pixel->y()}, point.z(), pointColor(frame, k, point, rotation, color)});
  }
  return dots;
}

void drawDots(cv::Mat& image, std::vector<Dot>& dots) {
  std::stable_sort(dots.begin(), dots.end(), [](const Dot& a, const Dot& b) { return a.depth > b.depth; });
  const double scale = 1 << kSubPixelBits;
  const double radius = std::max(0.8, image.cols / 1100.0);  // [px]
  // cv::circle() makes a diamond of so small a smooth circle.
  std::array<cv::Point2d, 8> octagon;
  for (std::size_t i = 0; i < octagon.size(); ++i) {
    const double angle = (static_cast<double>(i) + 0.5) * M_PI / 4.0;
    octagon[i] = radius * cv::Point2d(std::cos(angle), std::sin(angle));
  }
  std::vector<cv::Point> corners(octagon.size());
  for (const Dot& dot : dots) {
    std::transform(octagon.begin(), octagon.end(), corners.begin(),
                   [&](const cv::Point2d& corner) { return cv::Point(scale * (dot.pixel + corner)); });
    cv::fillConvexPoly(image, corners, cv::Scalar(dot.color), cv::LINE_AA, kSubPixelBits);
  }
}

// --- title bar ---

struct TextStyle {
  double scale;
  int thickness;
  cv::Size size(const std::string& text) const {
    return cv::getTextSize(text, kFont, scale, thickness, nullptr);
  }
};

/// So high [px], but never wider than `max_width`.
TextStyle textStyle(const std::string& text, int height, int max_width) {
  TextStyle style = {cv::getFontScaleFromHeight(kFont, std::max(4, height), 1), 1};
  const int width = style.size(text).width;
  if (width > max_width) style.scale *= std::max(1, max_width) / static_cast<double>(width);
  style.thickness = std::max(1, cvRound(style.scale * 1.2));
  return style;
}

void putText(cv::Mat& bar, const std::string& text, cv::Point left_base, const TextStyle& style,
             const cv::Scalar& color) {
  cv::putText(bar, text, left_base, kFont, style.scale, color, style.thickness, cv::LINE_AA);
}

std::string tickText(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%g", value);
  return text;
}

/// A ramp with numbers below it, in a cell at the right end of the bar.
template <typename Color, typename Ticks>
void drawRamp(cv::Mat cell, const std::string& label, const Color& color, const Ticks& ticks) {
  const int height = cell.rows;
  const int text_height = cvRound(0.22 * height);
  const TextStyle label_style = textStyle(label, text_height, cell.cols / 3);
  const int left = label_style.size(label).width + cvRound(0.6 * height);
  const int right = cell.cols - cvRound(0.5 * height);
  if (right - left < 8) return;
  const int top = cvRound(0.2 * height), bottom = cvRound(0.5 * height);
  putText(cell, label, {0, (top + bottom + label_style.size(label).height) / 2}, label_style,
          kFaintTextColor);
  for (int x = left; x < right; ++x) {
    const double position = (x - left) / static_cast<double>(right - 1 - left);
    cell(cv::Rect(x, top, 1, bottom - top)).setTo(cv::Scalar(color(position)));
  }
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    const std::string text = tickText(ticks[i]);
    const TextStyle style = textStyle(text, text_height, (right - left) / static_cast<int>(ticks.size()));
    const int x = left + cvRound(i / (ticks.size() - 1.0) * (right - 1 - left));
    cv::line(cell, {x, bottom - 1}, {x, bottom + cvRound(0.06 * height)}, kFaintTextColor);
    putText(cell, text, {x - style.size(text).width / 2, cvRound(0.86 * height)}, style, kFaintTextColor);
  }
}

void drawNote(cv::Mat cell, const std::string& note) {
  const TextStyle style = textStyle(note, cvRound(0.26 * cell.rows), cell.cols - cell.rows / 3);
  const cv::Size size = style.size(note);
  const int left = cell.cols - cell.rows / 3 - size.width;
  putText(cell, note, {std::max(0, left), (cell.rows + size.height) / 2}, style, kFaintTextColor);
}

void drawLegend(cv::Mat cell, const Frame& frame, OverlayColor color) {
  switch (color) {
    case OverlayColor::kDepth:
      // The ticks double each time, so on the logarithmic ramp they are evenly spaced.
      drawRamp(
          cell, "depth [m]", [](double position) { return rampColor(1.0 - position); }, kDepthTicks);
      break;
    case OverlayColor::kReflectivity:
      if (frame.points.hasReflectivity()) {
        drawRamp(cell, "reflectivity (relative)", rampColor, kUnitTicks);
      } else {
        drawNote(cell, "the cloud has no reflectivity");
      }
      break;
    case OverlayColor::kNormal:
      drawNote(cell, "normal: red = right, green = down, blue = forward");
      break;
    case OverlayColor::kSegment:
      drawNote(cell, "one colour per LiDAR segment, grey = none");
      break;
    case OverlayColor::kMask:
      drawNote(cell, "one colour per image mask, grey = none");
      break;
  }
}

/// Room above the image for title and legend.
cv::Mat titleBar(const Frame& frame, OverlayColor color, const std::string& title) {
  const int width = frame.image.cols;
  const int height = std::max(16, width / 26);
  cv::Mat bar(height, width, CV_8UC3, kBarColor);
  const std::string text = title.empty() ? std::string("LiDAR on camera") : title;
  const TextStyle style = textStyle(text, cvRound(0.4 * height), width / 2 - height);
  putText(bar, text, {height / 3, (height + style.size(text).height) / 2}, style, kTextColor);
  drawLegend(bar.colRange(width / 2, width), frame, color);
  return bar;
}

void checkImage(const Frame& frame) {
  const Intrinsics& i = frame.camera.intrinsics();
  if (frame.image.empty()) throw Error(ErrorCause::kImage, "the frame has no image to draw on");
  if (frame.image.type() != CV_8UC3 || frame.image.cols != i.width || frame.image.rows != i.height) {
    throw Error(ErrorCause::kImage, "the frame's image to draw on is " + std::to_string(frame.image.cols) +
                                        "x" + std::to_string(frame.image.rows) + " px with OpenCV type " +
                                        std::to_string(frame.image.type()) + "; it must be CV_8UC3 and " +
                                        std::to_string(i.width) + "x" + std::to_string(i.height) + " px");
  }
}

}  // namespace

cv::Vec3b depthColor(double depth) { return rampColor(1.0 - depthPosition(depth)); }

OverlayColor overlayColorFromName(const std::string& name) {
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) {
    throw Error(ErrorCause::kParameter, "unknown overlay colour '" + name +
                                            "'; known are depth, reflectivity, normal, segment and mask");
  }
  return static_cast<OverlayColor>(found - kNames.begin());
}

cv::Mat drawOverlay(const Frame& frame, const Eigen::Isometry3d& T_camera_lidar, OverlayColor color,
                    const std::string& title) {
  checkImage(frame);
  cv::Mat picture;
  frame.image.convertTo(picture, -1, 0.75);  // darker, so that the points stand out
  std::vector<Dot> dots = visibleDots(frame, T_camera_lidar, color);
  drawDots(picture, dots);
  cv::vconcat(titleBar(frame, color, title), picture, picture);
  return picture;
}

cv::Mat drawBeforeAfter(const Frame& frame, const Eigen::Isometry3d& before, const Eigen::Isometry3d& after,
                        OverlayColor color) {
  cv::Mat both;
  cv::vconcat(drawOverlay(frame, before, color, "before"), drawOverlay(frame, after, color, "after"), both);
  return both;
}

}  // namespace lidar_camera_recalibration

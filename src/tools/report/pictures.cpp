#include "pictures.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "html.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/overlay.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr int kMaxWidth = 1280, kZoomWidth = 480, kZoomHeight = 360;  // [px]
constexpr int kQuality = 82;                                          // of JPEG

std::string jpeg(const cv::Mat& picture) {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, kQuality}))
    throw Error(ErrorCause::kFile, "a picture of the report cannot be encoded as JPEG");
  return dataUri("image/jpeg", bytes);
}

/// The overlay without its title bar: the page has a legend of its own, readable at any size.
std::string overlay(const Frame& frame, const Eigen::Isometry3d& T) {
  const cv::Mat drawn = drawOverlay(frame, T, OverlayColor::kDepth);
  cv::Mat picture = drawn.rowRange(drawn.rows - frame.image.rows, drawn.rows);
  if (picture.cols > kMaxWidth)
    cv::resize(picture, picture, {kMaxWidth, picture.rows * kMaxWidth / picture.cols}, 0.0, 0.0,
               cv::INTER_AREA);
  return jpeg(picture);
}

// --- zooms ---

struct Edge {
  cv::Point2d pixel;  ///< in the image as it was taken
  double depth, weight;
  bool silhouette;  ///< along a ring, so a point of the border itself
};

std::vector<Edge> visibleEdges(const Frame& frame, const Eigen::Isometry3d& T) {
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < frame.edges.size(); ++i) {
    const Eigen::Vector3d point = T * Eigen::Vector3d(frame.edges.x[i], frame.edges.y[i], frame.edges.z[i]);
    const auto pixel = frame.camera.project(point);
    if (pixel)
      edges.push_back({{pixel->x(), pixel->y()},
                       point.z(),
                       frame.edges.weight[i],
                       frame.edges.kind[i] == EdgePoints::Kind::kAzimuthGap});
  }
  return edges;
}

struct Place {
  FramePtr frame;
  cv::Rect window;
  double weight = 0.0, near = 0.0, far = 0.0;
};

/// Which depths [m] a zoom shows, and which part of the image's width.
struct Band {
  double near, far, width;
};
constexpr std::array<Band, 2> kBands = {Band{3.0, 14.0, 0.12}, Band{16.0, 60.0, 0.07}};

/// Silhouettes that go on in the rings above and below, as those of poles, cars and walls do and those of
/// leaves do not. Nothing of the image enters, so that the places do not speak for the result.
std::vector<bool> upright(const std::vector<Edge>& edges, int image_width) {
  const double reach = 0.015 * image_width, aside = 0.003 * image_width;  // [px]
  std::vector<std::size_t> order(edges.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&edges](std::size_t a, std::size_t b) { return edges[a].pixel.x < edges[b].pixel.x; });
  std::vector<bool> result(edges.size(), false);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Edge& edge = edges[order[i]];
    bool above = false, below = false;
    const auto look = [&](const Edge& other) {
      const double dy = other.pixel.y - edge.pixel.y;
      if (!other.silhouette || std::abs(dy) > reach || std::abs(other.depth - edge.depth) > 0.02 * edge.depth)
        return;
      above = above || dy < -1.0;
      below = below || dy > 1.0;
    };
    for (std::size_t k = i; k-- > 0 && edge.pixel.x - edges[order[k]].pixel.x < aside;) look(edges[order[k]]);
    for (std::size_t k = i + 1; k < order.size() && edges[order[k]].pixel.x - edge.pixel.x < aside; ++k)
      look(edges[order[k]]);
    result[order[i]] = edge.silhouette && above && below;
  }
  return result;
}

/// The window with the most upright silhouettes of these depths and the least of others.
Place bestPlace(const FramePtr& frame, const std::vector<Edge>& edges, const Band& band) {
  const cv::Size image = frame->image.size();
  cv::Size size(cvRound(band.width * image.width), 0);
  size.height = std::min(image.height, size.width * kZoomHeight / kZoomWidth);
  const cv::Size step(std::max(1, size.width / 4), std::max(1, size.height / 4));
  const std::vector<bool> goes_on = upright(edges, image.width);
  Place best;
  for (int y = 0; y + size.height <= image.height; y += step.height) {
    for (int x = 0; x + size.width <= image.width; x += step.width) {
      Place place{frame, {{x, y}, size}, 0.0, band.far, band.near};
      double good = 0.0, all = 0.0;
      for (std::size_t i = 0; i < edges.size(); ++i) {
        const Edge& edge = edges[i];
        if (!edge.silhouette || !place.window.contains(cv::Point(edge.pixel))) continue;
        all += 1.0;
        if (!goes_on[i] || edge.depth < band.near || edge.depth > band.far) continue;
        good += 1.0;
        place.near = std::min(place.near, edge.depth);
        place.far = std::max(place.far, edge.depth);
      }
      if (all > 0.0) place.weight = good * good * good / (all * all);
      if (place.weight > best.weight) best = place;
    }
  }
  return best;
}

std::string zoom(const Place& place, const std::vector<Edge>& edges) {
  cv::Mat picture;
  const double scale = static_cast<double>(kZoomWidth) / place.window.width;
  cv::resize(place.frame->image(place.window), picture, {kZoomWidth, cvRound(scale * place.window.height)},
             0.0, 0.0, cv::INTER_CUBIC);
  // Shadows are made as bright as the rest.
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  picture.convertTo(picture, -1, std::clamp(90.0 / (cv::mean(grey)[0] + 1.0), 0.8, 2.5));
  constexpr int kShift = 4;  // bits behind the point of coordinates for cv::circle
  for (const Edge& edge : edges) {
    const cv::Point2d in_window =
        (edge.pixel - cv::Point2d(place.window.tl()) + cv::Point2d(0.5, 0.5)) * scale;
    const cv::Point centre(in_window * (1 << kShift));
    const int radius = edge.silhouette ? 5 : 2;
    if (edge.silhouette)
      cv::circle(picture, centre, (radius + 1) << kShift, cv::Scalar(20, 20, 20), cv::FILLED, cv::LINE_AA,
                 kShift);
    cv::circle(picture, centre, radius << kShift, cv::Scalar(depthColor(edge.depth)), cv::FILLED, cv::LINE_AA,
               kShift);
  }
  return jpeg(picture);
}

Frames withImages(const Frames& frames) {
  Frames result;
  std::copy_if(frames.begin(), frames.end(), std::back_inserter(result),
               [](const FramePtr& frame) { return !frame->image.empty(); });
  return result;
}

}  // namespace

std::vector<BeforeAfter> overlays(const Frames& frames, const Eigen::Isometry3d& start,
                                  const Eigen::Isometry3d& result, std::size_t count) {
  const Frames pictured = withImages(frames);
  count = std::min(count, pictured.size());
  std::vector<BeforeAfter> pictures;
  for (std::size_t i = 0; i < count; ++i) {
    const Frame& frame = *pictured[(2 * i + 1) * pictured.size() / (2 * count)];
    pictures.push_back({frame.stamp, 0.0, 0.0, overlay(frame, start), overlay(frame, result)});
  }
  return pictures;
}

std::vector<BeforeAfter> zooms(const Frames& frames, const Eigen::Isometry3d& start,
                               const Eigen::Isometry3d& result, std::size_t count) {
  std::vector<BeforeAfter> pictures;
  for (const Band& band : kBands) {
    std::vector<Place> places;
    for (const FramePtr& frame : withImages(frames)) {
      places.push_back(bestPlace(frame, visibleEdges(*frame, result), band));
    }
    std::stable_sort(places.begin(), places.end(),
                     [](const Place& a, const Place& b) { return a.weight > b.weight; });
    places.resize(std::min(places.size(), count / kBands.size()));
    for (const Place& place : places) {
      if (place.weight <= 0.0) continue;
      pictures.push_back({place.frame->stamp, place.near, place.far,
                          zoom(place, visibleEdges(*place.frame, start)),
                          zoom(place, visibleEdges(*place.frame, result))});
    }
  }
  return pictures;
}

std::string depthGradient() {
  constexpr int kStops = 12;
  constexpr double kNear = 2.5, kFar = 80.0;  // as the overlay's legend [m]
  std::string gradient = "linear-gradient(90deg";
  for (int i = 0; i <= kStops; ++i) {
    const cv::Vec3b color = depthColor(kNear * std::pow(kFar / kNear, static_cast<double>(i) / kStops));
    char stop[32];
    std::snprintf(stop, sizeof stop, ",#%02x%02x%02x", color[2], color[1], color[0]);
    gradient += stop;
  }
  return gradient + ")";
}

}  // namespace lidar_camera_recalibration

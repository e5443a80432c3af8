#include <algorithm>
#include <array>
#include <boost/polygon/voronoi.hpp>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/frame.hpp"

// Hidden points by a depth image: neighbouring samples, as the LiDAR sees them, become triangles where their
// ranges are alike; the triangles are drawn as seen from the camera; what lies behind them is hidden.
// Triangles follow the sampling of 16 beams as well as that of 128, end at silhouettes, and do not let
// slanted surfaces hide themselves.

namespace lidar_camera_recalibration {
namespace {

using Triangle = std::array<std::size_t, 3>;
using Site = boost::polygon::point_data<int>;

// Samples further apart than this are not taken for neighbours [rad]: two beams of a 16-beam LiDAR, and a few
// azimuth steps.
constexpr double kMaxElevationGap = 2.6 * kDegree;
constexpr double kMaxAzimuthGap = 1.0 * kDegree;
// A surface may recede by so much from one sample to the next [m], [m/m].
constexpr double kMaxRangeStep = 0.4;
constexpr double kMaxRelativeRangeStep = 0.04;
// A hidden point lies so much behind the surface [m], [m/m].
constexpr double kHiddenGap = 0.5;
constexpr double kRelativeHiddenGap = 0.05;
// Cell of the camera's depth image [rad].
constexpr double kCell = 0.1 * kDegree;
// Triangles so close to the camera that they appear wider than this are left out [rad].
constexpr double kMaxAppearance = 15.0 * kDegree;

// Direction and distance of all points, seen from one place. Azimuth runs around z and is 0 in the middle of
// the cloud.
struct View {
  std::vector<float> azimuth, elevation;  // [rad]
  std::vector<float> distance;            // [m]
};

View viewFrom(const Eigen::Vector3d& place, const std::vector<Eigen::Vector3f>& points, double forward) {
  View view;
  for (const auto& point : points) {
    const Eigen::Vector3d d = point.cast<double>() - place;
    const double azimuth = std::atan2(d.y(), d.x()) - forward;
    view.azimuth.push_back(static_cast<float>(std::remainder(azimuth, 2.0 * M_PI)));
    view.elevation.push_back(static_cast<float>(std::atan2(d.z(), std::hypot(d.x(), d.y()))));
    view.distance.push_back(static_cast<float>(d.norm()));
  }
  return view;
}

float spread(const std::vector<float>& values, const Triangle& t) {
  const auto range = std::minmax({values[t[0]], values[t[1]], values[t[2]]});
  return range.second - range.first;
}

// Whether three neighbouring samples lie on one surface.
bool onOneSurface(const View& lidar, const Triangle& t) {
  const double near = std::min({lidar.distance[t[0]], lidar.distance[t[1]], lidar.distance[t[2]]});
  return spread(lidar.elevation, t) <= kMaxElevationGap &&
         spread(lidar.azimuth, t) * std::cos(lidar.elevation[t[0]]) <= kMaxAzimuthGap &&
         spread(lidar.distance, t) <= std::max(kMaxRangeStep, kMaxRelativeRangeStep * near);
}

// Delaunay triangulation of the LiDAR's directions, reduced to surfaces.
std::vector<Triangle> surfaceTriangles(const View& lidar) {
  constexpr double kUnit = 1e-6;  // of the integer coordinates [rad]; far below any LiDAR's resolution
  std::vector<Site> sites;
  for (std::size_t i = 0; i < lidar.azimuth.size(); ++i) {
    sites.emplace_back(static_cast<int>(std::lround(lidar.azimuth[i] / kUnit)),
                       static_cast<int>(std::lround(lidar.elevation[i] / kUnit)));
  }
  boost::polygon::voronoi_diagram<double> voronoi;
  boost::polygon::construct_voronoi(sites.begin(), sites.end(), &voronoi);

  std::vector<Triangle> triangles;
  for (const auto& vertex : voronoi.vertices()) {
    // The cells around a vertex form a triangle; on a regular grid a polygon, which becomes a fan.
    const auto* const first = vertex.incident_edge();
    const std::size_t tip = first->cell()->source_index();
    for (auto* edge = first->rot_next(); edge->rot_next() != first; edge = edge->rot_next()) {
      const Triangle t{tip, edge->cell()->source_index(), edge->rot_next()->cell()->source_index()};
      if (onOneSurface(lidar, t)) triangles.push_back(t);
    }
  }
  return triangles;
}

// Nearest surface in each direction from the camera; infinite where there is none.
class DepthImage {
 public:
  DepthImage(const View& camera, std::vector<Triangle> triangles) : view_(camera) {
    const auto azimuth = std::minmax_element(view_.azimuth.begin(), view_.azimuth.end());
    const auto elevation = std::minmax_element(view_.elevation.begin(), view_.elevation.end());
    left_ = *azimuth.first;
    bottom_ = *elevation.first;
    depth_.create(cvCeil((*elevation.second - bottom_) / kCell) + 2,
                  cvCeil((*azimuth.second - left_) / kCell) + 2, CV_32FC1);
    depth_.setTo(std::numeric_limits<float>::infinity());
    draw(triangles);
    // The farthest depth of the neighbourhood: a line of sight must be surrounded by nearer surface.
    cv::dilate(depth_, depth_, cv::Mat());
  }

  float depthAt(std::size_t i) const { return depth_.at<float>(cvRound(row(i)), cvRound(column(i))); }

 private:
  double column(std::size_t i) const { return (view_.azimuth[i] - left_) / kCell; }
  double row(std::size_t i) const { return (view_.elevation[i] - bottom_) / kCell; }

  // From far to near, so that the nearest remains. Each triangle has the distance of its farthest corner.
  void draw(std::vector<Triangle>& triangles) {
    std::vector<std::pair<float, std::size_t>> order;
    for (std::size_t t = 0; t < triangles.size(); ++t) {
      const auto& [a, b, c] = triangles[t];
      order.emplace_back(std::max({view_.distance[a], view_.distance[b], view_.distance[c]}), t);
    }
    std::sort(order.begin(), order.end(), std::greater<>());
    for (const auto& [distance, t] : order) {
      const Triangle& triangle = triangles[t];
      if (spread(view_.azimuth, triangle) > kMaxAppearance) continue;
      if (spread(view_.elevation, triangle) > kMaxAppearance) continue;
      constexpr int kShift = 4;  // fractional bits
      std::array<cv::Point, 3> corners;
      for (int k = 0; k < 3; ++k) {
        corners[k] = {cvRound(column(triangle[k]) * (1 << kShift)),
                      cvRound(row(triangle[k]) * (1 << kShift))};
      }
      cv::fillConvexPoly(depth_, corners.data(), 3, cv::Scalar(distance), cv::LINE_8, kShift);
    }
  }

  const View& view_;
  float left_ = 0.0f, bottom_ = 0.0f;  // [rad]
  cv::Mat depth_;                      // [m]
};

}  // namespace

std::vector<std::uint8_t> visiblePoints(const std::vector<Eigen::Vector3f>& points,
                                        const Eigen::Isometry3d& T_camera_lidar) {
  std::vector<std::uint8_t> visible(points.size(), 1);
  if (points.size() < 3) return visible;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const auto& p : points) middle += p.cast<double>().normalized();
  const double forward = std::atan2(middle.y(), middle.x());

  const View lidar = viewFrom(Eigen::Vector3d::Zero(), points, forward);
  const View camera = viewFrom(T_camera_lidar.inverse().translation(), points, forward);
  const DepthImage surfaces(camera, surfaceTriangles(lidar));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double distance = camera.distance[i];
    const double gap = std::max(kHiddenGap, kRelativeHiddenGap * distance);
    if (surfaces.depthAt(i) < distance - gap) visible[i] = 0;
  }
  return visible;
}

}  // namespace lidar_camera_recalibration

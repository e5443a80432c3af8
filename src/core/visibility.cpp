#include <algorithm>
#include <array>
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

using Triangle = std::array<std::uint32_t, 3>;

// Samples further apart than this are not taken for neighbours [rad]: two beams of a 16-beam LiDAR, and a few
// azimuth steps.
constexpr float kMaxElevationGap = 2.6f * static_cast<float>(kDegree);
constexpr float kMaxAzimuthGap = 1.0f * static_cast<float>(kDegree);
// A surface may recede by so much from one sample to the next [m], [m/m].
constexpr float kMaxRangeStep = 0.4f;
constexpr float kMaxRelativeRangeStep = 0.04f;
// Height of a row of samples [rad].
constexpr float kMinRowHeight = 0.1f * static_cast<float>(kDegree), kMaxRowHeight = kMaxAzimuthGap;
// A hidden point lies so much behind the surface [m], [m/m].
constexpr double kHiddenGap = 0.5;
constexpr double kRelativeHiddenGap = 0.05;
// Cell of the camera's depth image [rad].
constexpr float kCell = 0.1f * static_cast<float>(kDegree);
// Triangles so close to the camera that they appear wider than this are left out [rad].
constexpr float kMaxAppearance = 15.0f * static_cast<float>(kDegree);

// Direction and distance of all points, seen from one place. Azimuth runs around z and is 0 in the middle of
// the cloud.
struct View {
  std::vector<float> azimuth, elevation;  // [rad]
  std::vector<float> distance;            // [m]
};

View viewFrom(const Eigen::Vector3f& place, const std::vector<Eigen::Vector3f>& points,
              const Eigen::Vector2f& forward) {
  View view;
  for (auto* column : {&view.azimuth, &view.elevation, &view.distance}) column->reserve(points.size());
  for (const auto& point : points) {
    const Eigen::Vector3f d = point - place;
    const float along = forward.x() * d.x() + forward.y() * d.y(),
                left = forward.x() * d.y() - forward.y() * d.x();
    view.azimuth.push_back(std::atan2(left, along));
    view.elevation.push_back(std::atan2(d.z(), d.head<2>().norm()));
    view.distance.push_back(d.norm());
  }
  return view;
}

float spread(const std::vector<float>& values, const Triangle& t) {
  const float a = values[t[0]], b = values[t[1]], c = values[t[2]];
  return std::max(a, std::max(b, c)) - std::min(a, std::min(b, c));
}

// Samples of about one elevation, sorted by azimuth. Not the LiDAR's rings: those cross each other where
// lasers do not start at one place, and not all clouds have them.
struct Row {
  std::vector<std::uint32_t> points;
  float elevation = 0.0f;  // mean [rad]
};

// From bottom to top, so high that samples are as far apart within a row as the rows are.
std::vector<Row> rowsOf(const View& lidar) {
  const auto azimuth = std::minmax_element(lidar.azimuth.begin(), lidar.azimuth.end());
  const auto elevation = std::minmax_element(lidar.elevation.begin(), lidar.elevation.end());
  const float bottom = *elevation.first;
  const float area = (*azimuth.second - *azimuth.first) * (*elevation.second - bottom);
  const float height =
      std::clamp(std::sqrt(area / static_cast<float>(lidar.azimuth.size())), kMinRowHeight, kMaxRowHeight);
  std::vector<Row> rows(static_cast<std::size_t>((*elevation.second - bottom) / height) + 1);
  for (std::uint32_t i = 0; i < lidar.elevation.size(); ++i) {
    Row& row = rows[static_cast<std::size_t>((lidar.elevation[i] - bottom) / height)];
    row.points.push_back(i);
    row.elevation += lidar.elevation[i];
  }
  rows.erase(std::remove_if(rows.begin(), rows.end(), [](const Row& row) { return row.points.empty(); }),
             rows.end());
  for (Row& row : rows) {
    row.elevation /= static_cast<float>(row.points.size());
    std::sort(row.points.begin(), row.points.end(), [&](std::uint32_t a, std::uint32_t b) {
      return std::make_pair(lidar.azimuth[a], a) < std::make_pair(lidar.azimuth[b], b);
    });
  }
  return rows;
}

// Triangles between neighbouring samples that lie on one surface.
class Surfaces {
 public:
  Surfaces(const View& lidar, const std::vector<Row>& rows) : lidar_(lidar), rows_(rows) {
    for (std::size_t r = 0; r + 1 < rows.size(); ++r) addAbove(r);
  }

  const std::vector<Triangle>& triangles() const { return triangles_; }

 private:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

  // Between a row and the ones above it.
  void addAbove(std::size_t r) {
    const std::vector<std::uint32_t>& row = rows_[r].points;
    next_.assign(rows_.size() - r, 0);
    std::uint32_t left = row.front(), above_left = neighbourAbove(r, left);
    for (std::size_t k = 1; k < row.size(); ++k) {
      const std::uint32_t right = row[k], above_right = neighbourAbove(r, right);
      const bool lower = add({left, right, above_left}), upper = add({right, above_right, above_left});
      if (!lower && !upper) {  // three of the four may still lie on one surface
        add({left, right, above_right});
        add({left, above_right, above_left});
      }
      left = right;
      above_left = above_right;
    }
  }

  // The sample above another one, in the first row that has one there: rows have holes. Expects to be asked
  // in the order of the row.
  std::uint32_t neighbourAbove(std::size_t r, std::uint32_t i) {
    for (std::size_t above = r + 1; above < rows_.size(); ++above) {
      if (rows_[above].elevation - rows_[r].elevation > kMaxElevationGap) break;
      const std::vector<std::uint32_t>& row = rows_[above].points;
      const auto distance = [&](std::size_t k) {
        return std::abs(lidar_.azimuth[row[k]] - lidar_.azimuth[i]);
      };
      std::size_t& k = next_[above - r - 1];
      while (k + 1 < row.size() && distance(k + 1) <= distance(k)) ++k;
      if (distance(k) <= 0.5f * kMaxAzimuthGap) return row[k];
    }
    return kNone;
  }

  bool add(const Triangle& t) {
    if (t[1] == t[2] || std::max({t[0], t[1], t[2]}) == kNone || !onOneSurface(t)) return false;
    triangles_.push_back(t);
    return true;
  }

  bool onOneSurface(const Triangle& t) const {
    const std::vector<float>& d = lidar_.distance;
    const float near = std::min(d[t[0]], std::min(d[t[1]], d[t[2]]));
    return spread(d, t) <= std::max(kMaxRangeStep, kMaxRelativeRangeStep * near) &&
           spread(lidar_.elevation, t) <= kMaxElevationGap &&
           spread(lidar_.azimuth, t) * std::cos(lidar_.elevation[t[0]]) <= kMaxAzimuthGap;
  }

  const View& lidar_;
  const std::vector<Row>& rows_;
  std::vector<std::size_t> next_;  // of the row at hand: where to go on in each row above
  std::vector<Triangle> triangles_;
};

// Nearest surface in each direction from the camera; infinite where there is none.
class DepthImage {
 public:
  DepthImage(const View& camera, const std::vector<Triangle>& triangles) : view_(camera) {
    const auto azimuth = std::minmax_element(view_.azimuth.begin(), view_.azimuth.end());
    const auto elevation = std::minmax_element(view_.elevation.begin(), view_.elevation.end());
    left_ = *azimuth.first;
    bottom_ = *elevation.first;
    depth_.create(cvCeil((*elevation.second - bottom_) / kCell) + 2,
                  cvCeil((*azimuth.second - left_) / kCell) + 2, CV_32FC1);
    depth_.setTo(std::numeric_limits<float>::infinity());
    for (const Triangle& triangle : triangles) draw(triangle);
    // The farthest depth of the neighbourhood: a line of sight must be surrounded by nearer surface.
    cv::dilate(depth_, depth_, cv::Mat());
  }

  float depthAt(std::size_t i) const { return depth_.at<float>(cvRound(row(i)), cvRound(column(i))); }

 private:
  float column(std::size_t i) const { return (view_.azimuth[i] - left_) / kCell; }
  float row(std::size_t i) const { return (view_.elevation[i] - bottom_) / kCell; }

  // A triangle has the distance of its farthest corner.
  void draw(const Triangle& t) {
    if (spread(view_.azimuth, t) > kMaxAppearance || spread(view_.elevation, t) > kMaxAppearance) return;
    const float distance = std::max({view_.distance[t[0]], view_.distance[t[1]], view_.distance[t[2]]});
    const float x[3] = {column(t[0]), column(t[1]), column(t[2])}, y[3] = {row(t[0]), row(t[1]), row(t[2])};
    const auto [left, right] = std::minmax({x[0], x[1], x[2]});
    const auto [bottom, top] = std::minmax({y[0], y[1], y[2]});
    // All cells that the triangle touches: those that it leaves with no side.
    const float turn = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0]);
    const float sign = turn < 0.0f ? -1.0f : 1.0f;
    float along_x[3], along_y[3], constant[3];
    for (int k = 0; k < 3; ++k) {
      const int m = (k + 1) % 3;
      along_x[k] = sign * (y[k] - y[m]);
      along_y[k] = sign * (x[m] - x[k]);
      constant[k] =
          0.5f * (std::abs(along_x[k]) + std::abs(along_y[k])) - along_x[k] * x[k] - along_y[k] * y[k];
    }
    for (int v = cvRound(bottom); v <= cvRound(top); ++v) {
      float* const depth = depth_.ptr<float>(v);
      for (int u = cvRound(left); u <= cvRound(right); ++u) {
        const auto inside = [&](int k) {
          return along_x[k] * static_cast<float>(u) + along_y[k] * static_cast<float>(v) + constant[k] >=
                 0.0f;
        };
        if (inside(0) && inside(1) && inside(2)) depth[u] = std::min(depth[u], distance);
      }
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
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  for (const auto& p : points) middle += p.normalized();
  const Eigen::Vector2f forward = middle.head<2>().normalized();

  const View lidar = viewFrom(Eigen::Vector3f::Zero(), points, forward);
  const View camera = viewFrom(T_camera_lidar.inverse().translation().cast<float>(), points, forward);
  const DepthImage surfaces(camera, Surfaces(lidar, rowsOf(lidar)).triangles());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double distance = camera.distance[i];
    const double gap = std::max(kHiddenGap, kRelativeHiddenGap * distance);
    if (surfaces.depthAt(i) < distance - gap) visible[i] = 0;
  }
  return visible;
}

}  // namespace lidar_camera_recalibration

#include "textbook.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/calib3d.hpp>
#include <random>

namespace textbook {
namespace {

using Points = std::vector<Point>;

struct ProjectedPoint {
  Point point;
  cv::Point pixel;
};

/// Eq. (2), those that lie ahead of the camera and in the image.
std::vector<ProjectedPoint> project(const Frame& frame, const cv::Affine3d& T_camera_lidar) {
  std::vector<Point> ahead;
  std::vector<cv::Point3d> positions;
  for (const Point& point : frame.points) {
    if ((T_camera_lidar * point.position).z <= 0.1) continue;
    ahead.push_back(point);
    positions.push_back(point.position);
  }
  std::vector<ProjectedPoint> projected;
  if (positions.empty()) return projected;
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(positions, T_camera_lidar.rvec(), T_camera_lidar.translation(), frame.K, cv::noArray(),
                    pixels);
  const cv::Rect image(cv::Point(0, 0), frame.masks.front().size());
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const cv::Point pixel(static_cast<int>(std::floor(pixels[i].x + 0.5)),
                          static_cast<int>(std::floor(pixels[i].y + 0.5)));
    if (image.contains(pixel)) projected.push_back({ahead[i], pixel});
  }
  return projected;
}

/// P_i, eq. (3).
Points pointsIn(const cv::Mat& mask, const std::vector<ProjectedPoint>& projected) {
  Points inside;
  for (const ProjectedPoint& p : projected) {
    if (mask.at<std::uint8_t>(p.pixel) != 0) inside.push_back(p.point);
  }
  return inside;
}

/// F_R, eq. (5): by the standard deviation, as the paper's text says; its formula has the variance.
double reflectivityConsistency(const Points& points) {
  const auto n = static_cast<double>(points.size());
  double mean = 0.0;
  for (const Point& p : points) mean += p.reflectivity / n;
  double variance = 0.0;
  for (const Point& p : points) variance += (p.reflectivity - mean) * (p.reflectivity - mean) / n;
  return 1.0 - std::sqrt(variance);
}

/// F_N, eq. (6): mean of |v| over all entries of A^T A.
double normalConsistency(const Points& points) {
  std::vector<cv::Point3d> normals;
  for (const Point& p : points) {
    if (p.normal != cv::Point3d(0.0, 0.0, 0.0)) normals.push_back(p.normal);
  }
  if (normals.empty()) return 0.0;
  double sum = 0.0;
  for (const cv::Point3d& a : normals) {
    for (const cv::Point3d& b : normals) sum += std::abs(a.dot(b));
  }
  return sum / (static_cast<double>(normals.size()) * static_cast<double>(normals.size()));
}

/// F_S, eq. (7) and (8).
double segmentConsistency(const Points& points) {
  constexpr double k = 0.4;
  std::map<int, int> count_of_class;
  for (const Point& p : points) {
    if (p.segment >= 0) ++count_of_class[p.segment];
  }
  std::vector<int> counts;
  for (const auto& class_and_count : count_of_class) counts.push_back(class_and_count.second);
  std::sort(counts.rbegin(), counts.rend());
  double sum = 0.0, C = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    sum += std::pow(k, static_cast<double>(i)) * counts[i];
    C += counts[i];
  }
  return C > 0.0 ? sum / C : 0.0;
}

/// Eq. (9); not below 0, as the formula is for one and two points.
double adjust(double n) { return std::max(0.0, 1.0 - 1.5 * std::pow(n, -0.4)); }

/// An extrinsic turned by a rotation vector [rad] and shifted [m], in the axes of the camera.
cv::Affine3d moved(const cv::Affine3d& T, const cv::Vec3d& rotation, const cv::Vec3d& translation) {
  return cv::Affine3d(rotation, translation) * T;
}

}  // namespace

double score(const std::vector<Frame>& frames, const cv::Affine3d& T_camera_lidar) {
  double sum = 0.0, points = 0.0;
  for (const Frame& frame : frames) {
    const std::vector<ProjectedPoint> projected = project(frame, T_camera_lidar);
    for (const cv::Mat& mask : frame.masks) {
      const Points inside = pointsIn(mask, projected);
      if (inside.empty()) continue;
      const auto n = static_cast<double>(inside.size());
      const double consistency =
          (reflectivityConsistency(inside) + normalConsistency(inside) + segmentConsistency(inside)) / 3.0;
      sum += n * consistency * adjust(n);  // eq. (4), weighted as in eq. (10)
      points += n;
    }
  }
  return points > 0.0 ? sum / points : 0.0;
}

SearchResult search(const std::vector<Frame>& frames, const cv::Affine3d& start, const SearchLimits& limits) {
  SearchResult best{start, score(frames, start), 1};
  const auto enter = [&](const cv::Affine3d& candidate) {
    const double s = score(frames, candidate);
    ++best.evaluations;
    if (s <= best.score) return;
    best.score = s;
    best.T_camera_lidar = candidate;
  };

  const double degree = CV_PI / 180.0;
  const int steps = static_cast<int>(limits.rotation_deg / limits.step_deg);
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      for (int z = -steps; z <= steps; ++z) {
        enter(moved(start, limits.step_deg * degree * cv::Vec3d(x, y, z), {0.0, 0.0, 0.0}));
      }
    }
  }

  std::mt19937_64 random(limits.seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  const auto draw = [&](double range) {
    const double x = uniform(random), y = uniform(random), z = uniform(random);
    return range * cv::Vec3d(x, y, z);
  };
  for (int i = 0; i < limits.random_candidates; ++i) {
    const cv::Vec3d rotation = draw(limits.fine_rotation_deg * degree),
                    translation = draw(limits.fine_translation);
    enter(moved(best.T_camera_lidar, rotation, translation));
  }
  return best;
}

}  // namespace textbook

#include "edge_weights.hpp"

#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr double kCell = 0.3 * kDegree;  // of the grid of directions
constexpr int kCrowd = 3;                // its width and height [cells]
constexpr float kShare = 0.5f;           // of an edge's variance that its crowd has in common

}  // namespace

void shareWeights(EdgePoints& edges) {
  if (edges.size() == 0) return;
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();  // the grid's seam is opposite of it
  for (std::size_t i = 0; i < edges.size(); ++i) {
    middle += Eigen::Vector2d(edges.x[i], edges.y[i]).normalized();
  }
  std::vector<cv::Point> cells;
  cells.reserve(edges.size());
  for (std::size_t i = 0; i < edges.size(); ++i) {
    const double x = edges.x[i], y = edges.y[i];
    const double azimuth = std::atan2(middle.x() * y - middle.y() * x, middle.x() * x + middle.y() * y);
    cells.emplace_back(cvRound(azimuth / kCell), cvRound(std::atan2(edges.z[i], std::hypot(x, y)) / kCell));
  }
  const cv::Rect bounds = cv::boundingRect(cells);
  std::array<cv::Mat, EdgePoints::kKinds> crowds;
  for (cv::Mat& crowd : crowds) crowd = cv::Mat::zeros(bounds.size(), CV_32FC1);
  const auto crowdOf = [&](std::size_t i) -> float& {
    return crowds[static_cast<std::size_t>(edges.kind[i])].at<float>(cells[i] - bounds.tl());
  };
  for (std::size_t i = 0; i < edges.size(); ++i) crowdOf(i) += edges.weight[i];
  for (cv::Mat& crowd : crowds) {
    cv::boxFilter(crowd, crowd, -1, {kCrowd, kCrowd}, {-1, -1}, false, cv::BORDER_CONSTANT);
  }
  for (std::size_t i = 0; i < edges.size(); ++i) edges.weight[i] /= 1.0f + kShare * crowdOf(i);
}

}  // namespace lidar_camera_recalibration

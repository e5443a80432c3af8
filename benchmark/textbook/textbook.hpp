#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/core/affine.hpp>
#include <vector>

/// Calib-Anything as one would write it down from the paper, formula by formula, with no thought of speed:
/// what the package's objective `paper` and search `paper` are compared with, in score and in cost. Equation
/// numbers are those of the paper, counted from its section III. It shares no code with the package.
namespace textbook {

/// Eq. (1).
struct Point {
  cv::Point3d position;  ///< LiDAR frame [m]
  cv::Point3d normal;    ///< unit vector; zero where unknown
  double reflectivity;   ///< 0..1
  int segment;           ///< class; negative if it belongs to none
};

struct Frame {
  cv::Matx33d K;               ///< intrinsics of a camera without distortion
  std::vector<cv::Mat> masks;  ///< M_i: CV_8UC1, non-zero inside, all of the image's size
  std::vector<Point> points;
};

/// The consistency of masks and points over all masks of all frames, eq. (10). Higher is better.
double score(const std::vector<Frame>& frames, const cv::Affine3d& T_camera_lidar);

struct SearchLimits {
  double rotation_deg = 2.5;       ///< brute-force search: +- this about each axis ...
  double step_deg = 1.0;           ///< ... in steps of this
  double fine_rotation_deg = 1.0;  ///< random search: +- this about each axis ...
  double fine_translation = 0.1;   ///< ... and +- this along each axis [m]
  int random_candidates = 4000;
  std::uint64_t seed = 1;
};

struct SearchResult {
  cv::Affine3d T_camera_lidar;
  double score = 0.0;
  int evaluations = 0;
};

/// Section III-C.2: brute-force over rotations, then random candidates around the best.
SearchResult search(const std::vector<Frame>& frames, const cv::Affine3d& start, const SearchLimits& limits);

}  // namespace textbook

#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "lidar_camera_recalibration/objective.hpp"

namespace lidar_camera_recalibration {

/// How far the truth may lie from the start, per axis of the optical frame (+-).
struct SearchRange {
  double rotation_deg = 5.0;
  double translation_m = 0.2;
};

struct SearchConfig {
  /// `coarse_to_fine`: for objective `consistency_edges`, needs none of the numbers below but the threads;
  /// `paper`: brute-force rotation grid, then random refinement
  std::string search = "coarse_to_fine";
  double grid_step_deg = 1.0;     ///< stride of the brute-force rotation search
  int refine_evaluations = 4000;  ///< random candidates of the refinement
  std::uint64_t seed = 1;         ///< same seed and input, same result
  int threads = 2;                ///< does not change the result
};

/// Told about 50 times in a search; return false to cancel it.
using Progress = std::function<bool(double fraction, double best_score)>;

struct SearchResult {
  Eigen::Isometry3d T_camera_lidar = Eigen::Isometry3d::Identity();
  std::size_t evaluations = 0;
  bool cancelled = false;  ///< then T_camera_lidar is the best so far
};

class Search {
 public:
  virtual ~Search() = default;
  virtual SearchResult run(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start,
                           const SearchRange& range, const Progress& progress) const = 0;
  /// Only the last, local part, from a start that is already good. Used to measure how far the result
  /// scatters. Works on the caller's thread, so that several can run side by side.
  virtual SearchResult refine(const Objective& objective, const Frames& frames,
                              const Eigen::Isometry3d& start, const Progress& progress) const = 0;
  /// Whether refine ends at the optimum itself, so that a frame more or less moves its result as it moves the
  /// optimum. A random search only comes near.
  virtual bool refinesExactly() const { return true; }
};

/// @throw Error(kParameter) for an unknown search or numbers out of range.
std::unique_ptr<Search> makeSearch(const SearchConfig& config);

}  // namespace lidar_camera_recalibration

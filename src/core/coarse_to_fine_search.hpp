#pragma once

#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

/// Search for objective `consistency_edges`: a grid over the rotation scored with wide borders, Gauss-Newton
/// with narrowing borders from the best places of it, and the best of the optima. No random numbers.
class CoarseToFineSearch : public Search {
 public:
  /// @throw Error(kParameter)
  explicit CoarseToFineSearch(const SearchConfig& config);

  /// @throw Error(kParameter) if the objective is not `consistency_edges`, Error(kNotEnough) without frames
  /// or edges
  SearchResult run(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start,
                   const SearchRange& range, const Progress& progress) const override;
  SearchResult refine(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start,
                      const Progress& progress) const override;

 private:
  SearchConfig config_;
};

}  // namespace lidar_camera_recalibration

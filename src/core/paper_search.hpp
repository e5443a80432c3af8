#pragma once

#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration {

/// The search of Calib-Anything (section III-C.2): all rotations of a coarse grid, translation kept; then
/// random 6-DoF candidates around the best one, in rounds whose range shrinks.
class PaperSearch : public Search {
 public:
  /// @throw Error(kParameter)
  explicit PaperSearch(const SearchConfig& config);

  SearchResult run(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start,
                   const SearchRange& range, const Progress& progress) const override;
  SearchResult refine(const Objective& objective, const Frames& frames, const Eigen::Isometry3d& start,
                      const Progress& progress) const override;
  bool refinesExactly() const override { return false; }

 private:
  SearchConfig config_;
};

}  // namespace lidar_camera_recalibration

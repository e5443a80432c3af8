#pragma once

#include <cstdint>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"
#include "projection.hpp"

namespace lidar_camera_recalibration {

/// Points in the order of their classes, those without a class first.
struct ClassifiedPoints {
  Places places;
  std::vector<std::size_t> class_end;  ///< the points of class c - 1 end where those of class c begin

  ClassifiedPoints() = default;

  /// @param chosen  indices into `points`
  ClassifiedPoints(const FramePoints& points, const std::vector<std::uint32_t>& chosen);
};

/// What masks and classes of LiDAR points tell about each other: NMI = I(mask; class) / H(mask, class) over
/// the points in the image, 0 = nothing, 1 = each determines the other. The paper's idea, that points in one
/// mask agree in their class, counted in both directions: one mask around everything is as useless as a mask
/// for each point.
///
/// Wide and smooth, but not sharp: it tells good optima of the edges from bad ones.
class RegionInformation {
 public:
  /// @param project  into the image of the masks
  /// @param used     grows by the number of points in the image
  double operator()(const MaskSets& masks, const ClassifiedPoints& points, const Projection& project,
                    std::size_t& used);

 private:
  // Scratch memory, by set of masks; overlapping masks: a set of them counts as a mask of its own.
  std::vector<std::uint32_t> in_class_, in_all_;  ///< points of one class and of all so far
  std::vector<std::uint32_t> touched_;            ///< sets with points of the class
};

}  // namespace lidar_camera_recalibration

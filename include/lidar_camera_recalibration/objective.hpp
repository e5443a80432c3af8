#pragma once

#include <Eigen/Geometry>
#include <memory>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

/// The score of one extrinsic on a set of frames; higher is better.
struct Score {
  double total = 0.0;  ///< what the search maximises
  // Objective `paper`: means over the masks, weighted like the total; 0..1.
  double reflectivity = 0.0;  ///< F_R
  double normal = 0.0;        ///< F_N
  double segment = 0.0;       ///< F_S
  // Objective `consistency_edges`: means over the edges by their weights, and over the frames.
  double edges = 0.0;      ///< LiDAR edges on borders of masks; 0 = chance, 1 = all of them
  double region = 0.0;     ///< normalised mutual information of masks and classes of points, 0..1
  std::size_t points = 0;  ///< points that fell into at least one mask; `consistency_edges`: into the image
  std::size_t masks = 0;  ///< masks that received at least one point; `consistency_edges`: of frames with one
};

struct ObjectiveConfig {
  /// `consistency_edges`: LiDAR edges on the borders of the masks, and classes of points in masks; `paper`:
  /// the consistency score of Calib-Anything
  std::string objective = "consistency_edges";

  // Of `consistency_edges`; 0 leaves a term out.
  double weight_azimuth_gap = 1.0;        ///< steps of the range along a ring
  double weight_ring_gap = 1.0;           ///< steps of the range from ring to ring, which are less exact
  double weight_reflectivity_step = 1.0;  ///< steps of the reflectivity along a ring
  double weight_region = 1.0;             ///< of Score::region beside Score::edges

  // Of `paper`.
  double weight_reflectivity =
      1.0 / 3.0;                      ///< w_R; shared out to the others where a cloud has no reflectivity
  double weight_normal = 1.0 / 3.0;   ///< w_N
  double weight_segment = 1.0 / 3.0;  ///< w_S
};

/// Scores extrinsics on a fixed set of frames. Owns its scratch memory: one evaluator per thread.
class Evaluator {
 public:
  virtual ~Evaluator() = default;
  virtual Score operator()(const Eigen::Isometry3d& T_camera_lidar) = 0;
};

/// Extrinsics that bound what is scored: see Objective::evaluator.
using Views = std::vector<Eigen::Isometry3d>;

/// An objective is a recipe for evaluators.
class Objective {
 public:
  virtual ~Objective() = default;

  /// @param in_view  score only points that lie well inside the image under each of these extrinsics; empty:
  /// all points. Scores
  ///   are means, so without this a candidate could raise its score by moving easy points, road above all,
  ///   into the image instead of bringing points and masks together.
  virtual std::unique_ptr<Evaluator> evaluator(const Frames& frames, const Views& in_view) const = 0;

  /// Whether scores some degrees beside the optimum are chance, ups and downs around one level, so that one
  /// can tell whether an optimum stands out from them. Otherwise the score rises over many degrees.
  virtual bool isPeaked() const { return true; }
};

/// @throw Error(kParameter) for an unknown objective or weights that are negative or all zero.
std::unique_ptr<Objective> makeObjective(const ObjectiveConfig& config);

}  // namespace lidar_camera_recalibration

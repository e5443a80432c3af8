#pragma once

#include <array>
#include <memory>
#include <vector>

#include "boundary_field.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"
#include "projection.hpp"
#include "region_information.hpp"

namespace lidar_camera_recalibration {

/// One step of a least-squares fit around an extrinsic T, in the perturbation xi of extrinsic.hpp: the cost
/// of exp(xi) * T is about cost + 2 b^T xi + xi^T H xi.
struct Linearisation {
  Matrix6d H = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  double cost = 0.0;
};

/// How well the LiDAR's edges lie on the borders of the masks, and masks on classes of points. Nothing
/// changes after construction: one evaluator serves all threads.
class ConsistencyEdgesEvaluator : public Evaluator {
 public:
  /// Edges that are drawn to borders of one direction.
  struct Edges {
    Places places;
    std::vector<float> weight;

    std::size_t size() const { return weight.size(); }
    void add(float x, float y, float z, float edge_weight);
  };

  /// What is scored of a frame.
  struct View {
    FramePtr frame;
    std::array<Edges, BoundaryField::kDirections> edges;
    ClassifiedPoints points;  ///< for the region term

    const Intrinsics& camera() const { return frame->camera.intrinsics(); }
  };

  /// The level of Score::edges: fine enough for the optimum to be right, wide enough to tell two places
  /// apart.
  static constexpr std::size_t kScoreLevel = 2;

  ConsistencyEdgesEvaluator(std::vector<View> views, double region_weight);

  /// total = edges + region weight * region. `points` = points in the image, `masks` = masks of frames that
  /// have some there.
  Score operator()(const Eigen::Isometry3d& T_camera_lidar) override;

  /// S = mean of BoundaryField::closeness at the projected edges, by their weights; about -0.1..1, higher is
  /// better, 0 = chance.
  /// @param level  of kBoundaryWidths, below kScoreLevels
  double edgeScore(const Eigen::Isometry3d& T_camera_lidar, std::size_t level) const;

  /// Of the cost sum_i w_i (1 - exp(-r_i^2 / 2 sigma^2)), r the angle between an edge and the line of its
  /// nearest border: edges further away than some sigma have no say. Gauss-Newton with these weights held
  /// fixed; b is exact while the nearest borders stay the same.
  Linearisation linearise(const Eigen::Isometry3d& T_camera_lidar, std::size_t level) const;

  /// With about `count` of the edges, spread evenly, and without the region term: what a coarse search needs.
  ConsistencyEdgesEvaluator thinned(std::size_t count) const;

  std::size_t edgeCount() const { return edge_count_; }

 private:
  std::vector<View> views_;
  double region_weight_;
  std::size_t edge_count_ = 0;
  double weight_ = 0.0;
};

/// The paper's idea, that what falls into one mask belongs together, by what is sharpest: LiDAR edges on the
/// borders of the masks. The agreement of masks and classes inside adds the wide basin.
class ConsistencyEdgesObjective : public Objective {
 public:
  explicit ConsistencyEdgesObjective(const ObjectiveConfig& config);

  /// @throw Error(kParameter) for frames made without edges (FrameConfig::edges)
  std::unique_ptr<Evaluator> evaluator(const Frames& frames, const Views& in_view) const override;

 private:
  std::array<float, EdgePoints::kKinds> edge_weights_;
  double region_weight_;
};

}  // namespace lidar_camera_recalibration

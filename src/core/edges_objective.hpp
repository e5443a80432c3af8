#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "boundary_field.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"

namespace lidar_camera_recalibration {

/// One step of a least-squares fit around an extrinsic T, in the perturbation xi of extrinsic.hpp: the cost
/// of exp(xi) * T is about cost + 2 b^T xi + xi^T H xi.
struct Linearisation {
  Matrix6d H = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  double cost = 0.0;
};

/// How well the LiDAR's edges lie on the borders of the masks. Nothing changes after construction: one
/// evaluator serves all threads.
class EdgeEvaluator : public Evaluator {
 public:
  struct View {
    std::shared_ptr<const BoundaryField> field;
    FramePtr frame;
    std::vector<std::size_t> chosen;  ///< edges to be scored
  };

  /// The level of Score::total: fine enough for the optimum to be right, wide enough to tell two places
  /// apart.
  static constexpr std::size_t kScoreLevel = 2;

  explicit EdgeEvaluator(std::vector<View> views);

  /// total = score(T, kScoreLevel); `points` = edges in the image, `masks` = masks of the frames that have
  /// some. The paper's terms stay 0.
  Score operator()(const Eigen::Isometry3d& T_camera_lidar) override;

  /// S = mean of BoundaryField::closeness at the projected edges, by their weights; about -0.1..1, higher is
  /// better, 0 = chance.
  /// @param level  of kBoundaryWidths
  double score(const Eigen::Isometry3d& T_camera_lidar, std::size_t level) const;

  /// Of the cost sum_i w_i (1 - exp(-D_i^2 / 2 sigma^2)), D the angle to the nearest border: edges further
  /// away than some sigma have no say. Gauss-Newton with these weights held fixed; b is exact.
  Linearisation linearise(const Eigen::Isometry3d& T_camera_lidar, std::size_t level) const;

  std::size_t edgeCount() const { return edge_count_; }

 private:
  std::vector<View> views_;
  std::size_t edge_count_ = 0;
  double weight_ = 0.0;
};

/// LiDAR edges against the borders of the masks; in the place of the paper's consistency. Makes each frame's
/// BoundaryField when it is first needed and keeps it as long as the frame lives.
class EdgesObjective : public Objective {
 public:
  std::unique_ptr<Evaluator> evaluator(const Frames& frames, const Views& in_view) const override;

 private:
  std::shared_ptr<const BoundaryField> field(const FramePtr& frame) const;

  mutable std::mutex mutex_;
  using WeakFrame = std::weak_ptr<const Frame>;
  mutable std::map<WeakFrame, std::shared_ptr<const BoundaryField>, std::owner_less<WeakFrame>> fields_;
};

}  // namespace lidar_camera_recalibration

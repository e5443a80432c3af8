#pragma once

#include <vector>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/objective.hpp"

namespace lidar_camera_recalibration {

/// The consistency score of Calib-Anything. Equation numbers are those of the paper, counted from its section
/// III.

/// Reflectivity consistency, eq. (5): 1 - standard deviation. The paper prints the variance but calls it
/// standard deviation, and that is what its authors' implementation computes.
double reflectivityConsistency(double sum, double sum_of_squares, double n);

/// Segment consistency, eq. (7): point counts of the classes, in any order; sorted in place.
double segmentConsistency(std::vector<std::uint32_t>& counts);

/// Adjusting function, eq. (9): f(n) = 1 - 1.5 n^-0.4, here never below 0 (the formula is negative for n < 3,
/// where there is nothing to agree or disagree about).
double adjust(double n);

/// Normal consistency, eq. (6): the mean absolute dot product over all pairs of normals, in O(n) instead of
/// O(n^2).
///
/// Each normal is folded to the side of its bin on a hemisphere of Fibonacci directions; a bin keeps the
/// vector sum S_b of its normals. Then sum_ij |n_i . n_j| ~ sum_ab |S_a . S_b|: exact within a bin, a lower
/// bound across bins, since only pairs of bins that straddle 90 degrees mix signs. Mean error on real masks
/// about 6e-4.
class NormalBins {
 public:
  static constexpr int kCount = 96;

  /// The bin of a unit normal; `normal` is flipped to the bin's side.
  static int fold(Eigen::Vector3f& normal);

  /// @param sums  kCount vectors S_b, @param n number of normals in them
  static double consistency(const Eigen::Vector3f* sums, double n);
};

class PaperObjective : public Objective {
 public:
  /// @throw Error(kParameter) for weights that are negative or all zero
  explicit PaperObjective(const ObjectiveConfig& config);
  std::unique_ptr<Evaluator> evaluator(const Frames& frames, const Views& in_view) const override;
  bool isPeaked() const override { return false; }

 private:
  ObjectiveConfig config_;
};

}  // namespace lidar_camera_recalibration

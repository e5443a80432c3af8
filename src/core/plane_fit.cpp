#include "plane_fit.hpp"

#include <Eigen/Eigenvalues>

namespace lidar_camera_recalibration {
namespace {

// Points whose second principal variance is below this share of the first one lie on a line: they fit any
// plane through it. Rounding of single precision alone makes 1e-6.
constexpr double kLineRatio = 1e-5;

}  // namespace

PlaneFit fitPlane(double count, const Eigen::Vector3d& sum, const Eigen::Matrix3d& products) {
  const Eigen::Vector3d mean = sum / count;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(products - sum * mean.transpose());
  const Eigen::Vector3d variances = solver.eigenvalues();  // ascending
  if (!(variances[1] > kLineRatio * variances[2])) return {mean, Eigen::Vector3d::Zero(), 0.0};
  return {mean, solver.eigenvectors().col(0), variances[1] / variances[2]};
}

}  // namespace lidar_camera_recalibration

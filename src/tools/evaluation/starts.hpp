#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <random>
#include <string>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/search.hpp"

namespace lidar_camera_recalibration::evaluation {

/// How wrong the starts of the trials are: exp(xi) * reference with a random xi.
struct Start {
  std::string name;
  Vector6d limits = Vector6d::Zero();  ///< xi is uniform in +- these [rad, m] ...
  std::optional<int> fixed_axis;       ///< ... but on this axis it is plus or minus the limit itself

  /// What contains all starts: the search range that a user who knows the limits would give.
  SearchRange range() const;

  /// Draws six numbers whatever the start, so that trials of one number are comparable.
  Eigen::Isometry3d draw(const Eigen::Isometry3d& reference, std::mt19937_64& random) const;
};

/// @param word  `E1`, `E2`, `E3` (+-1 deg and +-5 cm on each axis, +-2.5 and +-10, +-5 and +-20);
///              `R T`: +-R deg and +-T m; `AXIS=VALUE` with rx, ry, rz [deg] or tx, ty, tz [m]: off by
///              exactly VALUE on this axis and by E1 on the others
/// @throw Error(kParameter) naming the word
Start parseStart(const std::string& word);

}  // namespace lidar_camera_recalibration::evaluation

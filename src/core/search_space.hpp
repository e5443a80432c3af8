#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration {

// What all searches share: where they look, and what they need.

/// All combinations of -n..n steps [rad] about the three axes of the optical frame; the camera turns, so the
/// translation of `start` turns with it.
std::vector<Eigen::Isometry3d> rotationGrid(const Eigen::Isometry3d& start, int n, double step);

/// The translation that `start` would have after the rotation of T alone: the extrinsic turns about the
/// camera.
Eigen::Vector3d turnedTranslation(const Eigen::Isometry3d& T, const Eigen::Isometry3d& start);

/// T with its translation brought back to at most `limit` [m] on each axis from turnedTranslation(): the user
/// said how far off it can be.
Eigen::Isometry3d withLimitedTranslation(Eigen::Isometry3d T, const Eigen::Isometry3d& start, double limit);

/// @throw Error(kNotEnough) without a frame
void requireFrames(const Frames& frames);

/// @throw Error(kParameter) if the number of threads makes no sense
void requireThreads(int threads);

}  // namespace lidar_camera_recalibration

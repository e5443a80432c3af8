#pragma once

#include <vector>

namespace lidar_camera_recalibration {

/// When the points of a cloud were taken, after its stamp [s], from what its driver wrote.
///
/// Drivers write s, ms, us or ns, as offsets from the stamp or as absolute times, and no field says which.
/// The unit is the one in which the cloud took 2 ms to 1 s; units are a factor of 1000 apart, so there is one
/// at most. Up to 1 s from 0 are offsets, up to 1 s from the stamp are absolute times.
/// @return one for each point; empty if the numbers are neither: all alike, not finite, of another clock, or
/// single precision that cannot hold an absolute time.
std::vector<float> secondsAfter(double stamp, const std::vector<double>& raw);

}  // namespace lidar_camera_recalibration

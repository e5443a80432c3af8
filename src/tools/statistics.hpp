#pragma once

#include <vector>

namespace lidar_camera_recalibration {

// All of them: NaN without values.

double mean(const std::vector<double>& values);

/// Linear between the order statistics; 0.5 is the median.
double quantile(std::vector<double> values, double fraction);

/// Huber's M-estimate of location: the mean with values further than 1.345 robust standard deviations (from
/// the median absolute deviation) weighed down. Same unit as the values. This is how the column "Huber" of
/// the paper's table is read: a Huber *loss* could not be larger than the mean norm beside it, as it is in
/// one of its rows.
double huberMean(const std::vector<double>& values);

}  // namespace lidar_camera_recalibration

#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "dataset.hpp"
#include "lidar_camera_recalibration/point_cloud.hpp"

namespace lidar_camera_recalibration::evaluation {

/// A frame as it comes from the disk; prepared anew in each trial.
struct Input {
  std::string name;
  double stamp = 0.0;  ///< [s]
  cv::Mat image;
  std::vector<cv::Mat> layers;
  PointCloud cloud;
};

/// Which frames of a dataset, and how much of their clouds.
struct InputChoice {
  std::string frame_set = "all";  ///< `all`, or the frames at `even` or `odd` positions
  int every_ring = 1;             ///< see keepEveryRing
  std::string masks = "given";    ///< or spoilt, see spoilMasks
};

/// @throw Error(kFile, kMasks, kCloud) naming the frame
std::vector<Input> readInputs(const Dataset& dataset, const InputChoice& choice);

/// What a segmenter or a driver may get wrong: of each image only the 6 `largest` masks stay; `garbage` takes
/// their place, ellipses at random; or each image gets the masks of `another` one, half the dataset away.
/// @throw Error(kParameter) for other words
void spoilMasks(const std::string& how, std::vector<Input>& inputs);

/// The cloud of a LiDAR with fewer beams: of the rings, lowest first, the first of each `step` stays. Rings
/// are then numbered from below. Nothing changes for a step of 1.
/// @throw Error(kCloud) if the cloud's rings cannot be told apart
PointCloud keepEveryRing(const PointCloud& cloud, int step);

}  // namespace lidar_camera_recalibration::evaluation

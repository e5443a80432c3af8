#include "evaluation/prepare.hpp"

#include <cstdio>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration::evaluation {

Frames prepareAll(const std::vector<Input>& inputs, const Camera& camera, const Eigen::Isometry3d& guess,
                  const FrameConfig& config) {
  Frames frames;
  for (const Input& input : inputs) {
    try {
      frames.push_back(makeFrame(input.stamp, camera, input.image, input.layers, input.cloud, guess, config));
    } catch (const Error& error) {
      std::fprintf(stderr, "left out: %s: %s\n", input.name.c_str(), error.what());
    }
  }
  if (frames.empty()) throw Error(ErrorCause::kNotEnough, "no frame can be used");
  return frames;
}

}  // namespace lidar_camera_recalibration::evaluation

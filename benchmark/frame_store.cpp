#include "frame_store.hpp"

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration::performance {

Frames FrameStore::frames(const std::string& name, std::size_t count) {
  const Source& source = this->source(name);
  if (count > source.size()) {
    throw Error(ErrorCause::kNotEnough, name + " has only " + std::to_string(source.size()) + " of " +
                                            std::to_string(count) + " frames");
  }
  Frames& frames = frames_[name];
  while (frames.size() < count) {
    frames.push_back(prepare(source, source.frame(frames.size()), source.T_camera_lidar()));
  }
  return Frames(frames.begin(), frames.begin() + static_cast<std::ptrdiff_t>(count));
}

FramePtr prepare(const Source& source, const RawFrame& frame, const Eigen::Isometry3d& guess,
                 const FrameConfig& config) {
  return makeFrame(0.0, source.camera(), frame.image, frame.layers, frame.cloud, guess, config);
}

}  // namespace lidar_camera_recalibration::performance

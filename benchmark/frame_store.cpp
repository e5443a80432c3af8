#include "frame_store.hpp"

#include <numeric>

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
    const RawFrame raw = source.frame(frames.size());
    frames.push_back(prepare(source, raw, source.T_camera_lidar()));
    cloud_sizes_[name].push_back(raw.cloud.size());
  }
  return Frames(frames.begin(), frames.begin() + static_cast<std::ptrdiff_t>(count));
}

std::size_t FrameStore::cloudPoints(const std::string& name, std::size_t count) {
  frames(name, count);
  const auto& sizes = cloud_sizes_[name];
  return std::accumulate(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(count), std::size_t{0});
}

FramePtr prepare(const Source& source, const RawFrame& frame, const Eigen::Isometry3d& guess,
                 const FrameConfig& config) {
  return makeFrame(0.0, source.camera(), frame.image, frame.layers, frame.cloud, guess, config);
}

}  // namespace lidar_camera_recalibration::performance

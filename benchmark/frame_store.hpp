#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "inputs.hpp"
#include "lidar_camera_recalibration/frame.hpp"

namespace lidar_camera_recalibration::performance {

/// Inputs and prepared frames that several measurements share, made when they are first asked for.
class FrameStore {
 public:
  /// @param sources  by name
  explicit FrameStore(std::map<std::string, std::shared_ptr<const Source>> sources)
      : sources_(std::move(sources)) {}

  const Source& source(const std::string& name) const { return *sources_.at(name); }
  bool has(const std::string& name) const { return sources_.count(name) > 0; }

  /// The first `count` frames of a source, prepared around its true extrinsic.
  Frames frames(const std::string& name, std::size_t count);

  /// Points of the clouds that these frames were made from.
  std::size_t cloudPoints(const std::string& name, std::size_t count);

 private:
  std::map<std::string, std::shared_ptr<const Source>> sources_;
  std::map<std::string, Frames> frames_;
  std::map<std::string, std::vector<std::size_t>> cloud_sizes_;
};

/// `frame` prepared as on a vehicle that believes in `guess`.
FramePtr prepare(const Source& source, const RawFrame& frame, const Eigen::Isometry3d& guess,
                 const FrameConfig& config = {});

}  // namespace lidar_camera_recalibration::performance

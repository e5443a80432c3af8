#pragma once

#include <memory>
#include <string>
#include <vector>

#include "frame_store.hpp"
#include "measurement.hpp"

namespace lidar_camera_recalibration::performance {

/// `evaluation/...`: scoring one candidate on the first `frames` frames of a source, and the floor under it.
void addEvaluation(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                   const std::string& source, std::size_t frames, const std::vector<std::size_t>& threads);

/// `preparation/...`: makeFrame on the first frame of a source; its stages, each on what the one before left.
void addPreparation(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                    const std::string& source, bool stages);

}  // namespace lidar_camera_recalibration::performance

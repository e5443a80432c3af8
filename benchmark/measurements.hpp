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

/// `side_by_side/...`: score and search of the paper, by this package and by the textbook.
void addSideBySide(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                   const std::string& source, std::size_t frames);

/// How far off a recalibration starts, and its search range.
struct StartError {
  double rotation_deg, translation_m;
};

/// `recalibration/...`: calibrate() with the default configuration.
void addRecalibration(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
                      const std::string& source, std::size_t frames, const StartError& start, int threads);

/// `memory/...`: nothing is timed; what frames, evaluators and a calibration hold. Right only as the first
/// measurement of a process.
void addMemory(Measurements& measurements, const std::shared_ptr<FrameStore>& store,
               const std::string& source, std::size_t frames);

}  // namespace lidar_camera_recalibration::performance

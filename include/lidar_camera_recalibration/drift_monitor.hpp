#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <deque>
#include <string>
#include <vector>

#include "lidar_camera_recalibration/objective.hpp"

namespace lidar_camera_recalibration {

struct DriftConfig {
  // An extrinsic is off if its rotation or its translation is off by more than that.
  double rotation_tolerance_deg = 0.3;
  double translation_tolerance_m = 0.05;
  int window = 10;  ///< so many frames, the newest ones, are judged together
};

/// What some frames say about an extrinsic.
struct DriftVerdict {
  std::size_t frames = 0;    ///< 0: nothing is known
  double statistic = 0.0;    ///< gain of the best place around it, see DriftMonitor; -1..1
  double probability = 0.0;  ///< that it is off by more than the tolerance, if both were as likely before

  enum class State { kUnknown, kFits, kDoubtful, kOff };
  State state() const;
};

/// Watches the extrinsic in use: does another one, of a fixed pattern around it, score better? Of the frames
/// it keeps their scores only.
class DriftMonitor {
 public:
  /// @throw Error(kParameter) for tolerances or a window that are not above 0
  explicit DriftMonitor(const DriftConfig& config);

  /// The next frame. Those that were seen under another extrinsic are forgotten.
  /// @param evaluator  of this frame alone; of objective `consistency_edges`, others cannot tell
  /// @param keep  into the window; false for a frame that shows what another one showed, or shows it badly
  /// @return what this frame alone says
  DriftVerdict add(const Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar, bool keep = true);

  /// What the frames of the window say together about an extrinsic; nothing if they were seen under another
  /// one.
  DriftVerdict window(const Eigen::Isometry3d& T_camera_lidar) const;

  void reset() { frames_.clear(); }

  /// Of a frame, weighted by its edges: at an extrinsic itself, then at the places around it.
  using Scores = std::vector<double>;
  /// Empty if the evaluator cannot tell.
  Scores score(const Evaluator& evaluator, const Eigen::Isometry3d& T_camera_lidar) const;
  /// What frames say together, all at the same extrinsic.
  static DriftVerdict judge(const std::vector<Scores>& frames);

 private:
  std::size_t window_;
  std::vector<Eigen::Isometry3d> pattern_;
  Eigen::Isometry3d T_camera_lidar_ = Eigen::Isometry3d::Identity();  ///< of frames_
  std::deque<Scores> frames_;
};

/// In a sentence, for people.
std::string describe(const DriftVerdict& verdict, const DriftConfig& config);

}  // namespace lidar_camera_recalibration

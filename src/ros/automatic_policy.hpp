#pragma once

#include <optional>

#include "lidar_camera_recalibration/drift_monitor.hpp"

namespace lidar_camera_recalibration {

/// Mode `automatic`: when does a drift start a search? A pure function of probabilities, times and what
/// happened before; knows neither clock nor frames.
///
/// It cannot oscillate: a drift counts after several frames in a row, searches keep a distance, which doubles
/// from search to search until the extrinsic is found to fit, and after a restore nothing starts before that.
class AutomaticPolicy {
 public:
  /// @param min_interval  between the end of a search and the next one [s]
  explicit AutomaticPolicy(double min_interval) : min_interval_(min_interval), interval_(min_interval) {}

  /// After each frame that was judged.
  /// @param drift  what a full window of frames says: kOff confirms a drift, kFits ends it
  /// @param time   of the frame [s]
  /// @return whether a search is to start
  bool judge(DriftVerdict::State drift, double time);
  /// A search has ended, whoever asked for it and whatever came out.
  void searchEnded();
  /// Somebody took a result back: he knows better, until the extrinsic is found to fit.
  void restored() { armed_ = false; }

  /// Since when the extrinsic does not seem to fit [s]. Frames before that may show another extrinsic.
  std::optional<double> doubtfulSince() const { return doubtful_since_; }

 private:
  double min_interval_, interval_;
  bool armed_ = true;
  int confirmations_ = 0;  ///< frames in a row
  double last_time_ = 0.0;
  std::optional<double> doubtful_since_;
  std::optional<double> not_before_;
};

}  // namespace lidar_camera_recalibration

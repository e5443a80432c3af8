#include "automatic_policy.hpp"

#include <algorithm>

namespace lidar_camera_recalibration {
namespace {

constexpr int kConfirmations = 3;
constexpr double kMaxBackOff = 32.0;  ///< times the interval

}  // namespace

bool AutomaticPolicy::judge(DriftVerdict::State drift, double time) {
  // A bag that starts again: what was to be waited for counts from now on.
  if (time < last_time_ && not_before_) not_before_ = time + interval_;
  if (time < last_time_ && doubtful_since_) doubtful_since_ = time;
  last_time_ = time;
  if (drift == DriftVerdict::State::kUnknown) return false;
  if (drift == DriftVerdict::State::kFits) {
    armed_ = true;
    interval_ = min_interval_;
    doubtful_since_.reset();
  } else if (!doubtful_since_) {
    doubtful_since_ = time;
  }
  confirmations_ = drift == DriftVerdict::State::kOff ? confirmations_ + 1 : 0;
  if (!armed_ || confirmations_ < kConfirmations || (not_before_ && time < *not_before_)) return false;
  confirmations_ = 0;
  return true;
}

void AutomaticPolicy::searchEnded() {
  not_before_ = last_time_ + interval_;
  interval_ = std::min(2.0 * interval_, kMaxBackOff * min_interval_);
  confirmations_ = 0;
}

}  // namespace lidar_camera_recalibration

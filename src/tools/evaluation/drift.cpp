#include "evaluation/drift.hpp"

#include <algorithm>
#include <cstdio>
#include <ctime>
#include <numeric>
#include <random>
#include <sstream>

#include "command_line.hpp"
#include "evaluation/prepare.hpp"
#include "evaluation/trials.hpp"
#include "lidar_camera_recalibration/drift_monitor.hpp"
#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

constexpr double kAngles[] = {0.1,  0.15, 0.2, 0.25, 0.3, 0.35, 0.4,
                              0.45, 0.5,  0.6, 0.7,  1.0, 2.0,  4.0};  // [deg]
constexpr int kAxesOfAngle = 18;
constexpr double kDistances[] = {0.03, 0.05, 0.07, 0.1, 0.15, 0.2};  // [m]
// What the probability is fitted to: as often as not off by more than the default tolerances.
constexpr int kRandomOffsets = 160;
constexpr double kMostRotation = 1.0 * kDegree, kMostTranslation = 0.2, kShareOfMoved = 0.75;

struct Offset {
  const char* name;
  Vector6d xi;
};

std::vector<Offset> makeOffsets(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const auto direction = [&] {
    Eigen::Vector3d d;
    for (double& value : d) value = normal(random);
    return Eigen::Vector3d(d.normalized());
  };
  std::vector<Offset> offsets = {{"none", Vector6d::Zero()}};
  const auto add = [&](const char* name, const Eigen::Vector3d& rotation,
                       const Eigen::Vector3d& translation) {
    Vector6d xi;
    xi << rotation, translation;
    offsets.push_back({name, xi});
  };
  for (const double angle : kAngles) {
    for (int i = 0; i < kAxesOfAngle; ++i) {  // both ways about x, y, z, then about random axes
      const Eigen::Vector3d axis =
          i < 6 ? Eigen::Vector3d((i % 2 == 0 ? 1.0 : -1.0) * Eigen::Vector3d::Unit(i / 2)) : direction();
      add("rotation", angle * kDegree * axis, Eigen::Vector3d::Zero());
    }
  }
  for (const double distance : kDistances) {
    for (const double side : {-1.0, 1.0})
      add("sideways", Eigen::Vector3d::Zero(), side * distance * Eigen::Vector3d::UnitX());
  }
  const auto amount = [&](double most) {
    const double share = uniform(random);
    return uniform(random) < kShareOfMoved ? most * share : 0.0;
  };
  for (int i = 0; i < kRandomOffsets; ++i) {
    const double angle = amount(kMostRotation), distance = amount(kMostTranslation);
    const Eigen::Vector3d axis = direction();
    add("random", angle * axis, distance * direction());
  }
  return offsets;
}

/// Row by row.
void addWindows(const Offset& offset, const std::vector<DriftMonitor::Scores>& frames,
                const std::vector<int>& frame_counts, int windows, std::mt19937_64& random,
                std::ostringstream& out) {
  for (const int count : frame_counts) {
    const std::size_t size =
        count == kAllFrames ? frames.size() : std::min<std::size_t>(count, frames.size());
    for (int window = 0; window < windows; ++window) {
      std::vector<DriftMonitor::Scores> chosen;
      std::sample(frames.begin(), frames.end(), std::back_inserter(chosen), size, random);
      const DriftVerdict verdict = DriftMonitor::judge(chosen);
      out << offset.name << ',' << offset.xi.head<3>().norm() / kDegree << ',' << offset.xi.tail<3>().norm()
          << ',' << verdict.frames << ',' << verdict.statistic << ',' << verdict.probability << '\n';
    }
  }
}

}  // namespace

std::string driftWindows(const Method& method, const std::vector<Input>& inputs, const Camera& camera,
                         const Eigen::Isometry3d& reference, const std::vector<int>& frame_counts,
                         int windows, std::uint64_t seed) {
  const Frames frames = prepareAll(inputs, camera, reference, method.config.frame);
  const auto objective = makeObjective(method.config.calibrator.objective);
  const DriftMonitor monitor(method.config.monitor);
  std::vector<std::unique_ptr<Evaluator>> evaluators;
  for (const FramePtr& frame : frames) evaluators.push_back(objective->evaluator({frame}, {}));

  std::mt19937_64 random(seed);
  const std::vector<Offset> offsets = makeOffsets(random);
  std::ostringstream out;
  out.precision(9);
  out << "offset,rotation_deg,translation_m,frames,statistic,probability\n";
  ProgressBar progress;
  const std::clock_t before = std::clock();
  for (std::size_t i = 0; i < offsets.size(); ++i) {
    progress.show("drift", double(i) / double(offsets.size()));
    std::vector<DriftMonitor::Scores> scores;
    for (const auto& evaluator : evaluators) {
      scores.push_back(monitor.score(*evaluator, exp(offsets[i].xi) * reference));
      if (scores.back().empty())
        throw Error(ErrorCause::kParameter,
                    "--monitor: method '" + method.name + "' has no edges; take one with consistency_edges");
    }
    addWindows(offsets[i], scores, frame_counts, windows, random, out);
  }
  progress.show("drift", 1.0);
  const double seconds = double(std::clock() - before) / CLOCKS_PER_SEC;
  std::printf("%zu frames, %.2f ms of CPU a frame\n", frames.size(),
              1e3 * seconds / double(offsets.size() * frames.size()));
  return out.str();
}

}  // namespace lidar_camera_recalibration::evaluation

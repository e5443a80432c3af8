#include "evaluation/slices.hpp"

#include <array>
#include <cstdio>
#include <sstream>
#include <utility>

#include "command_line.hpp"
#include "evaluation/prepare.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/objective.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

/// The columns. A new term of Score gets its line here.
constexpr std::pair<const char*, double Score::*> kFigures[] = {
    {"total", &Score::total},   {"reflectivity", &Score::reflectivity},
    {"normal", &Score::normal}, {"segment", &Score::segment},
    {"edges", &Score::edges},   {"region", &Score::region},
};

constexpr std::array<const char*, 6> kAxes = {"rx", "ry", "rz", "tx", "ty", "tz"};
constexpr double kRotation = 2.0, kTranslation = 0.4;  ///< [deg], [m], to both sides
constexpr int kSteps = 20;                             ///< to each side

/// The reference moved along an axis by a part of the whole way.
Eigen::Isometry3d moved(const Eigen::Isometry3d& reference, int axis, double part) {
  Vector6d xi = Vector6d::Zero();
  xi[axis] = part * (axis < 3 ? kRotation * kDegree : kTranslation);
  return exp(xi) * reference;
}

void addSlice(const std::string& method, int axis, const Objective& objective, const Frames& frames,
              const Eigen::Isometry3d& reference, std::ostringstream& out) {
  // The same points along the whole slice, as in a search.
  const auto evaluator =
      objective.evaluator(frames, {moved(reference, axis, -1.0), moved(reference, axis, 1.0)});
  for (int step = -kSteps; step <= kSteps; ++step) {
    const double part = double(step) / kSteps;
    const Score score = (*evaluator)(moved(reference, axis, part));
    out << method << ',' << kAxes[axis] << ',' << part * (axis < 3 ? kRotation : kTranslation) << ','
        << (axis < 3 ? "deg" : "m");
    for (const auto& [name, figure] : kFigures) out << ',' << score.*figure;
    out << '\n';
  }
}

}  // namespace

std::string scoreSlices(const std::vector<Method>& methods, const std::vector<Input>& inputs,
                        const Camera& camera, const Eigen::Isometry3d& reference) {
  std::ostringstream out;
  out.precision(9);
  out << "method,axis,offset,unit";
  for (const auto& [name, figure] : kFigures) out << ',' << name;
  out << '\n';
  ProgressBar progress;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Method& method = methods[m];
    const Frames frames = prepareAll(inputs, camera, reference, method.config.frame);
    const auto objective = makeObjective(method.config.calibrator.objective);
    for (int axis = 0; axis < 6; ++axis) {
      progress.show("slices", (double(m) + axis / 6.0) / double(methods.size()));
      addSlice(method.name, axis, *objective, frames, reference, out);
    }
  }
  progress.show("slices", 1.0);
  return out.str();
}

}  // namespace lidar_camera_recalibration::evaluation

#include "evaluation/starts.hpp"

#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration::evaluation {

namespace {

constexpr double kMaxRotation = 45.0;    ///< [deg], as of parameter search_range/rotation_deg
constexpr double kMaxTranslation = 5.0;  ///< [m], as of search_range/translation_m

const std::map<std::string, int> kAxes = {{"rx", 0}, {"ry", 1}, {"rz", 2}, {"tx", 3}, {"ty", 4}, {"tz", 5}};

/// Of the same size on all axes. [deg], [m]
Vector6d box(double rotation, double translation) {
  Vector6d limits;
  limits << Eigen::Vector3d::Constant(rotation * kDegree), Eigen::Vector3d::Constant(translation);
  return limits;
}

const std::map<std::string, Vector6d>& namedBoxes() {
  static const std::map<std::string, Vector6d> boxes = {
      {"E1", box(1.0, 0.05)}, {"E2", box(2.5, 0.1)}, {"E3", box(5.0, 0.2)}};
  return boxes;
}

/// The numbers of a text; empty if there is anything else in it.
std::vector<double> numbers(const std::string& text) {
  std::istringstream words(text);
  std::vector<double> values;
  for (double value = 0.0; words >> value;) values.push_back(value);
  return words.eof() ? values : std::vector<double>();
}

bool inLimits(double value, double limit) { return value >= 0.0 && value <= limit; }

}  // namespace

SearchRange Start::range() const {
  // A start at the limit itself would have the truth on the border of the range, which the gate refuses.
  const double margin = fixed_axis ? 1.1 : 1.0;
  return {margin * limits.head<3>().maxCoeff() / kDegree, margin * limits.tail<3>().maxCoeff()};
}

Eigen::Isometry3d Start::draw(const Eigen::Isometry3d& reference, std::mt19937_64& random) const {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Vector6d xi;
  for (int i = 0; i < 6; ++i) {
    const double value = uniform(random);
    xi[i] = limits[i] * (fixed_axis == i ? std::copysign(1.0, value) : value);
  }
  return exp(xi) * reference;
}

Start parseStart(const std::string& word) {
  const auto named = namedBoxes().find(word);
  if (named != namedBoxes().end()) return {word, named->second, std::nullopt};
  const std::size_t equals = word.find('=');
  const std::vector<double> values = numbers(equals == std::string::npos ? word : word.substr(equals + 1));
  if (equals == std::string::npos && values.size() == 2 && inLimits(values[0], kMaxRotation) &&
      inLimits(values[1], kMaxTranslation)) {
    return {word, box(values[0], values[1]), std::nullopt};
  }
  const auto axis = kAxes.find(word.substr(0, equals));
  if (axis != kAxes.end() && values.size() == 1) {
    const bool turns = axis->second < 3;
    Start start{word, namedBoxes().at("E1"), axis->second};
    start.limits[axis->second] = turns ? values[0] * kDegree : values[0];
    if (inLimits(values[0], turns ? kMaxRotation : kMaxTranslation)) return start;
  }
  throw Error(
      ErrorCause::kParameter,
      "--start " + word +
          ": must be E1, E2, E3, \"R T\" (0 to 45 deg, 0 to 5 m on each axis), or AXIS=VALUE with an axis of "
          "rx, ry, rz [deg], tx, ty, tz [m]");
}

}  // namespace lidar_camera_recalibration::evaluation

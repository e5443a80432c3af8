#include "slices.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <vector>

#include "html.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr int kSteps = 30;                                   // to each side
constexpr double kRotationDeg = 2.0, kTranslationCm = 30.0;  // to each side

struct Axis {
  const char *name, *unit;
  double reach;  ///< to each side, in the unit
  double si;     ///< of one unit [rad, m]
};
constexpr std::array<Axis, 6> kAxes = {Axis{"Pitch, about x (right)", "\u00b0", kRotationDeg, kDegree},
                                       Axis{"Yaw, about y (down)", "\u00b0", kRotationDeg, kDegree},
                                       Axis{"Roll, about z (forward)", "\u00b0", kRotationDeg, kDegree},
                                       Axis{"Along x (right)", " cm", kTranslationCm, 0.01},
                                       Axis{"Along y (down)", " cm", kTranslationCm, 0.01},
                                       Axis{"Along z (forward)", " cm", kTranslationCm, 0.01}};

struct Slice {
  std::vector<double> scores;   ///< 2 kSteps + 1
  double start;                 ///< where the start lies on this axis, in the unit
  std::optional<double> sigma;  ///< in the unit
};

Frames usedFrames(const ReportInput& input) {
  Frames used;
  for (std::size_t i = 0; i < input.frames.size(); ++i) {
    const std::vector<std::size_t>& left_out = input.outcome.left_out;
    if (std::find(left_out.begin(), left_out.end(), i) == left_out.end()) used.push_back(input.frames[i]);
  }
  return used;
}

std::array<Slice, 6> slices(const ReportInput& input) {
  const Eigen::Isometry3d& result = input.outcome.T_camera_lidar;
  const auto evaluator = makeObjective(input.config.objective)->evaluator(usedFrames(input), {result});
  const ExtrinsicError start = extrinsicError(input.outcome.start, result);
  std::array<Slice, 6> slices;
  for (std::size_t axis = 0; axis < kAxes.size(); ++axis) {
    const Eigen::Index k = static_cast<Eigen::Index>(axis);
    const Axis& a = kAxes[axis];
    Slice& slice = slices[axis];
    for (int step = -kSteps; step <= kSteps; ++step) {
      Vector6d xi = Vector6d::Zero();
      xi[k] = a.reach * a.si * step / kSteps;
      slice.scores.push_back((*evaluator)(exp(xi) * result).total);
    }
    slice.start = (k < 3 ? start.rotation[k] : start.translation[k - 3]) / a.si;
    if (input.outcome.covariance) slice.sigma = std::sqrt((*input.outcome.covariance)(k, k)) / a.si;
  }
  return slices;
}

// --- drawing, in the units of the view box ---

constexpr double kLeft = 38.0, kRight = 276.0, kTop = 12.0, kBottom = 132.0;

struct Scale {
  double low, high;  ///< of the score
  double reach;
  double x(double offset) const { return kLeft + (kRight - kLeft) * (offset / reach + 1.0) / 2.0; }
  double y(double score) const { return kBottom - (kBottom - kTop) * (score - low) / (high - low); }
};

/// Plain decimals for attributes, whatever the sign.
std::string plain(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

void text(std::ostream& out, double x, double y, const char* anchor, const std::string& what,
          const char* style = "") {
  out << "<text x=\"" << plain(x) << "\" y=\"" << plain(y) << "\" text-anchor=\"" << anchor << "\" " << style
      << ">" << what << "</text>";
}

void vertical(std::ostream& out, double x, const char* kind) {
  out << "<line class=\"" << kind << "\" x1=\"" << plain(x) << "\" x2=\"" << plain(x) << "\" y1=\""
      << plain(kTop) << "\" y2=\"" << plain(kBottom) << "\"/>";
}

void drawStart(std::ostream& out, const Scale& scale, double start, const char* unit) {
  const bool inside = std::abs(start) <= scale.reach;
  const double x = scale.x(std::clamp(start, -scale.reach, scale.reach));
  vertical(out, x, "start");
  const char* arrow = inside ? "" : start < 0.0 ? "\u2190 " : "";
  const char* arrow_behind = !inside && start > 0.0 ? " \u2192" : "";
  // Away from the result, where there is room.
  constexpr double kRoom = 75.0;
  const bool to_the_left = start < 0.0 ? x - kLeft > kRoom : kRight - x < kRoom;
  text(out, to_the_left ? x - 4.0 : x + 4.0, kBottom - 6.0, to_the_left ? "end" : "start",
       arrow + std::string("start ") + signedFixed(start, unit[0] == ' ' ? 1 : 2) + unit + arrow_behind,
       "class=\"startText\"");
}

std::string figure(const Axis& axis, const Slice& slice, Scale scale) {
  scale.reach = axis.reach;
  std::ostringstream out;
  out << "<figure class=\"slice\"><svg viewBox=\"0 0 300 160\" role=\"img\" aria-label=\"" << axis.name
      << "\">";
  for (int i = 0; i <= 2; ++i) {
    const double score = scale.low + (scale.high - scale.low) * i / 2.0, y = scale.y(score);
    out << "<line class=\"grid\" x1=\"" << plain(kLeft) << "\" x2=\"" << plain(kRight) << "\" y1=\""
        << plain(y) << "\" y2=\"" << plain(y) << "\"/>";
    text(out, kLeft - 5.0, y + 3.5, "end", fixed(score, 2));
  }
  if (slice.sigma) {
    for (const double factor : {2.0, 1.0}) {
      const double half = std::min(scale.reach, factor * *slice.sigma);
      const double left = scale.x(-half), width = std::max(1.5, scale.x(half) - left);
      out << "<rect class=\"sigma\" x=\"" << plain(scale.x(0.0) - width / 2.0) << "\" y=\"" << plain(kTop)
          << "\" width=\"" << plain(width) << "\" height=\"" << plain(kBottom - kTop) << "\"/>";
    }
  }
  vertical(out, scale.x(0.0), "result");
  drawStart(out, scale, slice.start, axis.unit);
  out << "<polyline class=\"curve\" points=\"";
  for (int step = -kSteps; step <= kSteps; ++step) {
    const double score = slice.scores[static_cast<std::size_t>(step + kSteps)];
    out << (step == -kSteps ? "" : " ") << plain(scale.x(axis.reach * step / kSteps)) << ','
        << plain(scale.y(score));
  }
  out << "\"/>";
  for (int i = -2; i <= 2; ++i) {
    const double offset = axis.reach * i / 2.0;
    text(out, scale.x(offset), kBottom + 15.0, "middle", i == 0 ? "0" : signedFixed(offset, 0) + axis.unit);
  }
  const int digits = axis.unit[0] == ' ' ? 1 : 3;
  out << "</svg><figcaption><b>" << axis.name << "</b><br>moved " << signedFixed(-slice.start, digits)
      << axis.unit << ", \u03c3 "
      << (slice.sigma ? fixed(*slice.sigma, digits) + axis.unit : std::string("not known"))
      << "</figcaption></figure>\n";
  return out.str();
}

}  // namespace

std::string sliceFigures(const ReportInput& input) {
  const std::array<Slice, 6> all = slices(input);
  Scale scale{all[0].scores[0], all[0].scores[0], 1.0};
  for (const Slice& slice : all) {
    const auto [low, high] = std::minmax_element(slice.scores.begin(), slice.scores.end());
    scale.low = std::min(scale.low, *low);
    scale.high = std::max(scale.high, *high);
  }
  const double margin = std::max(1e-6, 0.06 * (scale.high - scale.low));
  scale.low -= margin;
  scale.high += margin;
  std::string figures;
  for (std::size_t axis = 0; axis < kAxes.size(); ++axis) figures += figure(kAxes[axis], all[axis], scale);
  return figures;
}

}  // namespace lidar_camera_recalibration

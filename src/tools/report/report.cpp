#include "report/report.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdio>
#include <map>
#include <sstream>
#include <utility>

#include "html.hpp"
#include "outcome_rows.hpp"
#include "pictures.hpp"
#include "slices.hpp"
#include "style.hpp"

namespace lidar_camera_recalibration {
namespace {

constexpr std::size_t kOverlays = 4, kZooms = 8;

bool isLeftOut(const ReportInput& input, std::size_t frame) {
  const std::vector<std::size_t>& left_out = input.outcome.left_out;
  return std::find(left_out.begin(), left_out.end(), frame) != left_out.end();
}

/// As a sentence, without the word that the verdict says already.
std::string reasonText(const CalibrationOutcome& outcome) {
  std::string text = outcome.reason;
  for (const std::string verdict : {"accepted: ", "rejected: "}) {
    if (text.rfind(verdict, 0) == 0) text.erase(0, verdict.size());
  }
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text + ".";
}

void verdict(std::ostream& out, const ReportInput& input) {
  const CalibrationOutcome& outcome = input.outcome;
  const StoredCalibration& c = *input.contents.calibration;
  out << "<h1>LiDAR\u2013camera calibration</h1>\n<p class=\"soft\">" << escaped(c.lidar_frame) << " \u2192 "
      << escaped(c.camera_frame) << " \u00b7 " << escaped(c.source) << "</p>\n";
  out << "<div id=\"verdict\" class=\"verdict " << (outcome.accepted ? "accepted" : "rejected") << "\"><b>"
      << (outcome.accepted ? "Accepted" : "Rejected") << "</b>" << escaped(reasonText(outcome)) << "</div>\n";
}

void tile(std::ostream& out, const char* label, const std::string& value, const std::string& more) {
  out << "<div class=\"tile\"><div class=\"label\">" << label << "</div><div class=\"value\">" << value
      << "</div><div class=\"more\">" << more << "</div></div>\n";
}

void tiles(std::ostream& out, const CalibrationOutcome& o) {
  const ExtrinsicError moved = extrinsicError(o.T_camera_lidar, o.start);
  std::string turn_sigma = "\u03c3 not known", shift_sigma = turn_sigma;
  if (o.covariance) {
    const Vector6d sigma = o.covariance->diagonal().cwiseSqrt();
    turn_sigma = "\u03c3 up to " + fixed(sigma.head<3>().maxCoeff() / kDegree, 3) + "\u00b0";
    shift_sigma = "\u03c3 up to " + fixed(100.0 * sigma.tail<3>().maxCoeff(), 1) + " cm";
  }
  out << "<div class=\"tiles\">\n";
  tile(out, "Turned by", fixed(moved.angle() / kDegree, 2) + "\u00b0", turn_sigma);
  tile(out, "Moved by", fixed(100.0 * moved.distance(), 1) + " cm", shift_sigma);
  tile(out, "Image shift, 20 m", fixed(o.pixel_shift[1], 1) + " px",
       fixed(o.pixel_shift[0], 1) + " at 10 m, " + fixed(o.pixel_shift[2], 1) + " at 40 m");
  tile(out, "Score", fixed(o.after.total, 3),
       "from " + fixed(o.before.total, 3) + ", " + std::to_string(o.frames) + " frames");
  out << "</div>\n";
}

void shot(std::ostream& out, const char* when, const std::string& uri, const std::string& what) {
  out << "<div class=\"shot " << when << "\"><span class=\"tag\">" << when << "</span><img alt=\"" << what
      << ", " << when << "\" src=\"" << uri << "\"></div>";
}

/// Seconds since the first frame of the search, which are easier to tell apart than stamps.
std::string sinceFirst(const ReportInput& input, double stamp) {
  double first = stamp;
  for (const FramePtr& frame : input.frames) first = std::min(first, frame->stamp);
  return fixed(stamp - first, 1) + " s";
}

void pictures(std::ostream& out, const ReportInput& input) {
  const CalibrationOutcome& o = input.outcome;
  out << "<h2 id=\"overlays\">Before and after</h2>\n<p>LiDAR points over the image, coloured by their "
         "depth. Outlines of "
         "cars, poles and walls must lie on those of the image.</p>\n";
  out << "<div class=\"legend\"><div class=\"ramp\" style=\"background:" << depthGradient()
      << "\"></div><div "
         "class=\"ticks\"><span>2.5</span><span>5</span><span>10</span><span>20</span><span>40</span>"
         "<span>80 m</span></div></div>\n";
  const std::vector<BeforeAfter> shown = overlays(input.frames, o.start, o.T_camera_lidar, kOverlays);
  for (const BeforeAfter& picture : shown) {
    out << "<figure class=\"pair\">";
    shot(out, "before", picture.before, "LiDAR points over the image");
    shot(out, "after", picture.after, "LiDAR points over the image");
    out << "<figcaption>Frame at " << sinceFirst(input, picture.stamp) << "</figcaption></figure>\n";
  }
  if (shown.empty()) out << "<p>The frames have no pictures.</p>\n";

  out << "<h2 id=\"zooms\">Object borders</h2>\n<p>Places with many LiDAR edges, near and far, magnified. "
         "Large dots are steps of "
         "the range along a ring, small ones all other edges; after the calibration they must line the "
         "objects.</p>\n";
  const std::vector<BeforeAfter> places = zooms(input.frames, o.start, o.T_camera_lidar, kZooms);
  if (places.empty())
    out << "<p>There are none: the frames hold no LiDAR edges in view, or no pictures.</p>\n";
  out << "<div class=\"zooms\">\n";
  for (const BeforeAfter& place : places) {
    out << "<figure class=\"zoom\"><div class=\"both\">";
    shot(out, "before", place.before, "LiDAR edges over the image");
    shot(out, "after", place.after, "LiDAR edges over the image");
    out << "</div><figcaption>" << fixed(place.near, 0) << " to " << fixed(place.far, 0) << " m, frame at "
        << sinceFirst(input, place.stamp) << "</figcaption></figure>\n";
  }
  out << "</div>\n";
}

void scoreSlices(std::ostream& out, const ReportInput& input) {
  out << "<h2 id=\"slices\">Score around the result</h2>\n<p>Each curve moves the result along one axis of "
         "the camera's optical "
         "frame and keeps the others. A trustworthy result stands on a clear peak. The bands are one and two "
         "standard "
         "deviations of the result; dashed, where the start lies on this axis.</p>\n<div class=\"slices\">\n"
      << sliceFigures(input) << "</div>\n";
}

void gate(std::ostream& out, const ReportInput& input) {
  out << "<h2 id=\"gate\">" << (input.outcome.accepted ? "Why it was accepted" : "Why it was rejected")
      << "</h2>\n"
      << "<div class=\"scroll\"><table><tr><th></th><th>Condition</th><th>Result</th><th>Limit</th></tr>\n";
  for (const CheckRow& row : gateRows(input.outcome, input.config)) {
    out << "<tr><td class=\"mark " << (row.passed ? "yes\">\u2713" : "no\">\u2717") << "</td><td>" << row.what
        << "</td><td>" << row.value << "</td><td>" << row.limit << "</td></tr>\n";
  }
  out << "</table></div>\n";
}

// --- frames ---

void frameTable(std::ostream& out, const ReportInput& input) {
  const CalibrationOutcome& o = input.outcome;
  const auto objective = makeObjective(input.config.objective);
  out << "<div class=\"scroll\"><table><tr><th>Frame at</th><th>Stamp</th><th>Score "
         "before</th><th>after</th><th></th></tr>\n";
  for (std::size_t i = 0; i < input.frames.size(); ++i) {
    const FramePtr& frame = input.frames[i];
    const auto evaluator = objective->evaluator({frame}, {o.start, o.T_camera_lidar});
    const double before = (*evaluator)(o.start).total, after = (*evaluator)(o.T_camera_lidar).total;
    out << "<tr><td>" << sinceFirst(input, frame->stamp) << "</td><td>" << fixed(frame->stamp, 2)
        << "</td><td>" << fixed(before, 3) << "</td><td class=\"" << (after > before ? "yes" : "no") << "\">"
        << fixed(after, 3) << "</td><td>"
        << (isLeftOut(input, i) ? "left out: contradicts the others" : "used") << "</td></tr>\n";
  }
  out << "</table></div>\n";
}

/// Reasons that differ in numbers only are one.
std::string kindOf(const std::string& reason) {
  std::string kind;
  for (const char c : reason) {
    const bool digit = (c >= '0' && c <= '9') || c == '.';
    if (!digit)
      kind += c;
    else if (kind.empty() || kind.back() != '#')
      kind += '#';
  }
  return kind;
}

void refusedFrames(std::ostream& out, const ReportInput& input) {
  std::vector<std::pair<std::string, std::size_t>> reasons;  // the first of its kind, and how many
  std::map<std::string, std::size_t> place;
  const auto add = [&](const std::string& reason) {
    const auto [found, is_new] = place.emplace(kindOf(reason), reasons.size());
    if (is_new) reasons.emplace_back(reason, 0);
    ++reasons[found->second].second;
  };
  for (const ImageRecord& image : input.images) {
    const bool searched = std::any_of(input.frames.begin(), input.frames.end(), [&](const FramePtr& frame) {
      return std::abs(frame->stamp - image.stamp) < 1e-6;
    });
    if (!image.kept) add(image.reason);
    if (image.kept && !searched) add("gave way to a frame that shows more (frames/max)");
  }
  std::stable_sort(reasons.begin(), reasons.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  out << "<h3>Images not used</h3>\n";
  if (reasons.empty() && input.given_up == "nothing") out << "<p>None.</p>\n";
  if (!reasons.empty()) {
    out << "<div class=\"scroll\"><table><tr><th>Images</th><th>Reason, of the first</th></tr>\n";
    for (const auto& [reason, count] : reasons)
      out << "<tr><td>" << count << "</td><td>" << escaped(reason) << "</td></tr>\n";
    out << "</table></div>\n";
  }
  if (input.given_up != "nothing")
    out << "<p class=\"soft\">Messages given up: " << escaped(input.given_up) << ".</p>\n";
}

void frames(std::ostream& out, const ReportInput& input) {
  out << "<h2 id=\"frames\">Frames</h2>\n";
  frameTable(out, input);
  refusedFrames(out, input);
}

// --- numbers and lines to paste ---

void allNumbers(std::ostream& out, const ReportInput& input) {
  out << "<h2 id=\"numbers\">All numbers</h2>\n<div class=\"scroll\"><table class=\"numbers\">\n";
  for (const NumberRow& row : numberRows(input))
    out << "<tr><td>" << row.what << "</td><td>" << row.value << "</td></tr>\n";
  out << "</table></div>\n";
}

void paste(std::ostream& out, const char* id, const char* title, const std::string& explanation,
           const std::string& text) {
  const bool whole = std::count(text.begin(), text.end(), '\n') < 20;  // longer ones may run over two pages
  out << "<section" << (whole ? " class=\"paste\"" : "") << "><h3>" << title << "</h3>\n<p class=\"soft\">"
      << explanation << "</p>\n<pre id=\"" << id << "\">" << escaped(text) << "</pre></section>\n";
}

std::string matrixText(const Eigen::Isometry3d& T) {
  std::string text;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      char number[32];
      std::snprintf(number, sizeof number, "%*.*f%s", 12, 9, T.matrix()(row, column),
                    column < 3 ? " " : "\n");
      text += number;
    }
  }
  return text;
}

void pastes(std::ostream& out, const ReportInput& input) {
  const auto rendered = [&](const char* format) {
    FormatOptions options = input.hints;
    options.format = format;
    return renderCalibration("", input.contents, options);
  };
  out << "<h2 id=\"paste\">How to use it</h2>\n";
  if (!input.outcome.accepted)
    out << "<p class=\"verdict rejected\">The result was rejected. These lines are for comparison, not for a "
           "vehicle.</p>\n";
  paste(out, "matrix", "4\u00d74 matrix",
        "T_camera_lidar: p_camera = T p_lidar, camera's optical frame (z forward, x right, y down), in m.",
        matrixText(input.outcome.T_camera_lidar));
  paste(out, "publisher", "tf", "The pose of the camera's optical frame in the LiDAR frame.",
        staticTransformPublisher(*input.contents.calibration));
  paste(out, "urdf", "URDF", "The same as a joint.", rendered("urdf"));
  paste(out, "kitti", "KITTI",
        "Lines of <code>calib_velo_to_cam.txt</code>, with this camera as KITTI's camera 0 and no further "
        "rectification.",
        rendered("kitti_raw"));
  paste(out, "autoware", "Autoware",
        "As if the sensor kit stood in the LiDAR. To put it into your own "
        "<code>sensor_kit_calibration.yaml</code>, whose other entries then stay, give that file to "
        "<code>calibrate_bag --out</code> or <code>convert_calibration</code>.",
        rendered("autoware"));
  paste(out, "yaml", "Result file",
        "All of it, as <code>calibrate_bag --out</code> writes it and the node reads it; for other formats "
        "see <code>convert_calibration --list</code>.",
        rendered("yaml"));
}

}  // namespace

std::string reportHtml(const ReportInput& input) {
  std::ostringstream out;
  out << "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" "
         "content=\"width=device-width, initial-scale=1\">\n<title>LiDAR\u2013camera calibration: "
      << (input.outcome.accepted ? "accepted" : "rejected") << "</title>\n<style>" << kReportStyle
      << "</style>\n</head>\n<body>\n<main>\n";
  verdict(out, input);
  tiles(out, input.outcome);
  pictures(out, input);
  scoreSlices(out, input);
  gate(out, input);
  frames(out, input);
  allNumbers(out, input);
  pastes(out, input);
  out << "</main>\n</body>\n</html>\n";
  return out.str();
}

}  // namespace lidar_camera_recalibration

// The page that calibrate_bag --report makes, from a simulated drive.

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <regex>
#include <sstream>

#include "lidar_camera_recalibration/calibration_formats.hpp"
#include "tool_fixture.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

std::string textOf(const std::string& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

/// What a block to paste holds, as a browser shows it.
std::string block(const std::string& page, const std::string& id) {
  const std::string begin = "<pre id=\"" + id + "\">";
  const std::size_t from = page.find(begin);
  if (from == std::string::npos) return "";
  std::string text = page.substr(from + begin.size());
  text.erase(text.find("</pre>"));
  const std::vector<std::pair<std::string, std::string>> entities = {
      {"&quot;", "\""}, {"&lt;", "<"}, {"&gt;", ">"}, {"&amp;", "&"}};
  for (const auto& [entity, character] : entities) {
    for (std::size_t at = text.find(entity); at != std::string::npos; at = text.find(entity, at + 1))
      text.replace(at, entity.size(), character);
  }
  return text;
}

/// Sources of all pictures.
std::vector<std::string> sources(const std::string& page) {
  std::vector<std::string> found;
  const std::string key = " src=\"";
  for (std::size_t at = page.find(key); at != std::string::npos; at = page.find(key, at + 1)) {
    const std::size_t begin = at + key.size();
    found.push_back(page.substr(begin, page.find('"', begin) - begin));
  }
  return found;
}

cv::Mat picture(const std::string& uri) {
  const std::string head = "data:image/jpeg;base64,";
  if (uri.rfind(head, 0) != 0) return {};
  static const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<unsigned char> bytes;
  unsigned group = 0;
  int bits = 0;
  for (std::size_t i = head.size(); i < uri.size() && uri[i] != '='; ++i) {
    group = group << 6 | static_cast<unsigned>(digits.find(uri[i]));
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes.push_back(static_cast<unsigned char>(group >> bits & 255));
  }
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

class ReportTest : public ToolTest {
 protected:
  static void SetUpTestSuite() {
    ToolTest::SetUpTestSuite();
    if (!hasSimulation()) return;
    const Finished drive = call(
        "simulate_drive drive.bag --frames 7 --rate 1 --width 640 --height 240 --beams 32 --perturb 1 0.05 "
        "--seed 3");
    ASSERT_EQ(drive.status, 0) << drive.output;
  }
};

TEST_F(ReportTest, SaysWhatTheResultFileSaysAndNeedsNothingElse) {
  NEEDS_SIMULATION;
  const std::string command =
      "calibrate_bag drive.bag --out r.yaml --set threads=2 --set frames/max=6 --report ";
  const Finished run = call(command + "r.html");
  ASSERT_EQ(run.status, 0) << run.output;
  const std::string page = textOf(path("r.html"));

  // Self-contained: nothing is loaded, nothing runs.
  for (const char* word : {"http", "<script", "<link", "<iframe", "url(", "@import", " href="})
    EXPECT_EQ(page.find(word), std::string::npos) << word;
  const std::vector<std::string> pictures = sources(page);
  ASSERT_GE(pictures.size(), 8u);
  for (std::size_t i = 0; i < pictures.size(); i += 2) {
    const cv::Mat before = picture(pictures[i]), after = picture(pictures[i + 1]);
    ASSERT_FALSE(before.empty() || after.empty()) << pictures[i].substr(0, 40);
    ASSERT_EQ(before.size(), after.size());
    EXPECT_GT(cv::norm(before, after, cv::NORM_L1) / static_cast<double>(before.total()), 0.5)
        << "picture " << i;
  }
  EXPECT_EQ(picture(pictures[0]).size(), cv::Size(640, 240));
  EXPECT_EQ(count(page, "<figure class=\"pair\""), 4u);
  EXPECT_GE(count(page, "<figure class=\"zoom\""), 2u);

  // Its parts.
  EXPECT_NE(page.find("class=\"verdict accepted\""), std::string::npos);
  for (const char* id : {"overlays", "zooms", "slices", "gate", "frames", "numbers", "paste"})
    EXPECT_EQ(count(page, std::string("<h2 id=\"") + id + "\""), 1u) << id;
  EXPECT_EQ(count(page, "<svg"), 6u);
  EXPECT_EQ(count(page, "<polyline class=\"curve\""), 6u);
  EXPECT_EQ(count(page, "<td>used</td>") + count(page, "left out: contradicts the others</td>"), 6u);
  EXPECT_NE(page.find("gave way to a frame that shows more"), std::string::npos);

  // The numbers of the result file.
  EXPECT_EQ(block(page, "yaml"), textOf(path("r.yaml")));
  const YAML::Node result = YAML::LoadFile(path("r.yaml"));
  const Eigen::Isometry3d T = readCalibration(path("r.yaml")).T_camera_lidar;
  std::istringstream matrix(block(page, "matrix"));
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      double value = 0.0;
      ASSERT_TRUE(matrix >> value);
      EXPECT_NEAR(value, T.matrix()(row, column), 1e-9);
    }
  }
  EXPECT_EQ(block(page, "publisher"), result["static_transform_publisher"].as<std::string>());
  FormatOptions frames;
  frames.camera_frame = result["camera_frame"].as<std::string>();
  frames.lidar_frame = result["lidar_frame"].as<std::string>();
  for (const char* format : {"urdf", "kitti", "autoware"}) {
    std::ofstream(path(format)) << block(page, format);
    EXPECT_TRUE(readExtrinsic(path(format), frames).T_camera_lidar.isApprox(T, 1e-9)) << format;
  }
  char score[32];
  std::snprintf(score, sizeof score, "%.4f", result["score_after"].as<double>());
  EXPECT_NE(page.find(std::string(" \u2192 ") + score + "</td>"), std::string::npos) << score;

  // Once more is the same page.
  ASSERT_EQ(call(command + "again.html").status, 0);
  EXPECT_EQ(textOf(path("again.html")), page);
}

TEST_F(ReportTest, RejectedResultsHaveOneToo) {
  NEEDS_SIMULATION;
  const Finished run =
      call("calibrate_bag drive.bag --set threads=2 --set gate/min_distinctness=100 --report rejected.html");
  ASSERT_EQ(run.status, 3) << run.output;
  const std::string page = textOf(path("rejected.html"));
  EXPECT_NE(page.find("id=\"verdict\" class=\"verdict rejected\""), std::string::npos);
  EXPECT_NE(page.find("gate/min_distinctness is 100.0"), std::string::npos);
  EXPECT_NE(page.find("Why it was rejected"), std::string::npos);
  EXPECT_NE(page.find("\u2717</td><td>Stands out on unseen frames by"), std::string::npos);
  EXPECT_NE(page.find("not for a vehicle"), std::string::npos);
}

TEST_F(ReportTest, ThePapersObjectiveHasOneToo) {
  NEEDS_SIMULATION;
  const Finished run = call(
      "calibrate_bag drive.bag --set threads=2 --set objective=paper --set search=paper "
      "--set paper/refine_evaluations=100 --set paper/grid_step_deg=2.5 --report paper.html");
  ASSERT_TRUE(run.status == 0 || run.status == 3) << run.output;
  const std::string page = textOf(path("paper.html"));
  EXPECT_EQ(count(page, "<figure class=\"pair\""), 4u);
  EXPECT_EQ(count(page, "<polyline class=\"curve\""), 6u);
  EXPECT_NE(page.find("Reflectivity term"), std::string::npos);
  EXPECT_EQ(page.find("Edges on borders of masks"), std::string::npos);
}

TEST_F(ReportTest, AFolderThatIsNotThereIsNamed) {
  NEEDS_SIMULATION;
  const Finished run = call("calibrate_bag drive.bag --set threads=2 --report nowhere/r.html");
  EXPECT_EQ(run.status, 1);
  EXPECT_NE(run.output.find("nowhere/r.html"), std::string::npos) << run.output;
}

}  // namespace
}  // namespace lidar_camera_recalibration

// The program evaluate, as a user calls it.

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tool_fixture.hpp"

namespace lidar_camera_recalibration {
namespace {

/// The cells of a CSV file by the names of their columns. Values in quotes hold no line ends.
std::vector<std::map<std::string, std::string>> readCsv(const std::string& file) {
  std::ifstream stream(file);
  const auto split = [](const std::string& line) {
    std::vector<std::string> words(1);
    bool in_quotes = false;
    for (const char c : line) {
      if (c == '"') in_quotes = !in_quotes;
      if (c == ',' && !in_quotes) {
        words.emplace_back();
      } else if (c != '"') {
        words.back() += c;
      }
    }
    return words;
  };
  std::vector<std::map<std::string, std::string>> rows;
  std::string line;
  std::getline(stream, line);
  const std::vector<std::string> names = split(line);
  while (std::getline(stream, line)) {
    const std::vector<std::string> words = split(line);
    EXPECT_EQ(words.size(), names.size()) << line;
    rows.emplace_back();
    for (std::size_t i = 0; i < std::min(names.size(), words.size()); ++i) rows.back()[names[i]] = words[i];
  }
  return rows;
}

std::set<std::string> wordsOf(const std::string& text) {
  std::istringstream words(text);
  return {std::istream_iterator<std::string>(words), {}};
}

/// A dataset that costs little to evaluate, with exact truth.
class EvaluateTest : public ToolTest {
 protected:
  static void SetUpTestSuite() {
    ToolTest::SetUpTestSuite();
    if (!hasSimulation()) return;
    const Finished run =
        call("simulate_drive --dataset drive --frames 6 --rate 0.2 --width 640 --height 192 --seed 3");
    ASSERT_EQ(run.status, 0) << run.output;
  }
};

TEST_F(EvaluateTest, ManyCellsInOneCall) {
  NEEDS_SIMULATION;
  const std::string command =
      "evaluate drive --method consistency_edges --method "
      "'paper:paper/refine_evaluations=50,paper/grid_step_deg=2'"
      " --frames 1,3 --start E1,'2 0.1' --trials 3";
  const Finished one = call(command + " --threads 1 --csv one.csv --json one.json");
  ASSERT_EQ(one.status, 0) << one.output;
  ASSERT_EQ(call(command + " --threads 2 --csv two.csv").status, 0);
  auto rows = readCsv(path("one.csv")), again = readCsv(path("two.csv"));
  ASSERT_EQ(rows.size(), 2u * 2u * 2u * 3u);
  ASSERT_EQ(again.size(), rows.size());
  std::map<std::string, std::string> starts, frames;  // by what they may depend on
  for (std::size_t i = 0; i < rows.size(); ++i) {
    auto &row = rows[i], &same = again[i];
    for (const char* column : {"cpu_preparation_s", "cpu_calibration_s"}) {
      EXPECT_GT(std::stod(row.at(column)), 0.0);
      row.erase(column);
      same.erase(column);
    }
    EXPECT_EQ(row, same);  // whatever the number of threads
    // Methods and numbers of frames are compared on the same trials.
    const std::string trial = row["trial"], start = row["start"] + " " + trial;
    EXPECT_EQ(starts.emplace(start, row["start_rx_deg"]).first->second, row["start_rx_deg"]);
    const std::string names = frames.emplace(row["frames"] + " " + trial, row["frame_names"]).first->second;
    EXPECT_EQ(names, row["frame_names"]);
    EXPECT_EQ(wordsOf(names).size(), std::stoul(row["frames"]));
    EXPECT_EQ(names.rfind(frames["1 " + trial], 0), 0u);
    const double limit = row["start"] == "E1" ? 1.0 : 2.0;
    EXPECT_LE(std::abs(std::stod(row["start_ry_deg"])), limit + 0.1);  // the axes of a rotation vector mix
    EXPECT_FALSE(row["reason"].empty());
    EXPECT_GT(std::stoul(row["evaluations"]), 50u);
  }
  EXPECT_EQ(std::set<std::string>({frames["1 0"], frames["1 1"], frames["1 2"]}).size() > 1, true);

  // Another parser's opinion, also of figures that trials of few frames do not have.
  EXPECT_EQ(std::system(("/usr/bin/python3 -m json.tool '" + path("one.json") + "' > /dev/null").c_str()), 0);
  const YAML::Node figures = YAML::LoadFile(path("one.json"));
  ASSERT_EQ(figures["cells"].size(), 8u);
  EXPECT_EQ(figures["trials"].as<int>(), 3);
  double paper_error = 0.0, edges_error = 0.0;
  for (const YAML::Node& cell : figures["cells"]) {
    std::vector<double> norms;
    for (const auto& row : rows) {
      if (row.at("method") == cell["method"].as<std::string>() &&
          row.at("start") == cell["start"].as<std::string>() &&
          row.at("frames") == cell["frames"].as<std::string>())
        norms.push_back(std::stod(row.at("rotation_deg")));
    }
    ASSERT_EQ(norms.size(), 3u);
    std::sort(norms.begin(), norms.end());
    EXPECT_NEAR(cell["rotation_deg"]["median"].as<double>(), norms[1], 1e-6);
    EXPECT_NEAR(cell["rotation_deg"]["mean"].as<double>(), (norms[0] + norms[1] + norms[2]) / 3, 1e-6);
    EXPECT_GT(cell["cpu_seconds_per_run"].as<double>(), cell["cpu_seconds_preparation"].as<double>());
    if (cell["frames"].as<int>() != 3) continue;
    (cell["method"].as<std::string>() == "paper" ? paper_error : edges_error) +=
        cell["rotation_deg"]["median"].as<double>();
    if (cell["method"].as<std::string>() != "consistency_edges") continue;
    EXPECT_LT(cell["rotation_deg"]["median"].as<double>(), 0.2);  // from 1 to 2 deg, 0.05 to 0.1 m
    EXPECT_LT(cell["translation_m"]["median"].as<double>(), 0.03);
  }
  EXPECT_LT(edges_error, paper_error);
}

TEST_F(EvaluateTest, HalvesAreDisjoint) {
  NEEDS_SIMULATION;
  const Finished run =
      call("evaluate drive --method consistency_edges --halves 3 --start E1 --trials 3 --csv halves.csv");
  ASSERT_EQ(run.status, 0) << run.output;
  const auto rows = readCsv(path("halves.csv"));
  ASSERT_EQ(rows.size(), 3u);
  for (const auto& row : rows) {
    const std::string& names = row.at("frame_names");
    const std::size_t middle = names.find(" / ");
    ASSERT_NE(middle, std::string::npos) << names;
    std::set<std::string> all = wordsOf(names.substr(0, middle)), second = wordsOf(names.substr(middle + 3));
    EXPECT_EQ(all.size(), 3u);
    EXPECT_EQ(second.size(), 3u);
    all.insert(second.begin(), second.end());
    EXPECT_EQ(all.size(), 6u);
    EXPECT_GT(std::stod(row.at("start_rotation_deg")), 0.1);  // two starts
    EXPECT_GT(std::stod(row.at("rotation_deg")), 0.0);
    EXPECT_LT(std::stod(row.at("rotation_deg")), 0.3);
  }
  const Finished many = call("evaluate drive --halves 4");
  EXPECT_EQ(many.status, 1);
  EXPECT_NE(many.output.find("there are 6 frames, too few for two sets of 4"), std::string::npos)
      << many.output;
}

TEST_F(EvaluateTest, AllFramesAndFewerRings) {
  NEEDS_SIMULATION;
  const std::string command = "evaluate drive --method consistency_edges --frames all --start E1 --trials 1";
  ASSERT_EQ(call(command + " --csv all.csv").status, 0);
  ASSERT_EQ(call(command + " --csv few.csv --every-ring 4").status, 0);
  const auto all = readCsv(path("all.csv")), few = readCsv(path("few.csv"));
  ASSERT_EQ(all.size(), 1u);
  ASSERT_EQ(few.size(), 1u);
  EXPECT_EQ(wordsOf(all[0].at("frame_names")).size(), 6u);
  EXPECT_EQ(all[0].at("frame_names"), few[0].at("frame_names"));
  EXPECT_EQ(all[0].at("start_rx_deg"), few[0].at("start_rx_deg"));
  EXPECT_NE(all[0].at("rotation_deg"), few[0].at("rotation_deg"));
  EXPECT_GT(std::stod(few[0].at("sigma_ry_deg")), 0.0);  // six frames are enough for a covariance
}

TEST_F(EvaluateTest, SlicesHaveTheirTopAtTheTruth) {
  NEEDS_SIMULATION;
  const Finished run = call("evaluate drive --method paper --method consistency_edges --slices slices.csv");
  ASSERT_EQ(run.status, 0) << run.output;
  const auto rows = readCsv(path("slices.csv"));
  ASSERT_EQ(rows.size(), 2u * 6u * 41u);
  std::map<std::string, std::pair<double, double>> top;  // of yaw: total and where
  for (const auto& row : rows) {
    EXPECT_EQ(row.at("unit"), row.at("axis")[0] == 'r' ? "deg" : "m");
    if (row.at("method") == "paper") {
      EXPECT_GT(std::stod(row.at("normal")), 0.0);
    }
    if (row.at("axis") != "ry") continue;
    const double total = std::stod(row.at("total")), offset = std::stod(row.at("offset"));
    auto& best = top.emplace(row.at("method"), std::pair(total, offset)).first->second;
    best = std::max(best, {total, offset});
  }
  ASSERT_EQ(top.size(), 2u);
  EXPECT_NEAR(top["consistency_edges"].second, 0.0, 0.11);
  EXPECT_NEAR(top["paper"].second, 0.0, 0.51);
}

TEST_F(EvaluateTest, WrongOptionsAreNamed) {
  NEEDS_SIMULATION;
  const std::map<std::string, std::string> wrong = {
      {"--frames 1,many", "--frames 1,many"}, {"--frames 0", "--frames 0"},
      {"--halves all", "--halves all"},       {"--method paper --method paper", "another one of this name"},
      {"--every-ring 0", "--every-ring 0"},   {"--frame-set some", "--frame-set some"}};
  for (const auto& [options, text] : wrong) {
    const Finished run = call("evaluate drive " + options);
    EXPECT_EQ(run.status, 2) << options;
    EXPECT_NE(run.output.find(text), std::string::npos) << run.output;
  }
  for (const std::string options : {"--method magic", "--start E9", "--frames 7", "--set gate/min_gian=1"})
    EXPECT_EQ(call("evaluate drive " + options).status, 1) << options;
}

TEST_F(EvaluateTest, EvaluationOfRealFrames) {
  NEEDS_DATA;
  const Finished run =
      call("evaluate '" + data().string() +
           "' --method consistency_edges --frames 5 --trials 2 --start E1 --frame-set odd --every-ring 2"
           " --json real.json");
  ASSERT_EQ(run.status, 0) << run.output;
  const YAML::Node cell = YAML::LoadFile(path("real.json"))["cells"][0];
  EXPECT_LT(cell["rotation_deg"]["median"].as<double>(), 0.5);
  EXPECT_LT(cell["translation_m"]["median"].as<double>(), 0.1);
}

}  // namespace
}  // namespace lidar_camera_recalibration

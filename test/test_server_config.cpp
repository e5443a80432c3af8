#include "server_config.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>

#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

using XmlRpc::XmlRpcValue;

const std::string kManual = PACKAGE_DIR "/config/recalibration.yaml";

ServerConfig readWith(const Parameters& parameters) { return readServerConfig(sourceOf(parameters)); }
ServerConfig readWith(const std::string& name, const XmlRpcValue& value) { return readWith({{name, value}}); }

// The message of the Error that reading must end with.
std::string refusal(const Parameters& parameters) {
  try {
    readWith(parameters);
  } catch (const Error& error) {
    EXPECT_EQ(ErrorCause::kParameter, error.cause());
    return error.what();
  }
  ADD_FAILURE() << "accepted " << parameters.begin()->first << " = " << parameters.begin()->second.toXml();
  return "";
}

void expectRefused(const std::string& name, const XmlRpcValue& value,
                   const std::vector<std::string>& words = {}) {
  const std::string message = refusal({{name, value}});
  EXPECT_NE(std::string::npos, message.find(name)) << message;
  for (const std::string& word : words) EXPECT_NE(std::string::npos, message.find(word)) << message;
}

class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& text) : path_(testing::TempDir() + "test_server_config.yaml") {
    std::ofstream(path_) << text;
  }
  ~TemporaryFile() { std::remove(path_.c_str()); }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

TEST(ServerConfig, withoutParametersItIsTheDefaults) {
  const ServerConfig config = readWith({});
  EXPECT_EQ("manual", config.mode);
  EXPECT_EQ(SynchroniserConfig().max_bytes, config.synchroniser.max_bytes);
  EXPECT_EQ(5, config.frames_min);
  EXPECT_FALSE(config.initial_T_camera_lidar);
  EXPECT_TRUE(config.tf_publish);
}

TEST(ServerConfig, manualListsEveryParameterWithItsDefault) {
  const Parameters manual = readParameterFile(kManual);
  std::set<std::string> listed;
  for (const auto& [name, value] : manual) listed.insert(name);
  const std::vector<std::string> names = parameterNames();
  EXPECT_EQ(std::set<std::string>(names.begin(), names.end()), listed);
  EXPECT_EQ(names.size(), listed.size()) << "a name is twice in the table";

  const ServerConfig from_manual = readWith(manual), defaults;
  for (const std::string& name : names) {
    EXPECT_EQ(parameterText(defaults, name), parameterText(from_manual, name)) << name;
  }
}

// The line above each parameter states what is allowed, in the words of the error messages.
TEST(ServerConfig, manualStatesWhatIsAllowed) {
  std::ifstream file(kManual);
  ASSERT_TRUE(file);
  std::vector<std::string> names = parameterNames();
  std::string group, last_allowed;
  std::size_t checked = 0;
  for (std::string line; std::getline(file, line);) {
    const std::size_t indent = line.find_first_not_of(' ');
    if (indent == std::string::npos) continue;
    const std::string content = line.substr(indent);
    if (content.rfind("# Allowed: ", 0) == 0) last_allowed = content.substr(11);
    if (content[0] == '#') continue;
    const std::string key = content.substr(0, content.find(':'));
    if (content.back() == ':') {
      group = key + "/";
      continue;
    }
    const std::string name = (indent > 0 ? group : "") + key;
    EXPECT_EQ(allowedValues(name), last_allowed) << name;
    EXPECT_EQ(names[checked], name) << "order of the table and the manual";
    last_allowed.clear();
    ++checked;
  }
  EXPECT_EQ(names.size(), checked);
}

TEST(ServerConfig, everyParameterReachesItsMember) {
  std::map<std::string, std::string> before;
  for (const std::string& name : parameterNames()) before[name] = parameterText(ServerConfig(), name);

  const Parameters other = {
      {"image_rectified", true},
      {"topics/image", "/a/image"},
      {"topics/camera_info", "/a/info"},
      {"topics/points", "lidar"},
      {"topics/masks", "/a/masks"},
      {"camera_info_file", "camera.yaml"},
      {"compressed", true},
      {"masks_compressed", true},
      {"intensity_field", "remission"},
      {"camera_frame", "cam"},
      {"lidar_frame", "os"},
      {"mode", "automatic"},
      {"automatic/min_interval", 7.0},
      {"fixed_frame", "odom"},
      {"deskew", false},
      {"sync/max_stamp_gap", 0.02},
      {"sync/mask_timeout", 10.5},
      {"sync/max_unmatched", 33},
      {"sync/max_bytes_mb", 40},
      {"initial/from_saved", false},
      {"frames/min", 3},
      {"frames/max", 7},
      {"frames/min_interval", 2.5},
      {"frames/min_view_change", 0.2},
      {"frames/max_turn_rate_deg", 33.0},
      {"frames/max_bytes_mb", 128},
      {"frame/crop_margin_deg", 20.0},
      {"frame/min_range", 2.0},
      {"frame/max_range", 80.0},
      {"frame/cull_hidden", false},
      {"frame/min_points", 100},
      {"frame/min_masks", 2},
      {"features/normal_neighbours", 20},
      {"features/reflectivity_quantile", 0.9},
      {"features/plane_distance", 0.2},
      {"features/plane_min_points", 800},
      {"features/plane_max_count", 3},
      {"features/cluster_tolerance", 0.5},
      {"features/cluster_tolerance_slope", 0.02},
      {"features/cluster_min_points", 5},
      {"search_range/rotation_deg", 2.5},
      {"search_range/translation_m", 0.1},
      {"edges/weight_azimuth_gap", 2.0},
      {"edges/weight_ring_gap", 0.7},
      {"edges/weight_reflectivity_step", 0.6},
      {"edges/weight_region", 0.0},
      {"paper/weight_reflectivity", 1.0},
      {"paper/weight_normal", 2.0},
      {"paper/weight_segment", 3.0},
      {"paper/grid_step_deg", 0.5},
      {"paper/refine_evaluations", 100},
      {"seed", 42},
      {"threads", 4},
      {"gate/min_significance", 3.0},
      {"gate/min_rotation_deg", 0.1},
      {"gate/min_translation_m", 0.01},
      {"gate/min_distinctness", 6.0},
      {"gate/max_rotation_sigma_deg", 0.4},
      {"gate/max_translation_sigma_m", 0.3},
      {"monitor/rotation_tolerance", 0.4},
      {"monitor/translation_tolerance", 0.06},
      {"monitor/window", 12},
      {"service_timeout", 12.0},
      {"tf/publish", false},
      {"tf/child_frame", "cam2"},
      {"tf/correct_parent", "base"},
      {"tf/correct_child", "mount"},
      {"result_file", "/tmp/result.yaml"},
      {"overlay/color", "mask"},
      {"overlay/compare", true},
  };
  const ServerConfig config = readWith(other);
  for (const std::string& name : parameterNames()) {
    if (name == "mode" || name == "objective" || name == "search" || name == "initial/T_camera_lidar")
      continue;
    ASSERT_EQ(1u, other.count(name)) << name;
    EXPECT_NE(before[name], parameterText(config, name)) << name;
  }
  EXPECT_EQ("remission", config.intensity_field);
  EXPECT_DOUBLE_EQ(0.02, config.synchroniser.max_stamp_gap);
  EXPECT_EQ(40u * 1024 * 1024, config.synchroniser.max_bytes);
  EXPECT_EQ(33u, config.synchroniser.max_unmatched);
  EXPECT_EQ(3, config.frames_min);
  EXPECT_EQ(7, config.frames_max);
  EXPECT_EQ(128u * 1024 * 1024, config.frames_max_bytes);
  EXPECT_DOUBLE_EQ(0.02, config.frame.features.cluster_tolerance_slope);
  EXPECT_DOUBLE_EQ(2.5, config.calibrator.range.rotation_deg);
  EXPECT_DOUBLE_EQ(0.1, config.calibrator.range.translation_m);
  EXPECT_DOUBLE_EQ(2.0, config.calibrator.objective.weight_azimuth_gap);
  EXPECT_DOUBLE_EQ(0.7, config.calibrator.objective.weight_ring_gap);
  EXPECT_DOUBLE_EQ(0.6, config.calibrator.objective.weight_reflectivity_step);
  EXPECT_DOUBLE_EQ(0.0, config.calibrator.objective.weight_region);
  EXPECT_DOUBLE_EQ(1.0, config.calibrator.objective.weight_reflectivity);
  EXPECT_DOUBLE_EQ(2.0, config.calibrator.objective.weight_normal);
  EXPECT_DOUBLE_EQ(3.0, config.calibrator.objective.weight_segment);
  EXPECT_EQ(42u, config.calibrator.search.seed);
  EXPECT_DOUBLE_EQ(3.0, config.calibrator.gate.min_significance);
  EXPECT_DOUBLE_EQ(0.1, config.calibrator.gate.min_rotation_deg);
  EXPECT_DOUBLE_EQ(0.01, config.calibrator.gate.min_translation_m);
  EXPECT_DOUBLE_EQ(6.0, config.calibrator.gate.min_distinctness);
  EXPECT_DOUBLE_EQ(0.4, config.calibrator.gate.max_rotation_sigma_deg);
  EXPECT_DOUBLE_EQ(0.3, config.calibrator.gate.max_translation_sigma_m);
  EXPECT_DOUBLE_EQ(0.4, config.monitor.rotation_tolerance_deg);
  EXPECT_DOUBLE_EQ(0.06, config.monitor.translation_tolerance_m);
  EXPECT_EQ(12, config.monitor.window);
  EXPECT_EQ("base", config.tf_correct_parent);
  EXPECT_EQ("mount", config.tf_correct_child);
  EXPECT_EQ(OverlayColor::kMask, config.overlay_color);
}

TEST(ServerConfig, wholeNumbersStandForNumbersButNotTheOtherWayRound) {
  EXPECT_DOUBLE_EQ(30.0, readWith("sync/mask_timeout", 30).synchroniser.mask_timeout);
  expectRefused("frames/min", 5.0, {"5", "whole number from 1 to 1000"});
  expectRefused("sync/max_bytes_mb", 100.5, {"whole number"});
}

TEST(ServerConfig, wrongTypes) {
  expectRefused("image_rectified", 1, {"true or false"});
  expectRefused("image_rectified", "true", {"\"true\"", "true or false"});
  expectRefused("frames/min", true);
  expectRefused("sync/max_stamp_gap", "0.1", {"\"0.1\"", "a number from 0 to 1"});
  expectRefused("sync/max_stamp_gap", false);
  expectRefused("camera_frame", 5);
  expectRefused("mode", 1);
  XmlRpcValue list;
  list[0] = 1.0;
  expectRefused("gate/min_significance", list);
  XmlRpcValue tree;
  tree["rotation_deg"] = 1.0;
  expectRefused("search", tree);
}

TEST(ServerConfig, outOfRange) {
  expectRefused("frames/min", 0, {"= 0", "from 1 to 1000"});
  expectRefused("seed", -1, {"-1", "from 0 to 2147483647"});
  expectRefused("sync/max_stamp_gap", 1.0001, {"1.0001", "from 0 to 1"});
  expectRefused("sync/max_stamp_gap", std::nan(""));
  expectRefused("sync/max_stamp_gap", INFINITY);
  expectRefused("sync/max_bytes_mb", -1);
  expectRefused("threads", 0);
  expectRefused("overlay/color", "rainbow", {"\"rainbow\"", "reflectivity"});
  expectRefused("objective", "magic", {"\"magic\"", "\"paper\""});
  expectRefused("camera_frame", "/camera", {"leading slash"});
}

// Every number refuses what lies beyond its range, so no line of the table has its bounds mixed up.
TEST(ServerConfig, boundsOfEveryNumber) {
  int numbers = 0;
  for (const std::string& name : parameterNames()) {
    const std::string allowed = allowedValues(name);
    double min = 0.0, max = 0.0;
    const char* from = std::strstr(allowed.c_str(), "number from ");
    if (from == nullptr) continue;
    ASSERT_EQ(2, std::sscanf(from, "number from %lf to %lf", &min, &max)) << name;
    ASSERT_LT(min, max) << name;
    ++numbers;
    const bool whole = allowed.find("whole") != std::string::npos;
    const double below = whole ? min - 1.0 : min - 1e-6;
    expectRefused(name, whole ? XmlRpcValue(static_cast<int>(below)) : XmlRpcValue(below), {allowed});
    if (whole && max < 2e9) expectRefused(name, static_cast<int>(max) + 1, {allowed});
    if (!whole) expectRefused(name, max + 1e-6, {allowed});
  }
  EXPECT_EQ(47, numbers);
}

TEST(ServerConfig, whatMustFitTogether) {
  const auto message = refusal({{"frames/min", 10}, {"frames/max", 5}});
  EXPECT_NE(std::string::npos, message.find("frames/min = 10")) << message;
  EXPECT_NE(std::string::npos, message.find("frames/max = 5")) << message;
  EXPECT_EQ(5, readWith({{"frames/min", 5}, {"frames/max", 5}}).frames_max);
  expectRefused("tf/correct_parent", "base", {"tf/correct_child", "both or neither"});
  expectRefused("tf/correct_child", "mount", {"tf/correct_parent", "both or neither"});
  refusal({{"tf/correct_parent", "a"}, {"tf/correct_child", "a"}});
  refusal({{"frame/crop_margin_deg", 4.0}, {"search_range/rotation_deg", 5.0}});
  refusal({{"frame/min_range", 50.0}, {"frame/max_range", 40.0}});
  refusal({{"paper/weight_reflectivity", 0}, {"paper/weight_normal", 0}, {"paper/weight_segment", 0.0}});
  refusal(
      {{"edges/weight_azimuth_gap", 0}, {"edges/weight_ring_gap", 0}, {"edges/weight_reflectivity_step", 0}});
  const auto search = refusal({{"objective", "paper"}});
  EXPECT_NE(std::string::npos, search.find("set search to \"paper\"")) << search;
  EXPECT_FALSE(readWith({{"objective", "paper"}, {"search", "paper"}}).frame.edges)
      << "nobody would use them";
  EXPECT_TRUE(readWith({}).frame.edges);
}

TEST(ServerConfig, otherModesAreRefusedInWords) {
  for (const char* mode : {"manual", "monitor", "automatic"})
    EXPECT_EQ(mode, readWith({{"mode", mode}}).mode);
  expectRefused("mode", "autonomous", {"autonomous", "\"automatic\""});
}

XmlRpcValue listOf(const std::vector<double>& numbers) {
  XmlRpcValue list;
  list.setSize(0);
  for (std::size_t i = 0; i < numbers.size(); ++i) list[static_cast<int>(i)] = numbers[i];
  return list;
}

TEST(ServerConfig, initialExtrinsicIsRowByRow) {
  // Camera looking along the LiDAR's x axis.
  XmlRpcValue list = listOf({0, -1, 0, 0.1, 0, 0, -1, 0.2, 1, 0, 0, 0.3, 0, 0, 0, 1});
  list[0] = 0;  // whole numbers mix with others
  const ServerConfig config = readWith("initial/T_camera_lidar", list);
  ASSERT_TRUE(config.initial_T_camera_lidar);
  const Eigen::Vector3d ahead = *config.initial_T_camera_lidar * Eigen::Vector3d(10.0, 0.0, 0.0);
  EXPECT_TRUE(ahead.isApprox(Eigen::Vector3d(0.1, 0.2, 10.3))) << ahead.transpose();
  EXPECT_EQ("[0, -1, 0, 0.1, 0, 0, -1, 0.2, 1, 0, 0, 0.3, 0, 0, 0, 1]",
            parameterText(config, "initial/T_camera_lidar"));

  EXPECT_FALSE(readWith("initial/T_camera_lidar", listOf({})).initial_T_camera_lidar);
  expectRefused("initial/T_camera_lidar", listOf({1, 2, 3}), {"16 numbers"});
  expectRefused("initial/T_camera_lidar", listOf(std::vector<double>(16, 0.0)), {"rigid"});
  expectRefused("initial/T_camera_lidar", listOf(std::vector<double>(16, std::nan(""))));
  expectRefused("initial/T_camera_lidar", 1.0);
  list[5] = "0";
  expectRefused("initial/T_camera_lidar", list);
}

TEST(ServerConfig, unknownNamesGetTheNearestKnownOne) {
  EXPECT_TRUE(unknownParameters(parameterNames()).empty());
  EXPECT_TRUE(unknownParameters({"image_transport"}).empty());
  const auto sentences = unknownParameters({"frames/mim", "seed", "min_distinct", "sync/max_gap"});
  ASSERT_EQ(3u, sentences.size());
  EXPECT_EQ("there is no parameter 'frames/mim'; did you mean 'frames/min'?", sentences[0]);
  EXPECT_EQ("there is no parameter 'min_distinct'; did you mean 'gate/min_distinctness'?", sentences[1]);
  EXPECT_NE(std::string::npos, sentences[2].find("'sync/max_")) << sentences[2];
}

TEST(ServerConfig, treeOfTheParameterServerIsFlattened) {
  XmlRpcValue tree;
  tree["seed"] = 3;
  tree["frames"]["min"] = 4;
  tree["a"]["b"]["c"] = "deep";
  const Parameters parameters = flatten(tree);
  ASSERT_EQ(3u, parameters.size());
  EXPECT_EQ(XmlRpcValue(4), parameters.at("frames/min"));
  EXPECT_EQ(XmlRpcValue("deep"), parameters.at("a/b/c"));
  EXPECT_EQ(3u, readWith({{"seed", parameters.at("seed")}}).calibrator.search.seed);
  EXPECT_TRUE(flatten(XmlRpcValue()).empty());
}

TEST(ParameterFile, types) {
  const TemporaryFile file(
      "seed: 7\nframes: {min: 2, min_interval: 0.5}\nimage_rectified: true\ncamera_frame: '17'\n"
      "lidar_frame: velodyne\nfrom: yes\nshort: y\nbig: 3000000000\nsmall: 1e-3\nlist: [1, 2.5, x]\n");
  const Parameters parameters = readParameterFile(file.path());
  EXPECT_EQ(XmlRpcValue(7), parameters.at("seed"));
  EXPECT_EQ(XmlRpcValue(2), parameters.at("frames/min"));
  EXPECT_EQ(XmlRpcValue(0.5), parameters.at("frames/min_interval"));
  EXPECT_EQ(XmlRpcValue(true), parameters.at("image_rectified"));
  EXPECT_EQ(XmlRpcValue("17"), parameters.at("camera_frame"));
  EXPECT_EQ(XmlRpcValue("velodyne"), parameters.at("lidar_frame"));
  EXPECT_EQ(XmlRpcValue(true), parameters.at("from"));
  EXPECT_EQ(XmlRpcValue("y"), parameters.at("short"));
  EXPECT_EQ(XmlRpcValue(3e9), parameters.at("big"));
  EXPECT_EQ(XmlRpcValue(1e-3), parameters.at("small"));
  ASSERT_EQ(3, parameters.at("list").size());
  EXPECT_EQ(XmlRpcValue(2.5), parameters.at("list")[1]);
}

std::string fileRefusal(const std::string& text) {
  const TemporaryFile file(text);
  try {
    readParameterFile(file.path());
  } catch (const Error& error) {
    EXPECT_EQ(ErrorCause::kFile, error.cause());
    EXPECT_NE(std::string::npos, std::string(error.what()).find(file.path())) << error.what();
    return error.what();
  }
  ADD_FAILURE() << "accepted: " << text;
  return "";
}

TEST(ParameterFile, malformed) {
  EXPECT_NE(std::string::npos, fileRefusal("seed: 1\nframes: [1, 2\n").find("line 3"));
  fileRefusal("- a\n- b\n");
  fileRefusal("just words\n");
  EXPECT_NE(std::string::npos, fileRefusal("frames:\n  min:\n").find("frames/min has no value"));
  std::string deep;
  for (int i = 0; i < 100; ++i) deep += "{a: ";
  fileRefusal("a: " + deep + "1" + std::string(100, '}') + "\n");
  fileRefusal("a: &x [*x]\n");
  EXPECT_THROW(readParameterFile("/nowhere/at/all.yaml"), Error);
  const TemporaryFile empty("# nothing set\n");
  EXPECT_TRUE(readParameterFile(empty.path()).empty());
}

}  // namespace
}  // namespace lidar_camera_recalibration

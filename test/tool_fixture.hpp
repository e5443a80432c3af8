#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace lidar_camera_recalibration {

struct Finished {
  int status = -1;
  std::string output;  ///< stdout and stderr
};

/// Calls the programs as a user does, in a folder that all tests of a suite share.
class ToolTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    std::string pattern = (std::filesystem::temp_directory_path() / "test_tools_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder() = pattern;
  }
  static void TearDownTestSuite() { std::filesystem::remove_all(folder()); }

  static Finished call(const std::string& command) {
    const std::filesystem::path log = folder() / "log.txt";
    const std::string line = "cd '" + folder().string() + "' && '" + TOOL_DIR "/" +
                             command.substr(0, command.find(' ')) + "'" + command.substr(command.find(' ')) +
                             " > '" + log.string() + "' 2>&1";
    const int status = std::system(line.c_str());
    std::ostringstream text;
    text << std::ifstream(log).rdbuf();
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, text.str()};
  }

  static std::filesystem::path& folder() {
    static std::filesystem::path folder;
    return folder;
  }
  static std::string path(const std::string& name) { return (folder() / name).string(); }

  static std::filesystem::path data() { return std::filesystem::path(SHARED_DATA) / "kitti_00"; }
  static bool hasData() { return std::filesystem::exists(data()); }
  static bool hasSimulation() { return std::filesystem::exists(TOOL_DIR "/simulate_drive"); }
};

}  // namespace lidar_camera_recalibration

#define NEEDS_DATA \
  if (!hasData()) GTEST_SKIP() << "no real data: " << data()

#define NEEDS_SIMULATION \
  if (!hasSimulation()) GTEST_SKIP() << "simulate_drive was not built: no Embree"

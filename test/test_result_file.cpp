#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <regex>
#include <sstream>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/result_file.hpp"

namespace fs = std::filesystem;
namespace lcr = lidar_camera_recalibration;

namespace {

/// A folder of its own for each test.
class ResultFile : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "result_file_XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(path(name), std::ios::binary) << text;
    return path(name);
  }
  std::size_t fileCount() const {
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  fs::path folder_;
};

std::string read(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

lcr::StoredCalibration example() {
  lcr::StoredCalibration c;
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  c.T_camera_lidar.linear() =
      Eigen::AngleAxisd(0.1234567890123, Eigen::Vector3d(0.3, -0.2, 0.9).normalized()) * R;
  c.T_camera_lidar.translation() << 0.1 / 3.0, -1.0 / 7.0, -0.2884147;
  c.camera_frame = "camera_optical";
  c.lidar_frame = "velodyne";
  lcr::Matrix6d root = lcr::Matrix6d::Identity() * 1e-3;
  root(1, 4) = 1.0 / 3.0 * 1e-4;
  c.covariance = root * root.transpose();
  c.score_before = 0.51234;
  c.score_after = 2.0 / 3.0;
  c.accepted = false;
  c.reason = "score: rose on 3 of 10 frames # only";
  c.frames = 10;
  c.frames_left_out = 2;
  c.stamp = 1317617735.123456789;
  c.source = "/rigs/a \"quoted\"/drive one.bag\nsecond line: ä";
  return c;
}

void expectRefused(const std::string& path, const std::string& word) {
  try {
    lcr::readCalibration(path);
    FAIL() << "accepted; expected an error with: " << word;
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kFile);
    EXPECT_NE(std::string(error.what()).find(path), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
  }
}

void expectNotWritten(const std::string& path, int system_error) {
  try {
    lcr::writeFileAtomically(path, std::string(10000, 'x'));
    FAIL() << "written: " << path;
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kFile);
    EXPECT_NE(std::string(error.what()).find("'" + path + "'"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(std::strerror(system_error)), std::string::npos) << error.what();
  }
}

const std::string kIdentityRows = "[[1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 1, 0.3], [0, 0, 0, 1]]";

}  // namespace

TEST_F(ResultFile, RoundTrip) {
  const lcr::StoredCalibration c = example();
  lcr::writeCalibration(path("result.yaml"), c);
  const lcr::StoredCalibration back = lcr::readCalibration(path("result.yaml"));
  EXPECT_LT((back.T_camera_lidar.matrix() - c.T_camera_lidar.matrix()).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_EQ(back.T_camera_lidar.translation(), c.T_camera_lidar.translation());
  ASSERT_TRUE(back.covariance);
  EXPECT_EQ(*back.covariance, *c.covariance);
  EXPECT_EQ(back.camera_frame, c.camera_frame);
  EXPECT_EQ(back.lidar_frame, c.lidar_frame);
  EXPECT_EQ(back.score_before, c.score_before);
  EXPECT_EQ(back.score_after, c.score_after);
  EXPECT_EQ(back.accepted, c.accepted);
  EXPECT_EQ(back.reason, c.reason);
  EXPECT_EQ(back.frames, c.frames);
  EXPECT_EQ(back.frames_left_out, c.frames_left_out);
  EXPECT_EQ(back.stamp, c.stamp);
  EXPECT_EQ(back.source, c.source);
}

TEST_F(ResultFile, RoundTripOfAwkwardValues) {
  lcr::StoredCalibration c = example();
  c.covariance.reset();
  c.score_before = std::numeric_limits<double>::quiet_NaN();
  c.score_after = -std::numeric_limits<double>::infinity();
  for (const char* text : {"", "~", "null", "yes", "- a", "{b: c}", "'", "\"", "a: b", "#x", " blanks ",
                           "1e3", "tab\there", "<a&b>", "%", "@", "!tag", "*alias", "\x01"}) {
    c.reason = c.source = c.camera_frame = text;
    lcr::writeCalibration(path("result.yaml"), c);
    const lcr::StoredCalibration back = lcr::readCalibration(path("result.yaml"));
    EXPECT_EQ(back.reason, text);
    EXPECT_EQ(back.source, text);
    EXPECT_EQ(back.camera_frame, text);
    EXPECT_FALSE(back.covariance);
    EXPECT_TRUE(std::isnan(back.score_before));
    EXPECT_EQ(back.score_after, c.score_after);
  }
}

TEST_F(ResultFile, HeaderSaysWhichDirection) {
  const std::string text = lcr::toYaml(example());
  EXPECT_EQ(text.front(), '#');
  EXPECT_NE(text.find("T_camera_lidar maps points of the LiDAR frame into the camera's optical frame"),
            std::string::npos);
  const YAML::Node node = YAML::Load(text);
  EXPECT_TRUE(std::regex_match(node["package_version"].as<std::string>(), std::regex("\\d+\\.\\d+\\.\\d+")));
}

TEST_F(ResultFile, SmallNumbersAreNumbersForYaml11) {
  lcr::StoredCalibration c;
  c.score_before = 1e-5;
  c.score_after = -1.5e-7;
  const YAML::Node node = YAML::Load(lcr::toYaml(c));
  EXPECT_EQ(node["score_before"].Scalar(), "1.0e-05");
  EXPECT_EQ(node["score_after"].Scalar(), "-1.5e-07");
}

TEST_F(ResultFile, OtherNotationsAreTheSameTransform) {
  const lcr::StoredCalibration c = example();
  const YAML::Node node = YAML::Load(lcr::toYaml(c));

  const auto q = node["quaternion"].as<std::vector<double>>();
  const Eigen::Quaterniond rotation(q.at(3), q.at(0), q.at(1), q.at(2));
  EXPECT_LT((rotation.toRotationMatrix() - c.T_camera_lidar.linear()).cwiseAbs().maxCoeff(), 1e-14);

  const auto rpy = node["rpy"].as<std::vector<double>>();
  const Eigen::Matrix3d R = (Eigen::AngleAxisd(rpy.at(2), Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(rpy.at(1), Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(rpy.at(0), Eigen::Vector3d::UnitX()))
                                .toRotationMatrix();
  EXPECT_LT((R - c.T_camera_lidar.linear()).cwiseAbs().maxCoeff(), 1e-14);
  const auto t = node["translation"].as<std::vector<double>>();
  EXPECT_EQ(Eigen::Vector3d(t.at(0), t.at(1), t.at(2)), c.T_camera_lidar.translation());
}

TEST_F(ResultFile, LinesToPasteHoldTheCameraPoseInTheLidarFrame) {
  const lcr::StoredCalibration c = example();
  const YAML::Node node = YAML::Load(lcr::toYaml(c));

  std::istringstream words(node["static_transform_publisher"].as<std::string>());
  std::string rosrun, package, program, parent, child;
  double x, y, z, qx, qy, qz, qw;
  words >> rosrun >> package >> program >> x >> y >> z >> qx >> qy >> qz >> qw >> parent >> child;
  ASSERT_TRUE(words);
  EXPECT_EQ(rosrun + " " + package + " " + program, "rosrun tf2_ros static_transform_publisher");
  EXPECT_EQ(parent, "velodyne");
  EXPECT_EQ(child, "camera_optical");
  // The camera's centre, given in the LiDAR frame, is the origin of the camera; a point on its axis stays on
  // it.
  EXPECT_LT((c.T_camera_lidar * Eigen::Vector3d(x, y, z)).norm(), 1e-14);
  const Eigen::Vector3d ahead =
      Eigen::Vector3d(x, y, z) + Eigen::Quaterniond(qw, qx, qy, qz) * Eigen::Vector3d(0, 0, 5);
  EXPECT_LT((c.T_camera_lidar * ahead - Eigen::Vector3d(0, 0, 5)).norm(), 1e-14);

  const std::string origin = node["urdf_origin"].as<std::string>();
  std::smatch match;
  ASSERT_TRUE(std::regex_match(origin, match, std::regex("<origin xyz=\"([^\"]*)\" rpy=\"([^\"]*)\"/>")))
      << origin;
  std::istringstream xyz(match[1]), rpy(match[2]);
  double roll, pitch, yaw;
  xyz >> x >> y >> z;
  rpy >> roll >> pitch >> yaw;
  ASSERT_TRUE(xyz && rpy);
  Eigen::Isometry3d T_lidar_camera = Eigen::Isometry3d::Identity();
  T_lidar_camera.translation() << x, y, z;
  T_lidar_camera.linear() =
      (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  EXPECT_TRUE((T_lidar_camera * c.T_camera_lidar).matrix().isIdentity(1e-13));
}

TEST_F(ResultFile, RpyAtGimbalLock) {
  for (const double pitch : {M_PI / 2.0, -M_PI / 2.0}) {
    lcr::StoredCalibration c;
    c.T_camera_lidar.linear() = (Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()) *
                                 Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                                 Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX()))
                                    .toRotationMatrix();
    const auto rpy = YAML::Load(lcr::toYaml(c))["rpy"].as<std::vector<double>>();
    const Eigen::Matrix3d R = (Eigen::AngleAxisd(rpy.at(2), Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(rpy.at(1), Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(rpy.at(0), Eigen::Vector3d::UnitX()))
                                  .toRotationMatrix();
    EXPECT_TRUE(R.isApprox(c.T_camera_lidar.linear(), 1e-9));
  }
}

TEST_F(ResultFile, DecimalCommaOfTheProcessDoesNotMatter) {
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const std::string plain = lcr::toYaml(example());
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Comma));
  const std::string under_comma = lcr::toYaml(example());
  std::locale::global(before);
  EXPECT_EQ(under_comma, plain);
}

TEST_F(ResultFile, MinimalHandWrittenFiles) {
  const std::string sixteen = "1, 0, 0, 0.1,  0, 1, 0, 0.2,  0, 0, 1, 0.3,  0, 0, 0, 1";
  for (const std::string& text :
       {"T_camera_lidar: " + kIdentityRows, "T_camera_lidar: [" + sixteen + "]",
        "T_camera_lidar: {rows: 4, cols: 4, data: [" + sixteen + "]}",
        std::string("# mine\nT_camera_lidar:\n- [1, 0, 0, 0.1]\n- [0, 1, 0, 0.2]\n- [0, 0, 1, 0.3]\n- [0, 0, "
                    "0, 1]\n")}) {
    const lcr::StoredCalibration c = lcr::readCalibration(write("minimal.yaml", text));
    EXPECT_TRUE(c.T_camera_lidar.linear().isIdentity(1e-15)) << text;
    EXPECT_EQ(c.T_camera_lidar.translation(), Eigen::Vector3d(0.1, 0.2, 0.3)) << text;
    EXPECT_TRUE(c.camera_frame.empty());
    EXPECT_FALSE(c.covariance);
  }
}

TEST_F(ResultFile, BadFilesAreRefused) {
  expectRefused(path("missing.yaml"), std::strerror(ENOENT));
  expectRefused(folder_.string(), "regular file");
  expectRefused(write("empty", ""), "key: value");
  expectRefused(write("text", "hello"), "key: value");
  expectRefused(write("other", "a: 1"), "holds no T_camera_lidar");
  expectRefused(write("syntax", "T_camera_lidar: [[1, 0"), "line");
  expectRefused(write("binary", std::string("\x00\xff\xfe\x80{[", 6)), "");
  expectRefused(write("count", "T_camera_lidar: [1, 2, 3]"), "holds 3 numbers, not 16");
  expectRefused(write("scalar", "T_camera_lidar: 7"), "holds 0 numbers");
  expectRefused(write("words", "T_camera_lidar: [[a, b, c, d]]"), "bad conversion");
  expectRefused(write("nan", "T_camera_lidar: [[.nan, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"),
                "NaN");
  expectRefused(write("scaled", "T_camera_lidar: [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]"),
                "orthonormal");
  expectRefused(write("covariance", "T_camera_lidar: " + kIdentityRows + "\ncovariance: [1]"), "covariance");
  expectRefused(write("accepted", "T_camera_lidar: " + kIdentityRows + "\naccepted: perhaps"), "accepted");
  expectRefused(write("frames", "T_camera_lidar: " + kIdentityRows + "\nframes: -1"), "frames");
  expectRefused(write("frame", "T_camera_lidar: " + kIdentityRows + "\ncamera_frame: [a]"), "camera_frame");
  expectRefused(write("huge", "T_camera_lidar: " + kIdentityRows + "\n#" + std::string(1 << 20, 'x')),
                "1 MB");
}

TEST_F(ResultFile, WritesAndReplaces) {
  lcr::writeFileAtomically(path("a"), "first");
  EXPECT_EQ(read(path("a")), "first");
  lcr::writeFileAtomically(path("a"), "2nd");
  EXPECT_EQ(read(path("a")), "2nd");
  EXPECT_EQ(fileCount(), 1U);
}

TEST_F(ResultFile, FailuresLeaveNothingBehind) {
  write("file", "old content");
  fs::create_directory(folder_ / "folder");
  expectNotWritten(path("missing/result.yaml"), ENOENT);
  expectNotWritten(path("file/result.yaml"), ENOTDIR);
  expectNotWritten(path("folder"), EISDIR);
  EXPECT_EQ(read(path("file")), "old content");
  EXPECT_EQ(fileCount(), 2U);
  try {
    lcr::writeCalibration("", example());
    FAIL() << "written";
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kFile);
  }
}

TEST_F(ResultFile, OldContentSurvivesAFullDisk) {
  write("result.yaml", "old content");
  // A limit on the size of files fails in the middle of writing, as a full disk does.
  rlimit old_limit{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old_limit), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit limit = old_limit;
  limit.rlim_cur = 4096;
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &limit), 0);
  expectNotWritten(path("result.yaml"), EFBIG);
  ::setrlimit(RLIMIT_FSIZE, &old_limit);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_EQ(read(path("result.yaml")), "old content");
  EXPECT_EQ(fileCount(), 1U);
}

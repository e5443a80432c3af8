#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "lidar_camera_recalibration/calibration_formats.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

const fs::path kSamples = PACKAGE_DIR "/test/formats";

std::string textOf(const fs::path& path) {
  std::ostringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

/// A copy of the samples for each test.
class CalibrationFormats : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "formats_XXXXXX").string();
    ASSERT_NE(::mkdtemp(name.data()), nullptr);
    folder_ = name;
    fs::copy(kSamples, folder_, fs::copy_options::recursive);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(path(name)) << text;
    return path(name);
  }
  std::string changed(const std::string& name, const std::string& before, const std::string& after) const {
    std::string text = textOf(path(name));
    const std::size_t place = text.find(before);
    EXPECT_NE(place, std::string::npos) << before;
    return write(name, text.replace(place, before.size(), after));
  }

  fs::path folder_;
};

FormatOptions autowareFrames() {
  FormatOptions options;
  options.camera_frame = "camera0/camera_optical_link";
  options.lidar_frame = "velodyne_top";
  options.lidar_height = 0.06611;
  return options;
}

void expectRefused(const std::string& file, const FormatOptions& options, const std::string& words) {
  try {
    readCalibrationFile(file, options);
    FAIL() << file << " was accepted; expected: " << words;
  } catch (const Error& error) {
    EXPECT_EQ(error.cause(), ErrorCause::kFile);
    EXPECT_NE(std::string(error.what()).find(file), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
  }
}

Eigen::Isometry3d someExtrinsic() {
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::AngleAxisd(0.123, Eigen::Vector3d(0.3, -0.2, 0.9).normalized()) * R;
  T.translation() << 0.1 / 3.0, -1.0 / 7.0, -0.2884147;
  return T;
}

CalibrationContents someContents() {
  CalibrationContents contents;
  contents.calibration.emplace();
  contents.calibration->T_camera_lidar = someExtrinsic();
  contents.calibration->camera_frame = "camera0/camera_optical_link";
  contents.calibration->lidar_frame = "velodyne_top";
  Intrinsics& camera = contents.intrinsics.emplace();
  camera.width = 1241;
  camera.height = 376;
  camera.fx = 718.856;
  camera.fy = 717.5;
  camera.cx = 607.1928;
  camera.cy = 185.2157;
  return contents;
}

double difference(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.matrix() - b.matrix()).cwiseAbs().maxCoeff();
}

// --- the directions: by hand, from what each project says of its file ---

TEST_F(CalibrationFormats, KittiOdometryIsThatOfItsCamera) {
  const CalibrationContents contents = readCalibrationFile(path("kitti_odometry/calib.txt"));
  ASSERT_TRUE(contents.calibration && contents.intrinsics);
  EXPECT_EQ(contents.intrinsics->fx, 718.856);
  EXPECT_EQ(contents.intrinsics->cy, 185.2157);
  // P2 * Tr * p and K * (T * p) are the same pixel.
  const Eigen::Vector3d point(12.0, 3.0, -0.5);
  Eigen::Matrix<double, 3, 4> P2, Tr;
  P2 << 718.856, 0, 607.1928, 45.38225, 0, 718.856, 185.2157, -0.1130887, 0, 0, 1, 0.003779761;
  Tr << 4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02,
      -7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02, 9.999738645903e-01,
      4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01;
  const Eigen::Vector2d expected = (P2 * (Tr * point.homogeneous()).homogeneous()).hnormalized();
  Intrinsics camera = *contents.intrinsics;
  camera.width = 1241;
  camera.height = 376;
  const auto pixel = Camera(camera).project(contents.calibration->T_camera_lidar * point);
  ASSERT_TRUE(pixel);
  EXPECT_LT((*pixel - expected).norm(), 1e-4);  // Tr is orthonormal to 7 digits

  FormatOptions left;
  left.camera = "0";
  EXPECT_NEAR(readExtrinsic(path("kitti_odometry/calib.txt"), left).T_camera_lidar.translation().x(),
              -1.198459927713e-02, 1e-12);
}

TEST_F(CalibrationFormats, KittiRawIsRectifiedByTheFileBesideIt) {
  const CalibrationContents contents = readCalibrationFile(path("kitti_raw/calib_velo_to_cam.txt"));
  ASSERT_TRUE(contents.calibration && contents.intrinsics);
  // What kitti_0926 has as its reference, made by another program from the same calibration.
  Eigen::Matrix4d expected;
  expected << 0.00023477369814709978, -0.9999441545437641, -0.0105634778110522, 0.05705244785953041,
      0.010449407416592824, 0.010565353641379319, -0.9998895741176488, -0.07546671853346001,
      0.9999453885620024, 0.00012436537838650657, 0.010451302995668946, -0.2693869124058732, 0, 0, 0, 1;
  EXPECT_LT((contents.calibration->T_camera_lidar.matrix() - expected).cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_EQ(contents.intrinsics->width, 1242);
  EXPECT_TRUE(contents.notes.empty());

  fs::remove(path("kitti_raw/calib_cam_to_cam.txt"));
  const CalibrationContents alone = readCalibrationFile(path("kitti_raw/calib_velo_to_cam.txt"));
  EXPECT_FALSE(alone.intrinsics);
  EXPECT_EQ(alone.calibration->T_camera_lidar.translation(),
            Eigen::Vector3d(-4.069766e-03, -7.631618e-02, -2.717806e-01));
  ASSERT_EQ(alone.notes.size(), 1u);
  EXPECT_NE(alone.notes[0].find("calib_cam_to_cam.txt"), std::string::npos);
}

TEST_F(CalibrationFormats, CalibAnythingMapsLidarPointsIntoTheCamera) {
  const CalibrationContents contents = readCalibrationFile(path("calib_anything/calib.json"));
  const Eigen::Isometry3d& T = contents.calibration->T_camera_lidar;
  EXPECT_TRUE((T * Eigen::Vector3d(10.0, 2.0, 1.0)).isApprox(Eigen::Vector3d(-1.95, -1.2, 9.7), 1e-12));
  EXPECT_EQ(contents.intrinsics->fy, 1101.5);
  EXPECT_EQ(contents.intrinsics->model, DistortionModel::kPlumbBob);
}

TEST_F(CalibrationFormats, VisualLidarHoldsTheInverseWithTheQuaternionsWLast) {
  const CalibrationContents contents = readCalibrationFile(path("visual_lidar/calib.json"));
  const Eigen::Isometry3d& T = contents.calibration->T_camera_lidar;
  // The camera's centre in the LiDAR frame, and a point 5 m ahead of the camera, which looks along the
  // LiDAR's x.
  EXPECT_LT((T * Eigen::Vector3d(0.3, 0.05, -0.2)).norm(), 1e-12);
  EXPECT_LT((T * Eigen::Vector3d(5.3, 0.05, -0.2) - Eigen::Vector3d(0.0, 0.0, 5.0)).norm(), 1e-12);
  EXPECT_EQ(contents.intrinsics->cx, 822.25);
  EXPECT_EQ(contents.intrinsics->distortion.size(), 5u);

  changed("visual_lidar/calib.json", "\"T_lidar_camera\"", "\"other\"");  // then the guess
  EXPECT_LT((readExtrinsic(path("visual_lidar/calib.json")).T_camera_lidar * Eigen::Vector3d(0.25, 0.1, -0.1))
                .norm(),
            1e-12);
}

TEST_F(CalibrationFormats, AutowareNamesBodyFramesAndTheFeetOfLidars) {
  const StoredCalibration c = readExtrinsic(path("autoware/sensor_kit_calibration.yaml"), autowareFrames());
  EXPECT_EQ(c.camera_frame, "camera0/camera_optical_link");
  EXPECT_EQ(c.lidar_frame, "velodyne_top");
  // In the kit's frame the camera stands at (1, 0.5, -0.25) and looks to the left, the LiDAR is turned to the
  // left, and its points begin 0.06611 m above its foot. A point 10 m ahead of the camera and 1 m below it:
  const Eigen::Vector3d in_kit(1.0, 0.5 + 10.0, -0.25 - 1.0);
  const Eigen::Vector3d in_lidar(in_kit.y(), -in_kit.x(), in_kit.z() - 0.06611);
  EXPECT_LT((c.T_camera_lidar * in_lidar - Eigen::Vector3d(0.0, 1.0, 10.0)).norm(), 1e-9);

  // The body frame as a name is the same camera.
  FormatOptions body = autowareFrames();
  body.camera_frame = "camera0/camera_link";
  const StoredCalibration same = readExtrinsic(path("autoware/sensor_kit_calibration.yaml"), body);
  EXPECT_EQ(same.camera_frame, "camera0/camera_optical_link");
  EXPECT_LT(difference(same.T_camera_lidar, c.T_camera_lidar), 1e-12);
}

TEST_F(CalibrationFormats, AutowaresTwoFilesAreOneTree) {
  FormatOptions options = autowareFrames();
  options.lidar_frame = "velodyne_rear_base_link";  // of the other file
  const StoredCalibration c = readExtrinsic(path("autoware/sensor_kit_calibration.yaml"), options);
  // Its foot, seen from the camera: base_link is common to both.
  const auto pose = [](double x, double y, double z, double roll, double pitch, double yaw) {
    return Eigen::Isometry3d(Eigen::Translation3d(x, y, z) *
                             Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()));
  };
  const Eigen::Isometry3d kit = pose(0.9, 0.0, 2.0, -0.001, 0.015, -0.0364);
  const Eigen::Isometry3d body = kit * pose(1.0, 0.5, -0.25, 0.0, 0.0, 1.5707963267948966);
  const Eigen::Vector3d in_body = body.inverse() * Eigen::Vector3d(-0.358, 0.0, 1.631);
  EXPECT_LT(
      (c.T_camera_lidar.translation() - Eigen::Vector3d(-in_body.y(), -in_body.z(), in_body.x())).norm(),
      1e-9);
}

TEST_F(CalibrationFormats, Kalibr) {
  const Intrinsics first = readIntrinsics(path("kalibr/camchain.yaml"));
  EXPECT_EQ(first.width, 752);
  EXPECT_EQ(first.height, 480);
  EXPECT_EQ(first.fy, 460.25);
  EXPECT_EQ(first.model, DistortionModel::kPlumbBob);
  FormatOptions options;
  options.camera = "cam1";
  const Intrinsics second = readIntrinsics(path("kalibr/camchain.yaml"), options);
  EXPECT_EQ(second.model, DistortionModel::kEquidistant);
  EXPECT_EQ(second.cx, 379.75);
  EXPECT_EQ(second.distortion, (std::vector<double>{-0.01, 0.002, 0.0003, -0.0004}));
}

TEST_F(CalibrationFormats, CameraInfo) {
  const CalibrationContents contents = readCalibrationFile(path("camera_info/front.yaml"));
  ASSERT_TRUE(contents.intrinsics && contents.rectified);
  EXPECT_EQ(contents.intrinsics->fx, 484.25);
  EXPECT_EQ(contents.intrinsics->cy, 365.125);
  EXPECT_EQ(contents.intrinsics->distortion.size(), 5u);
  EXPECT_EQ(contents.rectified->fy, 431.75);
  EXPECT_EQ(contents.rectified->model, DistortionModel::kNone);
}

TEST_F(CalibrationFormats, UrdfAlongFixedJoints) {
  FormatOptions options;
  options.camera_frame = "camera_optical_frame";
  options.lidar_frame = "lidar";
  const StoredCalibration c = readExtrinsic(path("urdf/vehicle.urdf"), options);
  // The point 10 m ahead of the camera lies at (11.5, 0.25, 1.25) in base_link; the LiDAR is turned to the
  // left.
  const Eigen::Vector3d in_lidar(0.25, -(11.5 - 0.5), 1.25 - 1.5);
  EXPECT_LT((c.T_camera_lidar * in_lidar - Eigen::Vector3d(0.0, 0.0, 10.0)).norm(), 1e-9);
  const std::string origin = write(
      "origin.xml", "<origin xyz=\"0.3 0.05 -0.2\" rpy=\"-1.5707963267948966 0 -1.5707963267948966\"/>");
  EXPECT_LT(
      (readExtrinsic(origin).T_camera_lidar * Eigen::Vector3d(5.3, 0.05, -0.2) - Eigen::Vector3d(0, 0, 5))
          .norm(),
      1e-9);
}

// --- there and back ---

TEST_F(CalibrationFormats, EveryFormatGivesBackWhatItWasGiven) {
  const CalibrationContents contents = someContents();
  for (const FormatDescription& format : calibrationFormats()) {
    FormatOptions options = autowareFrames();
    options.format = format.name;
    const std::string file = path("new_" + format.name);
    writeCalibrationFile(file, contents, options);
    options.format.clear();  // its content tells it
    const CalibrationContents back = readCalibrationFile(file, options);
    ASSERT_EQ(back.calibration.has_value(), format.has_extrinsic) << format.name;
    if (format.has_extrinsic) {
      EXPECT_LT(difference(back.calibration->T_camera_lidar, someExtrinsic()), 1e-12) << format.name;
      EXPECT_EQ(back.calibration->lidar_frame, "velodyne_top") << format.name;
      EXPECT_EQ(back.calibration->camera_frame, "camera0/camera_optical_link") << format.name;
    }
    if (back.intrinsics) {
      EXPECT_EQ(back.intrinsics->fx, 718.856) << format.name;
      EXPECT_EQ(back.intrinsics->fy, 717.5) << format.name;
      EXPECT_EQ(back.intrinsics->cx, 607.1928) << format.name;
      EXPECT_EQ(back.intrinsics->cy, 185.2157) << format.name;
    }
  }
}

TEST_F(CalibrationFormats, DistortionIsKept) {
  CalibrationContents contents = someContents();
  contents.intrinsics->model = DistortionModel::kPlumbBob;
  contents.intrinsics->distortion = {-0.1, 0.2, 0.003, 0.0004};
  for (const char* name : {"calib_anything", "visual_lidar", "kalibr", "camera_info"}) {
    FormatOptions options;
    options.format = name;
    writeCalibrationFile(path("distorted"), contents, options);
    const Intrinsics back = readIntrinsics(path("distorted"), options);
    EXPECT_EQ(back.model, DistortionModel::kPlumbBob) << name;
    EXPECT_EQ(back.distortion, contents.intrinsics->distortion) << name;
  }
  FormatOptions odometry;
  odometry.format = "kitti_odometry";
  EXPECT_THROW(renderCalibration("", contents, odometry), Error);
  contents.intrinsics->model = DistortionModel::kEquidistant;
  for (const char* name : {"visual_lidar", "kalibr", "camera_info"}) {
    FormatOptions options;
    options.format = name;
    writeCalibrationFile(path("fisheye"), contents, options);
    EXPECT_EQ(readIntrinsics(path("fisheye"), options).model, DistortionModel::kEquidistant) << name;
  }
  FormatOptions anything;
  anything.format = "calib_anything";
  EXPECT_THROW(renderCalibration("", contents, anything), Error);
}

/// Lines of b that are not at the same place in a.
std::vector<std::string> differingLines(const std::string& a, const std::string& b) {
  std::istringstream before(a), after(b);
  std::vector<std::string> lines;
  for (std::string x, y; std::getline(after, y);) {
    if (!std::getline(before, x) || x != y) lines.push_back(y);
  }
  return lines;
}

TEST_F(CalibrationFormats, OnlyTheCamerasEntryOfAutowareChanges) {
  const std::string file = path("autoware/sensor_kit_calibration.yaml"), before = textOf(file);
  writeCalibrationFile(file, someContents(), autowareFrames());
  const std::string after = textOf(file);
  EXPECT_EQ(differingLines(before, after).size(), 6u) << after;
  EXPECT_NE(after.find("# front left"), std::string::npos);
  EXPECT_LT(difference(readExtrinsic(file, autowareFrames()).T_camera_lidar, someExtrinsic()), 1e-12);
  // What was read and is written again changes nothing but roundings.
  const auto camera = YAML::Load(before)["sensor_kit_base_link"]["camera1/camera_link"];
  FormatOptions second = autowareFrames();
  second.camera_frame = "camera1/camera_optical_link";
  CalibrationContents contents = readCalibrationFile(file, second);
  writeCalibrationFile(file, contents, second);
  const auto again = YAML::LoadFile(file)["sensor_kit_base_link"]["camera1/camera_link"];
  for (const char* key : {"x", "y", "z", "roll", "pitch", "yaw"})
    EXPECT_NEAR(again[key].as<double>(), camera[key].as<double>(), 1e-12) << key;
}

TEST_F(CalibrationFormats, OtherMembersOfJsonStay) {
  for (const char* name : {"calib_anything/calib.json", "visual_lidar/calib.json"}) {
    nlohmann::json before = nlohmann::json::parse(textOf(path(name)));
    CalibrationContents contents = someContents();
    contents.intrinsics.reset();  // then the file's own stay
    writeCalibrationFile(path(name), contents);
    nlohmann::json after = nlohmann::json::parse(textOf(path(name)));
    EXPECT_LT(difference(readExtrinsic(path(name)).T_camera_lidar, someExtrinsic()), 1e-12) << name;
    for (nlohmann::json* root : {&before, &after}) {
      root->erase("T_lidar_to_cam");
      if (root->count("results") > 0) (*root)["results"].erase("T_lidar_camera");
    }
    EXPECT_EQ(before, after) << name;
  }
}

TEST_F(CalibrationFormats, OtherLinesOfKittiStay) {
  for (const char* name : {"kitti_odometry/calib.txt", "kitti_raw/calib_velo_to_cam.txt"}) {
    const std::string before = textOf(path(name));
    CalibrationContents contents = someContents();
    contents.calibration->camera_frame.clear();
    writeCalibrationFile(path(name), contents);
    EXPECT_LT(difference(readExtrinsic(path(name)).T_camera_lidar, someExtrinsic()), 1e-12) << name;
    std::istringstream lines(before);
    for (std::string line; std::getline(lines, line);) {
      const bool replaced = line[0] == 'T' || line.rfind("R:", 0) == 0;
      EXPECT_EQ(textOf(path(name)).find(line) == std::string::npos, replaced) << line;
    }
  }
}

TEST_F(CalibrationFormats, KalibrsOtherCameraStays) {
  FormatOptions options;
  options.camera = "cam1";
  writeCalibrationFile(path("kalibr/camchain.yaml"), someContents(), options);
  EXPECT_EQ(readIntrinsics(path("kalibr/camchain.yaml")).fx, 461.5);
  EXPECT_EQ(readIntrinsics(path("kalibr/camchain.yaml"), options).fx, 718.856);
  EXPECT_EQ(YAML::LoadFile(path("kalibr/camchain.yaml"))["cam1"]["T_cn_cnm1"][0][3].as<double>(), -0.11);
}

// --- names and contents tell the format ---

TEST_F(CalibrationFormats, TheNameOfANewFileTellsItsFormat) {
  const auto name = [this](const std::string& file) { return formatForWriting(path(file)).name; };
  EXPECT_EQ(name("calib_velo_to_cam.txt"), "kitti_raw");
  EXPECT_EQ(name("calib.txt"), "kitti_odometry");
  EXPECT_EQ(name("sensor_kit_calibration.yaml"), "autoware");
  EXPECT_EQ(name("camchain-front.yaml"), "kalibr");
  EXPECT_EQ(name("front_camera_info.yaml"), "camera_info");
  EXPECT_EQ(name("camera.urdf"), "urdf");
  EXPECT_EQ(name("result.yaml"), "yaml");
  EXPECT_EQ(name("calib_anything/calib.json"), "calib_anything");  // its content
  EXPECT_EQ(name("visual_lidar/calib.json"), "visual_lidar");
  fs::copy(path("autoware/sensor_kit_calibration.yaml"), path("kit.yaml"));
  EXPECT_EQ(name("kit.yaml"), "autoware");
  try {
    formatForWriting(path("calib.json"));
    FAIL() << "calib.json may be of two projects";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("visual_lidar"), std::string::npos) << error.what();
  }
}

TEST_F(CalibrationFormats, ArgumentsNameFormats) {
  const auto split = [](const std::string& argument) {
    std::string file;
    FormatOptions options;
    splitFormat(argument, file, options);
    return file + "|" + options.format;
  };
  EXPECT_EQ(split("a/b.txt:kitti_raw"), "a/b.txt|kitti_raw");
  EXPECT_EQ(split("a/b.txt"), "a/b.txt|");
  EXPECT_EQ(split("c:d.txt"), "c:d.txt|");
}

// --- what is wrong with a file ---

TEST_F(CalibrationFormats, UnknownFilesAreDescribed) {
  expectRefused(write("a", "speed: 3\ncolour: red\n"), {}, "it is YAML with the keys speed, colour");
  expectRefused(write("a", "speed: 3\n"), {}, "calib_anything: CalibAnything's calib.json");
  expectRefused(write("a", "{\"speed\": 3}"), {}, "it is JSON with the keys speed");
  expectRefused(write("a", "{\"speed\": "), {}, "it begins like JSON, but is none");
  expectRefused(write("a", "hello"), {}, "it is no list of `key: value`");
  expectRefused(write("a", " \n"), {}, "it is empty");
  expectRefused(path("missing"), {}, "No such file");
  FormatOptions unknown;
  unknown.format = "excel";
  EXPECT_THROW(readCalibrationFile(path("kalibr/camchain.yaml"), unknown), Error);
}

struct Fault {
  const char *file, *before, *after, *message;
};

TEST_F(CalibrationFormats, FaultsAreNamed) {
  const std::vector<Fault> faults = {
      {"kitti_raw/calib_velo_to_cam.txt", "T: -4.069766e-03 ", "T: ", "\"T:\" has 2 numbers, 3 are expected"},
      {"kitti_raw/calib_velo_to_cam.txt", "R: 7.533745e-03", "R: nan", "'nan' is no finite number"},
      {"kitti_raw/calib_velo_to_cam.txt", "9.998621e-01", "1.9998621", "not orthonormal"},
      {"kitti_raw/calib_cam_to_cam.txt", "P_rect_02", "P_rect_09", "no line \"P_rect_02:\""},
      {"kitti_odometry/calib.txt", "Tr: 4.276802385584e-04", "Tr: 0.1 4.276802385584e-04",
       "\"Tr:\" has 13 numbers"},
      {"kitti_odometry/calib.txt", "9.999738645903e-01", "1.999738645903e+00", "P2 and Tr: "},
      {"kitti_odometry/calib.txt", "P2: 7.188560000000e+02", "P2: -7.188560000000e+02", "focal lengths"},
      {"calib_anything/calib.json", "[0, -1, 0, 0.05]", "[0, -1, 0]", "T_lidar_to_cam is not 4x4"},
      {"calib_anything/calib.json", "[0, -1, 0, 0.05]", "[0, -2, 0, 0.05]", "not orthonormal"},
      {"calib_anything/calib.json", "[0, -1, 0, 0.05]", "[0, -1, 0, NaN]", "JSON"},
      {"calib_anything/calib.json", "[0, -1, 0, 0.05]", "[0, -1, 0, null]",
       "T_lidar_to_cam/data has an unsuitable value"},
      {"calib_anything/calib.json", "\"T_lidar_to_cam\"", "\"T\"", "T_lidar_to_cam is missing"},
      {"calib_anything/calib.json", "[-0.11, ", "[-0.11, 1, 2, ", "6 distortion coefficients"},
      {"visual_lidar/calib.json", "\"plumb_bob\"", "\"omnidir\"", "unknown distortion model 'omnidir'"},
      {"visual_lidar/calib.json", "      810.5,\n", "", "camera/intrinsics has 3 numbers"},
      {"visual_lidar/calib.json", "      0.3,\n", "", "results/T_lidar_camera has 6 numbers, not 7"},
      {"visual_lidar/calib.json", "-0.5,\n      0.5,\n", "-0.5,\n      0.6,\n", "norm of the quaternion"},
      {"autoware/sensor_kit_calibration.yaml", "    yaw: 1.5707963267948966\n", "",
       "'camera0/camera_link' has no yaw"},
      {"autoware/sensor_kit_calibration.yaml", "z: -0.25", "z: .nan",
       "'camera0/camera_link': the pose holds NaN"},
      {"autoware/sensor_kit_calibration.yaml", "z: -0.25", "z: low",
       "z of the entry 'camera0/camera_link' is no number"},
      {"autoware/sensor_kit_calibration.yaml", "camera0/", "camera7/",
       "no entry for the camera frame 'camera0/camera_optical_link'"},
      {"autoware/sensor_kit_calibration.yaml", "velodyne_top", "velodyne_left",
       "no entry for the LiDAR frame 'velodyne_top'"},
      {"kalibr/camchain.yaml", "camera_model: pinhole", "camera_model: omni", "'omni' is not pinhole"},
      {"kalibr/camchain.yaml", "radtan", "fov", "'fov' is none of radtan"},
      {"kalibr/camchain.yaml", "resolution: [752, 480]\n  rostopic: /cam0", "rostopic: /cam0",
       "resolution is missing"},
      {"kalibr/camchain.yaml", "[461.5,", "[.nan,", "describes no camera"},
      {"camera_info/front.yaml", "image_height: 724\n", "", "image_height is missing"},
      {"camera_info/front.yaml", "[484.25, ", "[", "camera_matrix holds 8 numbers, not 9"},
      {"camera_info/front.yaml", "plumb_bob", "plumb", "unknown distortion model 'plumb'"},
      {"camera_info/front.yaml", "[484.25, ", "[-484.25, ", "describes no camera"},
  };
  for (const Fault& fault : faults) {
    const std::string good = textOf(path(fault.file));
    changed(fault.file, fault.before, fault.after);
    const bool beside = std::string(fault.file) == "kitti_raw/calib_cam_to_cam.txt";
    expectRefused(path(beside ? "kitti_raw/calib_velo_to_cam.txt" : fault.file), autowareFrames(),
                  fault.message);
    write(fault.file, good);
  }
}

TEST_F(CalibrationFormats, DamagedFilesAreRefusedOrRead) {
  FormatOptions urdf;
  urdf.camera_frame = "camera_optical_frame";
  urdf.lidar_frame = "lidar";
  std::size_t refused = 0, read = 0;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kSamples)) {
    if (!entry.is_regular_file() || entry.path().filename() == "calib_cam_to_cam.txt") continue;
    const std::string whole = textOf(entry.path());
    for (std::size_t at = 0; at < whole.size(); at += 13) {
      std::string other = whole;
      other[at] = static_cast<char>(whole[at] ^ 21);
      for (const std::string& text : {whole.substr(0, at), other}) {
        try {
          const CalibrationContents contents = readCalibrationFile(
              write("damaged", text), entry.path().extension() == ".urdf" ? urdf : autowareFrames());
          if (contents.calibration) {
            EXPECT_TRUE(contents.calibration->T_camera_lidar.matrix().allFinite())
                << entry.path() << ' ' << at;
          }
          ++read;
        } catch (const Error&) {
          ++refused;
        }
      }
    }
  }
  EXPECT_GT(refused, 500u);
  EXPECT_GT(read, 100u);  // a digit more or less is no fault that could be seen
  expectRefused(write("deep", std::string(100000, '[')), {}, "calibration file");
}

TEST_F(CalibrationFormats, UrdfFaultsAreNamed) {
  FormatOptions options;
  options.lidar_frame = "lidar";
  expectRefused(path("urdf/vehicle.urdf"), options, "name the camera's optical frame");
  options.camera_frame = "camera";
  expectRefused(path("urdf/vehicle.urdf"), options, "there is no frame 'camera'; known are");
  options.camera_frame = "wheel";
  expectRefused(path("urdf/vehicle.urdf"), options, "there is no frame 'wheel'");
  options.camera_frame = "camera_optical_frame";
  changed("urdf/vehicle.urdf", "1.5 0.25 1.25", "${x} 0.25 1.25");
  expectRefused(path("urdf/vehicle.urdf"), options, "xacro");
  expectRefused(write("a.urdf", "<origin xyz=\"1 2\"/>"), {}, "has 2 numbers, not 3");
  expectRefused(write("a.urdf", "<origin xyz=\"1 2 nan\"/>"), {}, "'nan' is no finite number");
  expectRefused(write("a.urdf", "<origin "), {}, "is no XML");
  expectRefused(write("a.urdf", "<link/>"), {}, "none of <robot>, <joint>, <origin>");
  options.camera_frame = "camera_optical_frame";
  EXPECT_THROW(writeCalibrationFile(path("urdf/vehicle.urdf"), someContents(), options), Error);
}

TEST_F(CalibrationFormats, TheLidarsFootIsNotMistakenForItsPoints) {
  FormatOptions options = autowareFrames();
  options.lidar_height.reset();
  const std::string file = path("autoware/sensor_kit_calibration.yaml"), before = textOf(file);
  expectRefused(file, options, "say how far the frame of the points 'velodyne_top' lies above it");
  EXPECT_THROW(writeCalibrationFile(file, someContents(), options), Error);
  EXPECT_EQ(textOf(file), before);
  fs::remove(path("autoware/sensors_calibration.yaml"));
  options.lidar_frame.clear();  // the only one
  const CalibrationContents contents = readCalibrationFile(file, options);
  EXPECT_EQ(contents.calibration->lidar_frame, "velodyne_top_base_link");
  EXPECT_EQ(contents.notes.size(), 1u);
  options.camera_frame.clear();
  expectRefused(file, options, "these may be it: camera0/camera_link, camera1/camera_link");
}

TEST_F(CalibrationFormats, WhatAFormatNeedsIsNamed) {
  CalibrationContents contents = someContents();
  contents.intrinsics.reset();
  const auto refusal = [&](const char* format) {
    FormatOptions options;
    options.format = format;
    try {
      renderCalibration(path("new"), contents, options);
      return std::string("written");
    } catch (const Error& error) {
      return std::string(error.what());
    }
  };
  for (const char* format : {"calib_anything", "visual_lidar", "kitti_odometry", "kalibr", "camera_info"})
    EXPECT_NE(refusal(format).find("needs the camera's intrinsics"), std::string::npos) << refusal(format);
  contents.calibration.reset();
  for (const char* format : {"yaml", "urdf", "kitti_raw", "autoware"})
    EXPECT_NE(refusal(format).find("needs an extrinsic"), std::string::npos) << refusal(format);
}

}  // namespace
}  // namespace lidar_camera_recalibration

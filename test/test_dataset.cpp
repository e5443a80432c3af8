#include "dataset.hpp"

#include <gtest/gtest.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "dataset_files.hpp"
#include "dataset_writing.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

constexpr int kWidth = 8, kHeight = 6;

class DatasetTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "test_dataset_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    root_ = pattern;
  }
  void TearDown() override { fs::remove_all(root_); }

  fs::path write(const fs::path& file, const std::string& text) const {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file, std::ios::binary) << text;
    return root_ / file;
  }

  void writePng(const fs::path& file, const cv::Mat& image) const {
    fs::create_directories((root_ / file).parent_path());
    ASSERT_TRUE(cv::imwrite((root_ / file).string(), image));
  }

  void writeImage(const fs::path& file) const {
    writePng(file, cv::Mat(kHeight, kWidth, CV_8UC3, cv::Scalar(10, 20, 30)));
  }

  fs::path writeBin(const fs::path& file, const std::vector<float>& values) const {
    return write(file,
                 std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)));
  }

  std::unique_ptr<Dataset> open(const fs::path& folder = "") const {
    return Dataset::open((root_ / folder).string());
  }

  /// The message of the Error(kFile) that an action must throw.
  template <typename Action>
  static std::string refusal(const Action& action) {
    try {
      action();
    } catch (const Error& error) {
      EXPECT_EQ(error.cause(), ErrorCause::kFile) << error.what();
      return error.what();
    }
    ADD_FAILURE() << "nothing was thrown";
    return "";
  }

  void writeOdometry() const;
  void writeRaw() const;
  void writeCalibAnything(const std::string& changes = "") const;

  fs::path root_;
};

void expectContains(const std::string& text, const std::string& part) {
  EXPECT_NE(text.find(part), std::string::npos) << text;
}

// --- KITTI odometry: the published calibration of sequence 00 ---

constexpr char kOdometryCalib[] =
    "P0: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 0.000000000000e+00 0.000000000000e+00 "
    "7.188560000000e+02 1.852157000000e+02 0.000000000000e+00 0.000000000000e+00 0.000000000000e+00 "
    "1.000000000000e+00 0.000000000000e+00\n"
    "P2: 7.188560000000e+02 0.000000000000e+00 6.071928000000e+02 4.538225000000e+01 0.000000000000e+00 "
    "7.188560000000e+02 1.852157000000e+02 -1.130887000000e-01 0.000000000000e+00 0.000000000000e+00 "
    "1.000000000000e+00 3.779761000000e-03\n"
    "Tr: 4.276802385584e-04 -9.999672484946e-01 -8.084491683471e-03 -1.198459927713e-02 -7.210626507497e-03 "
    "8.081198471645e-03 -9.999413164504e-01 -5.403984729748e-02 9.999738645903e-01 4.859485810390e-04 "
    "-7.206933692422e-03 -2.921968648686e-01\n";

void DatasetTest::writeOdometry() const {
  write("calib.txt", kOdometryCalib);
  write("times.txt", "0.000000e+00\n1.037359e-01\n2.073343e-01\n");
  for (const char* name : {"000000", "000001", "000002"}) writeImage(std::string("image_2/") + name + ".png");
  // The cloud of frame 1 is missing.
  writeBin("velodyne/000000.bin", {1, 2, 3, 0.25F, 4, 5, 6, 0.5F});
  writeBin("velodyne/000002.bin", {7, 8, 9, 0.75F});
}

TEST_F(DatasetTest, KittiOdometry) {
  writeOdometry();
  const auto dataset = open();
  EXPECT_EQ(dataset->layout(), "KITTI odometry");
  ASSERT_EQ(dataset->size(), 2u);
  EXPECT_EQ(dataset->name(1), "000002");
  EXPECT_NEAR(dataset->stamp(1) - dataset->stamp(0), 0.2073343, 1e-6);
  EXPECT_GT(dataset->stamp(0), 0.0);
  EXPECT_EQ(dataset->intrinsics().fx, 718.856);
  EXPECT_EQ(dataset->intrinsics().cy, 185.2157);
  EXPECT_EQ(dataset->intrinsics().width, kWidth);
  EXPECT_EQ(dataset->intrinsics().height, kHeight);
  EXPECT_EQ(dataset->intrinsics().model, DistortionModel::kNone);
  // By hand: Tr's translation plus K^-1 of P2's last column.
  ASSERT_TRUE(dataset->reference());
  const double z = 0.003779761;
  const Eigen::Vector3d expected(-0.01198459927713 + (45.38225 - 607.1928 * z) / 718.856,
                                 -0.05403984729748 + (-0.1130887 - 185.2157 * z) / 718.856,
                                 -0.2921968648686 + z);
  EXPECT_LT((dataset->reference()->translation() - expected).norm(), 1e-9);
  EXPECT_NEAR(dataset->reference()->linear()(2, 0), 0.9999738645903, 1e-6);

  const PointCloud cloud = dataset->cloud(0);
  ASSERT_EQ(cloud.size(), 2u);
  EXPECT_EQ(cloud.points[1], Eigen::Vector3f(4, 5, 6));
  EXPECT_EQ(cloud.reflectivity, (std::vector<float>{0.25F, 0.5F}));
  EXPECT_TRUE(cloud.ring.empty());
  EXPECT_EQ(dataset->image(0).at<cv::Vec3b>(0, 0), cv::Vec3b(10, 20, 30));
  EXPECT_TRUE(dataset->maskLayers(0).empty());
}

TEST_F(DatasetTest, KittiBinHasNoFalseAndNoUselessPoints) {
  writeOdometry();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  writeBin("velodyne/000000.bin", {0, 0, 0, 1, 1, nan, 3, 1, 1, 2, 3, nan});
  const PointCloud cloud = open()->cloud(0);
  ASSERT_EQ(cloud.size(), 1u);
  EXPECT_EQ(cloud.points[0], Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(cloud.reflectivity, std::vector<float>{0.0F});

  writeBin("velodyne/000000.bin", {1, 2, 3, 4, 5});
  expectContains(refusal([&] { open()->cloud(0); }), "000000.bin\": 20 bytes are no whole number of points");
  writeBin("velodyne/000000.bin", {0, 0, 0, 1});
  expectContains(refusal([&] { open()->cloud(0); }), "no finite point");
}

TEST_F(DatasetTest, MasksOfKitti) {
  writeOdometry();
  cv::Mat left = cv::Mat::zeros(kHeight, kWidth, CV_8UC1), all = left.clone();
  left.colRange(0, 3).setTo(255);
  all.setTo(255);
  writePng("masks/000000/000.png", all);
  writePng("masks/000000/001.png", left);
  cv::Mat labels(kHeight, kWidth, CV_16UC1, cv::Scalar(0));
  labels.at<std::uint16_t>(2, 3) = 40000;
  writePng("masks/000002.png", labels);
  const auto dataset = open();

  const std::vector<cv::Mat> binary = dataset->maskLayers(0);
  ASSERT_EQ(binary.size(), 2u);  // they overlap
  EXPECT_EQ(binary[0].type(), CV_32SC1);
  EXPECT_EQ(binary[0].at<int>(5, 7), 1);
  EXPECT_EQ(binary[1].at<int>(5, 2), 2);
  EXPECT_EQ(binary[1].at<int>(5, 3), 0);

  const std::vector<cv::Mat> label_image = dataset->maskLayers(1);
  ASSERT_EQ(label_image.size(), 1u);
  EXPECT_EQ(label_image[0].type(), CV_32SC1);
  EXPECT_EQ(label_image[0].at<int>(2, 3), 40000);
  EXPECT_EQ(cv::countNonZero(label_image[0]), 1);
}

TEST_F(DatasetTest, WrongSizesAreRefusedByName) {
  writeOdometry();
  writePng("image_2/000002.png", cv::Mat::zeros(3, 4, CV_8UC3));
  writePng("masks/000000/000.png", cv::Mat::ones(3, 4, CV_8UC1));
  const auto dataset = open();
  expectContains(refusal([&] { dataset->image(1); }), "000002.png\": is 4x3, the first image is 8x6");
  expectContains(refusal([&] { dataset->maskLayers(0); }), "000000\": is 4x3");
  writePng("masks/000000/001.png", cv::Mat::ones(kHeight, kWidth, CV_8UC1));
  expectContains(refusal([&] { dataset->maskLayers(0); }), "masks/000000");
}

TEST_F(DatasetTest, BrokenKittiCalibration) {
  writeOdometry();
  write("calib.txt", "P2: 1 2 3\n");
  expectContains(refusal([&] { open(); }), "calib.txt': \"P2:\" has 3 numbers, 12 are expected");
  write("calib.txt", "P0: 1 2 3\n");
  expectContains(refusal([&] { open(); }), "no line \"P2:\"");
  std::string sheared = kOdometryCalib;
  sheared.replace(sheared.find("9.999738645903e-01"), 18, "1.999738645903e+00");
  write("calib.txt", sheared);
  expectContains(refusal([&] { open(); }), "P2 and Tr");
  write("calib.txt", kOdometryCalib);
  write("times.txt", "0.0\n");
  expectContains(refusal([&] { open(); }), "times.txt\": has no line for the frame 000002");
  write("times.txt", "0.0\nsoon\n");
  expectContains(refusal([&] { open(); }), "line 2 is no time: soon");
}

// --- KITTI raw: the published calibration of 2011_09_26 ---

void DatasetTest::writeRaw() const {
  write(
      "calib_cam_to_cam.txt",
      "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.950000e-02\nS_rect_02: 8.0 6.0\n"
      "R_rect_00: 9.999239e-01 9.837760e-03 -7.445048e-03 -9.869795e-03 9.999421e-01 -4.278459e-03 "
      "7.402527e-03 4.351614e-03 9.999631e-01\n"
      "P_rect_02: 7.215377e+02 0.000000e+00 6.095593e+02 4.485728e+01 0.000000e+00 7.215377e+02 1.728540e+02 "
      "2.163791e-01 0.000000e+00 0.000000e+00 1.000000e+00 2.745884e-03\n");
  write("calib_velo_to_cam.txt",
        "calib_time: 15-Mar-2012 11:37:16\n"
        "R: 7.533745e-03 -9.999714e-01 -6.166020e-04 1.480249e-02 7.280733e-04 -9.998902e-01 9.998621e-01 "
        "7.523790e-03 1.480755e-02\n"
        "T: -4.069766e-03 -7.631618e-02 -2.717806e-01\ndelta_f: 0.000000e+00 0.000000e+00\n");
  const std::string drive = "2011_09_26_drive_0005_sync/";
  write(drive + "image_02/timestamps.txt",
        "2011-09-26 13:02:25.594360375\n2011-09-26 13:02:25.698118000\n\n");
  for (const char* name : {"0000000000", "0000000001"}) {
    writeImage(drive + "image_02/data/" + name + ".png");
    writeBin(drive + "velodyne_points/data/" + name + ".bin", {1, 2, 3, 0.5F});
  }
}

TEST_F(DatasetTest, KittiRaw) {
  writeRaw();
  const auto dataset = open("2011_09_26_drive_0005_sync");
  EXPECT_EQ(dataset->layout(), "KITTI raw");
  ASSERT_EQ(dataset->size(), 2u);
  EXPECT_NEAR(dataset->stamp(0), 1317042145.594360, 1e-5);  // date -u -d '2011-09-26 13:02:25' +%s
  EXPECT_NEAR(dataset->stamp(1) - dataset->stamp(0), 0.103758, 1e-5);
  EXPECT_EQ(dataset->intrinsics().fx, 721.5377);
  EXPECT_EQ(dataset->intrinsics().cx, 609.5593);
  // What kitti_0926 has as its reference, made by another program from the same calibration.
  Eigen::Matrix4d expected;
  expected << 0.00023477369814709978, -0.9999441545437641, -0.0105634778110522, 0.05705244785953041,
      0.010449407416592824, 0.010565353641379319, -0.9998895741176488, -0.07546671853346001,
      0.9999453885620024, 0.00012436537838650657, 0.010451302995668946, -0.2693869124058732, 0, 0, 0, 1;
  ASSERT_TRUE(dataset->reference());
  EXPECT_LT((dataset->reference()->matrix() - expected).cwiseAbs().maxCoeff(), 1e-6);
}

TEST_F(DatasetTest, KittiRawOpensWithTrailingSlash) {
  writeRaw();
  EXPECT_EQ(open("2011_09_26_drive_0005_sync/")->size(), 2u);
}

TEST_F(DatasetTest, UnrectifiedDriveIsRefused) {
  writeRaw();
  for (const char* name : {"0000000000", "0000000001"}) {
    writePng(std::string("2011_09_26_drive_0005_sync/image_02/data/") + name + ".png",
             cv::Mat::zeros(7, 9, CV_8UC3));
  }
  expectContains(refusal([&] { open("2011_09_26_drive_0005_sync"); }), "_sync");
}

TEST_F(DatasetTest, MissingRawCalibrationIsNamed) {
  writeRaw();
  fs::remove(root_ / "calib_velo_to_cam.txt");
  expectContains(refusal([&] { open("2011_09_26_drive_0005_sync"); }),
                 "calib_velo_to_cam.txt': No such file");
}

// --- CalibAnything ---

/// @param changes  more members of the object; later ones win
void DatasetTest::writeCalibAnything(const std::string& changes) const {
  write("calib.json", R"({"cam_K": {"rows": 3, "cols": 3, "data": [[100, 0, 4], [0, 110, 3], [0, 0, 1]]},
  "cam_dist": {"cols": 5, "data": [0.1, 0.01, 0.001, 0.002, 0.003]},
  "T_lidar_to_cam": {"rows": 4, "cols": 4, "data": [[0, -1, 0, 1], [0, 0, -1, 2], [1, 0, 0, 3], [0, 0, 0, 1]]},
  "T_lidar_to_cam_gt": {"available": true, "data": [[0, -1, 0, 4], [0, 0, -1, 5], [1, 0, 0, 6], [0, 0, 0, 1]]},
  "img_folder": "pictures", "pc_folder": "pc", "img_format": ".png", "pc_format": ".pcd", "mask_folder": "masks")" +
                          (changes.empty() ? R"(, "file_name": ["a", "b"])" : ", " + changes) + "}");
  for (const char* name : {"a", "b"}) writeImage(std::string("pictures/") + name + ".png");
  fs::create_directories(root_ / "pc");
}

TEST_F(DatasetTest, CalibAnythingAndItsFaults) {
  writeCalibAnything();
  EXPECT_EQ(open()->reference()->translation(), Eigen::Vector3d(4, 5, 6));  // what the file says to be true
  EXPECT_EQ(open()->intrinsics().fy, 110.0);
  EXPECT_EQ(open()->intrinsics().distortion.size(), 5u);
  const std::string whole = readText(root_ / "calib.json");
  const auto refused = [&](const std::string& before, const std::string& after) {
    std::string text = whole;
    text.replace(text.find(before), before.size(), after);
    write("calib.json", text);
    return refusal([&] { open(); });
  };
  expectContains(refused("\"cam_K\"", "\"K\""), "calib.json\": the key cam_K is missing");
  expectContains(refused("[0, 110, 3]", "[0, 110]"), "cam_K is not 3x3");
  expectContains(refused("\"file_name\"", "\"names\""), "the key file_name is missing");
  expectContains(refused("{", "["), "calib.json\": [json");
}

TEST_F(DatasetTest, BrokenCloudsAndImages) {
  writeCalibAnything();
  // PCL would set all of that memory aside before it returned the header.
  const std::vector<std::string> too_much = {"COUNT 1 1 1\nWIDTH 4000000000\nHEIGHT 1\nPOINTS 4000000000",
                                             "COUNT 1 1 1\nWIDTH 100000\nHEIGHT 100000\nPOINTS 3",
                                             "COUNT 1 1 100000\nWIDTH 1000000\nHEIGHT 1\nPOINTS 1000000",
                                             "COUNT 1 1 1\nWIDTH -1\nHEIGHT 1\nPOINTS 3"};
  for (const std::string& claim : too_much) {
    write("pc/a.pcd", "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n" + claim + "\nDATA binary\nabc");
    expectContains(refusal([&] { open()->cloud(0); }), "a.pcd\": claims ");
  }
  // Every cut of a compressed and of a binary file, PCL's own reader crashes on some.
  pcl::PointCloud<pcl::PointXYZI> cloud;
  for (int i = 0; i < 50; ++i) cloud.push_back(pcl::PointXYZI(1, 2, static_cast<float>(i), 5));
  for (const bool compressed : {false, true}) {
    compressed ? pcl::io::savePCDFileBinaryCompressed((root_ / "pc/a.pcd").string(), cloud)
               : pcl::io::savePCDFileBinary((root_ / "pc/a.pcd").string(), cloud);
    const std::string whole = readText(root_ / "pc/a.pcd");
    EXPECT_EQ(open()->cloud(0).size(), 50u);
    for (std::size_t size = 1; size < whole.size(); size += 7) {
      write("pc/a.pcd", whole.substr(0, size));
      expectContains(refusal([&] { open()->cloud(0); }), "a.pcd\"");
    }
  }
  write("pc/a.pcd", "this is no cloud");
  expectContains(refusal([&] { open()->cloud(0); }), "a.pcd\"");
  fs::remove(root_ / "pc/a.pcd");
  expectContains(refusal([&] { open()->cloud(0); }), "a.pcd\": there is no such file");
  write("pictures/b.png", "no picture");
  expectContains(refusal([&] { open()->image(1); }), "b.png\": cannot be decoded");
}

TEST_F(DatasetTest, UnknownLayouts) {
  expectContains(refusal([&] { open(); }), "expected calib.json");
  expectContains(refusal([&] { open("nowhere"); }), "there is no such folder");
}

// --- real frames ---

std::unique_ptr<Dataset> openShared(const std::string& name) {
  const fs::path folder = fs::path(SHARED_DATA) / name;
  return fs::exists(folder) ? Dataset::open(folder.string()) : nullptr;
}

TEST(RealDataset, Kitti00) {
  const auto dataset = openShared("kitti_00");
  if (!dataset) GTEST_SKIP() << "no real data: " << SHARED_DATA << "/kitti_00";
  EXPECT_EQ(dataset->size(), 25u);
  EXPECT_EQ(dataset->name(1), "000185");
  EXPECT_EQ(dataset->intrinsics().width, 1241);
  EXPECT_EQ(dataset->intrinsics().height, 376);
  EXPECT_EQ(dataset->intrinsics().fx, 718.856);
  EXPECT_EQ(dataset->intrinsics().model, DistortionModel::kNone);
  EXPECT_LT(
      (dataset->reference()->translation() - Eigen::Vector3d(0.04795398, -0.05517103, -0.2884147)).norm(),
      1e-9);
  EXPECT_NEAR(dataset->reference()->linear()(0, 1), -0.9999672286981587, 1e-9);
  const PointCloud cloud = dataset->cloud(0);
  EXPECT_EQ(cloud.size(), 124668u);  // POINTS of the file's header
  EXPECT_EQ(cloud.reflectivity.size(), cloud.size());
  const std::vector<cv::Mat> layers = dataset->maskLayers(0);
  ASSERT_FALSE(layers.empty());
  double largest = 0.0, largest_of_layer = 0.0;
  for (const cv::Mat& layer : layers) {
    cv::minMaxLoc(layer, nullptr, &largest_of_layer);
    largest = std::max(largest, largest_of_layer);
  }
  const auto files =
      std::distance(fs::directory_iterator(fs::path(SHARED_DATA) / "kitti_00/masks/000000"), {});
  EXPECT_EQ(largest, static_cast<double>(files));
}

TEST(RealDataset, Kitti0926) {
  const auto dataset = openShared("kitti_0926");
  if (!dataset) GTEST_SKIP() << "no real data: " << SHARED_DATA << "/kitti_0926";
  EXPECT_EQ(dataset->size(), 13u);
  EXPECT_EQ(dataset->intrinsics().width, 1242);
  const PointCloud cloud = dataset->cloud(12);
  EXPECT_EQ(cloud.size(),
            fs::file_size(fs::path(SHARED_DATA) / "kitti_0926/pc" / (dataset->name(12) + ".bin")) / 16);
  EXPECT_EQ(dataset->image(12).type(), CV_8UC3);
}

TEST(RealDataset, Pandar64) {
  const auto dataset = openShared("pandar64_a");
  if (!dataset) GTEST_SKIP() << "no real data: " << SHARED_DATA << "/pandar64_a";
  EXPECT_EQ(dataset->size(), 2u);
  EXPECT_EQ(dataset->intrinsics().model, DistortionModel::kPlumbBob);
  EXPECT_EQ(dataset->intrinsics().distortion, (std::vector<double>{-0.1192, 0.162, 0.00073985, 0.0014}));
  const PointCloud cloud = dataset->cloud(0);
  EXPECT_GT(cloud.size(), 90000u);
  EXPECT_LE(cloud.size(), 101340u);
  ASSERT_EQ(cloud.ring.size(), cloud.size());
  EXPECT_LT(*std::max_element(cloud.ring.begin(), cloud.ring.end()), 64);
}

// --- what is written is read back ---

Intrinsics smallCamera() {
  Intrinsics intrinsics;
  intrinsics.width = kWidth;
  intrinsics.height = kHeight;
  intrinsics.fx = 10.1;
  intrinsics.fy = 10.2;
  intrinsics.cx = 4.3;
  intrinsics.cy = 2.9;
  intrinsics.model = DistortionModel::kPlumbBob;
  intrinsics.distortion = {-0.19, 1.0 / 3.0, 6e-4, -9e-4, 0.0};
  return intrinsics;
}

TEST_F(DatasetTest, WrittenFramesAreReadBack) {
  const cv::Mat image(kHeight, kWidth, CV_8UC3, cv::Scalar(10, 20, 30));
  cv::Mat parts = cv::Mat::zeros(kHeight, kWidth, CV_32SC1), things = parts.clone();
  parts.at<int>(2, 3) = 65535;
  parts.at<int>(4, 1) = 7;
  things.at<int>(5, 6) = 300;
  PointCloud cloud;
  cloud.points = {{1.1F, -2.2F, 3.3F}, {-4.4F, 5.5F, -6.6F}};
  cloud.reflectivity = {0.25F, 255.0F};
  cloud.ring = {63, 0};
  const Eigen::Isometry3d T(Eigen::Translation3d(0.1, -0.2, 1.0 / 3.0) *
                            Eigen::AngleAxisd(1.1, Eigen::Vector3d(1, 2, 3).normalized()));
  const fs::path folder = root_ / "written";
  DatasetWriter writer(folder.string(), smallCamera());
  writer.add(image, {parts, things}, cloud);
  writer.add(image, {}, cloud);
  refusal([&] { open("written"); });  // not before it is complete
  writer.finish(T, "a \"note\"");

  const auto dataset = open("written");
  EXPECT_EQ(dataset->layout(), "CalibAnything");
  ASSERT_EQ(dataset->size(), 2u);
  ASSERT_TRUE(dataset->reference());
  EXPECT_TRUE(dataset->reference()->isApprox(T, 1e-14));
  const Intrinsics& intrinsics = dataset->intrinsics();
  EXPECT_EQ(intrinsics.fx, 10.1);
  EXPECT_EQ(intrinsics.fy, 10.2);
  EXPECT_EQ(intrinsics.cx, 4.3);
  EXPECT_EQ(intrinsics.cy, 2.9);
  EXPECT_EQ(intrinsics.model, DistortionModel::kPlumbBob);
  EXPECT_EQ(intrinsics.distortion, smallCamera().distortion);
  EXPECT_EQ(cv::norm(dataset->image(0), image, cv::NORM_INF), 0.0);
  const PointCloud read = dataset->cloud(0);
  EXPECT_EQ(read.points, cloud.points);
  EXPECT_EQ(read.reflectivity, cloud.reflectivity);
  EXPECT_EQ(read.ring, cloud.ring);
  const std::vector<cv::Mat> layers = dataset->maskLayers(0);
  ASSERT_EQ(layers.size(), 2u);
  EXPECT_EQ(cv::norm(layers[0], parts, cv::NORM_INF), 0.0);
  EXPECT_EQ(cv::norm(layers[1], things, cv::NORM_INF), 0.0);
  EXPECT_TRUE(dataset->maskLayers(1).empty());
  expectContains(refusal([&] { DatasetWriter(folder.string(), smallCamera()); }), "already holds a dataset");
}

TEST_F(DatasetTest, WhatTheLayoutCannotHoldIsNotWritten) {
  const auto cause = [](const auto& action) {
    try {
      action();
    } catch (const Error& error) {
      return error.cause();
    }
    ADD_FAILURE() << "nothing was thrown";
    return ErrorCause::kCloud;
  };
  Intrinsics fisheye = smallCamera();
  fisheye.model = DistortionModel::kEquidistant;
  fisheye.distortion = {0.1, 0.0, 0.0, 0.0};
  EXPECT_EQ(cause([&] { DatasetWriter((root_ / "fisheye").string(), fisheye); }), ErrorCause::kCamera);
  DatasetWriter writer((root_ / "other").string(), smallCamera());
  const cv::Mat image(kHeight, kWidth, CV_8UC3), layer(kHeight, kWidth, CV_32SC1, cv::Scalar(65536));
  EXPECT_EQ(cause([&] { writer.add(image, {layer}, {}); }), ErrorCause::kMasks);
  const cv::Mat one(kHeight, kWidth, CV_32SC1, cv::Scalar(1));
  EXPECT_EQ(cause([&] { writer.add(image, {one, one, one, one, one}, {}); }), ErrorCause::kMasks);
}

}  // namespace
}  // namespace lidar_camera_recalibration

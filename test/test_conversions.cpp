#include "conversions.hpp"

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <functional>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "camera_info_file.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lidar_camera_recalibration {
namespace {

using sensor_msgs::PointCloud2;
using sensor_msgs::PointField;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

void expectError(ErrorCause cause, const std::vector<std::string>& words, const std::function<void()>& call) {
  try {
    call();
  } catch (const Error& error) {
    EXPECT_EQ(cause, error.cause()) << error.what();
    for (const std::string& word : words) {
      EXPECT_NE(std::string::npos, std::string(error.what()).find(word)) << word << " in: " << error.what();
    }
    return;
  }
  ADD_FAILURE() << "no error with " << (words.empty() ? "" : words.front());
}

// --- Clouds ---

std::size_t sizeOf(std::uint8_t datatype) {
  static const std::size_t sizes[] = {0, 1, 1, 2, 2, 4, 4, 4, 8};
  return sizes[datatype];
}

template <class T>
void put(std::vector<std::uint8_t>& data, double value, bool bigendian) {
  const T typed = static_cast<T>(value);
  std::uint8_t raw[sizeof(T)];
  std::memcpy(raw, &typed, sizeof(T));
  if (bigendian) std::reverse(raw, raw + sizeof(T));
  data.insert(data.end(), raw, raw + sizeof(T));
}

void put(std::vector<std::uint8_t>& data, double value, std::uint8_t datatype, bool bigendian) {
  switch (datatype) {
    case PointField::INT8:
      return put<std::int8_t>(data, value, bigendian);
    case PointField::UINT8:
      return put<std::uint8_t>(data, value, bigendian);
    case PointField::INT16:
      return put<std::int16_t>(data, value, bigendian);
    case PointField::UINT16:
      return put<std::uint16_t>(data, value, bigendian);
    case PointField::INT32:
      return put<std::int32_t>(data, value, bigendian);
    case PointField::UINT32:
      return put<std::uint32_t>(data, value, bigendian);
    case PointField::FLOAT32:
      return put<float>(data, value, bigendian);
    default:
      return put<double>(data, value, bigendian);
  }
}

struct Column {
  std::string name;
  std::uint8_t datatype;
};
using Rows = std::vector<std::vector<double>>;

const std::vector<Column> kXyz = {
    {"x", PointField::FLOAT32}, {"y", PointField::FLOAT32}, {"z", PointField::FLOAT32}};

std::vector<Column> xyzAnd(const std::vector<Column>& more) {
  std::vector<Column> columns = kXyz;
  columns.insert(columns.end(), more.begin(), more.end());
  return columns;
}

// Fields one after the other, each followed by a byte of padding, so that nothing is aligned.
PointCloud2 makeCloud(const std::vector<Column>& columns, const Rows& rows, bool bigendian = false) {
  PointCloud2 cloud;
  cloud.header.frame_id = "velodyne";
  cloud.is_bigendian = bigendian;
  for (const Column& column : columns) {
    PointField field;
    field.name = column.name;
    field.datatype = column.datatype;
    field.count = 1;
    field.offset = cloud.point_step;
    cloud.fields.push_back(field);
    cloud.point_step += static_cast<std::uint32_t>(sizeOf(column.datatype)) + 1;
  }
  for (const auto& row : rows) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
      put(cloud.data, row[i], columns[i].datatype, bigendian);
      cloud.data.push_back(0xee);
    }
  }
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(rows.size());
  cloud.row_step = cloud.width * cloud.point_step;
  return cloud;
}

void expectCloudError(const PointCloud2& cloud, const std::vector<std::string>& words,
                      const std::string& intensity_field = "") {
  std::vector<std::string> all = words;
  all.push_back("velodyne");
  expectError(ErrorCause::kCloud, all, [&] { toPointCloud(cloud, intensity_field); });
}

TEST(ToPointCloud, everyDatatypeForXyzAndIntensityInBothByteOrders) {
  for (std::uint8_t datatype = PointField::INT8; datatype <= PointField::FLOAT64; ++datatype) {
    for (bool bigendian : {false, true}) {
      const auto cloud =
          toPointCloud(makeCloud({{"x", datatype}, {"y", datatype}, {"z", datatype}, {"intensity", datatype}},
                                 {{1, 2, 3, 100}, {40, 50, 60, 7}}, bigendian),
                       "");
      ASSERT_EQ(2u, cloud.size()) << int(datatype) << bigendian;
      EXPECT_EQ(Eigen::Vector3f(1, 2, 3), cloud.points[0]) << int(datatype) << bigendian;
      EXPECT_EQ(Eigen::Vector3f(40, 50, 60), cloud.points[1]) << int(datatype) << bigendian;
      EXPECT_EQ((std::vector<float>{100, 7}), cloud.reflectivity) << int(datatype) << bigendian;
      EXPECT_TRUE(cloud.ring.empty());
    }
  }
}

// --- times of the points ---

constexpr double kStamp = 1700000000.25;  // [s]

/// Three points, taken at the stamp of the cloud plus these times [s].
const std::vector<double> kTaken = {0.0, 0.03, 0.09};

std::vector<float> timesOf(const std::string& field, std::uint8_t datatype, double unit, double zero,
                           double stamp = kStamp, const std::vector<double>& taken = kTaken) {
  Rows rows;
  for (const double time : taken) rows.push_back({1.0, 2.0, 3.0, (zero + time) / unit});
  PointCloud2 cloud = makeCloud(xyzAnd({{field, datatype}}), rows);
  cloud.header.stamp = ros::Time(stamp);
  return toPointCloud(cloud, "").time;
}

void expectTimes(const std::vector<float>& times, const std::string& what,
                 const std::vector<double>& taken = kTaken) {
  ASSERT_EQ(times.size(), taken.size()) << what;
  for (std::size_t i = 0; i < taken.size(); ++i) EXPECT_NEAR(times[i], taken[i], 2e-6) << what;
}

TEST(PointTimes, ofTheUsualDriversInTheirUnits) {
  expectTimes(timesOf("t", PointField::UINT32, 1e-9, 0.0), "Ouster");
  expectTimes(timesOf("time", PointField::FLOAT32, 1.0, 0.0), "Velodyne");
  expectTimes(timesOf("timestamp", PointField::FLOAT64, 1.0, kStamp), "Hesai, Robosense");
  expectTimes(timesOf("timestamp", PointField::FLOAT64, 1.0, 0.0), "Robosense, relative");
  expectTimes(timesOf("timestamp", PointField::FLOAT64, 1e-9, kStamp), "Livox");
  expectTimes(timesOf("offset_time", PointField::UINT32, 1e-9, 0.0), "Livox, relative");
  for (const char* field : {"timeStamp", "time_stamp", "time_offset", "stamps", "stamp"})
    expectTimes(timesOf(field, PointField::FLOAT64, 1.0, kStamp), field);
}

TEST(PointTimes, everyUnitOffsetAndAbsolute) {
  for (const double unit : {1.0, 1e-3, 1e-6, 1e-9}) {
    for (const double zero : {0.0, kStamp}) {
      const std::string what = std::to_string(unit) + " from " + std::to_string(zero);
      expectTimes(timesOf("time", PointField::FLOAT64, unit, zero), what);
      // The stamp may be that of the end, and a part of a turn may take a fiftieth of it.
      const std::vector<double> before = {-0.1, -0.05, 0.0}, part = {0.02, 0.021, 0.0225};
      expectTimes(timesOf("time", PointField::FLOAT64, unit, zero, kStamp, before), what, before);
      expectTimes(timesOf("time", PointField::FLOAT64, unit, zero, kStamp, part), what, part);
    }
  }
}

TEST(PointTimes, followThePointsThatAreKept) {
  const PointCloud2 cloud = makeCloud(xyzAnd({{"t", PointField::UINT32}}),
                                      {{1, 2, 3, 0}, {kNan, 2, 3, 5e7}, {0, 0, 0, 6e7}, {4, 5, 6, 9e7}});
  expectTimes(toPointCloud(cloud, "").time, "without the points that are none", {0.0, 0.09});
}

TEST(PointTimes, whatCannotBeTimesIsLeftOut) {
  EXPECT_TRUE(toPointCloud(makeCloud(kXyz, {{1, 2, 3}, {4, 5, 6}}), "").time.empty()) << "no field";
  EXPECT_TRUE(timesOf("time", PointField::FLOAT32, 1.0, 0.0, kStamp, {0.0, 0.0, 0.0}).empty())
      << "not filled";
  EXPECT_TRUE(timesOf("time", PointField::FLOAT64, 1.0, 0.0, kStamp, {0.0, kNan, 0.1}).empty());
  EXPECT_TRUE(timesOf("timestamp", PointField::FLOAT32, 1.0, kStamp).empty())
      << "single precision resolves 128 s here";
  EXPECT_TRUE(timesOf("timestamp", PointField::FLOAT64, 1.0, kStamp - 37.0).empty()) << "another clock";
  EXPECT_TRUE(timesOf("t", PointField::UINT32, 1e-9, 0.0, kStamp, {0.0, 1.2, 3.0}).empty())
      << "no cloud takes 3 s";
}

TEST(PointTimes, aClockThatStartsAtZero) {
  expectTimes(timesOf("time", PointField::FLOAT32, 1.0, 0.0, 0.5), "offsets");
  expectTimes(timesOf("time", PointField::FLOAT64, 1.0, 20.0, 20.0), "absolute");
}

TEST(ToPointCloud, signsAndFractions) {
  const auto cloud = toPointCloud(makeCloud({{"x", PointField::INT16},
                                             {"y", PointField::FLOAT64},
                                             {"z", PointField::FLOAT32},
                                             {"intensity", PointField::UINT16}},
                                            {{-300, -0.125, 1e-3, 65535}}),
                                  "");
  EXPECT_EQ(Eigen::Vector3f(-300.0f, -0.125f, 1e-3f), cloud.points[0]);
  EXPECT_EQ(65535.0f, cloud.reflectivity[0]);
}

TEST(ToPointCloud, intensityFieldIsFoundInOrder) {
  const Rows rows = {{1, 2, 3, 10, 20}};
  const auto read = [&](const std::string& a, const std::string& b, const std::string& wanted) {
    return toPointCloud(makeCloud(xyzAnd({{a, PointField::FLOAT32}, {b, PointField::UINT8}}), rows), wanted)
        .reflectivity;
  };
  EXPECT_EQ(std::vector<float>{20}, read("reflectivity", "intensity", ""));
  EXPECT_EQ(std::vector<float>{10}, read("reflectivity", "i", ""));
  EXPECT_EQ(std::vector<float>{20}, read("signal", "i", ""));
  EXPECT_EQ(std::vector<float>{10}, read("signal", "range", ""));
  EXPECT_EQ(std::vector<float>{20}, read("intensity", "remission", "remission"));
  EXPECT_TRUE(read("remission", "range", "").empty());
}

TEST(ToPointCloud, namedIntensityFieldThatIsMissing) {
  expectCloudError(makeCloud(xyzAnd({{"intensity", PointField::UINT8}}), {{1, 2, 3, 4}}),
                   {"remission", "intensity_field", "x, y, z, intensity"}, "remission");
}

TEST(ToPointCloud, withoutIntensity) {
  const auto cloud = toPointCloud(makeCloud(kXyz, {{1, 2, 3}}), "");
  EXPECT_EQ(1u, cloud.size());
  EXPECT_FALSE(cloud.hasReflectivity());
}

TEST(ToPointCloud, pointsWithoutEchoAreDropped) {
  const auto columns = xyzAnd({{"intensity", PointField::FLOAT32}, {"ring", PointField::UINT16}});
  const auto cloud = toPointCloud(makeCloud(columns, {{1, 2, 3, 4, 5},
                                                      {kNan, 2, 3, 4, 5},
                                                      {1, INFINITY, 3, 4, 5},
                                                      {1, 2, -INFINITY, 4, 5},
                                                      {0, 0, 0, 4, 5},
                                                      {6, 7, 8, 9, 10}}),
                                  "");
  ASSERT_EQ(2u, cloud.size());
  EXPECT_EQ(Eigen::Vector3f(6, 7, 8), cloud.points[1]);
  EXPECT_EQ((std::vector<float>{4, 9}), cloud.reflectivity);
  EXPECT_EQ((std::vector<std::uint16_t>{5, 10}), cloud.ring);
}

TEST(ToPointCloud, doublesBeyondFloatAreNotFinite) {
  const std::vector<Column> columns = {{"x", PointField::FLOAT64},
                                       {"y", PointField::FLOAT64},
                                       {"z", PointField::FLOAT64},
                                       {"intensity", PointField::FLOAT64}};
  const auto cloud = toPointCloud(makeCloud(columns, {{1e300, 0, 0, 1}, {1, 0, 0, 1e300}, {2, 0, 0, 5}}), "");
  ASSERT_EQ(2u, cloud.size());
  EXPECT_EQ((std::vector<float>{0, 5}), cloud.reflectivity);
}

TEST(ToPointCloud, strangeIntensitiesDoNotCostThePoint) {
  const auto columns = xyzAnd({{"intensity", PointField::FLOAT32}});
  const auto some = toPointCloud(makeCloud(columns, {{1, 0, 0, kNan}, {2, 0, 0, 5}}), "");
  EXPECT_EQ((std::vector<float>{0, 5}), some.reflectivity);
  const auto none = toPointCloud(makeCloud(columns, {{1, 0, 0, kNan}, {2, 0, 0, INFINITY}}), "");
  EXPECT_EQ(2u, none.size());
  EXPECT_FALSE(none.hasReflectivity());
}

TEST(ToPointCloud, ringOfAnyIntegerType) {
  for (std::uint8_t datatype = PointField::INT8; datatype <= PointField::UINT32; ++datatype) {
    const auto cloud =
        toPointCloud(makeCloud(xyzAnd({{"ring", datatype}}), {{1, 0, 0, 63}, {2, 0, 0, 0}}), "");
    EXPECT_EQ((std::vector<std::uint16_t>{63, 0}), cloud.ring) << int(datatype);
  }
  // What is no ring number is left out.
  EXPECT_TRUE(
      toPointCloud(makeCloud(xyzAnd({{"ring", PointField::INT32}}), {{1, 0, 0, 1}, {2, 0, 0, -1}}), "")
          .ring.empty());
  EXPECT_TRUE(
      toPointCloud(makeCloud(xyzAnd({{"ring", PointField::UINT32}}), {{1, 0, 0, 70000}}), "").ring.empty());
  EXPECT_TRUE(
      toPointCloud(makeCloud(xyzAnd({{"ring", PointField::FLOAT32}}), {{1, 0, 0, 1.5}}), "").ring.empty());
}

TEST(ToPointCloud, organisedCloudWithPaddedRows) {
  const PointCloud2 flat = makeCloud(kXyz, {{1, 0, 0}, {kNan, kNan, kNan}, {3, 0, 0}, {4, 0, 0}});
  PointCloud2 cloud = flat;
  cloud.width = cloud.height = 2;
  cloud.row_step = 2 * cloud.point_step + 5;
  cloud.data.clear();
  for (std::uint32_t row = 0; row < 2; ++row) {
    const auto* begin = flat.data.data() + row * 2 * flat.point_step;
    cloud.data.insert(cloud.data.end(), begin, begin + 2 * flat.point_step);
    cloud.data.resize(cloud.data.size() + 5, 0x41);
  }
  const auto read = toPointCloud(cloud, "");
  ASSERT_EQ(3u, read.size());
  EXPECT_EQ(3.0f, read.points[1].x());
  EXPECT_EQ(4.0f, read.points[2].x());
}

TEST(ToPointCloud, emptyClouds) {
  expectCloudError(makeCloud(kXyz, {}), {"empty"});
  expectCloudError(makeCloud(kXyz, {{kNan, 0, 0}, {0, 0, 0}}), {"2 points", "none"});
  PointCloud2 cloud = makeCloud(kXyz, {{1, 2, 3}});
  cloud.width = 0;
  cloud.height = 0xffffffffu;
  expectCloudError(cloud, {"empty"});
}

TEST(ToPointCloud, missingCoordinates) {
  const PointCloud2 cloud = makeCloud(
      {{"x", PointField::FLOAT32}, {"y", PointField::FLOAT32}, {"range", PointField::FLOAT32}}, {{1, 2, 3}});
  expectCloudError(cloud, {"'z'", "x, y, range"});
  PointCloud2 bare = cloud;
  bare.fields.clear();
  expectCloudError(bare, {"'x'", "none"});
}

// Velodyne's driver until 2021.
TEST(ToPointCloud, rowStepLeftAtZero) {
  PointCloud2 cloud = makeCloud(xyzAnd({{"channel", PointField::UINT8}}), {{1, 2, 3, 4}, {5, 6, 7, 8}});
  cloud.row_step = 0;
  EXPECT_EQ((std::vector<std::uint16_t>{4, 8}), toPointCloud(cloud, "").ring);
  cloud.width = 1;
  cloud.height = 2;
  EXPECT_EQ(2u, toPointCloud(cloud, "").size());
  cloud.data.pop_back();
  expectCloudError(cloud, {"row_step"});
}

TEST(ToPointCloud, contradictingSizes) {
  const PointCloud2 good =
      makeCloud(xyzAnd({{"intensity", PointField::UINT8}}), {{1, 2, 3, 4}, {5, 6, 7, 8}});
  ASSERT_EQ(2u, toPointCloud(good, "").size());
  PointCloud2 cloud = good;
  cloud.data.resize(cloud.data.size() - 1);
  expectCloudError(cloud, {"bytes of data", "truncated"});
  cloud = good;
  cloud.data.push_back(0);
  expectCloudError(cloud, {"bytes of data"});
  cloud = good;
  cloud.row_step -= 1;
  expectCloudError(cloud, {"row_step"});
  cloud = good;
  cloud.point_step = 1;
  expectCloudError(cloud, {"point_step"});
  cloud = good;
  cloud.point_step = 0;
  expectCloudError(cloud, {"point_step"});
  cloud = good;
  cloud.fields[3].offset = 0xfffffffeu;
  expectCloudError(cloud, {"'intensity'", "offset"});
  cloud = good;
  cloud.fields[2].datatype = PointField::FLOAT64;
  cloud.fields[2].offset = cloud.point_step - 4;
  expectCloudError(cloud, {"'z'", "offset"});
  cloud = good;
  cloud.fields[0].datatype = 9;
  expectCloudError(cloud, {"'x'", "datatype 9"});
  cloud = good;
  cloud.fields[0].datatype = 0;
  expectCloudError(cloud, {"'x'", "datatype 0"});
  cloud = good;
  cloud.fields[1].count = 3;
  expectCloudError(cloud, {"'y'", "3 elements"});
}

// Products that wrap around in 32 bits to the size of the data.
TEST(ToPointCloud, absurdSizes) {
  PointCloud2 cloud = makeCloud(kXyz, {{1, 2, 3}});
  cloud.width = 0x40000000u;
  cloud.point_step = 16;
  cloud.row_step = 0;
  expectCloudError(cloud, {"row_step"});
  cloud.width = 1;
  cloud.row_step = 0x80000000u;
  cloud.height = 2;
  expectCloudError(cloud, {"bytes of data"});
  cloud.width = cloud.height = cloud.point_step = cloud.row_step = 0xffffffffu;
  expectCloudError(cloud, {"row_step"});
}

TEST(ToPointCloud, damagedMessagesNeverCrash) {
  std::mt19937 random(3);
  const PointCloud2 good = makeCloud(xyzAnd({{"intensity", PointField::UINT8}, {"ring", PointField::UINT16}}),
                                     Rows(20, {1, 2, 3, 4, 5}));
  const auto any = [&](std::uint32_t& value) { value = random() % 4 == 0 ? random() : random() % 64; };
  int accepted = 0;
  for (int i = 0; i < 20000; ++i) {
    PointCloud2 cloud = good;
    for (std::uint32_t changes = random() % 3 + 1; changes > 0; --changes) {
      PointField& field = cloud.fields[random() % cloud.fields.size()];
      switch (random() % 9) {
        case 0:
          any(cloud.width);
          break;
        case 1:
          any(cloud.height);
          break;
        case 2:
          any(cloud.point_step);
          break;
        case 3:
          any(cloud.row_step);
          break;
        case 4:
          any(field.offset);
          break;
        case 5:
          field.datatype = static_cast<std::uint8_t>(random() % 11);
          break;
        case 6:
          any(field.count);
          break;
        case 7:
          cloud.data.resize(random() % 1000);
          break;
        default:
          cloud.data[random() % cloud.data.size()] = static_cast<std::uint8_t>(random());
      }
      if (cloud.data.empty()) break;
    }
    try {
      toPointCloud(cloud, "");
      ++accepted;
    } catch (const Error& error) {
      EXPECT_EQ(ErrorCause::kCloud, error.cause());
    }
  }
  EXPECT_GT(accepted, 100);
}

// --- CameraInfo ---

sensor_msgs::CameraInfo makeInfo() {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = "cam0";
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {-0.2, 0.05, 0.001, -0.001, 0.0};
  info.K = {500, 0, 320, 0, 510, 240, 0, 0, 1};
  info.P = {450, 0, 310, -20, 0, 455, 235, 0, 0, 0, 1, 0};
  return info;
}

void expectCameraError(const sensor_msgs::CameraInfo& info, bool rectified,
                       const std::vector<std::string>& words) {
  std::vector<std::string> all = words;
  all.push_back("cam0");
  expectError(ErrorCause::kCamera, all, [&] { toCamera(info, rectified); });
}

TEST(ToCamera, rawUsesKAndD) {
  const Intrinsics intrinsics = toCamera(makeInfo(), false).intrinsics();
  EXPECT_EQ(640, intrinsics.width);
  EXPECT_EQ(480, intrinsics.height);
  EXPECT_EQ(500.0, intrinsics.fx);
  EXPECT_EQ(510.0, intrinsics.fy);
  EXPECT_EQ(320.0, intrinsics.cx);
  EXPECT_EQ(240.0, intrinsics.cy);
  EXPECT_EQ(DistortionModel::kPlumbBob, intrinsics.model);
  ASSERT_GE(intrinsics.distortion.size(), 5u);
  EXPECT_EQ(-0.2, intrinsics.distortion[0]);
  EXPECT_EQ(-0.001, intrinsics.distortion[3]);
}

TEST(ToCamera, rectifiedUsesPAndIgnoresDistortion) {
  sensor_msgs::CameraInfo info = makeInfo();
  info.distortion_model = "mystery";
  const Camera camera = toCamera(info, true);
  EXPECT_FALSE(camera.distorted());
  EXPECT_EQ(450.0, camera.intrinsics().fx);
  EXPECT_EQ(455.0, camera.intrinsics().fy);
  EXPECT_EQ(310.0, camera.intrinsics().cx);
  EXPECT_EQ(235.0, camera.intrinsics().cy);
}

TEST(ToCamera, models) {
  sensor_msgs::CameraInfo info = makeInfo();
  info.distortion_model = "equidistant";
  info.D = {0.01, 0.002, 0, 0};
  EXPECT_EQ(DistortionModel::kEquidistant, toCamera(info, false).intrinsics().model);
  info.distortion_model = "rational_polynomial";
  info.D = {0.1, 0.01, 0, 0, 0, 0.05, 0, 0};
  EXPECT_EQ(DistortionModel::kRationalPolynomial, toCamera(info, false).intrinsics().model);
  info.distortion_model = "";
  info.D = {};
  EXPECT_FALSE(toCamera(info, false).distorted());
  info.D = {0, 0, 0, 0, 0};
  EXPECT_FALSE(toCamera(info, false).distorted());
  info.D = {0.1, 0, 0, 0, 0};
  expectCameraError(info, false, {"distortion_model is empty"});
  info.distortion_model = "mystery";
  expectCameraError(info, false, {"mystery"});
}

TEST(ToCamera, uncalibrated) {
  sensor_msgs::CameraInfo info = makeInfo();
  info.K.fill(0.0);
  expectCameraError(info, false, {"K describes no camera", "calibrate"});
  EXPECT_NO_THROW(toCamera(info, true));
  info = makeInfo();
  info.P.fill(0.0);
  expectCameraError(info, true, {"P describes no camera", "image_rectified"});
  EXPECT_NO_THROW(toCamera(info, false));
  info = makeInfo();
  info.K[2] = kNan;
  expectCameraError(info, false, {"K describes no camera"});
  info = makeInfo();
  info.D[1] = INFINITY;
  expectCameraError(info, false, {});
}

TEST(ToCamera, sizesOfNoCamera) {
  for (const auto& [width, height] : std::vector<std::pair<std::uint32_t, std::uint32_t>>{
           {0, 480}, {640, 0}, {0xffffffffu, 480}, {640, 0x80000000u}, {32000, 32000}}) {
    sensor_msgs::CameraInfo info = makeInfo();
    info.width = width;
    info.height = height;
    expectCameraError(info, false, {std::to_string(width) + " x " + std::to_string(height)});
  }
}

// The pixel of a point must move as the image is cropped, then shrunk.
TEST(CameraInfoFile, asCameraCalibrationWritesIt) {
  const std::string path = testing::TempDir() + "/camera_info.yaml";
  const auto write = [&path](const std::string& text) { std::ofstream(path) << text; };
  const std::string size = "image_width: 640\nimage_height: 480\ncamera_name: front\n";
  const std::string matrix =
      "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [500, 0, 320, 0, 501, 240, 0, 0, 1]\n";
  write(size + matrix +
        "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [0.1, 0, 0, 0, "
        "0]\n"
        "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
        "projection_matrix: {rows: 3, cols: 4, data: [490, 0, 321, 0, 0, 491, 241, 0, 0, 0, 1, 0]}\n");
  const sensor_msgs::CameraInfo info = readCameraInfoFile(path);
  EXPECT_EQ(info.width, 640u);
  EXPECT_EQ(info.height, 480u);
  EXPECT_EQ(toCamera(info, false).intrinsics().fy, 501.0);
  EXPECT_EQ(toCamera(info, false).intrinsics().distortion.at(0), 0.1);
  EXPECT_EQ(toCamera(info, true).intrinsics().fy, 491.0);
  const auto expectRefusal = [&](const std::string& text, const std::string& word) {
    write(text);
    expectError(ErrorCause::kFile, {path, word}, [&] { readCameraInfoFile(path); });
  };
  expectRefusal(matrix, "image_width");
  expectRefusal(size, "camera_matrix");
  expectRefusal(size + "camera_matrix: {data: [1, 2]}", "2 numbers instead of 9");
  expectRefusal(size + "camera_matrix: [500, 0, 320]", "camera_matrix");
  expectRefusal("- a", "name: value");
  std::remove(path.c_str());
  expectError(ErrorCause::kFile, {path}, [&] { readCameraInfoFile(path); });
}

TEST(ToCamera, roiAndBinning) {
  sensor_msgs::CameraInfo info = makeInfo();
  const Eigen::Vector3d point(0.4, -0.3, 2.0);
  for (bool rectified : {false, true}) {
    const Eigen::Vector2d full = *toCamera(makeInfo(), rectified).project(point);
    info.roi.x_offset = 100;
    info.roi.y_offset = 60;
    info.roi.width = 400;
    info.roi.height = 300;
    info.binning_x = 2;
    info.binning_y = 3;
    const Camera camera = toCamera(info, rectified);
    EXPECT_EQ(200, camera.intrinsics().width);
    EXPECT_EQ(100, camera.intrinsics().height);
    const Eigen::Vector2d expected((full.x() - 100.0) / 2.0, (full.y() - 60.0) / 3.0);
    EXPECT_LT((*camera.project(point) - expected).norm(), 1e-9);
  }
}

TEST(ToCamera, roiOfTheWholeImage) {
  sensor_msgs::CameraInfo info = makeInfo();
  info.roi.width = 640;
  info.roi.height = 480;
  info.roi.do_rectify = true;
  info.binning_x = info.binning_y = 1;
  EXPECT_EQ(320.0, toCamera(info, false).intrinsics().cx);
  EXPECT_EQ(640, toCamera(info, false).intrinsics().width);
}

TEST(ToCamera, contradictingRoiAndBinning) {
  sensor_msgs::CameraInfo info = makeInfo();
  info.roi.x_offset = 300;
  info.roi.width = 400;
  info.roi.height = 300;
  expectCameraError(info, false, {"roi 400 x 300 at (300, 0)"});
  info.roi.x_offset = 0xffffffffu;
  expectCameraError(info, false, {"roi"});
  info.roi = sensor_msgs::RegionOfInterest();
  info.roi.y_offset = 10;
  expectCameraError(info, false, {"roi 0 x 0"});
  info = makeInfo();
  info.binning_x = 1000;
  expectCameraError(info, false, {"binning 1000"});
}

// --- Images ---

sensor_msgs::Image makeImage(const std::string& encoding, const cv::Mat& image) {
  std_msgs::Header header;
  header.frame_id = "cam0";
  return *cv_bridge::CvImage(header, encoding, image).toImageMsg();
}

void expectImageError(const sensor_msgs::Image& image, const std::vector<std::string>& words) {
  std::vector<std::string> all = words;
  all.push_back("cam0");
  expectError(ErrorCause::kImage, all, [&] { toBgr(image); });
}

cv::Vec3b pixelOf(const std::string& encoding, const cv::Mat& image) {
  const cv::Mat bgr = toBgr(makeImage(encoding, image));
  EXPECT_EQ(CV_8UC3, bgr.type());
  EXPECT_EQ(image.size(), bgr.size());
  return bgr.at<cv::Vec3b>(2, 2);
}

TEST(ToBgr, channelOrders) {
  const cv::Size size(8, 6);
  EXPECT_EQ(cv::Vec3b(1, 2, 3), pixelOf("bgr8", cv::Mat(size, CV_8UC3, cv::Scalar(1, 2, 3))));
  EXPECT_EQ(cv::Vec3b(3, 2, 1), pixelOf("rgb8", cv::Mat(size, CV_8UC3, cv::Scalar(1, 2, 3))));
  EXPECT_EQ(cv::Vec3b(1, 2, 3), pixelOf("bgra8", cv::Mat(size, CV_8UC4, cv::Scalar(1, 2, 3, 4))));
  EXPECT_EQ(cv::Vec3b(3, 2, 1), pixelOf("rgba8", cv::Mat(size, CV_8UC4, cv::Scalar(1, 2, 3, 4))));
  EXPECT_EQ(cv::Vec3b(9, 9, 9), pixelOf("mono8", cv::Mat(size, CV_8UC1, cv::Scalar(9))));
  EXPECT_EQ(cv::Vec3b(9, 9, 9), pixelOf("8UC1", cv::Mat(size, CV_8UC1, cv::Scalar(9))));
  EXPECT_EQ(cv::Vec3b(1, 2, 3), pixelOf("8UC3", cv::Mat(size, CV_8UC3, cv::Scalar(1, 2, 3))));
}

TEST(ToBgr, sixteenBitsAreScaledByTheBitsInUse) {
  const cv::Size size(8, 6);
  cv::Mat image(size, CV_16UC1, cv::Scalar(2048));
  image.at<std::uint16_t>(0, 0) = 4095;  // 12 bits
  EXPECT_NEAR(255.0 * 2048 / 4095, pixelOf("mono16", image)[0], 1.0);
  EXPECT_NEAR(255.0 * 2048 / 4095, pixelOf("16UC1", image)[1], 1.0);
  image.at<std::uint16_t>(0, 0) = 65535;
  EXPECT_NEAR(255.0 * 2048 / 65535, pixelOf("mono16", image)[0], 1.0);
  const cv::Mat color(size, CV_16UC3, cv::Scalar(1023, 512, 256));  // 10 bits
  EXPECT_NEAR(64, pixelOf("rgb16", color)[0], 1.0);
  EXPECT_NEAR(255, pixelOf("rgb16", color)[2], 1.0);
  EXPECT_NEAR(255, pixelOf("bgr16", color)[0], 1.0);
}

TEST(ToBgr, sixteenBitsInTheOtherByteOrder) {
  cv::Mat image(4, 4, CV_16UC1, cv::Scalar(0x3ff));
  sensor_msgs::Image message = makeImage("mono16", image);
  for (std::size_t i = 0; i < message.data.size(); i += 2) std::swap(message.data[i], message.data[i + 1]);
  message.is_bigendian = 1;
  EXPECT_EQ(255, toBgr(message).at<cv::Vec3b>(1, 1)[0]);
}

TEST(ToBgr, bayerPatterns) {
  // A red scene: only the red pixels of the pattern are lit.
  for (const auto& [pattern, x, y] : std::vector<std::tuple<std::string, int, int>>{
           {"rggb", 0, 0}, {"bggr", 1, 1}, {"gbrg", 0, 1}, {"grbg", 1, 0}}) {
    cv::Mat image = cv::Mat::zeros(12, 12, CV_8UC1);
    for (int v = y; v < 12; v += 2) {
      for (int u = x; u < 12; u += 2) image.at<std::uint8_t>(v, u) = 200;
    }
    const cv::Vec3b pixel = toBgr(makeImage("bayer_" + pattern + "8", image)).at<cv::Vec3b>(6, 6);
    EXPECT_EQ(200, pixel[2]) << pattern;
    EXPECT_LT(pixel[0], 10) << pattern;
    cv::Mat deep;
    image.convertTo(deep, CV_16U, 5.0);
    const cv::Vec3b deep_pixel = toBgr(makeImage("bayer_" + pattern + "16", deep)).at<cv::Vec3b>(6, 6);
    EXPECT_NEAR(255.0 * 1000 / 1023, deep_pixel[2], 1.0) << pattern;
  }
}

TEST(ToBgr, yuv) {
  const cv::Vec3b grey = pixelOf("yuv422", cv::Mat(6, 8, CV_8UC2, cv::Scalar(128, 235)));  // UYVY, white
  for (int i = 0; i < 3; ++i) EXPECT_GT(grey[i], 250);
}

TEST(ToBgr, doesNotAliasTheMessage) {
  sensor_msgs::Image message = makeImage("bgr8", cv::Mat(4, 4, CV_8UC3, cv::Scalar(1, 2, 3)));
  const cv::Mat image = toBgr(message);
  std::fill(message.data.begin(), message.data.end(), 0);
  EXPECT_EQ(cv::Vec3b(1, 2, 3), image.at<cv::Vec3b>(0, 0));
}

TEST(ToBgr, paddedRows) {
  sensor_msgs::Image message = makeImage("mono8", cv::Mat(1, 8, CV_8UC1, cv::Scalar(7)));
  message.width = 3;
  message.height = 2;
  message.step = 4;
  EXPECT_EQ(cv::Size(3, 2), toBgr(message).size());
}

TEST(ToBgr, encodingsWithoutColour) {
  for (const char* encoding :
       {"32FC1", "16SC1", "8UC2", "64FC7", "", "h264", "8UC999999999999", "8UC-1", "yuv"}) {
    sensor_msgs::Image message = makeImage("mono8", cv::Mat(8, 8, CV_8UC1, cv::Scalar(7)));
    message.encoding = encoding;
    expectImageError(message, {"'" + message.encoding + "'", "encoding"});
  }
}

TEST(ToBgr, contradictingSizes) {
  const sensor_msgs::Image good = makeImage("bgr8", cv::Mat(4, 4, CV_8UC3, cv::Scalar(1, 2, 3)));
  sensor_msgs::Image message = good;
  message.data.pop_back();
  expectImageError(message, {"47 bytes of data", "truncated"});
  message = good;
  message.step = 11;
  expectImageError(message, {"step 11"});
  message = good;
  message.width = 0;
  expectImageError(message, {"0 x 4"});
  message = good;
  message.data.clear();
  expectImageError(message, {"0 bytes"});
  // 32-bit products that wrap around.
  message = good;
  message.width = 0x55555556u;
  message.step = 2;
  expectImageError(message, {"is that of no image"});
  message = good;
  message.height = 0x80000004u;
  message.step = 12;
  expectImageError(message, {"is that of no image"});
  message = good;
  message.encoding = "mono16";
  message.width = 5;
  message.step = 11;
  message.data.resize(44);
  expectImageError(message, {"step 11"});
}

TEST(ToBgr, tinyImagesNeverCrash) {
  for (const char* encoding : {"mono8", "bgr8", "rgba8", "bayer_rggb8", "yuv422", "mono16", "bayer_gbrg16"}) {
    for (std::uint32_t width : {1u, 2u, 3u}) {
      for (std::uint32_t height : {1u, 2u, 3u}) {
        sensor_msgs::Image message;
        message.encoding = encoding;
        message.width = width;
        message.height = height;
        message.step = width * 8;
        message.data.resize(message.step * height, 50);
        try {
          EXPECT_EQ(cv::Size(static_cast<int>(width), static_cast<int>(height)), toBgr(message).size());
        } catch (const Error& error) {
          EXPECT_EQ(ErrorCause::kImage, error.cause());
        }
      }
    }
  }
}

// --- Masks ---

void expectMaskError(const sensor_msgs::Image& image, const std::vector<std::string>& words) {
  std::vector<std::string> all = words;
  all.push_back("cam0");
  expectError(ErrorCause::kMasks, all, [&] { toMaskLayers(image); });
}

TEST(ToMaskLayers, encodings) {
  const auto check = [](const std::string& encoding, int type, const cv::Scalar& ids, std::size_t layers) {
    cv::Mat image(5, 7, type, cv::Scalar::all(0));
    image(cv::Rect(2, 1, 3, 2)).setTo(ids);
    const auto read = toMaskLayers(makeImage(encoding, image));
    ASSERT_EQ(layers, read.size()) << encoding;
    for (std::size_t i = 0; i < layers; ++i) {
      ASSERT_EQ(CV_32SC1, read[i].type()) << encoding;
      ASSERT_EQ(cv::Size(7, 5), read[i].size()) << encoding;
      EXPECT_EQ(static_cast<int>(ids[static_cast<int>(i)]), read[i].at<int>(2, 4)) << encoding;
      EXPECT_EQ(6, cv::countNonZero(read[i])) << encoding;
    }
  };
  check("mono8", CV_8UC1, {255}, 1);
  check("8UC1", CV_8UC1, {255}, 1);
  check("mono16", CV_16UC1, {65535}, 1);
  check("16UC1", CV_16UC1, {65535}, 1);
  check("32SC1", CV_32SC1, {2147483647}, 1);
  check("8UC2", CV_8UC2, {1, 200}, 2);
  check("8UC3", CV_8UC3, {1, 2, 3}, 3);
  check("16UC2", CV_16UC2, {300, 40000}, 2);
  check("16UC4", CV_16UC4, {1, 2, 3, 65535}, 4);
}

TEST(ToMaskLayers, moreThanFourLayers) {
  cv::Mat image(3, 3, CV_16UC(7));
  for (int i = 0; i < 9 * 7; ++i) image.ptr<std::uint16_t>()[i] = static_cast<std::uint16_t>(1000 + i % 7);
  const auto layers = toMaskLayers(makeImage("16UC7", image));
  ASSERT_EQ(7u, layers.size());
  EXPECT_EQ(1006, layers[6].at<int>(2, 2));
}

TEST(ToMaskLayers, otherByteOrder) {
  sensor_msgs::Image message = makeImage("16UC1", cv::Mat(2, 2, CV_16UC1, cv::Scalar(0x0102)));
  message.is_bigendian = 1;
  EXPECT_EQ(0x0201, toMaskLayers(message)[0].at<int>(0, 0));
  message = makeImage("32SC1", cv::Mat(2, 2, CV_32SC1, cv::Scalar(0x01000000)));
  message.is_bigendian = 1;
  EXPECT_EQ(1, toMaskLayers(message)[0].at<int>(0, 0));
}

TEST(ToMaskLayers, refusesOtherEncodings) {
  for (const char* encoding : {"bgr8", "32FC1", "8SC1", "16SC1", "32SC2", "8UC", "8UC0", "8UC513",
                               "16UC99999999", "8UC-1", "8UC1x", "", "bayer_rggb8"}) {
    sensor_msgs::Image message = makeImage("mono8", cv::Mat(4, 4, CV_8UC1, cv::Scalar(1)));
    message.encoding = encoding;
    expectMaskError(message, {"'" + message.encoding + "'", "mono16"});
  }
}

TEST(ToMaskLayers, refusesNegativeIds) {
  cv::Mat image(4, 4, CV_32SC1, cv::Scalar(1));
  image.at<int>(3, 3) = -7;
  expectMaskError(makeImage("32SC1", image), {"-7"});
}

TEST(ToMaskLayers, contradictingSizes) {
  const sensor_msgs::Image good = makeImage("16UC2", cv::Mat(4, 4, CV_16UC2, cv::Scalar(1, 2)));
  sensor_msgs::Image message = good;
  message.data.resize(10);
  expectMaskError(message, {"10 bytes of data"});
  message = good;
  message.encoding = "16UC4";
  expectMaskError(message, {"step 16"});
  message = good;
  message.height = 0;
  expectMaskError(message, {"4 x 0"});
  message = good;
  message.width = 0xffffffffu;
  expectMaskError(message, {"is that of no image"});
}

TEST(ToMaskMessage, roundTrip) {
  cv::Mat first(3, 4, CV_32SC1, cv::Scalar(0)), second(3, 4, CV_32SC1, cv::Scalar(65535));
  first.at<int>(1, 2) = 300;
  std_msgs::Header header;
  header.stamp = ros::Time(12, 34);
  header.frame_id = "cam0";
  for (std::size_t count : {1u, 2u, 6u}) {
    std::vector<cv::Mat> layers(count, second);
    layers[0] = first;
    const sensor_msgs::Image message = toMaskMessage(header, layers);
    EXPECT_EQ("16UC" + std::to_string(count), message.encoding);
    EXPECT_EQ(header.stamp, message.header.stamp);
    EXPECT_EQ(4u, message.width);
    EXPECT_EQ(3u, message.height);
    EXPECT_EQ(count * 4 * 3 * 2, message.data.size());
    const auto read = toMaskLayers(message);
    ASSERT_EQ(count, read.size());
    for (std::size_t i = 0; i < count; ++i) EXPECT_EQ(0, cv::norm(read[i], layers[i], cv::NORM_INF));
  }
}

TEST(ToMaskMessage, refusesWhatDoesNotFit) {
  const cv::Mat good(3, 4, CV_32SC1, cv::Scalar(1));
  const auto refused = [](const std::vector<cv::Mat>& layers, const std::string& word) {
    expectError(ErrorCause::kMasks, {word}, [&] { toMaskMessage(std_msgs::Header(), layers); });
  };
  refused({}, "0 layers");
  refused({good, cv::Mat(4, 4, CV_32SC1, cv::Scalar(1))}, "layer 1");
  refused({cv::Mat(3, 4, CV_8UC1, cv::Scalar(1))}, "layer 0");
  refused({cv::Mat()}, "layer 0");
  refused({good, cv::Mat(3, 4, CV_32SC1, cv::Scalar(65536))}, "65536");
  refused({cv::Mat(3, 4, CV_32SC1, cv::Scalar(-1))}, "-1");
}

// --- Compressed images ---

sensor_msgs::CompressedImage compress(const std::string& extension, const cv::Mat& image,
                                      const std::string& format) {
  sensor_msgs::CompressedImage message;
  message.header.frame_id = "cam0";
  message.header.stamp = ros::Time(12, 34);
  message.format = format;
  cv::imencode(extension, image, message.data);
  return message;
}

void expectDecodeError(const sensor_msgs::CompressedImage& message, const std::vector<std::string>& words) {
  std::vector<std::string> all = words;
  all.push_back("cam0");
  expectError(ErrorCause::kImage, all, [&] { decode(message); });
}

cv::Mat ramp(int type) {
  cv::Mat image(20, 30, type);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols * image.channels(); ++u) {
      if (image.depth() == CV_8U) image.ptr<std::uint8_t>(v)[u] = static_cast<std::uint8_t>(v * 7 + u);
      if (image.depth() == CV_16U) image.ptr<std::uint16_t>(v)[u] = static_cast<std::uint16_t>(v * 1000 + u);
    }
  }
  return image;
}

TEST(Decode, pngKeepsDepthAndChannels) {
  for (int type : {CV_8UC1, CV_8UC3, CV_8UC4, CV_16UC1, CV_16UC3, CV_16UC4}) {
    const cv::Mat image = ramp(type);
    const auto message = decode(compress(".png", image, "png"));
    EXPECT_EQ(ros::Time(12, 34), message->header.stamp);
    EXPECT_EQ("cam0", message->header.frame_id);
    const auto layers = toMaskLayers(*message);
    std::vector<cv::Mat> expected;
    cv::split(image, expected);
    ASSERT_EQ(expected.size(), layers.size()) << type;
    for (std::size_t i = 0; i < layers.size(); ++i) {
      expected[i].convertTo(expected[i], CV_32S);
      EXPECT_EQ(0, cv::norm(expected[i], layers[i], cv::NORM_INF)) << type;
    }
  }
}

TEST(Decode, colourOfPngAndJpeg) {
  const cv::Mat image(16, 16, CV_8UC3, cv::Scalar(20, 120, 220));
  for (const char* extension : {".png", ".jpg"}) {
    const cv::Vec3b pixel =
        toBgr(*decode(compress(extension, image, "rgb8; compressed bgr8"))).at<cv::Vec3b>(8, 8);
    EXPECT_NEAR(20, pixel[0], 3) << extension;
    EXPECT_NEAR(120, pixel[1], 3) << extension;
    EXPECT_NEAR(220, pixel[2], 3) << extension;
  }
}

TEST(Decode, bayerPatternsStayRaw) {
  const auto message = decode(compress(".png", ramp(CV_8UC1), "bayer_rggb8; png compressed bayer_rggb8"));
  EXPECT_EQ("bayer_rggb8", message->encoding);
  EXPECT_EQ("8UC1", decode(compress(".png", ramp(CV_8UC1), "bayer_rggb16; png compressed"))->encoding);
  EXPECT_EQ("8UC3", decode(compress(".png", ramp(CV_8UC3), "bayer_rggb8; jpeg compressed bgr8"))->encoding);
}

TEST(Decode, masksAreNoJpeg) {
  sensor_msgs::CompressedImage message;
  cv::imencode(".jpg", cv::Mat(8, 8, CV_8UC1, cv::Scalar(3)), message.data);
  expectError(ErrorCause::kMasks, {"JPEG", "PNG"}, [&] { decodeMasks(message); });
  cv::imencode(".png", cv::Mat(8, 8, CV_16UC1, cv::Scalar(300)), message.data);
  EXPECT_EQ(300, toMaskLayers(*decodeMasks(message)).at(0).at<int>(3, 3));
}

TEST(Decode, rubbish) {
  sensor_msgs::CompressedImage message;
  message.header.frame_id = "cam0";
  message.format = "png";
  expectDecodeError(message, {"'png'", "0 bytes", "neither PNG nor JPEG"});
  message.data.assign(1000, 0x42);
  expectDecodeError(message, {"neither PNG nor JPEG"});
  expectDecodeError(compress(".bmp", ramp(CV_8UC3), "bmp"), {"neither PNG nor JPEG"});
  // compressedDepth puts 12 bytes in front of the PNG.
  message = compress(".png", ramp(CV_16UC1), "16UC1; compressedDepth");
  message.data.insert(message.data.begin(), 12, 0);
  expectDecodeError(message, {"compressedDepth", "neither PNG nor JPEG"});
}

// Half a mask image would look like an image with few masks.
TEST(Decode, truncatedPng) {
  sensor_msgs::CompressedImage message = compress(".png", ramp(CV_16UC1), "png");
  message.data.resize(message.data.size() / 2);
  expectDecodeError(message, {"damaged"});
}

TEST(Decode, sizesThatWouldTakeAllMemory) {
  sensor_msgs::CompressedImage png = compress(".png", ramp(CV_8UC1), "png");
  for (std::size_t i = 16; i < 24; ++i) png.data[i] = i % 4 < 2 ? 0 : 0x7f;
  expectDecodeError(png, {"32639 x 32639"});
  sensor_msgs::CompressedImage jpeg = compress(".jpg", ramp(CV_8UC1), "jpeg");
  const std::vector<std::uint8_t> start_of_frame = {0xff, 0xc0};
  const auto at =
      std::search(jpeg.data.begin(), jpeg.data.end(), start_of_frame.begin(), start_of_frame.end());
  ASSERT_LT(at + 9, jpeg.data.end());
  std::fill(at + 5, at + 9, 0xff);
  expectDecodeError(jpeg, {"65535 x 65535"});
}

TEST(Decode, truncatedAndDamagedFilesNeverCrash) {
  std::mt19937 random(5);
  for (const char* extension : {".png", ".jpg"}) {
    const auto good = compress(extension, ramp(CV_8UC3), "x");
    for (std::size_t length = 0; length < good.data.size(); ++length) {
      auto message = good;
      if (length % 2 == 0) {
        message.data.resize(length);
      } else {
        // Not in the header: some of the sizes there are legal and slow.
        message.data[std::max<std::size_t>(length, 40)] = static_cast<std::uint8_t>(random());
      }
      try {
        const auto image = decode(message);
        EXPECT_LE(image->width, 32766u);
      } catch (const Error& error) {
        EXPECT_EQ(ErrorCause::kImage, error.cause());
      }
    }
  }
}

}  // namespace
}  // namespace lidar_camera_recalibration

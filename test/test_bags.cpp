// Bags as converters and drivers leave them: compressed, of several cameras, with their topics, frames and
// point fields.

#include <cv_bridge/cv_bridge.h>
#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/PointCloud2.h>
#include <tf2_msgs/TFMessage.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "conversions.hpp"
#include "driver_clouds.hpp"
#include "lidar_camera_recalibration/calibration_formats.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/result_file.hpp"
#include "tool_fixture.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

sensor_msgs::CompressedImage compressed(const sensor_msgs::Image& image, const std::string& format,
                                        const std::string& extension) {
  sensor_msgs::CompressedImage result;
  result.header = image.header;
  result.format = format;
  cv::imencode(extension, cv_bridge::toCvCopy(image)->image, result.data);
  return result;
}

class BagsTest : public ToolTest {
 protected:
  static void SetUpTestSuite() {
    ToolTest::SetUpTestSuite();
    if (hasSimulation()) {
      const Finished run = call(
          "simulate_drive plain.bag --frames 6 --rate 0.1 --perturb 1 0.05 --seed 21 --compression none");
      ASSERT_EQ(run.status, 0) << run.output;
    }
    if (hasData()) {
      const Finished run =
          call("dataset_to_bag '" + data().string() + "' --every 5 --perturb 2 0.1 --seed 4 --out kitti.bag");
      ASSERT_EQ(run.status, 0) << run.output;
    }
  }

  using Rewrite = std::function<void(const rosbag::MessageInstance& message, rosbag::Bag& out)>;

  static void rewrite(const std::string& from, const std::string& to, const Rewrite& convert,
                      rosbag::CompressionType compression = rosbag::compression::Uncompressed) {
    const rosbag::Bag in(path(from));
    rosbag::Bag out(path(to), rosbag::bagmode::Write);
    out.setCompression(compression);
    for (const rosbag::MessageInstance& message : rosbag::View(in)) convert(message, out);
  }

  static void keep(const rosbag::MessageInstance& message, rosbag::Bag& out) {
    out.write(message.getTopic(), message.getTime(), message);
  }

  /// A bag that is the plain one but for its clouds.
  static void withClouds(const std::string& to,
                         const std::function<sensor_msgs::PointCloud2(const sensor_msgs::PointCloud2&)>& of) {
    rewrite("plain.bag", to, [&](const rosbag::MessageInstance& message, rosbag::Bag& out) {
      const auto cloud = message.instantiate<sensor_msgs::PointCloud2>();
      if (!cloud) return keep(message, out);
      out.write(message.getTopic(), message.getTime(), of(*cloud));
    });
  }

  /// Calibrates and compares with the truth; 0.03 deg and 0.6 cm are usual with 64 beams and few frames.
  static void expectGood(const std::string& arguments, const std::string& truth, double max_deg = 0.1,
                         double max_cm = 3.0) {
    const Finished run = call("calibrate_bag " + arguments + " --out good.yaml");
    ASSERT_EQ(run.status, 0) << run.output;
    const ExtrinsicError error = extrinsicError(readCalibration(path("good.yaml")).T_camera_lidar,
                                                readExtrinsic(truth).T_camera_lidar);
    EXPECT_LT(error.angle() / kDegree, max_deg) << arguments;
    EXPECT_LT(100.0 * error.distance(), max_cm) << arguments;
    std::printf("%s: %.3f deg, %.1f cm\n", arguments.c_str(), error.angle() / kDegree,
                100.0 * error.distance());
  }
};

// --- compression ---

TEST_F(BagsTest, CompressedImagesMasksAndChunks) {
  NEEDS_SIMULATION;
  const auto compress = [](const rosbag::MessageInstance& message, rosbag::Bag& out) {
    const auto image = message.instantiate<sensor_msgs::Image>();
    if (!image) return keep(message, out);
    if (message.getTopic() == "/camera/masks") {
      // A PNG has one, three or four channels.
      std::vector<cv::Mat> layers = toMaskLayers(*image);
      while (layers.size() < 3) layers.push_back(cv::Mat::zeros(layers[0].size(), CV_32S));
      out.write("/camera/masks/compressed", message.getTime(),
                compressed(toMaskMessage(image->header, layers), "16UC3; png compressed ", ".png"));
    } else {
      out.write(message.getTopic() + "/compressed", message.getTime(),
                compressed(*image, "bgr8; jpeg compressed bgr8", ".jpg"));
    }
  };
  rewrite("plain.bag", "bz2.bag", compress, rosbag::compression::BZ2);
  rewrite("plain.bag", "lz4.bag", keep, rosbag::compression::LZ4);
  const Finished check = call("check_bag bz2.bag");
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_TRUE(contains(check.output, "image:=/camera/image_raw compressed:=true")) << check.output;
  EXPECT_TRUE(contains(check.output, "masks:=/camera/masks masks_compressed:=true")) << check.output;
  expectGood("bz2.bag", path("plain.truth.yaml"));
  expectGood("lz4.bag", path("plain.truth.yaml"));
  // A parameter file names topics as the node does, without the transport.
  expectGood("bz2.bag --set topics/image=/camera/image_raw --set topics/masks=camera/masks",
             path("plain.truth.yaml"));
}

TEST_F(BagsTest, MasksAsJpegAreRefused) {
  NEEDS_SIMULATION;
  rewrite("plain.bag", "jpeg.bag", [](const rosbag::MessageInstance& message, rosbag::Bag& out) {
    const auto image = message.instantiate<sensor_msgs::Image>();
    if (!image || message.getTopic() != "/camera/masks") return keep(message, out);
    const cv::Mat first = toMaskLayers(*image).front();
    cv::Mat bytes;
    first.convertTo(bytes, CV_8U);
    out.write("/camera/masks/compressed", message.getTime(),
              compressed(*cv_bridge::CvImage(image->header, "mono8", bytes).toImageMsg(),
                         "mono8; jpeg compressed ", ".jpg"));
  });
  const Finished check = call("check_bag jpeg.bag");
  EXPECT_EQ(check.status, 1);
  EXPECT_TRUE(contains(check.output, "is a JPEG, which changes the ids")) << check.output;
  const Finished run = call("calibrate_bag jpeg.bag");
  EXPECT_EQ(run.status, 1);
  EXPECT_TRUE(contains(run.output, "is a JPEG, which changes the ids")) << run.output;
}

// --- several cameras ---

TEST_F(BagsTest, SeveralCamerasInOneCall) {
  NEEDS_SIMULATION;
  // The same camera twice, once compressed and with its masks elsewhere; a third one is without masks.
  rewrite("plain.bag", "cameras.bag", [](const rosbag::MessageInstance& message, rosbag::Bag& out) {
    const std::string& topic = message.getTopic();
    if (topic.rfind("/camera/", 0) != 0) return keep(message, out);
    const std::string part = topic.substr(8);
    out.write("/front/" + part, message.getTime(), message);
    const auto image = message.instantiate<sensor_msgs::Image>();
    if (part == "masks") {
      out.write("/segmenter/back", message.getTime(), message);
    } else if (image) {
      out.write("/rear/image_raw/compressed", message.getTime(),
                compressed(*image, "bgr8; jpeg compressed bgr8", ".jpg"));
    } else {
      out.write("/rear/camera_info", message.getTime(), message);
      out.write("/side/camera_info", message.getTime(), message);
    }
    if (image && part != "masks") out.write("/side/image_raw", message.getTime(), message);
  });
  const std::string cameras =
      "cameras.bag --camera front=/front/image_raw --camera rear=/rear/image_raw,masks=/segmenter/back";
  const Finished check = call("check_bag " + cameras);
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_TRUE(contains(check.output, "camera front")) << check.output;
  EXPECT_TRUE(contains(check.output, "image:=/rear/image_raw compressed:=true")) << check.output;
  const Finished run = call("calibrate_bag " + cameras + ",threads=1 --out both.yaml --overlay both.jpg");
  ASSERT_EQ(run.status, 0) << run.output;
  const Eigen::Isometry3d truth = readCalibration(path("plain.truth.yaml")).T_camera_lidar;
  for (const std::string camera : {"front", "rear"}) {
    const StoredCalibration result = readCalibration(path("both_" + camera + ".yaml"));
    EXPECT_LT(extrinsicError(result.T_camera_lidar, truth).angle(), 0.1 * kDegree) << camera;
    EXPECT_TRUE(fs::exists(path("both_" + camera + ".jpg")));
  }
  EXPECT_FALSE(fs::exists(path("both.yaml")));
  // The results are the start of the next call: nothing is to be gained from there.
  const Finished next = call("calibrate_bag " + cameras + " --initial both.yaml --out next.yaml");
  EXPECT_EQ(next.status, 3) << next.output;

  // One that cannot be calibrated does not stop the others; nor does it borrow another camera's masks.
  const Finished three = call(
      "calibrate_bag cameras.bag --camera side=/side/image_raw --camera front=/front/image_raw "
      "--out three.yaml");
  EXPECT_EQ(three.status, 1) << three.output;
  EXPECT_TRUE(contains(three.output, "camera side: no topic fits --masks")) << three.output;
  EXPECT_TRUE(fs::exists(path("three_front.yaml")));
  EXPECT_FALSE(fs::exists(path("three_side.yaml")));

  EXPECT_EQ(call("calibrate_bag cameras.bag --camera /front/image_raw").status, 2);
  EXPECT_EQ(call("calibrate_bag cameras.bag --camera a=/x --camera a=/y").status, 2);
  EXPECT_EQ(call("calibrate_bag cameras.bag --camera a=/x --image /y").status, 2);
}

// --- converters ---

/// kitti2bag's raw_synced: rectified images under a raw name, K and D of the camera before that, x y z i,
/// static transforms again at each stamp.
TEST_F(BagsTest, OfKitti2bag) {
  NEEDS_DATA;
  rosbag::Bag masks(path("kitti_masks.bag"), rosbag::bagmode::Write);
  const rosbag::Bag original(path("kitti.bag"));
  const auto mounting = rosbag::View(original, rosbag::TopicQuery("/tf_static"))
                            .begin()
                            ->instantiate<tf2_msgs::TFMessage>()
                            ->transforms.front();
  rewrite("kitti.bag", "kitti2bag.bag", [&](const rosbag::MessageInstance& message, rosbag::Bag& out) {
    const ros::Time& time = message.getTime();
    if (const auto image = message.instantiate<sensor_msgs::Image>()) {
      sensor_msgs::Image own = *image;
      own.header.frame_id = "camera_color_left";
      if (message.getTopic() == "/camera/masks")
        return masks.write("/kitti/camera_color_left/masks", time, own);
      out.write("/kitti/camera_color_left/image_raw", time, own);
      sensor_msgs::Image grey = own;
      grey.header.frame_id = "camera_gray_left";
      out.write("/kitti/camera_gray_left/image_raw", time, grey);
      tf2_msgs::TFMessage fixed;
      fixed.transforms.resize(2);
      fixed.transforms[0].header.frame_id = "base_link";
      fixed.transforms[0].child_frame_id = "velo_link";
      fixed.transforms[0].transform.rotation.w = 1.0;
      fixed.transforms[1] = mounting;
      fixed.transforms[1].header.frame_id = "velo_link";
      fixed.transforms[1].child_frame_id = "camera_color_left";
      for (auto& transform : fixed.transforms) transform.header.stamp = own.header.stamp;
      out.write("/tf_static", time, fixed);
    } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
      sensor_msgs::CameraInfo own = *info;
      own.header.frame_id = "camera_color_left";
      own.K = {959.7910, 0.0, 696.0217, 0.0, 956.9251, 224.1806, 0.0, 0.0, 1.0};
      own.D = {-0.3691481, 0.1968681, 0.001353473, 0.0005677587, -0.06770705};
      own.distortion_model = "plumb_bob";
      own.P[3] = 45.0;  // the stereo baseline, which is none of this camera's
      out.write("/kitti/camera_color_left/camera_info", time, own);
      out.write("/kitti/camera_gray_left/camera_info", time, own);
    } else if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
      out.write("/kitti/velo/pointcloud", time, xyzi(*cloud, "velo_link", "i"));
    }
  });
  masks.close();
  const Finished bare = call("check_bag kitti2bag.bag");
  EXPECT_EQ(bare.status, 1) << "no masks";
  EXPECT_TRUE(contains(bare.output, "--config config/kitti2bag.yaml")) << bare.output;
  EXPECT_TRUE(contains(bare.output, "missing: masks")) << bare.output;
  EXPECT_TRUE(contains(bare.output, "there are 2 cameras")) << bare.output;

  const std::string config = " --config '" PACKAGE_DIR "/config/kitti2bag.yaml'";
  const Finished check = call("check_bag kitti2bag.bag kitti_masks.bag" + config);
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_TRUE(contains(check.output, "without a field `ring`")) << check.output;
  EXPECT_TRUE(contains(check.output, "points:=/kitti/velo/pointcloud")) << check.output;
  expectGood("kitti2bag.bag kitti_masks.bag" + config, (data() / "calib.json").string(), 0.2, 6.0);
}

void writeCameraInfoFile(const std::string& file, const sensor_msgs::CameraInfo& info) {
  std::ofstream out(file);
  out << "image_width: " << info.width << "\nimage_height: " << info.height << "\ncamera_name: cam_front\n";
  out << "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [";
  for (std::size_t i = 0; i < 9; ++i) out << (i > 0 ? ", " : "") << info.K[i];
  out << "]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [";
  for (std::size_t i = 0; i < 5; ++i) out << (i > 0 ? ", " : "") << info.D[i];
  out << "]\n";
}

/// nuscenes2bag: topics without a slash, no CameraInfo, no rings, all transforms on /tf at the stamps of the
/// sensors.
TEST_F(BagsTest, OfNuscenes2bag) {
  NEEDS_SIMULATION;
  const Finished drive = call(
      "simulate_drive drive32.bag --frames 8 --rate 0.2 --beams 32 --cloud-delay 0.04 --perturb 1 0.05 "
      "--seed 5");
  ASSERT_EQ(drive.status, 0) << drive.output;
  rosbag::Bag masks(path("nuscenes_masks.bag"), rosbag::bagmode::Write);
  tf2_msgs::TFMessage mountings;
  rewrite("drive32.bag", "nuscenes.bag", [&](const rosbag::MessageInstance& message, rosbag::Bag& out) {
    const ros::Time& time = message.getTime();
    if (const auto image = message.instantiate<sensor_msgs::Image>()) {
      sensor_msgs::Image own = *image;
      own.header.frame_id = "cam_front";
      if (message.getTopic() == "/camera/masks") return masks.write("/cam_front/masks", time, own);
      out.write("cam_front/raw", own.header.stamp, own);
      own.header.frame_id = "cam_back";
      out.write("cam_back/compressed", own.header.stamp, compressed(own, "jpg", ".jpg"));
    } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
      writeCameraInfoFile(path("cam_front.yaml"), *info);
    } else if (const auto cloud = message.instantiate<sensor_msgs::PointCloud2>()) {
      out.write("lidar_top", cloud->header.stamp, xyzi(*cloud, "lidar_top", "intensity"));
    } else if (const auto tf = message.instantiate<tf2_msgs::TFMessage>()) {
      if (message.getTopic() == "/tf_static") {
        mountings = *tf;
        return;
      }
      tf2_msgs::TFMessage all = mountings;
      for (auto& transform : all.transforms) {
        if (transform.child_frame_id == "lidar") transform.child_frame_id = "lidar_top";
        if (transform.child_frame_id == "camera_optical_frame") transform.child_frame_id = "cam_front";
        transform.header.stamp = tf->transforms[0].header.stamp;
      }
      all.transforms.push_back(tf->transforms[0]);
      out.write("/tf", time, all);
    }
  });
  masks.close();
  const Finished bare = call("check_bag nuscenes.bag");
  EXPECT_EQ(bare.status, 1);
  EXPECT_TRUE(contains(bare.output, "--config config/nuscenes2bag.yaml")) << bare.output;
  EXPECT_TRUE(contains(bare.output, "parameter camera_info_file")) << bare.output;

  const std::string words =
      "nuscenes.bag nuscenes_masks.bag --config '" PACKAGE_DIR "/config/nuscenes2bag.yaml'";
  const Finished check = call("check_bag " + words);
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_TRUE(contains(check.output, "rings, told apart without a field `ring`")) << check.output;
  EXPECT_TRUE(contains(check.output, "tf: the way of lidar_top in odom")) << check.output;
  EXPECT_TRUE(contains(check.output, "image:=/cam_front/raw points:=/lidar_top")) << check.output;
  expectGood(words, path("drive32.truth.yaml"), 0.15, 3.0);

  const Finished lost = call("check_bag " + words + " --set camera_info_file=nowhere.yaml");
  EXPECT_EQ(lost.status, 1);
  EXPECT_TRUE(contains(lost.output, "nowhere.yaml")) << lost.output;
}

// --- drivers ---

struct Driver {
  const char* name;
  sensor_msgs::PointCloud2 (*of)(const sensor_msgs::PointCloud2&);
};

TEST_F(BagsTest, OfTheUsualDrivers) {
  NEEDS_SIMULATION;
  const Driver drivers[] = {{"velodyne", velodyne},    {"velodyne_2018", velodyne2018},
                            {"ouster", ouster},        {"ouster_transposed", ousterTransposed},
                            {"hesai", hesai},          {"hesai_general", hesaiGeneral},
                            {"livox_spinning", livox2}};
  const rosbag::Bag plain(path("plain.bag"));
  const auto original = rosbag::View(plain, rosbag::TopicQuery("/lidar/points"))
                            .begin()
                            ->instantiate<sensor_msgs::PointCloud2>();
  const PointCloud expected = toPointCloud(velodyne(*original), "");
  ASSERT_EQ(expected.time.size(), original->width);
  ASSERT_EQ(expected.ring.size(), original->width);
  for (const Driver& driver : drivers) {
    const sensor_msgs::PointCloud2 message = driver.of(*original);
    const PointCloud cloud = toPointCloud(message, "");
    const double later = (message.header.stamp - original->header.stamp).toSec();
    EXPECT_EQ(cloud.size(), expected.size()) << driver.name;
    ASSERT_EQ(cloud.time.size(), cloud.size()) << driver.name << ": times";
    EXPECT_EQ(cloud.hasReflectivity(), true) << driver.name;
    const bool livox = std::string(driver.name) == "livox_spinning";
    EXPECT_EQ(cloud.ring.empty(), livox) << driver.name << ": Livox's lines are no rings";
    // In whatever order: the same places, each with its own ring and time.
    const auto sum = [](const PointCloud& of, double stamp) {
      double result = 0.0;
      for (std::size_t i = 0; i < of.size(); ++i) {
        const double own = of.ring.empty() ? 1.0 : 1.0 + of.ring[i];
        result += own * (1.0 + stamp + of.time[i]) *
                  of.points[i].cast<double>().dot(Eigen::Vector3d(1.0, 2.0, 3.0));
      }
      return result;
    };
    PointCloud comparable = expected;
    if (livox) comparable.ring.clear();
    EXPECT_NEAR(sum(cloud, later) / sum(comparable, 0.0), 1.0, 1e-6) << driver.name;
  }
  withClouds("ouster.bag", ousterTransposed);
  expectGood("ouster.bag", path("plain.truth.yaml"));
  const Finished check = call("check_bag ouster.bag");
  EXPECT_EQ(check.status, 0) << check.output;
  EXPECT_TRUE(contains(check.output, "intensity_field=reflectivity")) << check.output;
  EXPECT_TRUE(contains(check.output, "64 rings, by their field")) << check.output;
  withClouds("velodyne.bag", velodyne2018);
  expectGood("velodyne.bag", path("plain.truth.yaml"));
}

TEST_F(BagsTest, OfALidarThatDoesNotSpin) {
  NEEDS_SIMULATION;
  withClouds("rosette.bag", livoxRosette);
  const Finished check = call("check_bag rosette.bag");
  EXPECT_EQ(check.status, 1);
  EXPECT_TRUE(contains(check.output, "wrong: points: no rings")) << check.output;
  EXPECT_TRUE(contains(check.output, "--set objective=paper --set search=paper")) << check.output;
  const Finished run = call("calibrate_bag rosette.bag");
  EXPECT_EQ(run.status, 1) << run.output;
  EXPECT_TRUE(contains(run.output, "shows no rings")) << run.output;
  const std::string paper =
      "rosette.bag --set objective=paper --set search=paper --set paper/refine_evaluations=500";
  EXPECT_EQ(call("check_bag " + paper).status, 0);
  const Finished searched =
      call("calibrate_bag " + paper + " --set search_range/rotation_deg=1 --out rosette.yaml");
  EXPECT_TRUE(searched.status == 0 || searched.status == 3) << searched.output;
  EXPECT_EQ(readCalibration(path("rosette.yaml")).frames, 6u);
}

}  // namespace
}  // namespace lidar_camera_recalibration

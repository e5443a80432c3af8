// Real frames through the nodelet, as on a vehicle: a bag is replayed, ~recalibrate is called, tf is read.

#include <gtest/gtest.h>
#include <lidar_camera_recalibration/Recalibrate.h>
#include <ros/ros.h>
#include <tf2_eigen/tf2_eigen.h>
#include <tf2_ros/transform_listener.h>

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "lidar_camera_recalibration/extrinsic.hpp"
#include "lidar_camera_recalibration/result_file.hpp"

namespace lidar_camera_recalibration {
namespace {

namespace fs = std::filesystem;

/// What the eye sees of an extrinsic's error in the overlay: the mean over near and far of the displacement
/// [px].
double imageError(const Eigen::Isometry3d& T, const Eigen::Isometry3d& reference) {
  constexpr double kFocalLength = 718.856;
  constexpr int kWidth = 1241;
  double sum = 0.0;
  for (const double distance : {8.0, 15.0, 30.0})
    sum += pixelShift(T, reference, distance, kFocalLength, kWidth);
  return sum / 3.0;
}

TEST(RealDrive, TheNodeletComesNearTheReference) {
  const fs::path data = fs::path(SHARED_DATA) / "kitti_00";
  if (!fs::exists(data)) GTEST_SKIP() << "no real data: " << data;
  const fs::path folder = fs::temp_directory_path() / ("test_real_drive_" + std::to_string(getpid()));
  fs::create_directories(folder);
  const std::string bag = (folder / "kitti.bag").string();
  ASSERT_EQ(std::system((TOOL_DIR "/dataset_to_bag '" + data.string() +
                         "' --every 2 --perturb 2 0.1 --seed 4 --out '" + bag + "'")
                            .c_str()),
            0);
  const Eigen::Isometry3d reference = readCalibration((folder / "kitti.truth.yaml").string()).T_camera_lidar;

  tf2_ros::Buffer tf;
  const tf2_ros::TransformListener listener(tf);
  ASSERT_TRUE(ros::service::waitForService("/recalibration/recalibrate", ros::Duration(30.0)));
  std::thread player(
      [&] { EXPECT_EQ(std::system(("rosbag play --quiet --delay 2 --rate 3 '" + bag + "'").c_str()), 0); });
  Recalibrate recalibrate;
  recalibrate.request.wait = true;
  recalibrate.request.min_frames = 10;
  const bool answered = ros::service::call("/recalibration/recalibrate", recalibrate);
  player.join();
  fs::remove_all(folder);
  ASSERT_TRUE(answered);
  ASSERT_TRUE(recalibrate.response.success) << recalibrate.response.message;

  const CalibrationResult& result = recalibrate.response.result;
  EXPECT_TRUE(result.accepted) << result.reason;
  EXPECT_GE(result.frames, 10u);
  const Eigen::Isometry3d start = tf2::transformToEigen(result.start),
                          found = tf2::transformToEigen(result.transform);
  EXPECT_NEAR(extrinsicError(start, reference).angle() / kDegree, 2.0, 1e-6);
  EXPECT_NEAR(extrinsicError(start, reference).distance(), 0.1, 1e-6);
  // The reference of this day is itself some 0.1 deg off (doc/accuracy.md).
  EXPECT_LT(extrinsicError(found, reference).angle() / kDegree, 0.4);
  EXPECT_LT(extrinsicError(found, reference).distance(), 0.06);
  EXPECT_LT(imageError(found, reference), imageError(start, reference) / 4.0);

  const geometry_msgs::TransformStamped published =
      tf.lookupTransform("camera_optical_frame_recalibrated", "lidar", ros::Time(0), ros::Duration(10.0));
  EXPECT_TRUE(tf2::transformToEigen(published).isApprox(found, 1e-9));
}

}  // namespace
}  // namespace lidar_camera_recalibration

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "test_real_drive");
  ros::AsyncSpinner spinner(1);
  spinner.start();
  return RUN_ALL_TESTS();
}

#include "lidar_camera_recalibration/deskew.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lidar_camera_recalibration {
namespace {

using Way = std::function<Eigen::Isometry3d(double time)>;

constexpr double kBegin = -0.05, kEnd = 0.05;  // of the sweep, around the stamp of the cloud [s]

/// A vehicle in a bend, far from the origin of the fixed frame: 15 m/s, 20 deg/s, and its body rolls and
/// pitches.
Eigen::Isometry3d inABend(double time) {
  Vector6d twist;
  twist << 0.05, -0.03, 20.0 * kDegree, 15.0, 0.4, -0.1;
  Eigen::Isometry3d start = Eigen::Isometry3d::Identity();
  start.translate(Eigen::Vector3d(1000.0, -2000.0, 30.0));
  start.rotate(Eigen::AngleAxisd(2.0, Eigen::Vector3d::UnitZ()));
  return start * exp(time * twist);
}

/// Brakes and turns the other way in the middle of the sweep, on a pose.
Eigen::Isometry3d zigzag(double time) {
  const auto leg = [](double seconds, double turn) {
    Vector6d twist;
    twist << 0.0, 0.0, turn, 20.0 - 40.0 * std::abs(turn), 0.0, 0.0;
    return exp(seconds * twist);
  };
  return time < 0.0 ? leg(time, 0.4) : leg(time, -0.3);
}

Eigen::Vector3d wall(double azimuth, double height) {
  const double range = 12.0 + 6.0 * std::sin(3.0 * azimuth);
  return {range * std::cos(azimuth), range * std::sin(azimuth), height};
}

struct Scan {
  PointCloud as_fired, from_standing;
};

/// One turn of a LiDAR that looks at a still world; and what it would have seen standing at its pose of
/// `image_time`.
Scan scan(const Way& way, double image_time, bool same_time_for_all = false) {
  Scan result;
  const Eigen::Isometry3d T_world_start = way(0.0), T_image_world = way(image_time).inverse();
  for (int column = 0; column <= 360; ++column) {
    const double time = same_time_for_all ? 0.0 : kBegin + (kEnd - kBegin) * column / 360.0;
    for (double height = -1.5; height <= 3.0; height += 1.5) {
      const Eigen::Vector3d in_world = T_world_start * wall(2.0 * M_PI * column / 360.0, height);
      result.as_fired.points.push_back((way(time).inverse() * in_world).cast<float>());
      result.from_standing.points.push_back((T_image_world * in_world).cast<float>());
      if (!same_time_for_all) result.as_fired.time.push_back(static_cast<float>(time));
    }
  }
  return result;
}

std::vector<LidarPose> sampled(const Way& way, double from, double to, int intervals) {
  std::vector<LidarPose> poses;
  for (int i = 0; i <= intervals; ++i) {
    const double time = from + (to - from) * i / intervals;
    poses.push_back({time, way(time)});
  }
  return poses;
}

double furthest(const PointCloud& a, const PointCloud& b) {
  double distance = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i)
    distance = std::max(distance, static_cast<double>((a.points[i] - b.points[i]).norm()));
  return distance;
}

TEST(Deskew, isExactOnASpinningScanOfAMovingSensor) {
  for (const double image_time : {kBegin, -0.013, 0.0, 0.031, 0.08}) {
    Scan scanned = scan(inABend, image_time);
    EXPECT_GT(furthest(scanned.as_fired, scanned.from_standing), 0.4) << "there is something to do";
    deskew(scanned.as_fired, sampled(inABend, kBegin, 0.08, 4), image_time);
    // A motion along a screw is met exactly; what is left is single precision.
    EXPECT_LT(furthest(scanned.as_fired, scanned.from_standing), 2e-5) << image_time;
    EXPECT_TRUE(scanned.as_fired.time.empty()) << "the points belong to one moment now";
  }
}

TEST(Deskew, followsTheMotionFromPoseToPose) {
  Scan scanned = scan(zigzag, 0.02);
  PointCloud coarse = scanned.as_fired;
  deskew(scanned.as_fired, sampled(zigzag, kBegin, kEnd, 10), 0.02);
  EXPECT_LT(furthest(scanned.as_fired, scanned.from_standing), 2e-5);
  deskew(coarse, sampled(zigzag, kBegin, kEnd, 1), 0.02);
  EXPECT_GT(furthest(coarse, scanned.from_standing), 0.01) << "first and last pose alone do not tell";
}

TEST(Deskew, withoutTimesTheCloudMovesAsAWhole) {
  Scan scanned = scan(inABend, -0.03, true);
  EXPECT_GT(furthest(scanned.as_fired, scanned.from_standing), 0.4);
  deskew(scanned.as_fired, sampled(inABend, -0.04, 0.0, 4), -0.03);
  EXPECT_LT(furthest(scanned.as_fired, scanned.from_standing), 2e-5);
}

TEST(Deskew, aStandingSensorChangesNothing) {
  const Way stands = [](double) { return inABend(0.0); };
  Scan scanned = scan(stands, 0.01);
  const PointCloud before = scanned.as_fired;
  deskew(scanned.as_fired, {{kBegin, stands(0)}, {kEnd, stands(0)}}, 0.01);
  EXPECT_LT(furthest(scanned.as_fired, before), 1e-5);
}

TEST(Deskew, onePoseServesOneMoment) {
  PointCloud cloud;
  cloud.points = {{1.0F, 2.0F, 3.0F}};
  deskew(cloud, {{0.0, inABend(0.0)}}, 0.0);
  EXPECT_LT((cloud.points[0] - Eigen::Vector3f(1.0F, 2.0F, 3.0F)).norm(), 1e-6F);
}

TEST(Deskew, refusesWhatThePosesDoNotCover) {
  const auto cause = [](const std::vector<LidarPose>& poses, double time) {
    Scan scanned = scan(inABend, 0.0);
    try {
      deskew(scanned.as_fired, poses, time);
    } catch (const Error& error) {
      return error.cause() == ErrorCause::kMotion;
    }
    return false;
  };
  EXPECT_TRUE(cause({}, 0.0));
  EXPECT_TRUE(cause(sampled(inABend, kBegin, 0.04, 4), 0.0)) << "the last points are later";
  EXPECT_TRUE(cause(sampled(inABend, -0.04, kEnd, 4), 0.0)) << "the first points are earlier";
  EXPECT_TRUE(cause(sampled(inABend, kBegin, kEnd, 4), 0.06)) << "the image is later";
  EXPECT_TRUE(cause(sampled(inABend, kEnd, kBegin, 4), 0.0)) << "backwards";
  EXPECT_TRUE(cause(sampled(inABend, kBegin, kEnd, 4), std::nan("")));
  EXPECT_FALSE(cause(sampled(inABend, kBegin, kEnd, 4), 0.0));
}

}  // namespace
}  // namespace lidar_camera_recalibration

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/overlay.hpp"

namespace lcr = lidar_camera_recalibration;
using lcr::OverlayColor;

namespace {

const cv::Vec3b kGrey(150, 150, 150);
const std::vector<OverlayColor> kAllColors = {OverlayColor::kDepth, OverlayColor::kReflectivity,
                                              OverlayColor::kNormal, OverlayColor::kSegment,
                                              OverlayColor::kMask};

lcr::Camera wideCamera(int width = 1800, int height = 300, const std::vector<double>& distortion = {}) {
  lcr::Intrinsics i;
  i.width = width;
  i.height = height;
  i.fx = i.fy = 0.5 * width;
  i.cx = 0.5 * width;
  i.cy = 0.5 * height;
  i.model = distortion.empty() ? lcr::DistortionModel::kNone : lcr::DistortionModel::kPlumbBob;
  i.distortion = distortion;
  return lcr::Camera(i);
}

/// A white image without points; mask 5 covers its left half, mask 9 a stripe on the right.
lcr::Frame emptyFrame(const lcr::Camera& camera = wideCamera()) {
  const int width = camera.intrinsics().width, height = camera.intrinsics().height;
  cv::Mat layer = cv::Mat::zeros(height, width, CV_32SC1);
  layer.colRange(0, width / 2) = 5;
  layer.colRange(width - width / 6, width) = 9;
  return {
      0.0, camera, cv::Mat(height, width, CV_8UC3, cv::Scalar::all(255)), lcr::MaskSets::fromLayers({layer}),
      {},  {}};
}

/// LiDAR axes x forward, y left, z up, at the camera's place.
Eigen::Isometry3d lidarToCamera() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  return T;
}

struct Point {
  Eigen::Vector3d in_camera;
  float reflectivity = 0.5F;
  std::int32_t segment = 0;
  Eigen::Vector3d normal_in_camera = -Eigen::Vector3d::UnitZ();
  bool visible = true;
};

void add(lcr::Frame& frame, const Point& point) {
  const Eigen::Vector3f p = (lidarToCamera().inverse() * point.in_camera).cast<float>();
  const Eigen::Vector3f n = (lidarToCamera().linear().transpose() * point.normal_in_camera).cast<float>();
  lcr::FramePoints& points = frame.points;
  points.x.push_back(p.x()), points.y.push_back(p.y()), points.z.push_back(p.z());
  points.nx.push_back(n.x()), points.ny.push_back(n.y()), points.nz.push_back(n.z());
  points.reflectivity.push_back(point.reflectivity);
  points.segment.push_back(point.segment);
  frame.visible.push_back(point.visible ? 1 : 0);
}

lcr::Frame frameWith(const std::vector<Point>& points, const lcr::Camera& camera = wideCamera()) {
  lcr::Frame frame = emptyFrame(camera);
  for (const Point& point : points) add(frame, point);
  return frame;
}

/// The picture without its title bar.
cv::Mat draw(const lcr::Frame& frame, OverlayColor color) {
  const cv::Mat picture = lcr::drawOverlay(frame, lidarToCamera(), color);
  return picture.rowRange(picture.rows - frame.image.rows, picture.rows);
}

cv::Vec3b colorOf(const lcr::Frame& frame, OverlayColor color, int u = 900, int v = 150) {
  return draw(frame, color).at<cv::Vec3b>(v, u);
}

int differing(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  return cv::countNonZero(difference.reshape(1));
}

void expectImageError(const lcr::Frame& frame) {
  try {
    lcr::drawOverlay(frame, lidarToCamera(), OverlayColor::kDepth);
    FAIL() << "drawn";
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kImage);
  }
}

}  // namespace

TEST(Overlay, TitleBarComesOnTop) {
  const lcr::Frame frame = frameWith({{{0, 0, 10}}});
  const cv::Mat picture = lcr::drawOverlay(frame, lidarToCamera(), OverlayColor::kDepth, "title");
  EXPECT_EQ(picture.type(), CV_8UC3);
  EXPECT_EQ(picture.cols, 1800);
  EXPECT_GT(picture.rows, 320);
  EXPECT_LT(picture.rows, 400);
  const cv::Mat other = lcr::drawOverlay(frame, lidarToCamera(), OverlayColor::kDepth, "another title");
  const int bar = picture.rows - frame.image.rows;
  EXPECT_GT(differing(picture.rowRange(0, bar), other.rowRange(0, bar)), 100);
  EXPECT_EQ(differing(picture.rowRange(bar, picture.rows), other.rowRange(bar, picture.rows)), 0);
}

TEST(Overlay, EachColouringHasItsLegend) {
  const lcr::Frame frame = emptyFrame();
  std::vector<cv::Mat> pictures;
  for (const OverlayColor color : kAllColors)
    pictures.push_back(lcr::drawOverlay(frame, lidarToCamera(), color));
  for (std::size_t a = 0; a < pictures.size(); ++a) {
    for (std::size_t b = 0; b < a; ++b) EXPECT_GT(differing(pictures[a], pictures[b]), 100) << a << " " << b;
  }
  lcr::Frame without = frame;
  without.points.reflectivity.clear();
  add(without, {{0, 0, 10}});
  const cv::Mat with = lcr::drawOverlay(without, lidarToCamera(), OverlayColor::kReflectivity);
  without.points.reflectivity.clear();
  EXPECT_GT(differing(with, lcr::drawOverlay(without, lidarToCamera(), OverlayColor::kReflectivity)), 100);
}

TEST(Overlay, APointIsASmallDotAtItsPixel) {
  const cv::Mat empty = draw(emptyFrame(), OverlayColor::kDepth);
  const cv::Mat picture = draw(frameWith({{{2.0, 0.5, 10.0}}}), OverlayColor::kDepth);
  cv::Mat changed;
  cv::absdiff(empty, picture, changed);
  cv::Mat channels[3], any;
  cv::split(changed, channels);
  any = (channels[0] | channels[1] | channels[2]) > 0;
  const cv::Moments moments = cv::moments(any, true);
  EXPECT_GE(moments.m00, 9);
  EXPECT_LE(moments.m00, 60);
  EXPECT_NEAR(moments.m10 / moments.m00, 900 + 900 * 0.2, 0.6);
  EXPECT_NEAR(moments.m01 / moments.m00, 150 + 900 * 0.05, 0.6);
}

TEST(Overlay, PointsFollowTheLensOfTheRawImage) {
  const lcr::Camera camera = wideCamera(1800, 300, {-0.2, 0.0, 0.0, 0.0});
  const Eigen::Vector3d point(6.0, 0.0, 10.0);
  const auto pixel = camera.project(point);
  ASSERT_TRUE(pixel);
  ASSERT_LT(pixel->x(), 900 + 900 * 0.6 - 20);  // the pinhole's pixel is far off
  const cv::Mat empty = draw(emptyFrame(camera), OverlayColor::kDepth);
  const cv::Mat picture = draw(frameWith({{point}}, camera), OverlayColor::kDepth);
  const cv::Point raw(cvRound(pixel->x()), cvRound(pixel->y()));
  EXPECT_NE(picture.at<cv::Vec3b>(raw), empty.at<cv::Vec3b>(raw));
  EXPECT_EQ(picture.at<cv::Vec3b>(150, 1440), empty.at<cv::Vec3b>(150, 1440));
}

TEST(Overlay, HiddenPointsAndPointsOutOfSightAreLeftOut) {
  Point hidden{{0, 0, 10}};
  hidden.visible = false;
  const lcr::Frame frame =
      frameWith({hidden, {{0.0, 0.0, -10.0}}, {{100.0, 0.0, 10.0}}, {{0.0, -50.0, 10.0}}});
  EXPECT_EQ(differing(draw(frame, OverlayColor::kDepth), draw(emptyFrame(), OverlayColor::kDepth)), 0);
}

TEST(Overlay, NearestIsOnTop) {
  const Point near{{0, 0, 5}}, far{{0, 0, 40}};
  const cv::Vec3b expected = colorOf(frameWith({near}), OverlayColor::kDepth);
  ASSERT_NE(expected, colorOf(frameWith({far}), OverlayColor::kDepth));
  EXPECT_EQ(colorOf(frameWith({near, far}), OverlayColor::kDepth), expected);
  EXPECT_EQ(colorOf(frameWith({far, near}), OverlayColor::kDepth), expected);
}

TEST(Overlay, DepthRunsFromRedToBlue) {
  const cv::Vec3b near = colorOf(frameWith({{{0, 0, 3}}}), OverlayColor::kDepth);
  const cv::Vec3b middle = colorOf(frameWith({{{0, 0, 14}}}), OverlayColor::kDepth);
  const cv::Vec3b far = colorOf(frameWith({{{0, 0, 70}}}), OverlayColor::kDepth);
  EXPECT_GT(near[2], near[0] + 80);
  EXPECT_GT(middle[1], middle[0]);
  EXPECT_GT(middle[1], middle[2]);
  EXPECT_GT(far[0], far[2] + 80);
  // Beyond the scale's ends the colour stays.
  EXPECT_EQ(colorOf(frameWith({{{0, 0, 80}}}), OverlayColor::kDepth),
            colorOf(frameWith({{{0, 0, 500}}}), OverlayColor::kDepth));
}

TEST(Overlay, ReflectivityRunsFromBlueToRed) {
  const cv::Vec3b dark = colorOf(frameWith({{{0, 0, 10}, 0.05F}}), OverlayColor::kReflectivity);
  const cv::Vec3b bright = colorOf(frameWith({{{0, 0, 10}, 0.95F}}), OverlayColor::kReflectivity);
  EXPECT_GT(dark[0], dark[2]);
  EXPECT_GT(bright[2], bright[0]);
  lcr::Frame without = frameWith({{{0, 0, 10}}});
  without.points.reflectivity.clear();
  EXPECT_EQ(colorOf(without, OverlayColor::kReflectivity), kGrey);
}

TEST(Overlay, NormalsAreShownInCameraAxes) {
  const auto color = [](const Eigen::Vector3d& normal) {
    Point point{{0, 0, 10}};
    point.normal_in_camera = normal;
    return colorOf(frameWith({point}), OverlayColor::kNormal);
  };
  EXPECT_EQ(color(Eigen::Vector3d::UnitX()), cv::Vec3b(128, 128, 255));  // red
  EXPECT_EQ(color(-Eigen::Vector3d::UnitY()), cv::Vec3b(128, 0, 128));   // not green
  EXPECT_EQ(color(-Eigen::Vector3d::UnitZ()), cv::Vec3b(0, 128, 128));   // not blue
  EXPECT_EQ(color(Eigen::Vector3d::Zero()), kGrey);                      // unknown
}

TEST(Overlay, SegmentsAreToldApart) {
  std::vector<Point> points;
  for (int u = 3; u < 1800; u += 6) {
    points.push_back({{(u - 900) / 90.0, 0.0, 10.0}, 0.5F, static_cast<std::int32_t>(points.size()) - 1});
  }
  const cv::Mat picture = draw(frameWith(points), OverlayColor::kSegment);
  const auto color = [&picture](int segment) { return picture.at<cv::Vec3b>(150, 3 + 6 * (segment + 1)); };
  EXPECT_EQ(color(lcr::LidarFeatures::kNoSegment), kGrey);
  for (int segment = 0; segment < 298; ++segment) {
    EXPECT_NE(color(segment), kGrey);
    EXPECT_GT(cv::norm(color(segment), color(segment + 1)), 60) << segment;
  }
}

TEST(Overlay, MasksOfTheIdealImageColourThePoints) {
  const cv::Vec3b left = colorOf(frameWith({{{-5, 0, 10}}}), OverlayColor::kMask, 450);
  const cv::Vec3b middle = colorOf(frameWith({{{2, 0, 10}}}), OverlayColor::kMask, 1080);
  const cv::Vec3b right = colorOf(frameWith({{{9, 0, 10}}}), OverlayColor::kMask, 1710);
  EXPECT_EQ(middle, kGrey);
  EXPECT_NE(left, kGrey);
  EXPECT_NE(right, kGrey);
  EXPECT_NE(left, right);

  // With this lens the raw pixel of x/z = 0.7 lies left of the stripe, its ideal pixel 1530 in the stripe.
  const lcr::Camera camera = wideCamera(1800, 300, {-0.2, 0.0, 0.0, 0.0});
  const auto pixel = camera.project({7.0, 0.0, 10.0});
  ASSERT_TRUE(pixel && pixel->x() < 1490);
  EXPECT_EQ(colorOf(frameWith({{{7, 0, 10}}}, camera), OverlayColor::kMask, cvRound(pixel->x())), right);
}

TEST(Overlay, BeforeAboveAfter) {
  const lcr::Frame frame = frameWith({{{1, 0, 10}}, {{-3, 0.3, 20}}});
  Eigen::Isometry3d before = lidarToCamera();
  before.translation().x() += 0.3;
  const cv::Mat both = lcr::drawBeforeAfter(frame, before, lidarToCamera(), OverlayColor::kDepth);
  const cv::Mat upper = lcr::drawOverlay(frame, before, OverlayColor::kDepth, "before");
  const cv::Mat lower = lcr::drawOverlay(frame, lidarToCamera(), OverlayColor::kDepth, "after");
  ASSERT_EQ(both.rows, upper.rows + lower.rows);
  EXPECT_EQ(differing(both.rowRange(0, upper.rows), upper), 0);
  EXPECT_EQ(differing(both.rowRange(upper.rows, both.rows), lower), 0);
  EXPECT_GT(differing(upper, lower), 100);
}

TEST(Overlay, TheFramesImageStaysAsItIs) {
  const lcr::Frame frame = frameWith({{{0, 0, 10}}});
  draw(frame, OverlayColor::kDepth);
  EXPECT_EQ(differing(frame.image, emptyFrame().image), 0);
}

TEST(Overlay, TinyImages) {
  for (const int width : {8, 40, 200}) {
    const lcr::Frame frame = frameWith({{{0, 0, 10}}}, wideCamera(width, 6));
    for (const OverlayColor color : kAllColors) {
      const cv::Mat picture =
          lcr::drawOverlay(frame, lidarToCamera(), color, "a title that is much too long for it");
      EXPECT_EQ(picture.cols, width);
    }
  }
}

TEST(Overlay, FramesWithoutUsableImageAreRefused) {
  lcr::Frame frame = emptyFrame();
  frame.image = cv::Mat();
  expectImageError(frame);
  frame.image = cv::Mat(300, 1800, CV_8UC1);
  expectImageError(frame);
  frame.image = cv::Mat(301, 1800, CV_8UC3);
  expectImageError(frame);
}

TEST(Overlay, Names) {
  EXPECT_EQ(lcr::overlayColorFromName("depth"), OverlayColor::kDepth);
  EXPECT_EQ(lcr::overlayColorFromName("reflectivity"), OverlayColor::kReflectivity);
  EXPECT_EQ(lcr::overlayColorFromName("normal"), OverlayColor::kNormal);
  EXPECT_EQ(lcr::overlayColorFromName("segment"), OverlayColor::kSegment);
  EXPECT_EQ(lcr::overlayColorFromName("mask"), OverlayColor::kMask);
  try {
    lcr::overlayColorFromName("rainbow");
    FAIL();
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kParameter);
    EXPECT_NE(std::string(error.what()).find("'rainbow'"), std::string::npos);
  }
}

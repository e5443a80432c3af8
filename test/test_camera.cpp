#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "lidar_camera_recalibration/camera.hpp"
#include "lidar_camera_recalibration/error.hpp"

namespace lcr = lidar_camera_recalibration;
using lcr::DistortionModel;

namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

lcr::Intrinsics intrinsics(DistortionModel model = DistortionModel::kNone,
                           const std::vector<double>& d = {}) {
  lcr::Intrinsics i;
  i.width = 640;
  i.height = 480;
  i.fx = 420.0;
  i.fy = 410.0;
  i.cx = 325.3;
  i.cy = 231.7;
  i.model = model;
  i.distortion = d;
  return i;
}

lcr::Intrinsics wideAngle(DistortionModel model, const std::vector<double>& d, double f = 220.0) {
  lcr::Intrinsics i = intrinsics(model, d);
  i.fx = f;
  i.fy = f + 1.0;
  return i;
}

const std::vector<double> kPlumbBob = {-0.28, 0.09, 0.0007, -0.0012, -0.013};
const std::vector<double> kRational = {0.31, 0.05, 0.0004, 0.0009, 0.008, 0.62, 0.12, 0.01};
const std::vector<double> kEquidistant = {0.012, -0.021, 0.009, -0.002};

std::vector<lcr::Intrinsics> lenses() {
  return {intrinsics(),
          intrinsics(DistortionModel::kPlumbBob, kPlumbBob),
          intrinsics(DistortionModel::kPlumbBob, {-0.1192, 0.162, 0.00073985, 0.0014}),
          intrinsics(DistortionModel::kRationalPolynomial, kRational),
          intrinsics(DistortionModel::kEquidistant, kEquidistant),
          wideAngle(DistortionModel::kEquidistant, kEquidistant, 300.0),
          wideAngle(DistortionModel::kEquidistant, {0.0, 0.0, 0.0, 0.0}, 270.0)};
}

std::vector<cv::Point3d> grid() {
  std::vector<cv::Point3d> points;
  for (const double z : {0.7, 3.0, 40.0}) {
    for (double x = -0.8; x <= 0.81; x += 0.1) {
      for (double y = -0.6; y <= 0.61; y += 0.1) points.emplace_back(x * z, y * z, z);
    }
  }
  return points;
}

std::vector<cv::Point2d> projectedByOpenCv(const lcr::Intrinsics& i, const std::vector<cv::Point3d>& points) {
  const cv::Matx33d K(i.fx, 0, i.cx, 0, i.fy, i.cy, 0, 0, 1);
  const cv::Vec3d zero(0, 0, 0);
  std::vector<cv::Point2d> pixels;
  if (i.model == DistortionModel::kEquidistant) {
    cv::fisheye::projectPoints(points, pixels, zero, zero, K, i.distortion);
  } else {
    cv::projectPoints(points, zero, zero, K, i.distortion, pixels);
  }
  return pixels;
}

lcr::ErrorCause causeOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const lcr::Error& error) {
    return error.cause();
  }
  ADD_FAILURE() << "nothing was thrown";
  return lcr::ErrorCause::kParameter;
}

void expectRefused(const lcr::Intrinsics& i, const std::string& word) {
  try {
    lcr::Camera camera(i);
    FAIL() << "accepted; expected an error with: " << word;
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kCamera);
    EXPECT_NE(std::string(error.what()).find(word), std::string::npos) << error.what();
  }
}

/// First radius at which a distorted radius, sampled finely, stops rising.
double firstDescent(const std::function<double(double)>& distorted, double limit) {
  const double step = 1e-5;
  for (double r = step; r < limit; r += step) {
    if (distorted(r) <= distorted(r - step)) return r;
  }
  return limit;
}

cv::Mat randomLabels(const lcr::Intrinsics& i) {
  cv::Mat labels(i.height, i.width, CV_32SC1);
  cv::RNG random(7);
  random.fill(labels, cv::RNG::UNIFORM, 1, 100000);
  return labels;
}

}  // namespace

TEST(Camera, ProjectsLikeOpenCv) {
  const std::vector<cv::Point3d> points = grid();
  for (const lcr::Intrinsics& i : lenses()) {
    const lcr::Camera camera(i);
    const std::vector<cv::Point2d> expected = projectedByOpenCv(i, points);
    for (std::size_t k = 0; k < points.size(); ++k) {
      const auto pixel = camera.project({points[k].x, points[k].y, points[k].z});
      ASSERT_TRUE(pixel.has_value()) << lcr::name(i.model) << points[k];
      EXPECT_NEAR(pixel->x(), expected[k].x, 1e-6) << lcr::name(i.model) << points[k];
      EXPECT_NEAR(pixel->y(), expected[k].y, 1e-6) << lcr::name(i.model) << points[k];
    }
  }
}

TEST(Camera, PixelCentresAreAtIntegers) {
  const lcr::Camera camera(intrinsics());
  const auto pixel = camera.project({1.0, 2.0, 4.0});
  ASSERT_TRUE(pixel);
  EXPECT_DOUBLE_EQ(pixel->x(), 420.0 * 0.25 + 325.3);
  EXPECT_DOUBLE_EQ(pixel->y(), 410.0 * 0.5 + 231.7);
}

TEST(Camera, NothingBehindTheCamera) {
  for (const lcr::Intrinsics& i : lenses()) {
    const lcr::Camera camera(i);
    EXPECT_FALSE(camera.project({0.1, 0.1, -1.0}));
    EXPECT_FALSE(camera.project({0.1, 0.1, 0.0}));
    EXPECT_FALSE(camera.project({0.0, 0.0, kNan}));
  }
}

TEST(Camera, RayRoundTrip) {
  for (const lcr::Intrinsics& i : lenses()) {
    const lcr::Camera camera(i);
    for (double u = 0; u < i.width; u += 13.7) {
      for (double v = 0; v < i.height; v += 11.3) {
        const Eigen::Vector3d ray = camera.ray({u, v});
        EXPECT_NEAR(ray.norm(), 1.0, 1e-12);
        const auto pixel = camera.project(5.0 * ray);
        ASSERT_TRUE(pixel.has_value()) << lcr::name(i.model) << " " << u << " " << v;
        EXPECT_NEAR(pixel->x(), u, 1e-7) << lcr::name(i.model);
        EXPECT_NEAR(pixel->y(), v, 1e-7) << lcr::name(i.model);
      }
    }
  }
}

TEST(Camera, FoldBackIsWhereThePolynomialStopsRising) {
  // r (1 - 0.3 r^2) turns at r = sqrt(1 / 0.9).
  const lcr::Camera barrel(wideAngle(DistortionModel::kPlumbBob, {-0.3, 0.0, 0.0, 0.0}));
  EXPECT_TRUE(barrel.project({1.0540, 0.0, 1.0}));
  EXPECT_FALSE(barrel.project({1.0542, 0.0, 1.0}));
  EXPECT_FALSE(barrel.project({0.0, 3.0, 1.0}));

  // theta (1 - 0.2 theta^2) turns at theta = sqrt(1 / 0.6).
  const lcr::Camera fisheye(wideAngle(DistortionModel::kEquidistant, {-0.2, 0.0, 0.0, 0.0}));
  const double fold = std::sqrt(1.0 / 0.6);
  EXPECT_TRUE(fisheye.project({std::sin(fold - 1e-6), 0.0, std::cos(fold - 1e-6)}));
  EXPECT_FALSE(fisheye.project({std::sin(fold + 1e-6), 0.0, std::cos(fold + 1e-6)}));

  const std::vector<double> k = {-0.35, 0.1, 0.0, 0.0, -0.03, 0.1, 0.02, 0.01};
  const double descent = firstDescent(
      [&k](double r) {
        const double s = r * r;
        return r * (1 + k[0] * s + k[1] * s * s + k[4] * s * s * s) /
               (1 + k[5] * s + k[6] * s * s + k[7] * s * s * s);
      },
      10.0);
  ASSERT_LT(descent, 10.0);
  const lcr::Camera rational(wideAngle(DistortionModel::kRationalPolynomial, k));
  EXPECT_TRUE(rational.project({descent - 1e-4, 0.0, 1.0}));
  EXPECT_FALSE(rational.project({descent + 1e-4, 0.0, 1.0}));

  // The denominator 1 - 0.5 r^2 has a pole at sqrt(2), before which the radius only rises.
  const lcr::Camera pole(wideAngle(DistortionModel::kRationalPolynomial, {0, 0, 0, 0, 0, -0.5, 0, 0}));
  EXPECT_TRUE(pole.project({1.41, 0.0, 1.0}));
  EXPECT_FALSE(pole.project({1.42, 0.0, 1.0}));
}

TEST(Camera, RayBeyondTheLensIsItsRim) {
  const lcr::Camera barrel(wideAngle(DistortionModel::kPlumbBob, {-0.3, 0.0, 0.0, 0.0}));
  const Eigen::Vector3d ray = barrel.ray({100000.0, barrel.intrinsics().cy});
  EXPECT_NEAR(ray.x() / ray.z(), std::sqrt(1.0 / 0.9), 1e-9);
  EXPECT_NEAR(ray.y(), 0.0, 1e-12);
}

TEST(Camera, ToIdealEqualsANaiveLoop) {
  std::vector<lcr::Intrinsics> cameras = lenses();
  cameras.push_back(wideAngle(DistortionModel::kPlumbBob, {-0.3, 0.0, 0.0, 0.0}));
  for (const lcr::Intrinsics& i : cameras) {
    const lcr::Camera camera(i);
    const cv::Mat labels = randomLabels(i);
    const cv::Mat ideal = camera.toIdeal(labels, cv::INTER_NEAREST);
    int compared = 0, covered = 0;
    for (int v = 0; v < i.height; ++v) {
      for (int u = 0; u < i.width; ++u) {
        const auto pixel = camera.project({(u - i.cx) / i.fx, (v - i.cy) / i.fy, 1.0});
        int expected = 0;
        if (pixel) {
          // OpenCV's maps have single precision, so half-way pixels may go either way.
          const auto halfway = [](double x) { return std::abs(x - std::floor(x) - 0.5) < 1e-3; };
          if (halfway(pixel->x()) || halfway(pixel->y())) continue;
          const int x = cvRound(pixel->x()), y = cvRound(pixel->y());
          if (x >= 0 && y >= 0 && x < i.width && y < i.height) expected = labels.at<int>(y, x);
        }
        ++compared;
        covered += expected != 0;
        ASSERT_EQ(ideal.at<int>(v, u), expected) << lcr::name(i.model) << " " << u << " " << v;
      }
    }
    EXPECT_GT(compared, 0.98 * i.width * i.height);
    EXPECT_GT(covered, 0.5 * i.width * i.height);
  }
}

TEST(Camera, NothingOfTheRimIsSeenTwice) {
  const lcr::Intrinsics i = wideAngle(DistortionModel::kPlumbBob, {-0.3, 0.0, 0.0, 0.0});
  const cv::Mat ideal = lcr::Camera(i).toIdeal(randomLabels(i), cv::INTER_NEAREST);
  const double fold = i.fx * std::sqrt(1.0 / 0.9);
  int beyond = 0;
  for (int v = 0; v < i.height; ++v) {
    for (int u = 0; u < i.width; ++u) {
      const double radius = std::hypot(u - i.cx, (v - i.cy) * i.fx / i.fy);
      if (radius < fold + 1.0) continue;
      ++beyond;
      ASSERT_EQ(ideal.at<int>(v, u), 0);
    }
  }
  EXPECT_GT(beyond, 10000);
}

TEST(Camera, UndistortedImageIsLeftAlone) {
  const lcr::Intrinsics i = intrinsics();
  const cv::Mat labels = randomLabels(i);
  EXPECT_EQ(cv::countNonZero(lcr::Camera(i).toIdeal(labels, cv::INTER_NEAREST) != labels), 0);
}

TEST(Camera, ToIdealInterpolatesColourImages) {
  const lcr::Intrinsics i = intrinsics(DistortionModel::kPlumbBob, kPlumbBob);
  const cv::Mat grey(i.height, i.width, CV_8UC3, cv::Scalar(10, 20, 30));
  const cv::Mat ideal = lcr::Camera(i).toIdeal(grey, cv::INTER_LINEAR);
  EXPECT_EQ(ideal.type(), CV_8UC3);
  EXPECT_EQ(ideal.at<cv::Vec3b>(240, 320), cv::Vec3b(10, 20, 30));
}

TEST(Camera, WrongImageSizeIsRefused) {
  const lcr::Camera camera(intrinsics());
  EXPECT_EQ(causeOf([&] { camera.toIdeal(cv::Mat(480, 641, CV_8UC1), cv::INTER_NEAREST); }),
            lcr::ErrorCause::kImage);
  EXPECT_EQ(causeOf([&] { camera.toIdeal(cv::Mat(), cv::INTER_NEAREST); }), lcr::ErrorCause::kImage);
}

TEST(Camera, ZeroCoefficientsMeanNoDistortion) {
  EXPECT_FALSE(lcr::Camera(intrinsics()).distorted());
  EXPECT_FALSE(lcr::Camera(intrinsics(DistortionModel::kNone, {0, 0, 0, 0, 0})).distorted());
  EXPECT_FALSE(lcr::Camera(intrinsics(DistortionModel::kPlumbBob)).distorted());
  EXPECT_FALSE(lcr::Camera(intrinsics(DistortionModel::kPlumbBob, {0, 0, 0, 0, 0})).distorted());
  EXPECT_FALSE(
      lcr::Camera(intrinsics(DistortionModel::kRationalPolynomial, std::vector<double>(8))).distorted());
  EXPECT_TRUE(lcr::Camera(intrinsics(DistortionModel::kPlumbBob, {0, 0, 0, 1e-3})).distorted());
  EXPECT_TRUE(lcr::Camera(intrinsics(DistortionModel::kEquidistant, {0, 0, 0, 0})).distorted());
}

TEST(Camera, NumberOfCoefficients) {
  for (const std::size_t count : {1, 2, 3, 6, 7, 8, 12, 14}) {
    expectRefused(intrinsics(DistortionModel::kPlumbBob, std::vector<double>(count, 0.01)),
                  std::to_string(count));
  }
  for (const std::size_t count : {0, 1, 3, 5, 8}) {
    expectRefused(intrinsics(DistortionModel::kEquidistant, std::vector<double>(count, 0.01)),
                  std::to_string(count));
  }
  for (const std::size_t count : {1, 3, 6, 7, 9, 13, 15}) {
    expectRefused(intrinsics(DistortionModel::kRationalPolynomial, std::vector<double>(count, 0.01)),
                  std::to_string(count));
  }
  expectRefused(intrinsics(DistortionModel::kNone, {0.1, 0, 0, 0}), "no distortion model");

  std::vector<double> fourteen = kRational;
  fourteen.resize(14, 0.0);
  const lcr::Camera padded(intrinsics(DistortionModel::kRationalPolynomial, fourteen));
  const lcr::Camera plain(intrinsics(DistortionModel::kRationalPolynomial, kRational));
  EXPECT_EQ(*padded.project({0.5, 0.4, 1.0}), *plain.project({0.5, 0.4, 1.0}));
  fourteen[8] = 1e-3;
  expectRefused(intrinsics(DistortionModel::kRationalPolynomial, fourteen), "thin prism");
  fourteen.resize(12);
  expectRefused(intrinsics(DistortionModel::kRationalPolynomial, fourteen), "thin prism");

  // Four or five coefficients under this name are a plumb_bob lens.
  const lcr::Camera five(intrinsics(DistortionModel::kRationalPolynomial, kPlumbBob));
  const lcr::Camera plumb_bob(intrinsics(DistortionModel::kPlumbBob, kPlumbBob));
  EXPECT_EQ(*five.project({0.5, 0.4, 1.0}), *plumb_bob.project({0.5, 0.4, 1.0}));
}

TEST(Camera, WhatDescribesNoCameraIsRefused) {
  lcr::Intrinsics i = intrinsics();
  i.fx = i.fy = i.cx = i.cy = 0.0;
  expectRefused(i, "all zero");
  i = intrinsics();
  i.fy = 0.0;
  expectRefused(i, "fy=0");
  i.fy = -410.0;
  expectRefused(i, "fy=-410");
  i = intrinsics();
  i.cx = kNan;
  expectRefused(i, "cx=nan");
  i = intrinsics();
  i.fx = std::numeric_limits<double>::infinity();
  expectRefused(i, "fx=inf");
  i = intrinsics();
  i.width = -640;
  expectRefused(i, "-640x480");
  i = intrinsics();
  i.height = 0;
  expectRefused(i, "640x0");
  i = intrinsics();
  i.width = 100000;
  expectRefused(i, "100000x480");
  expectRefused(intrinsics(DistortionModel::kPlumbBob, {0.1, kNan, 0, 0}), "D[1]");
}

TEST(Camera, ModelNames) {
  for (const char* known : {"plumb_bob", "rational_polynomial", "equidistant"}) {
    EXPECT_STREQ(lcr::name(lcr::distortionModelFromName(known)), known);
  }
  EXPECT_EQ(lcr::distortionModelFromName("fisheye"), DistortionModel::kEquidistant);
  EXPECT_EQ(lcr::distortionModelFromName(""), DistortionModel::kNone);
  try {
    lcr::distortionModelFromName("thin_prism_fisheye");
    FAIL();
  } catch (const lcr::Error& error) {
    EXPECT_EQ(error.cause(), lcr::ErrorCause::kCamera);
    EXPECT_NE(std::string(error.what()).find("'thin_prism_fisheye'"), std::string::npos);
  }
}

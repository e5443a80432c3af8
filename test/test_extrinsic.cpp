#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <unsupported/Eigen/MatrixFunctions>

#include "lidar_camera_recalibration/error.hpp"
#include "lidar_camera_recalibration/extrinsic.hpp"

namespace lcr = lidar_camera_recalibration;

namespace {

/// The exponential from its definition as a matrix exponential of the 4x4 twist.
Eigen::Matrix4d matrixExponential(const lcr::Vector6d& xi) {
  Eigen::Matrix4d twist = Eigen::Matrix4d::Zero();
  twist(0, 1) = -xi[2];
  twist(0, 2) = xi[1];
  twist(1, 0) = xi[2];
  twist(1, 2) = -xi[0];
  twist(2, 0) = -xi[1];
  twist(2, 1) = xi[0];
  twist.topRightCorner<3, 1>() = xi.tail<3>();
  return twist.exp();
}

lcr::Vector6d randomTwist(std::mt19937_64& generator, double angle) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  lcr::Vector6d xi;
  for (int i = 0; i < 6; ++i) xi[i] = uniform(generator);
  xi.head<3>() *= angle / xi.head<3>().norm();
  return xi;
}

// From far below to just above the switch to the series, up to almost half a turn.
const double kAngles[] = {1e-12, 1e-8, 1e-5, 0.99e-3, 1.01e-3, 0.01, 0.3, 1.5, 3.0, 3.14};

lcr::ErrorCause causeOf(const Eigen::Matrix4d& matrix) {
  try {
    lcr::isometryFromMatrix(matrix);
  } catch (const lcr::Error& error) {
    return error.cause();
  }
  ADD_FAILURE() << "accepted:\n" << matrix;
  return lcr::ErrorCause::kParameter;
}

}  // namespace

TEST(Extrinsic, ExpIsTheMatrixExponential) {
  std::mt19937_64 generator(1);
  for (const double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const lcr::Vector6d xi = randomTwist(generator, angle);
      EXPECT_LT((lcr::exp(xi).matrix() - matrixExponential(xi)).cwiseAbs().maxCoeff(), 1e-13) << angle;
    }
  }
  EXPECT_TRUE(lcr::exp(lcr::Vector6d::Zero()).matrix().isIdentity(0.0));
}

TEST(Extrinsic, LogInvertsExp) {
  std::mt19937_64 generator(2);
  for (const double angle : kAngles) {
    for (int i = 0; i < 20; ++i) {
      const lcr::Vector6d xi = randomTwist(generator, angle);
      EXPECT_LT((lcr::log(lcr::exp(xi)) - xi).cwiseAbs().maxCoeff(), 1e-11) << angle;
    }
  }
  EXPECT_TRUE(lcr::log(Eigen::Isometry3d::Identity()).isZero(0.0));
}

TEST(Extrinsic, ScrewMotionByHand) {
  lcr::Vector6d xi;
  xi << 0.0, 0.0, M_PI / 2.0, 1.0, 0.0, 0.0;
  const Eigen::Isometry3d T = lcr::exp(xi);
  // A quarter turn about z while moving along x draws a quarter circle of radius 2 / pi.
  EXPECT_NEAR(T.translation().x(), 2.0 / M_PI, 1e-15);
  EXPECT_NEAR(T.translation().y(), 2.0 / M_PI, 1e-15);
  EXPECT_NEAR(T.linear()(1, 0), 1.0, 1e-15);
}

TEST(Extrinsic, ErrorIsInTheAxesOfTheOpticalFrame) {
  Eigen::Isometry3d reference = Eigen::Isometry3d::Identity();
  reference.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  reference.translation() << 0.1, -0.2, 0.3;
  Eigen::Isometry3d other = reference;
  other.linear() = Eigen::AngleAxisd(0.02, Eigen::Vector3d::UnitY()).toRotationMatrix() * reference.linear();
  other.translation() += Eigen::Vector3d(0.03, 0.0, -0.04);

  const lcr::ExtrinsicError error = lcr::extrinsicError(other, reference);
  EXPECT_LT((error.rotation - Eigen::Vector3d(0, 0.02, 0)).norm(), 1e-15);
  EXPECT_LT((error.translation - Eigen::Vector3d(0.03, 0.0, -0.04)).norm(), 1e-15);
  EXPECT_NEAR(error.angle(), 0.02, 1e-15);
  EXPECT_NEAR(error.distance(), 0.05, 1e-15);
}

TEST(Extrinsic, RoundedMatrixBecomesARotation) {
  const Eigen::AngleAxisd rotation(0.7, Eigen::Vector3d(1, -2, 3).normalized());
  Eigen::Matrix4d rounded = Eigen::Matrix4d::Identity();
  rounded.topLeftCorner<3, 3>() = (rotation.toRotationMatrix() * 1e4).array().round().matrix() / 1e4;
  rounded.topRightCorner<3, 1>() << 1.0, 2.0, 3.0;

  const Eigen::Isometry3d T = lcr::isometryFromMatrix(rounded);
  EXPECT_TRUE((T.linear() * T.linear().transpose()).isIdentity(1e-14));
  EXPECT_NEAR(T.linear().determinant(), 1.0, 1e-14);
  EXPECT_LT(lcr::extrinsicError(T, Eigen::Isometry3d(rotation)).angle(), 1e-4);
  EXPECT_EQ(T.translation(), Eigen::Vector3d(1, 2, 3));
}

TEST(Extrinsic, WhatIsNoRigidTransformIsRefused) {
  const Eigen::Matrix4d identity = Eigen::Matrix4d::Identity();
  Eigen::Matrix4d matrix = identity;
  matrix(0, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(causeOf(matrix), lcr::ErrorCause::kExtrinsic);
  matrix = identity;
  matrix(1, 1) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(causeOf(matrix), lcr::ErrorCause::kExtrinsic);
  matrix = identity;
  matrix.topLeftCorner<3, 3>() *= 1.01;
  EXPECT_EQ(causeOf(matrix), lcr::ErrorCause::kExtrinsic);
  matrix = identity;
  matrix(2, 2) = -1.0;
  EXPECT_EQ(causeOf(matrix), lcr::ErrorCause::kExtrinsic);
  matrix = identity;
  matrix(3, 3) = 0.0;
  EXPECT_EQ(causeOf(matrix), lcr::ErrorCause::kExtrinsic);
  matrix = identity;
  matrix(0, 0) = std::numeric_limits<double>::max();
  EXPECT_EQ(causeOf(matrix), lcr::ErrorCause::kExtrinsic);
  EXPECT_EQ(causeOf(Eigen::Matrix4d::Zero()), lcr::ErrorCause::kExtrinsic);
}

TEST(Extrinsic, PixelShift) {
  const double fx = 700.0;
  const int width = 1400;  // so the borders lie at 45 deg
  Eigen::Isometry3d a = Eigen::Isometry3d::Identity();
  a.linear() << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  a.translation() << 0.5, -0.3, 0.1;

  EXPECT_NEAR(lcr::pixelShift(a, a, 20.0, fx, width), 0.0, 1e-9);

  // 10 cm sideways: most at the borders, whose points are nearer to the image plane: z = 20 m / sqrt(2).
  Eigen::Isometry3d b = a;
  b.translation().x() += 0.1;
  EXPECT_NEAR(lcr::pixelShift(a, b, 20.0, fx, width), fx * 0.1 / (20.0 / std::sqrt(2.0)), 1e-9);

  // Roll by 1 deg leaves the centre where it is and moves the borders along a circle of 700 px.
  lcr::Vector6d roll = lcr::Vector6d::Zero();
  roll[2] = lcr::kDegree;
  EXPECT_NEAR(lcr::pixelShift(a, lcr::exp(roll) * a, 10.0, fx, width), 2 * 700.0 * std::sin(lcr::kDegree / 2),
              1e-9);

  // Yaw by 1 deg brings the left border (-45 deg) to -44 deg and the right one from 45 to 46 deg.
  lcr::Vector6d yaw = lcr::Vector6d::Zero();
  yaw[1] = lcr::kDegree;
  EXPECT_NEAR(lcr::pixelShift(a, lcr::exp(yaw) * a, 10.0, fx, width),
              fx * (std::tan(46 * lcr::kDegree) - 1.0), 1e-9);

  yaw[1] = 90 * lcr::kDegree;
  EXPECT_TRUE(std::isinf(lcr::pixelShift(a, lcr::exp(yaw) * a, 10.0, fx, width)));
}

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <numbers>
#include <opencv2/calib3d.hpp>

#include "calib/base/check.h"
#include "calib/base/random.h"
#include "calib/geometry/pose.h"

namespace countershade {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Vector3d random_vector(Random& random, double size) {
  return Vector3d(random.normal(), random.normal(), random.normal()) * size;
}

Random seeded() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  return Random(hash_name(fmt::format("{}.{}", info->test_suite_name(), info->name())));
}

// OpenCV's rotation matrix of a Rodrigues vector.
Matrix3d opencv_rotation(const Vector3d& r) {
  cv::Matx33d R;
  cv::Rodrigues(cv::Vec3d(r.x(), r.y(), r.z()), R);
  Matrix3d out;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) out(i, j) = R(i, j);
  return out;
}

TEST(Rotation, IsOpenCvsRodrigues) {
  Random random = seeded();
  for (int i = 0; i < 200; ++i) {
    const Vector3d r = random_vector(random, std::pow(10, random.uniform(-9, 0.3)));
    // A few roundings of numbers up to 1.
    EXPECT_LT((rotation_from_vector(r) - opencv_rotation(r)).norm(), 1e-14) << r.transpose();
  }
}

TEST(Rotation, TurnsXIntoYAboutZ) {
  const Matrix3d R = rotation_from_vector({0, 0, std::numbers::pi / 2});
  EXPECT_LT((R * Vector3d::UnitX() - Vector3d::UnitY()).norm(), 1e-15);  // rounding
}

TEST(Rotation, VectorComesBack) {
  Random random = seeded();
  for (int i = 0; i < 300; ++i) {
    const double angle = i % 3 == 0   ? std::pow(10, random.uniform(-15, -6))
                         : i % 3 == 1 ? random.uniform(0.1, 3)
                                      : std::numbers::pi - std::pow(10, random.uniform(-7, -3));
    const Vector3d r = random_vector(random, 1).normalized() * angle;
    // Rounding of the matrix, 1e-16, and what a quaternion makes of it near half a turn.
    EXPECT_LT((vector_from_rotation(rotation_from_vector(r)) - r).norm(), 3e-15) << "angle " << angle;
  }
  EXPECT_EQ(vector_from_rotation(Matrix3d::Identity()), Vector3d::Zero());
}

TEST(Rotation, HalfATurnComesBackUpToItsSign) {
  const Vector3d r = Vector3d(1, -2, 0.5).normalized() * std::numbers::pi;
  const Matrix3d R = rotation_from_vector(r);
  EXPECT_LT((rotation_from_vector(vector_from_rotation(R)) - R).norm(), 1e-14);  // rounding
}

TEST(Pose, ProductAndInverseAreThoseOfHomogeneousMatrices) {
  Random random = seeded();
  const Pose a{rotation_from_vector(random_vector(random, 1)), random_vector(random, 3)};
  const Pose b{rotation_from_vector(random_vector(random, 1)), random_vector(random, 3)};
  const auto matrix = [](const Pose& pose) {
    Eigen::Matrix4d M = Eigen::Matrix4d::Identity();
    M.topLeftCorner<3, 3>() = pose.rotation;
    M.topRightCorner<3, 1>() = pose.translation;
    return M;
  };
  EXPECT_LT((matrix(a * b) - matrix(a) * matrix(b)).norm(), 1e-14);             // rounding of numbers up to 10
  EXPECT_LT((matrix(a.inverse()) - matrix(a).inverse().eval()).norm(), 1e-14);  // the same
  const Vector3d x(0.3, -2, 5);
  EXPECT_LT(((a * b) * x - a * (b * x)).norm(), 1e-14);  // the same
}

TEST(LookAt, HasXRightYDownZForward) {
  // Looking north (+y) with up = +z: right is east (+x), down is -z.
  const Pose pose = look_at({2, 3, 1}, {2, 10, 1}, Vector3d::UnitZ());
  EXPECT_LT((pose * Vector3d(2, 10, 1) - Vector3d(0, 0, 7)).norm(), 1e-14);     // rounding
  EXPECT_LT((pose * Vector3d(2.5, 3, 1) - Vector3d(0.5, 0, 0)).norm(), 1e-14);  // rounding
  EXPECT_LT((pose * Vector3d(2, 3, 0.2) - Vector3d(0, 0.8, 0)).norm(), 1e-14);  // rounding
}

TEST(LookAt, IsARotationThatPutsThePositionAtTheOrigin) {
  Random random = seeded();
  for (int i = 0; i < 50; ++i) {
    const Vector3d position = random_vector(random, 3), target = random_vector(random, 3);
    const Vector3d up = random_vector(random, 1);
    const Pose pose = look_at(position, target, up, random.uniform(-3, 3));
    EXPECT_LT((pose.rotation * pose.rotation.transpose() - Matrix3d::Identity()).norm(), 1e-14);  // rounding
    EXPECT_GT(pose.rotation.determinant(), 0);
    EXPECT_LT((pose * position).norm(), 1e-13);  // rounding of numbers up to 10
    EXPECT_LT((pose * target - Vector3d(0, 0, (target - position).norm())).norm(), 1e-13);
    const Pose straight = look_at(position, target, up);
    EXPECT_LT(std::abs((straight.rotation * up).x()), 1e-14 * up.norm() + 1e-14);  // up has no part to the right,
    EXPECT_LT((straight.rotation * up).y(), 0);                                    // and its part along y is upward
  }
}

TEST(LookAt, RollTurnsTheDeviceClockwiseAsItSeesItself) {
  // Rolled by 90 degrees, what was on the right lies up (negative y); what was below lies on the right.
  const Pose pose = look_at({0, 0, 0}, {0, 1, 0}, Vector3d::UnitZ(), std::numbers::pi / 2);
  EXPECT_LT((pose * Vector3d(1, 0, 0) - Vector3d(0, -1, 0)).norm(), 1e-15);  // rounding
  EXPECT_LT((pose * Vector3d(0, 0, -1) - Vector3d(1, 0, 0)).norm(), 1e-15);  // rounding
}

TEST(LookAt, RefusesAViewWithoutDirection) {
  EXPECT_THROW(look_at({1, 2, 3}, {1, 2, 3}, Vector3d::UnitZ()), Bug);
  EXPECT_THROW(look_at({1, 2, 3}, {1, 2, 9}, Vector3d::UnitZ()), Bug);
  EXPECT_THROW(look_at({1, 2, 3}, {1, 5, 9}, Vector3d::Zero()), Bug);
}

}  // namespace
}  // namespace countershade

#include "calib/geometry/pose.h"

#include <cmath>

#include "calib/base/check.h"

namespace countershade {

Eigen::Matrix3d rotation_from_vector(const Eigen::Vector3d& r) {
  const double angle = r.norm();
  if (angle < 1e-12) {
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    R(0, 1) = -r.z(), R(0, 2) = r.y(), R(1, 0) = r.z(), R(1, 2) = -r.x(), R(2, 0) = -r.y(), R(2, 1) = r.x();
    return R;
  }
  return Eigen::AngleAxisd(angle, r / angle).toRotationMatrix();
}

Eigen::Vector3d vector_from_rotation(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd turn(R);
  return turn.angle() * turn.axis();
}

Pose look_at(const Eigen::Vector3d& position, const Eigen::Vector3d& target, const Eigen::Vector3d& up, double roll) {
  const Eigen::Vector3d view = target - position;
  CS_CHECK(view.norm() > 0, "looks at its own position");
  const Eigen::Vector3d z = view.normalized(), side = z.cross(up);
  CS_CHECK(side.norm() > 1e-9 * up.norm(), "looks along its up direction");
  const Eigen::Vector3d x = side.normalized(), y = z.cross(x);
  Eigen::Matrix3d R;
  R.row(0) = std::cos(roll) * x + std::sin(roll) * y;
  R.row(1) = -std::sin(roll) * x + std::cos(roll) * y;
  R.row(2) = z;
  return {R, -(R * position)};
}

}  // namespace countershade

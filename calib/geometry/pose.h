// Rigid transforms. A Pose called a_from_b maps points: x_in_a = a_from_b * x_in_b.
#pragma once

#include <Eigen/Dense>

namespace countershade {

struct Pose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& x) const { return rotation * x + translation; }
  Pose operator*(const Pose& other) const {
    return {rotation * other.rotation, rotation * other.translation + translation};
  }
  Pose inverse() const { return {rotation.transpose(), -(rotation.transpose() * translation)}; }
};

// Rodrigues vector (axis times angle, rad) <-> rotation matrix.
Eigen::Matrix3d rotation_from_vector(const Eigen::Vector3d& r);
Eigen::Vector3d vector_from_rotation(const Eigen::Matrix3d& R);

// Pose of a device at `position` looking at `target`, x right, y down, z forward, rolled by `roll` rad about z;
// `up` is the world's up. Returns device_from_world. Requires position != target and up not along the view (a Bug).
Pose look_at(const Eigen::Vector3d& position, const Eigen::Vector3d& target, const Eigen::Vector3d& up,
             double roll = 0);

struct Ray {
  Eigen::Vector3d origin;
  Eigen::Vector3d direction;  // need not be unit length
};

}  // namespace countershade

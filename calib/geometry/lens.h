// Lens models: where a point in device coordinates (x right, y down, z forward) lands in the picture, and back.
#pragma once

#include <Eigen/Dense>
#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/geometry/pose.h"

namespace countershade {

// A lens of any model mrcal knows, by mrcal's own name and parameter order:
// LENSMODEL_PINHOLE [fx, fy, cx, cy], LENSMODEL_OPENCV5 [fx, fy, cx, cy, k1, k2, p1, p2, k3] (Brown-Conrady), ...
// Pixels: centre of the first pixel is (0, 0).
class Lens {
 public:
  // Errors: kBadValue for an unknown model, a wrong number of parameters, a non-finite one, or an empty picture;
  // kUnsupported for CAHVORE, which mrcal cannot unproject.
  static Result<Lens> make(const std::string& model, std::vector<double> intrinsics, int width, int height);
  static Lens pinhole(double focal_px, double cx, double cy, int width, int height);

  const std::string& model() const { return model_; }
  const std::vector<double>& intrinsics() const { return intrinsics_; }
  int width() const { return width_; }
  int height() const { return height_; }
  bool contains(const Eigen::Vector2d& q) const {
    return q.x() > -0.5 && q.y() > -0.5 && q.x() < width_ - 0.5 && q.y() < height_ - 0.5;
  }

  // Pixel of a point; (NaN, NaN) for a point that is not in front of the device.
  Eigen::Vector2d project(const Eigen::Vector3d& x_in_device) const;
  // Unit direction of a pixel, in device coordinates; NaN for a pixel that no direction near the axis projects to
  // (beyond the fold of a strongly distorted lens).
  Eigen::Vector3d unproject(const Eigen::Vector2d& q_px) const;

 private:
  std::string model_;
  std::vector<double> intrinsics_;
  int width_ = 0, height_ = 0;
  int distortions_ = 0;  // parameters of a model that we compute ourselves; -1: mrcal does
  double fold_ = 0;      // distance from the axis, at z = 1, up to which their radial part grows
};

// A camera or projector that has been placed: lens and pose.
struct Device {
  Lens lens = Lens::pinhole(1, 0, 0, 1, 1);
  Pose device_from_world;

  Eigen::Vector2d project(const Eigen::Vector3d& x_in_world) const {
    return lens.project(device_from_world * x_in_world);
  }
  Ray ray(const Eigen::Vector2d& q_px) const {
    const Pose world_from_device = device_from_world.inverse();
    return {world_from_device.translation, world_from_device.rotation * lens.unproject(q_px)};
  }
  Eigen::Vector3d position() const { return device_from_world.inverse().translation; }
};

// mrcal's .cameramodel (FORMATS 5.6); extrinsics become device_from_world. Errors: kBadFile. Numbers are
// written with all their digits; mrcal itself says on stderr why it cannot read a broken file.
Result<Device> read_cameramodel(const std::filesystem::path& path);
Result<void> write_cameramodel(const std::filesystem::path& path, const Device& device);

}  // namespace countershade

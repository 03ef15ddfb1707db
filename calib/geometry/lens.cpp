#include "calib/geometry/lens.h"

extern "C" {
#include <mrcal/mrcal.h>
}

#include <cmath>
#include <limits>

#include "calib/file/file.h"

namespace countershade {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

bool parse_model(const std::string& name, mrcal_lensmodel_t& model) {
  return mrcal_lensmodel_from_name(&model, name.c_str());
}

// Brown-Conrady on normalised coordinates, OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6; returns the distorted point, and its
// Jacobian where asked for.
Eigen::Vector2d distort(const double* d, int count, const Eigen::Vector2d& n, Eigen::Matrix2d* jacobian) {
  double k[8] = {0, 0, 0, 0, 0, 0, 0, 0};
  for (int i = 0; i < count; ++i) k[i] = d[i];
  const double x = n.x(), y = n.y(), r2 = x * x + y * y;
  const double up = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4])), down = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  const double radial = up / down;
  if (jacobian) {
    const double dup = k[0] + r2 * (2 * k[1] + 3 * r2 * k[4]), ddown = k[5] + r2 * (2 * k[6] + 3 * r2 * k[7]);
    const double slope = (dup * down - up * ddown) / (down * down);  // d radial / d r2
    *jacobian << radial + 2 * x * x * slope + 2 * k[2] * y + 6 * k[3] * x,
        2 * x * y * slope + 2 * k[2] * x + 2 * k[3] * y, 2 * x * y * slope + 2 * k[2] * x + 2 * k[3] * y,
        radial + 2 * y * y * slope + 6 * k[2] * y + 2 * k[3] * x;
  }
  return {x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x),
          y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y};
}

// Distance from the axis up to which the radial part of distort grows: up to a fold, or a pole of the quotient.
double fold_radius(const double* d, int count) {
  constexpr double kStep = 1e-3, kFarthest = 20;  // 20 = 87 degrees off the axis
  double radial[8] = {0, 0, 0, 0, 0, 0, 0, 0};
  for (int i = 0; i < count; ++i) radial[i] = i == 2 || i == 3 ? 0 : d[i];
  double before = 0;
  for (int i = 1; i * kStep < kFarthest; ++i) {
    const double r = i * kStep;
    Eigen::Matrix2d J;
    const double now = distort(radial, 8, {r, 0}, &J).x();
    if (!(now > before) || !(J(0, 0) > 0)) return r;
    before = now;
  }
  return std::numeric_limits<double>::infinity();
}

// Inverse of distort: Newton's method from the axis, with steps halved until they help, so that it stays where the
// distortion does not fold. NaN where no point there is distorted to `wanted`.
Eigen::Vector2d undistort(const double* d, int count, double fold, const Eigen::Vector2d& wanted) {
  Eigen::Vector2d n(0, 0), residual = -wanted;
  Eigen::Matrix2d J = Eigen::Matrix2d::Identity();  // on the axis
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector2d step = J.inverse() * residual;
    if (residual.squaredNorm() < 1e-20) return n - step;  // converges quadratically: now exact to rounding
    bool nearer = false;
    double length = 1;
    for (int halving = 0; halving < 20 && !nearer; ++halving, length /= 2) {
      Eigen::Matrix2d slope;
      const Eigen::Vector2d trial = n - length * step, left = distort(d, count, trial, &slope) - wanted;
      if (!(trial.squaredNorm() < fold * fold) || !(slope.determinant() > 0) ||
          !(left.squaredNorm() < residual.squaredNorm()))
        continue;
      n = trial, residual = left, J = slope;
      nearer = true;
    }
    if (!nearer) break;
  }
  return {kNaN, kNaN};
}

// Distortion parameters of the models with an own fast path; -1 = by mrcal.
int own_parameters(const std::string& model) {
  if (model == "LENSMODEL_PINHOLE") return 0;
  if (model == "LENSMODEL_OPENCV4") return 4;
  if (model == "LENSMODEL_OPENCV5") return 5;
  if (model == "LENSMODEL_OPENCV8") return 8;
  return -1;
}

}  // namespace

Result<Lens> Lens::make(const std::string& model, std::vector<double> intrinsics, int width, int height) {
  mrcal_lensmodel_t parsed;
  if (!parse_model(model, parsed))
    return error(ErrorCode::kBadValue,
                 "lens model '{}' is not known to mrcal; examples: LENSMODEL_PINHOLE, LENSMODEL_OPENCV5", model);
  if (!mrcal_lensmodel_metadata(&parsed).has_gradients)
    return error(ErrorCode::kUnsupported,
                 "lens model {} gives no ray for a pixel; fit LENSMODEL_CAHVOR or LENSMODEL_OPENCV8 to it "
                 "(mrcal-convert-lensmodel)",
                 model);
  const int wanted = mrcal_lensmodel_num_params(&parsed);
  if (wanted != static_cast<int>(intrinsics.size()))
    return error(ErrorCode::kBadValue, "lens model {} has {} parameters, {} are given", model, wanted,
                 intrinsics.size());
  for (double v : intrinsics)
    if (!std::isfinite(v))
      return error(ErrorCode::kBadValue, "lens model {}: a parameter is {}, must be finite; calibrate again", model, v);
  if (width < 1 || height < 1)
    return error(ErrorCode::kBadValue, "lens model {}: picture of {} x {} pixels, must have at least 1 x 1", model,
                 width, height);
  if (!(intrinsics[0] > 0) || !(intrinsics[1] > 0))
    return error(ErrorCode::kBadValue, "lens model {}: focal lengths {} and {} must be positive", model, intrinsics[0],
                 intrinsics[1]);
  Lens lens;
  lens.model_ = model;
  lens.intrinsics_ = std::move(intrinsics);
  lens.distortions_ = own_parameters(model);
  if (lens.distortions_ > 0) lens.fold_ = fold_radius(lens.intrinsics_.data() + 4, lens.distortions_);
  lens.width_ = width;
  lens.height_ = height;
  return lens;
}

Lens Lens::pinhole(double focal_px, double cx, double cy, int width, int height) {
  return make("LENSMODEL_PINHOLE", {focal_px, focal_px, cx, cy}, width, height).value();
}

Eigen::Vector2d Lens::project(const Eigen::Vector3d& x) const {
  if (!(x.z() > 0)) return {kNaN, kNaN};
  if (distortions_ >= 0) {
    const Eigen::Vector2d n = x.hnormalized();
    const Eigen::Vector2d d = distortions_ ? distort(intrinsics_.data() + 4, distortions_, n, nullptr) : n;
    return {intrinsics_[0] * d.x() + intrinsics_[2], intrinsics_[1] * d.y() + intrinsics_[3]};
  }
  mrcal_lensmodel_t model;
  CS_CHECK(parse_model(model_, model), "lens model " + model_);
  mrcal_point2_t q;
  const mrcal_point3_t p{.x = x.x(), .y = x.y(), .z = x.z()};
  if (!mrcal_project(&q, nullptr, nullptr, &p, 1, &model, intrinsics_.data())) return {kNaN, kNaN};
  return {q.x, q.y};
}

Eigen::Vector3d Lens::unproject(const Eigen::Vector2d& q) const {
  if (distortions_ >= 0) {
    const Eigen::Vector2d d((q.x() - intrinsics_[2]) / intrinsics_[0], (q.y() - intrinsics_[3]) / intrinsics_[1]);
    const Eigen::Vector2d n = distortions_ ? undistort(intrinsics_.data() + 4, distortions_, fold_, d) : d;
    return n.homogeneous().normalized();
  }
  mrcal_lensmodel_t model;
  CS_CHECK(parse_model(model_, model), "lens model " + model_);
  mrcal_point3_t v;
  const mrcal_point2_t pixel{.x = q.x(), .y = q.y()};
  if (!mrcal_unproject(&v, &pixel, 1, &model, intrinsics_.data())) return {kNaN, kNaN, kNaN};
  return Eigen::Vector3d(v.x, v.y, v.z).normalized();
}

Result<Device> read_cameramodel(const std::filesystem::path& path) {
  CS_TRY(const std::string text, read_text(path));
  mrcal_cameramodel_t* raw =
      text.empty() ? nullptr : mrcal_read_cameramodel_string(text.c_str(), static_cast<int>(text.size()));
  if (!raw)
    return error(ErrorCode::kBadFile,
                 "'{}' is not a camera model that mrcal can read; give a .cameramodel file that "
                 "mrcal has written",
                 path.string());
  char name[512];
  Result<Device> result = error(ErrorCode::kBadFile, "'{}': its lens model has no name", path.string());
  if (mrcal_lensmodel_name(name, sizeof name, &raw->lensmodel)) {
    const int count = mrcal_lensmodel_num_params(&raw->lensmodel);
    Result<Lens> lens = Lens::make(name, {raw->intrinsics, raw->intrinsics + count},
                                   static_cast<int>(raw->imagersize[0]), static_cast<int>(raw->imagersize[1]));
    const double* e = raw->rt_cam_ref;
    if (lens)
      result = Device{*lens, {rotation_from_vector({e[0], e[1], e[2]}), {e[3], e[4], e[5]}}};
    else
      result = error(ErrorCode::kBadFile, "'{}': {}", path.string(), lens.error().message);
  }
  mrcal_free_cameramodel(&raw);
  return result;
}

// Our own text: mrcal's C function writes six decimals, too few for rotations and distortions.
Result<void> write_cameramodel(const std::filesystem::path& path, const Device& device) {
  const Eigen::Vector3d r = vector_from_rotation(device.device_from_world.rotation);
  const Eigen::Vector3d& t = device.device_from_world.translation;
  return write_atomically(
      path, fmt::format("{{\n"
                        "    'lensmodel':  '{}',\n"
                        "    # fx, fy, cx, cy, distortion\n"
                        "    'intrinsics': [ {} ],\n"
                        "    # rt_cam_ref: Rodrigues vector, translation\n"
                        "    'extrinsics': [ {}, {}, {}, {}, {}, {} ],\n"
                        "    'imagersize': [ {}, {} ]\n"
                        "}}\n",
                        device.lens.model(), fmt::join(device.lens.intrinsics(), ", "), r.x(), r.y(), r.z(), t.x(),
                        t.y(), t.z(), device.lens.width(), device.lens.height()));
}

}  // namespace countershade

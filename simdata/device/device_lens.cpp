#include "simdata/device/device_lens.h"

namespace countershade::simdata {

namespace {

// Whether each pixel of the picture's rim has a ray that comes back to it.
bool holds_the_picture(const Lens& lens) {
  constexpr int kSteps = 32;
  for (int i = 0; i <= kSteps; ++i) {
    const double x = i * lens.width() / double{kSteps} - 0.5, y = i * lens.height() / double{kSteps} - 0.5;
    for (const Eigen::Vector2d& q : {Eigen::Vector2d(x, -0.5), Eigen::Vector2d(x, lens.height() - 0.5),
                                     Eigen::Vector2d(-0.5, y), Eigen::Vector2d(lens.width() - 0.5, y)})
      if (!((lens.project(lens.unproject(q)) - q).norm() < 1e-3)) return false;
  }
  return true;
}

}  // namespace

Result<Lens> camera_lens(const SimulatedCamera& c) {
  if (c.lens.empty()) {
    std::vector<double> intrinsics{c.focal_px, c.focal_px, c.principal[0], c.principal[1]};
    intrinsics.insert(intrinsics.end(), c.distortion.begin(), c.distortion.end());
    return Lens::make("LENSMODEL_OPENCV5", intrinsics, c.resolution[0], c.resolution[1]);
  }
  CS_TRY(const Device read, read_cameramodel(c.lens));
  if (read.lens.width() != c.resolution[0] || read.lens.height() != c.resolution[1])
    return error(ErrorCode::kBadValue,
                 "camera '{}': the lens '{}' is for {} x {} pixels, its resolution is [{}, {}]; set the resolution to "
                 "the lens's or name another lens",
                 c.id, c.lens.string(), read.lens.width(), read.lens.height(), c.resolution[0], c.resolution[1]);
  return read.lens;
}

Result<Lens> projector_lens(const SimulatedProjector& p, int width, int height) {
  const double focal = p.throw_ratio * width;
  // lens_shift: the picture's centre as seen from the lens axis.
  std::vector<double> intrinsics{focal, focal, (width - 1) / 2.0 - p.lens_shift[0] * width,
                                 (height - 1) / 2.0 - p.lens_shift[1] * height};
  if (p.distortion == std::array<double, 5>{}) return Lens::make("LENSMODEL_PINHOLE", intrinsics, width, height);
  intrinsics.insert(intrinsics.end(), p.distortion.begin(), p.distortion.end());
  CS_TRY(Lens lens, Lens::make("LENSMODEL_OPENCV5", intrinsics, width, height));
  if (!holds_the_picture(lens))
    return error(ErrorCode::kBadValue,
                 "projector '{}': distortion = [{}] folds inside its picture; make it smaller, or the throw ratio {} "
                 "larger",
                 p.id, fmt::join(p.distortion, ", "), p.throw_ratio);
  return lens;
}

}  // namespace countershade::simdata

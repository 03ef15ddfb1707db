#include "simdata/render/emitter.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"
#include "simdata/device/blur.h"

namespace countershade::simdata {

namespace {

// Between levels light is linear in the variance. A sinusoid that the lower one leaves e^-a of is at most
// e^(-1.15 a) (.3 a)^2 / 8 off then, below .5 % of its amplitude for any a.
constexpr double kNextVariance = 1.3, kSharp = 0.06;  // times; px^2

std::vector<double> variances_between(double low, double high) {
  std::vector<double> variances{low};
  while (variances.back() < high)
    variances.push_back(std::min(high, kNextVariance * std::max(kSharp, variances.back())));
  return variances;
}

// Rows first .. last of a blurred picture, columns from -margin on. `sharp`: rows top .. bottom of the picture.
struct Band {
  const std::vector<Light4>& sharp;
  int width, top, bottom, first, last, margin;

  void blur(const std::vector<float>& kernel, Light4* to) const {
    const int radius = static_cast<int>(kernel.size()) / 2, columns = width + 2 * margin;
    std::vector<Light4> column(columns + 2 * radius);
    for (int y = first; y < last; ++y, to += columns) {
      std::fill(column.begin(), column.end(), Light4::Zero());
      Light4* middle = column.data() + radius + margin;
      for (int k = std::max(-radius, top - y); k <= std::min(radius, bottom - 1 - y); ++k) {
        const Light4* row = sharp.data() + static_cast<std::size_t>(y + k - top) * width;
        for (int x = 0; x < width; ++x) middle[x] += kernel[k + radius] * row[x];
      }
      for (int x = 0; x < columns; ++x) {
        Light4 sum = Light4::Zero();
        for (int k = 0; k <= 2 * radius; ++k) sum += kernel[k] * column[x + k];
        to[x] = sum;
      }
    }
  }
};

}  // namespace

Emitter::Emitter(const SimulatedProjector& spec, const Device& device, int block_px, std::array<double, 2> depths)
    : spec_(spec),
      device_(device),
      colours_(spec, device.lens.width(), device.lens.height()),
      position_(device.position()),
      block_px_(block_px),
      distorted_(spec.distortion != std::array<double, 5>{}) {
  blocks_x_ = (device.lens.width() + block_px - 1) / block_px;
  blocks_y_ = (device.lens.height() + block_px - 1) / block_px;
  const double in_focus = std::clamp(spec.focus_distance, depths[0], depths[1]);
  variances_ = variances_between(blur_variance(in_focus), std::max(blur_variance(depths[0]), blur_variance(depths[1])));
  // The blurred picture ends in zeros, so that bilinear look-up neither cuts its rim nor makes light.
  margin_ = blur_radius(std::sqrt(variances_.back())) + 2;
  const double width = device.lens.width(), height = device.lens.height(), low = -0.5 - margin_;
  for (int i = 0; i <= 64 && distorted_; ++i) {
    const double x = low + i / 64.0 * (width - 1 - 2 * low), y = low + i / 64.0 * (height - 1 - 2 * low);
    for (const Eigen::Vector2d& q : {Eigen::Vector2d(x, low), Eigen::Vector2d(x, height - 1 - low),
                                     Eigen::Vector2d(low, y), Eigen::Vector2d(width - 1 - low, y)}) {
      const double tangent = device.lens.unproject(q).hnormalized().norm();
      if (tangent > reach_) reach_ = tangent;  // not where there is no direction
    }
  }
}

double Emitter::blur_variance(double depth) const {
  const double disc = 1e-3 * spec_.aperture_mm * spec_.throw_ratio * device_.lens.width() *
                      std::abs(1 / spec_.focus_distance - 1 / depth);
  return spec_.defocus_sigma_px * spec_.defocus_sigma_px + disc * disc / 16;
}

double Emitter::level_of(double depth) const {
  if (variances_.size() == 1) return 0;
  const double variance = std::clamp(blur_variance(depth), variances_.front(), variances_.back());
  const auto above = std::upper_bound(variances_.begin() + 1, variances_.end() - 1, variance);
  const double below = *(above - 1);
  return static_cast<double>(above - variances_.begin()) - 1 + (variance - below) / (*above - below);
}

double Emitter::power_for(double distance) const {
  const double width = device_.lens.width(), height = device_.lens.height();
  return distance * distance * height / (spec_.throw_ratio * spec_.throw_ratio * width);
}

double Emitter::density(const Eigen::Vector3d& x) const {
  constexpr double kStep = 1e-4;  // central differences of a smooth function: exact to 1e-8
  Eigen::Matrix2d J;
  for (int k = 0; k < 2; ++k) {
    Eigen::Vector3d low(x.x() / x.z(), x.y() / x.z(), 1), high = low;
    low[k] -= kStep, high[k] += kStep;
    J.col(k) = (device_.lens.project(high) - device_.lens.project(low)) / (2 * kStep);
  }
  const double focal = spec_.throw_ratio * device_.lens.width();
  return J.determinant() / (focal * focal);
}

std::optional<Emitter::Beam> Emitter::beam(const Scene& scene, const SurfacePoint& at, double margin_px) const {
  const Eigen::Vector3d x_in_device = device_.device_from_world * at.x;
  const Eigen::Vector2d q = device_.lens.project(x_in_device);
  const double width = device_.lens.width(), height = device_.lens.height();
  const double low = -0.5 - margin_px;
  if (!(q.x() > low && q.y() > low && q.x() < width - 1 - low && q.y() < height - 1 - low)) return std::nullopt;
  if (distorted_ && x_in_device.hnormalized().norm() > reach_) return std::nullopt;
  const Eigen::Vector3d to_projector = position_ - at.x;
  const double r2 = to_projector.squaredNorm(), r = std::sqrt(r2);
  const double cos_theta = at.normal.dot(to_projector) / r;
  const bool behind = cos_theta < 0;
  const double passes = behind ? scene.transmission(at.surface) : 1;
  if (!(passes > 0) || cos_theta == 0 || !scene.visible(at, position_, -1, behind)) return std::nullopt;
  const double cos_alpha = x_in_device.z() / r;
  const double dx = q.x() - (width - 1) / 2, dy = q.y() - (height - 1) / 2;
  const double falloff = 1 - spec_.falloff * 4 * (dx * dx + dy * dy) / (width * width + height * height);
  const double focal = spec_.throw_ratio;
  Beam beam{q, 0, level_of(x_in_device.z()), to_projector / r, behind};
  beam.irradiance = passes * spec_.gain * power_ * falloff * focal * focal * width / height * std::abs(cos_theta) /
                    (r2 * cos_alpha * cos_alpha * cos_alpha);
  if (distorted_) beam.irradiance *= density(x_in_device);
  if (behind) beam.to_projector = -beam.to_projector;
  return beam;
}

int Emitter::block_of(const Eigen::Vector2d& q) const {
  const int x = std::clamp(static_cast<int>(q.x() + 0.5) / block_px_, 0, blocks_x_ - 1);
  const int y = std::clamp(static_cast<int>(q.y() + 0.5) / block_px_, 0, blocks_y_ - 1);
  return y * blocks_x_ + x;
}

PictureLight Emitter::light_of(const Picture& picture, const Light4& share) const {
  PictureLight light;
  light.width = device_.lens.width(), light.height = device_.lens.height(), light.margin = margin_;
  CS_CHECK(picture.empty() || (picture.same_size(light.width, light.height) && picture.channels() == 3),
           "projector '" + spec_.id + "' is sent a picture that is not of its size");
  const int columns = light.width + 2 * margin_, rows = light.height + 2 * margin_;
  const auto* table = colours_.table();
  const std::vector<Light4> whole = table ? std::vector<Light4>() : colours_.light(picture, share);
  const float *red = table ? (*table)[0].data() : nullptr, *green = table ? (*table)[1].data() : nullptr,
              *blue = table ? (*table)[2].data() : nullptr;
  const Light4 given = share;  // no store can change it
  std::vector<std::vector<float>> kernels;
  for (double variance : variances_) kernels.push_back(blur_kernel(std::sqrt(variance)));
  light.block_mean.assign(blocks(), Light4::Zero());
  light.blurred.resize(kernels.size() * columns * rows);
  // Band by band, so that the sharp picture never leaves the cache; rows of the margins go with the outermost bands.
  parallel_for(blocks_y_, [&](int by) {
    const int y0 = by * block_px_, y1 = std::min(light.height, y0 + block_px_);
    const int first = by == 0 ? -margin_ : y0, last = by == blocks_y_ - 1 ? light.height + margin_ : y1;
    const int radius = static_cast<int>(kernels.back().size()) / 2;
    const int top = std::max(0, first - radius), bottom = std::min(light.height, last + radius);
    std::vector<Light4> sharp(static_cast<std::size_t>(light.width) * std::max(0, bottom - top));
    for (int y = top; y < bottom; ++y) {
      Light4* to = sharp.data() + static_cast<std::size_t>(y - top) * light.width;
      if (!table) {
        std::copy_n(whole.begin() + static_cast<std::ptrdiff_t>(y) * light.width, light.width, to);
        continue;
      }
      const std::uint16_t* from = picture.empty() ? nullptr : picture.row(y);
      const Light4 black = Light4(red[0], green[0], blue[0], 0) * given;
      for (int x = 0; x < light.width; ++x, from += from ? 3 : 0)
        to[x] = from ? Light4(red[from[0]], green[from[1]], blue[from[2]], 0) * given : black;
    }
    for (int bx = 0; bx < blocks_x_; ++bx) {
      const int x1 = std::min(light.width, (bx + 1) * block_px_);
      Light4 sum = Light4::Zero();
      for (int y = y0; y < y1; ++y)
        for (int x = bx * block_px_; x < x1; ++x) sum += sharp[static_cast<std::size_t>(y - top) * light.width + x];
      light.block_mean[by * blocks_x_ + bx] = sum / static_cast<float>((x1 - bx * block_px_) * (y1 - y0));
    }
    const Band band{sharp, light.width, top, bottom, first, last, margin_};
    for (std::size_t level = 0; level < kernels.size(); ++level)
      band.blur(kernels[level], light.blurred.data() + (level * rows + first + margin_) * columns);
  });
  return light;
}

}  // namespace countershade::simdata

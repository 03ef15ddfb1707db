#include "simdata/render/emitter.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"
#include "simdata/device/blur.h"

namespace countershade::simdata {

Emitter::Emitter(const SimulatedProjector& spec, const Device& device, int block_px)
    : spec_(spec), device_(device), position_(device.position()), block_px_(block_px) {
  blocks_x_ = (device.lens.width() + block_px - 1) / block_px;
  blocks_y_ = (device.lens.height() + block_px - 1) / block_px;
  // The blurred picture ends in zeros, so that bilinear look-up neither cuts its rim nor makes light.
  margin_ = blur_radius(spec.defocus_sigma_px) + 2;
  for (int c = 0; c < 3; ++c) {
    table_[c].resize(65536);
    for (int i = 0; i < 65536; ++i)
      table_[c][i] =
          static_cast<float>(spec.black_level + (1 - spec.black_level) * std::pow(i / 65535.0, spec.gamma[c]));
  }
}

double Emitter::power_for(double distance) const {
  const double width = device_.lens.width(), height = device_.lens.height();
  return distance * distance * height / (spec_.throw_ratio * spec_.throw_ratio * width);
}

std::optional<Emitter::Beam> Emitter::beam(const Scene& scene, int surface, const Eigen::Vector3d& x,
                                           double margin_px) const {
  const Eigen::Vector3d x_in_device = device_.device_from_world * x;
  const Eigen::Vector2d q = device_.lens.project(x_in_device);
  const double width = device_.lens.width(), height = device_.lens.height();
  const double low = -0.5 - margin_px;
  if (!(q.x() > low && q.y() > low && q.x() < width - 1 - low && q.y() < height - 1 - low)) return std::nullopt;
  const Eigen::Vector3d to_projector = position_ - x;
  const double r2 = to_projector.squaredNorm(), r = std::sqrt(r2);
  const double cos_theta = scene.plane(surface).normal(0, 0).dot(to_projector) / r;
  if (!(cos_theta > 0) || !scene.visible(surface, x, position_)) return std::nullopt;
  const double cos_alpha = x_in_device.z() / r;
  const double dx = q.x() - (width - 1) / 2, dy = q.y() - (height - 1) / 2;
  const double falloff = 1 - spec_.falloff * 4 * (dx * dx + dy * dy) / (width * width + height * height);
  const double focal = spec_.throw_ratio;
  return Beam{q, spec_.gain * power_ * falloff * focal * focal * width / height * cos_theta /
                     (r2 * cos_alpha * cos_alpha * cos_alpha)};
}

int Emitter::block_of(const Eigen::Vector2d& q) const {
  const int x = std::clamp(static_cast<int>(q.x() + 0.5) / block_px_, 0, blocks_x_ - 1);
  const int y = std::clamp(static_cast<int>(q.y() + 0.5) / block_px_, 0, blocks_y_ - 1);
  return y * blocks_x_ + x;
}

PictureLight Emitter::light_of(const Picture& picture) const {
  PictureLight light;
  light.width = device_.lens.width(), light.height = device_.lens.height(), light.margin = margin_;
  CS_CHECK(picture.empty() || (picture.same_size(light.width, light.height) && picture.channels() == 3),
           "projector '" + spec_.id + "' is sent a picture that is not of its size");
  const int columns = light.width + 2 * margin_, rows = light.height + 2 * margin_;
  const Light4 black(table_[0][0], table_[1][0], table_[2][0], 0);
  const std::vector<float> kernel = blur_kernel(spec_.defocus_sigma_px);
  light.block_mean.assign(blocks(), Light4::Zero());
  light.blurred.resize(static_cast<std::size_t>(columns) * rows);
  // Band by band, so that the sharp picture never leaves the cache; rows of the margins go with the outermost bands.
  parallel_for(blocks_y_, [&](int by) {
    const int y0 = by * block_px_, y1 = std::min(light.height, y0 + block_px_);
    const int first = by == 0 ? -margin_ : y0, last = by == blocks_y_ - 1 ? light.height + margin_ : y1;
    const int radius = static_cast<int>(kernel.size()) / 2;
    const int top = std::max(0, first - radius), bottom = std::min(light.height, last + radius);
    std::vector<Light4> sharp(static_cast<std::size_t>(light.width) * std::max(0, bottom - top));
    for (int y = top; y < bottom; ++y) {
      Light4* to = sharp.data() + static_cast<std::size_t>(y - top) * light.width;
      const std::uint16_t* from = picture.empty() ? nullptr : picture.row(y);
      for (int x = 0; x < light.width; ++x, from += from ? 3 : 0)
        to[x] = from ? Light4(table_[0][from[0]], table_[1][from[1]], table_[2][from[2]], 0) : black;
    }
    for (int bx = 0; bx < blocks_x_; ++bx) {
      const int x1 = std::min(light.width, (bx + 1) * block_px_);
      Light4 sum = Light4::Zero();
      for (int y = y0; y < y1; ++y)
        for (int x = bx * block_px_; x < x1; ++x) sum += sharp[static_cast<std::size_t>(y - top) * light.width + x];
      light.block_mean[by * blocks_x_ + bx] = sum / static_cast<float>((x1 - bx * block_px_) * (y1 - y0));
    }
    std::vector<Light4> column(columns + 2 * radius);
    for (int y = first; y < last; ++y) {
      std::fill(column.begin(), column.end(), Light4::Zero());
      Light4* middle = column.data() + radius + margin_;
      for (int k = std::max(-radius, top - y); k <= std::min(radius, bottom - 1 - y); ++k) {
        const Light4* row = sharp.data() + static_cast<std::size_t>(y + k - top) * light.width;
        for (int x = 0; x < light.width; ++x) middle[x] += kernel[k + radius] * row[x];
      }
      Light4* to = light.blurred.data() + static_cast<std::size_t>(y + margin_) * columns;
      for (int x = 0; x < columns; ++x) {
        Light4 sum = Light4::Zero();
        for (int k = 0; k <= 2 * radius; ++k) sum += kernel[k] * column[x + k];
        to[x] = sum;
      }
    }
  });
  return light;
}

}  // namespace countershade::simdata

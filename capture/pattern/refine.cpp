#include "capture/pattern/refine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr int kRadius = 3, kSide = 2 * kRadius + 1;

// The decoded values of one window, NaN where nothing was decoded.
struct Window {
  std::array<float, kSide * kSide> value;
  int count = 0;
};

Window window_at(const Image& q, const Mask& reason, int x, int y) {
  Window w;
  w.value.fill(std::numeric_limits<float>::quiet_NaN());
  for (int dy = -kRadius; dy <= kRadius; ++dy)
    for (int dx = -kRadius; dx <= kRadius; ++dx) {
      const int nx = x + dx, ny = y + dy;
      if (nx < 0 || ny < 0 || nx >= q.width() || ny >= q.height() || reason.at(nx, ny)) continue;
      w.value[(dy + kRadius) * kSide + dx + kRadius] = q.at(nx, ny);
      ++w.count;
    }
  return w;
}

float median(std::array<float, 2 * kSide>& values, int count) {
  std::nth_element(values.begin(), values.begin() + count / 2, values.begin() + count);
  return values[count / 2];
}

// Median slope along one direction, from pairs three or more pixels apart. stride: 1 along x, kSide along y.
bool slope(const Window& w, int stride, int across, float& result) {
  std::array<float, 2 * kSide> slopes{};
  int count = 0;
  for (int line = 0; line < kSide; ++line)
    for (int reach : {kRadius, kRadius - 1}) {
      const float low = w.value[line * across + (kRadius - reach) * stride], high = w.value[line * across + (kRadius + reach) * stride];
      if (std::isfinite(low) && std::isfinite(high)) slopes[count++] = (high - low) / (2 * reach);
    }
  if (count == 0) return false;
  result = median(slopes, count);
  return true;
}

// Plane through the agreeing values, at the centre; count of those that agree.
struct Plane {
  float value = 0, sigma = 0;
  int agree = 0;
};

Plane fit(const Window& w, float gx, float gy, float reach) {
  const float centre = w.value[kRadius * kSide + kRadius];
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0, syy = 0, sr = 0, sxr = 0, syr = 0, srr = 0;
  for (int dy = -kRadius; dy <= kRadius; ++dy)
    for (int dx = -kRadius; dx <= kRadius; ++dx) {
      const float r = w.value[(dy + kRadius) * kSide + dx + kRadius] - (centre + gx * dx + gy * dy);
      if (!(std::abs(r) <= reach)) continue;  // NaN never agrees
      n += 1, sx += dx, sy += dy, sxx += dx * dx, sxy += dx * dy, syy += dy * dy, sr += r, sxr += dx * r, syr += dy * r, srr += r * r;
    }
  Plane plane;
  plane.agree = static_cast<int>(n);
  // Normal equations of r = c + a dx + b dy, by Cramer's rule.
  const double cx = sxx * syy - sxy * sxy, cy = sxy * sy - sx * syy, cz = sx * sxy - sxx * sy;
  const double determinant = n * cx + sx * cy + sy * cz;
  if (n < 6 || determinant < 1e-3 * n * sxx * syy) return plane;
  const double c = (sr * cx + sxr * cy + syr * cz) / determinant;
  plane.value = static_cast<float>(centre + c);
  const double rms = std::sqrt(std::max(0.0, srr / n - (sr / n) * (sr / n)));
  // Rounding errors of neighbours are not independent: along a line of equal code they repeat. Half as many count.
  plane.sigma = static_cast<float>(std::max(0.02, rms / std::sqrt(std::max(1.0, n / 2))));
  return plane;
}

}  // namespace

void refine_by_neighbours(bool has_x, bool has_y, int cell_px, Correspondence& c) {
  const Mask before = c.reason;
  const Image x0 = c.x, y0 = c.y;
  const float reach = 1.6f * static_cast<float>(cell_px);  // neighbours may round to either side, and edges read half a cell
  parallel_for(c.reason.height(), [&](int y) {
    for (int x = 0; x < c.reason.width(); ++x) {
      if (before.at(x, y)) continue;
      float sigma = 0;
      for (int axis = 0; axis < 2; ++axis) {
        if (axis == 0 ? !has_x : !has_y) continue;
        const Window w = window_at(axis ? y0 : x0, before, x, y);
        float gx = 0, gy = 0;
        Reason why = Reason::kAccepted;
        Plane plane;
        if (w.count < 10 || !slope(w, 1, kSide, gx) || !slope(w, kSide, 1, gy)) {
          why = Reason::kIsolated;
        } else {
          plane = fit(w, gx, gy, reach);
          if (plane.agree < 6 || plane.agree < 0.3 * w.count) why = Reason::kInconsistent;
        }
        if (why != Reason::kAccepted) {
          c.reason.at(x, y) = static_cast<std::uint8_t>(why);
          break;
        }
        if (plane.sigma <= 0) continue;  // a line of pixels supports it but gives no plane: the reading stays
        (axis ? c.y : c.x).at(x, y) = plane.value;
        sigma = std::max(sigma, plane.sigma);
      }
      if (sigma > 0) c.sigma.at(x, y) = sigma;
    }
  });
}

}  // namespace countershade::capture

#include "capture/diagnose/signs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace countershade::capture {

Handedness handedness(const Correspondence& c) {
  constexpr int kReach = 4;       // camera px: rounding and noise of readings are small against it
  constexpr double kThin = 0.02;  // sine of the least angle between the two directions that tells
  const int stride = std::max(2, c.reason.width() / 400);
  Handedness h;
  for (int v = 0; v + kReach < c.reason.height(); v += stride)
    for (int u = 0; u + kReach < c.reason.width(); u += stride) {
      const double xu = c.x.at(u + kReach, v) - c.x.at(u, v), xv = c.x.at(u, v + kReach) - c.x.at(u, v);
      const double yu = c.y.at(u + kReach, v) - c.y.at(u, v), yv = c.y.at(u, v + kReach) - c.y.at(u, v);
      const double determinant = xu * yv - xv * yu;
      if (!(std::abs(determinant) > kThin * std::hypot(xu, yu) * std::hypot(xv, yv))) continue;  // NaN never is
      ++h.places;
      h.mirrored += determinant < 0;
      h.crossed += determinant < 0 && std::abs(xv) > std::abs(xu) && std::abs(yu) > std::abs(yv);
    }
  h.mirrored /= static_cast<double>(std::max<std::size_t>(1, h.places));
  h.crossed /= static_cast<double>(std::max<std::size_t>(1, h.places));
  return h;
}

namespace {

float median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// What four photos of one pixel are.
struct Four {
  float white, black, a, b;
  // How much too large the sum is when all are raised to g, as a fraction of white - black.
  float excess(double g) const {
    const auto p = [g](float v) { return static_cast<float>(std::pow(std::max(v, 0.0f), g)); };
    const float w = p(white), k = p(black);
    return (p(a) + p(b) - w - k) / (w - k);
  }
};

float median_excess(const std::vector<Four>& pixels, double g) {
  std::vector<float> all(pixels.size());
  std::transform(pixels.begin(), pixels.end(), all.begin(), [g](const Four& f) { return f.excess(g); });
  return all.empty() ? 0 : median(all);
}

}  // namespace

bool PairSum::gamma() const {
  // A camera said to be linear is so within a few percent. At an exponent of 1.15 a half-lit pixel's sum is 9 % too
  // large without a black level, and 4 % where black is a tenth of white.
  // Where noise is as large as that, it chooses which pixels look half lit.
  return std::abs(excess) > std::max(0.04, 0.5 * scatter) && std::abs(std::log(exponent)) > std::log(1.15);
}

std::optional<PairSum> pair_sum(const Image& white, const Image& black, const Image& a, const Image& b,
                                const Mask& valid) {
  std::vector<float> contrast;
  for (std::size_t i = 0; i < white.data().size(); ++i)
    if (valid.data()[i]) contrast.push_back(white.data()[i] - black.data()[i]);
  if (contrast.size() < 1000) return std::nullopt;
  const auto nth = contrast.begin() + static_cast<std::ptrdiff_t>(0.9 * static_cast<double>(contrast.size()));
  std::nth_element(contrast.begin(), nth, contrast.end());
  const float least = 0.25f * *nth;
  std::vector<Four> half, whole;
  double n = 0, mean_s = 0, mean_t = 0, ss = 0, tt = 0, st = 0;
  const std::size_t step = white.data().size() / 200000 | 1;  // a median needs no more; odd: rows are not columns
  for (std::size_t i = 0; i < white.data().size(); i += step) {
    const Four f{white.data()[i], black.data()[i], a.data()[i], b.data()[i]};
    const float range = f.white - f.black;
    if (!valid.data()[i] || !(range > least)) continue;
    const float s = (f.a - f.black) / range, t = (f.b - f.black) / range;
    n += 1, mean_s += s, mean_t += t, ss += s * s, tt += t * t, st += s * t;
    if (std::min(s, t) > 0.15f)
      half.push_back(f);
    else if (std::max(s, t) > 0.8f && std::min(s, t) < 0.08f)
      whole.push_back(f);
  }
  // Stripes and their complement, each in its own way bent, fall where the other rises; two photos that are no pair
  // know nothing of each other.
  if (half.size() < 300) return std::nullopt;
  mean_s /= n, mean_t /= n;
  const double against =
      (st / n - mean_s * mean_t) / std::sqrt((ss / n - mean_s * mean_s) * (tt / n - mean_t * mean_t));
  if (!(against < -0.6)) return std::nullopt;
  PairSum sum;
  sum.half = half.size();
  const auto drift = static_cast<float>(whole.size() < 300 ? 0 : median_excess(whole, 1));
  sum.excess = median_excess(half, 1) - drift;
  std::vector<float> off(half.size());
  for (std::size_t i = 0; i < half.size(); ++i)
    off[i] = std::abs(half[i].excess(1) - static_cast<float>(sum.excess) - drift);
  sum.scatter = 1.48 * median(off);
  double low = 0.2, high = 5;
  for (int halving = 0; halving < 12; ++halving) {  // to a thousandth; the excess falls as the exponent rises
    const double middle = std::sqrt(low * high);
    (median_excess(half, middle) - drift > 0 ? low : high) = middle;
  }
  sum.exponent = std::sqrt(low * high);
  return sum;
}

Blockiness blockiness(const Image& light) {
  // Sums by where a 2 x 2 stands on the grid of 8; a glint or an edge counts as no more than four of the usual.
  std::vector<float> sample;
  const auto second = [&](int x, int y) {
    const float *p = light.row(y) + x, *q = light.row(y + 1) + x;
    return std::abs(p[0] - p[1] - q[0] + q[1]);
  };
  for (int y = 0; y + 1 < light.height(); y += 5)
    for (int x = 0; x + 1 < light.width(); x += 3) sample.push_back(second(x, y));
  Blockiness result;
  if (sample.size() < 500) return result;
  double mean = 0;
  for (const float v : sample) mean += v / static_cast<double>(sample.size());
  const double cap = 4 * mean;
  double sum[8][8] = {}, squares[8][8] = {}, count[8][8] = {};
  const int skip =
      std::max<int>(1, static_cast<int>(light.pixels() / 500000));  // rows of blocks: half a million pixels
  for (int y = 0; y + 1 < light.height(); ++y) {
    if (y / 8 % skip != 0) continue;
    for (int x = 0; x + 1 < light.width(); ++x) {
      const double z = std::min<double>(second(x, y), cap);
      if (!std::isfinite(z)) continue;
      sum[y % 8][x % 8] += z, squares[y % 8][x % 8] += z * z, count[y % 8][x % 8] += 1;
    }
  }
  // `offset`: the last column and row of a block.
  const auto of_grid = [&](int offset) {
    double s[2] = {}, ss[2] = {}, n[2] = {};
    for (int j = 0; j < 8; ++j)
      for (int i = 0; i < 8; ++i) {
        const int border = i == offset || j == offset;
        s[border] += sum[j][i], ss[border] += squares[j][i], n[border] += count[j][i];
      }
    Blockiness b;
    b.inside = s[0] / n[0], b.across = s[1] / n[1];
    const double variance = (ss[0] / n[0] - b.inside * b.inside) / n[0] + (ss[1] / n[1] - b.across * b.across) / n[1];
    b.sigmas = variance > 0 ? (b.across - b.inside) / std::sqrt(variance) : 0;
    return b;
  };
  result = of_grid(7);
  double elsewhere = 0;
  for (int offset = 0; offset < 7; ++offset) {
    const Blockiness other = of_grid(offset);
    elsewhere = std::max(elsewhere, other.across - other.inside);
  }
  const double step = result.across - result.inside;
  result.compressed = result.sigmas > 8 && step > 0.05 * result.inside && step > 3 * elsewhere;
  return result;
}

std::optional<double> agreement(const Correspondence& c, const Picture& picture, const Image& photo, const Image& white,
                                const Image& black) {
  double n = 0, sp = 0, sr = 0, spp = 0, srr = 0, spr = 0;
  const int stride = std::max(1, c.reason.width() / 300);
  // Where the projector is strongest: elsewhere the others make more of the light than it does.
  std::vector<float> ranges;
  for (std::size_t i = 0; i < white.data().size(); i += 7)
    if (!c.reason.data()[i]) ranges.push_back(white.data()[i] - black.data()[i]);
  if (ranges.size() < 100) return std::nullopt;
  const float least = median(ranges);
  for (int v = 0; v < c.reason.height(); v += stride)
    for (int u = 0; u < c.reason.width(); u += stride) {
      const float x = c.x.at(u, v), y = c.y.at(u, v), range = white.at(u, v) - black.at(u, v);
      if (!std::isfinite(x) || !std::isfinite(y) || !(range > least)) continue;
      const int px = std::clamp(static_cast<int>(std::lround(x)), 0, picture.width() - 1);
      const int py = std::clamp(static_cast<int>(std::lround(y)), 0, picture.height() - 1);
      double p = 0;
      for (int k = 0; k < 3; ++k) p += std::pow(picture.at(px, py, k) / 65535.0, 2) / 3;  // near enough to any response
      const double r = std::clamp((photo.at(u, v) - black.at(u, v)) / range, -1.0f, 2.0f);
      n += 1, sp += p, sr += r, spp += p * p, srr += r * r, spr += p * r;
    }
  if (n < 500) return std::nullopt;
  const double vp = spp / n - sp / n * sp / n, vr = srr / n - sr / n * sr / n;
  if (vp < 1e-4 || vr < 1e-8) return std::nullopt;
  return (spr / n - sp / n * sr / n) / std::sqrt(vp * vr);
}

}  // namespace countershade::capture

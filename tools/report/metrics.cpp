#include "tools/report/metrics.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/parallel.h"
#include "tools/report/colour.h"

namespace countershade::tools {

namespace {

constexpr int kBlock = 8;
constexpr int kBins = 81;           // odd: one bin is centred on zero
constexpr double kDarkest = 0.003;  // of W: below it no projector with usual contrast gets
constexpr double kWorseSigmas = 3;

// Light of U, C, T per channel, averaged over a block or of one pixel.
struct Sample {
  float u[3], c[3], t[3];
  int pixels = 0;
  bool edge = false, clipped = false;
};

bool finite_at(const Image& image, int x, int y) {
  for (int k = 0; k < image.channels(); ++k)
    if (!std::isfinite(image.at(x, y, k))) return false;
  return true;
}

// Lit and finite in all three photos.
Mask usable(const VerifyInput& in) {
  Mask valid = *in.lit;
  for (int y = 0; y < valid.height(); ++y)
    for (int x = 0; x < valid.width(); ++x)
      if (valid.at(x, y))
        valid.at(x, y) =
            finite_at(*in.uncompensated, x, y) && finite_at(*in.compensated, x, y) && finite_at(*in.target, x, y);
  return valid;
}

// Usable pixels of a block that a mask holds.
int count_in_block(const Mask* mask, const Mask& valid, int block_x, int block_y, int factor) {
  if (!mask) return 0;
  int count = 0;
  for (int y = block_y * factor; y < (block_y + 1) * factor; ++y)
    for (int x = block_x * factor; x < (block_x + 1) * factor; ++x) count += valid.at(x, y) && mask->at(x, y);
  return count;
}

// A projector can take away no more than the direct light that it sends. What scatters onto a place in the compensated
// show is at most what scatters there in the plain one, U - T: the estimate errs towards "clipped".
bool looks_clipped(const Sample& s, double white) {
  for (int k = 0; k < 3; ++k)
    if (s.t[k] - (s.u[k] - s.t[k]) < kDarkest * white) return true;
  return false;
}

std::vector<Sample> samples(const VerifyInput& in, const Mask& valid, int factor) {
  const Reduced u = masked_box_reduce(*in.uncompensated, valid, factor);
  const Reduced c = masked_box_reduce(*in.compensated, valid, factor);
  const Reduced t = masked_box_reduce(*in.target, valid, factor);
  std::vector<Sample> result;
  for (int y = 0; y < u.value.height(); ++y)
    for (int x = 0; x < u.value.width(); ++x) {
      if (std::isnan(u.value.at(x, y))) continue;
      Sample s{};
      for (int k = 0; k < 3; ++k) {
        const int from = u.value.channels() == 3 ? k : 0;
        s.u[k] = u.value.at(x, y, from), s.c[k] = c.value.at(x, y, from), s.t[k] = t.value.at(x, y, from);
      }
      s.pixels = u.pixels.at(x, y);
      s.edge = in.edge && 2 * count_in_block(in.edge, valid, x, y, factor) >= s.pixels;
      s.clipped = in.clipped ? count_in_block(in.clipped, valid, x, y, factor) > 0 : looks_clipped(s, in.white);
      result.push_back(s);
    }
  return result;
}

double mean(const std::vector<float>& values) {
  double sum = 0;
  for (float v : values) sum += v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

// Smallest value that at least `share` of the values do not exceed. Reorders them.
double percentile(std::vector<float>& values, double share) {
  if (values.empty()) return 0;
  const double rank = std::ceil(share * static_cast<double>(values.size())) - 1;
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::max(0.0, rank));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

using Light = float (Sample::*)[3];

Deviations deviations(const std::vector<const Sample*>& chosen, Light light, double white) {
  std::vector<float> linear(3 * chosen.size()), grey(3 * chosen.size()), delta_e(chosen.size());
  constexpr std::size_t kChunk = 4096;
  parallel_for(static_cast<int>((chosen.size() + kChunk - 1) / kChunk), [&](int chunk) {
    const std::size_t first = chunk * kChunk, last = std::min(chosen.size(), first + kChunk);
    for (std::size_t i = first; i < last; ++i) {
      const float *v = chosen[i]->*light, *t = chosen[i]->t;
      Rgb shown{}, wanted{};
      for (int k = 0; k < 3; ++k) {
        shown[k] = v[k] / white, wanted[k] = t[k] / white;
        linear[3 * i + k] = static_cast<float>(100 * std::abs(shown[k] - wanted[k]));
        grey[3 * i + k] = static_cast<float>(255 * std::abs(srgb_encode(shown[k]) - srgb_encode(wanted[k])));
      }
      delta_e[i] = static_cast<float>(delta_e_2000(lab_of_linear(shown), lab_of_linear(wanted)));
    }
  });
  Deviations d;
  d.blocks = static_cast<int>(chosen.size());
  d.mean_percent = mean(linear), d.p99_percent = percentile(linear, 0.99);
  d.mean_grey = mean(grey), d.p99_grey = percentile(grey, 0.99);
  d.mean_delta_e = mean(delta_e), d.p95_delta_e = percentile(delta_e, 0.95);
  return d;
}

template <class Belongs>
ZoneNumbers zone(const std::vector<Sample>& all, double white, Belongs&& belongs) {
  std::vector<const Sample*> chosen;
  for (const Sample& s : all)
    if (belongs(s)) chosen.push_back(&s);
  ZoneNumbers z;
  z.uncompensated = deviations(chosen, &Sample::u, white);
  z.compensated = deviations(chosen, &Sample::c, white);
  z.suppression = z.uncompensated.mean_percent / z.compensated.mean_percent;  // x / 0 = inf, 0 / 0 = NaN
  return z;
}

void fill_histograms(const std::vector<Sample>& blocks, double white, VerifyNumbers& n) {
  n.histogram_u.assign(kBins, 0.0);
  n.histogram_c.assign(kBins, 0.0);
  const auto bin = [&](double difference) {
    const double position = (100 * difference / white / n.histogram_reach + 1) / 2 * kBins;
    return static_cast<int>(std::clamp(position, 0.0, kBins - 1.0));
  };
  const double share = 1.0 / (3.0 * static_cast<double>(blocks.size()));
  for (const Sample& b : blocks)
    for (int k = 0; k < 3; ++k) {
      n.histogram_u[bin(b.u[k] - b.t[k])] += share;
      n.histogram_c[bin(b.c[k] - b.t[k])] += share;
    }
}

// Numbers that compare U and C block by block.
void compare_blocks(const std::vector<Sample>& blocks, double sigma_per_pixel, VerifyNumbers& n) {
  double u = 0, c = 0, worse = 0, clipped = 0;
  for (const Sample& b : blocks) {
    clipped += b.clipped;
    const double margin = kWorseSigmas * sigma_per_pixel / std::sqrt(b.pixels);
    for (int k = 0; k < 3; ++k) {
      u += static_cast<double>(b.u[k]) * b.pixels, c += static_cast<double>(b.c[k]) * b.pixels;
      worse += std::abs(b.c[k] - b.t[k]) > std::abs(b.u[k] - b.t[k]) + margin;
    }
  }
  const double count = std::max<double>(1, static_cast<double>(blocks.size()));
  n.paper_measure = u > 0 ? (u - c) / u : 0;
  n.clipped_share = clipped / count;
  n.worse_share = worse / (3 * count);
}

void fill_coverage(const VerifyInput& in, const std::vector<Sample>& blocks, VerifyNumbers& n) {
  double lit = 0, uncovered = 0, used = 0;
  for (std::size_t i = 0; i < in.lit->data().size(); ++i) {
    if (!in.lit->data()[i]) continue;
    ++lit;
    uncovered += in.modelled && !in.modelled->data()[i];
  }
  for (const Sample& b : blocks) used += b.pixels;
  n.uncovered_share = lit > 0 ? uncovered / lit : 0;
  n.unused_share = lit > 0 ? 1 - used / lit : 0;
}

void check_input(const VerifyInput& in) {
  CS_CHECK(in.uncompensated && in.compensated && in.target && in.lit, "three photos and the mask of lit pixels");
  const int width = in.uncompensated->width(), height = in.uncompensated->height();
  for (const Image* image : {in.compensated, in.target}) {
    CS_CHECK(image->same_size(width, height), "photos of one size");
    CS_CHECK(image->channels() == in.uncompensated->channels(), "photos with as many channels");
  }
  for (const Mask* mask : {in.lit, in.edge, in.modelled, in.clipped})
    CS_CHECK(!mask || mask->same_size(width, height), "masks of the photos' size");
  CS_CHECK(in.white > 0, "reference white is positive");
}

}  // namespace

Reduced masked_box_reduce(const Image& image, const Mask& valid, int factor) {
  CS_CHECK(factor >= 1, "factor is positive");
  CS_CHECK(valid.same_size(image.width(), image.height()), "mask of the image's size");
  const int width = image.width() / factor, height = image.height() / factor, channels = image.channels();
  Reduced out{Image(width, height, channels, NAN), Raster<int>(width, height, 1)};
  parallel_for(height, [&](int row) {
    for (int column = 0; column < width; ++column) {
      double sum[3] = {0, 0, 0};
      int count = 0;
      for (int y = row * factor; y < (row + 1) * factor; ++y)
        for (int x = column * factor; x < (column + 1) * factor; ++x) {
          if (!valid.at(x, y) || !finite_at(image, x, y)) continue;
          ++count;
          for (int k = 0; k < channels; ++k) sum[k] += image.at(x, y, k);
        }
      out.pixels.at(column, row) = count;
      if (2 * count < factor * factor) continue;
      for (int k = 0; k < channels; ++k) out.value.at(column, row, k) = static_cast<float>(sum[k] / count);
    }
  });
  return out;
}

VerifyNumbers measure(const VerifyInput& in) {
  check_input(in);
  const Mask valid = usable(in);
  const std::vector<Sample> blocks = samples(in, valid, kBlock), pixels = samples(in, valid, 1);
  const auto any = [](const Sample&) { return true; };
  VerifyNumbers n;
  n.edge_text = in.edge_text;
  n.clipped_text = in.clipped ? "as the projectors' pictures say" : "estimated from the photos, generously";
  n.all = zone(blocks, in.white, any);
  n.unclipped = zone(blocks, in.white, [](const Sample& s) { return !s.clipped; });
  n.edge = zone(blocks, in.white, [](const Sample& s) { return s.edge; });
  std::size_t above = 0, near = 0;
  for (const Sample& s : blocks)
    for (int k = 0; k < 3 && s.edge; ++k) above += s.t[k] > in.white, ++near;
  n.above_white_share = near > 0 ? static_cast<double>(above) / static_cast<double>(near) : 0;
  n.per_pixel = zone(pixels, in.white, any);
  n.pixel_mean_percent = n.per_pixel.compensated.mean_percent;
  const double sigma = in.pixel_noise * std::sqrt(1 + in.target_noise * in.target_noise);  // of C - T, one pixel
  // The mean of |x| for normal x is sqrt(2 / pi) sigma.
  n.pixel_noise_floor_percent = 100 * std::sqrt(2 / std::numbers::pi) * sigma / in.white;
  n.noise_floor_percent = n.pixel_noise_floor_percent / kBlock;
  compare_blocks(blocks, sigma, n);
  fill_coverage(in, blocks, n);
  fill_histograms(blocks, in.white, n);
  return n;
}

}  // namespace countershade::tools

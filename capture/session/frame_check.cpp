#include "capture/session/frame_check.h"

#include <algorithm>
#include <cmath>

#include "calib/photometry/response.h"

namespace countershade::capture {

namespace {

constexpr double kSaturation = 0.995;  // of full scale

// Linear light for a stored fraction; an empty table is the identity.
std::vector<float> linearisation(const CameraSpec& camera) {
  const auto response = Response::parse(camera.response);
  if (!response || response->text() == "linear") return {};
  return response->decode_table(4096);
}

struct Accumulated {
  double sum = 0, brightest = 0;
  double channel[3] = {0, 0, 0};
  std::size_t saturated = 0;
};

// Sums one bin: fractions of full scale above the pedestal.
Accumulated accumulate_bin(const Image& stored, int x0, int y0, int bin, double pedestal, double full,
                           const std::vector<float>& table) {
  Accumulated a;
  const int n = stored.channels();
  for (int y = y0; y < y0 + bin; ++y) {
    const float* p = stored.row(y) + static_cast<std::size_t>(x0) * n;
    for (int x = 0; x < bin; ++x) {
      bool saturated = false;
      for (int c = 0; c < n; ++c, ++p) {
        const double fraction = (*p - pedestal) / (full - pedestal);
        saturated = saturated || *p >= kSaturation * full;
        a.brightest = std::max(a.brightest, fraction);
        const double light =
            table.empty() ? fraction : table[std::lround(std::clamp(fraction, 0.0, 1.0) * (table.size() - 1))];
        a.sum += light;
        a.channel[c] += light;
      }
      a.saturated += saturated;
    }
  }
  return a;
}

void check_sizes(const Bins& a, const Bins& b) {
  CS_CHECK(a.light.same_size(b.light.width(), b.light.height()), "binned photos of different sizes");
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double correlation(const std::vector<double>& a, const std::vector<double>& b, double& smaller_deviation) {
  const double n = static_cast<double>(a.size());
  double ma = 0, mb = 0, aa = 0, bb = 0, ab = 0;
  for (std::size_t i = 0; i < a.size(); ++i) ma += a[i] / n, mb += b[i] / n;
  for (std::size_t i = 0; i < a.size(); ++i) {
    aa += (a[i] - ma) * (a[i] - ma), bb += (b[i] - mb) * (b[i] - mb), ab += (a[i] - ma) * (b[i] - mb);
  }
  smaller_deviation = n > 0 ? std::sqrt(std::min(aa, bb) / n) : 0;
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

}  // namespace

Bins bin_photo(const Image& stored, double full_scale, const CameraSpec& camera, int bin) {
  const double full = camera.full_scale.value_or(full_scale);
  const std::vector<float> table = linearisation(camera);
  bin = std::max(1, std::min({bin, stored.width(), stored.height()}));
  Bins bins;
  bins.light = Image(stored.width() / bin, stored.height() / bin, 1);
  bins.colour = Image(bins.light.width(), bins.light.height(), stored.channels());
  bins.valid = Mask(bins.light.width(), bins.light.height(), 1, 1);
  std::size_t saturated = 0;
  for (int by = 0; by < bins.light.height(); ++by)
    for (int bx = 0; bx < bins.light.width(); ++bx) {
      const Accumulated a = accumulate_bin(stored, bx * bin, by * bin, bin, camera.pedestal, full, table);
      bins.light.at(bx, by) = static_cast<float>(a.sum / (bin * bin * stored.channels()));
      for (int c = 0; c < stored.channels(); ++c)
        bins.colour.at(bx, by, c) = static_cast<float>(a.channel[c] / (bin * bin));
      if (a.saturated) bins.valid.at(bx, by) = 0;
      bins.brightest = std::max(bins.brightest, a.brightest);
      saturated += a.saturated;
    }
  bins.saturated = static_cast<double>(saturated) / std::max<std::size_t>(1, bins.light.pixels() * bin * bin);
  return bins;
}

double mean_light(const Bins& bins) {
  double sum = 0;
  for (float v : bins.light.data()) sum += v;
  return sum / std::max<std::size_t>(1, bins.light.pixels());
}

double mean_difference(const Bins& a, const Bins& b) {
  check_sizes(a, b);
  double sum = 0;
  const std::size_t count = a.colour.data().size();
  for (std::size_t i = 0; i < count; ++i) sum += std::abs(a.colour.data()[i] - b.colour.data()[i]);
  return sum / std::max<std::size_t>(1, count);
}

std::pair<double, double> change_of_view(const Bins& a, const Bins& b) {
  check_sizes(a, b);
  double ab = 0, bb = 0, mean_a = 0, difference = 0;
  for (std::size_t i = 0; i < a.light.pixels(); ++i) {
    const double x = a.light.data()[i], y = b.light.data()[i];
    ab += x * y, bb += y * y, mean_a += std::abs(x);
  }
  const double factor = bb > 0 ? ab / bb : 1;
  for (std::size_t i = 0; i < a.light.pixels(); ++i)
    difference += std::abs(a.light.data()[i] - factor * b.light.data()[i]);
  return {mean_a > 0 ? difference / mean_a : 0, factor - 1};
}

PairLaw pair_law(const Bins& white, const Bins& black, const Bins& one, const Bins& other) {
  for (const Bins* b : {&black, &one, &other}) check_sizes(white, *b);
  const auto swing = [&](std::size_t i) { return double(white.light.data()[i]) - black.light.data()[i]; };
  std::vector<double> swings(white.light.pixels());
  for (std::size_t i = 0; i < swings.size(); ++i) swings[i] = swing(i);
  const double brightest = percentile(std::move(swings), 0.99);  // a hot pixel or a glint is not the measure
  double error = 0, total = 0;
  std::vector<double> ones, others;
  for (std::size_t i = 0; i < white.light.pixels(); ++i) {
    const bool valid = white.valid.data()[i] && one.valid.data()[i] && other.valid.data()[i];
    if (!valid || swing(i) < 0.1 * brightest) continue;  // a tenth: dark bins hold more noise than pattern
    const double r = one.light.data()[i] - black.light.data()[i], s = other.light.data()[i] - black.light.data()[i];
    error += std::abs(r + s - swing(i));
    total += swing(i);
    ones.push_back(r / swing(i));
    others.push_back(s / swing(i));
  }
  PairLaw law;
  law.error = total > 0 ? error / total : 0;
  law.correlation = correlation(ones, others, law.contrast);
  return law;
}

Image block_light(const Picture& picture) {
  const int block = std::max(1, (picture.width() + 19) / 20);
  Image blocks((picture.width() + block - 1) / block, (picture.height() + block - 1) / block, picture.channels());
  Image counts(blocks.width(), blocks.height(), 1);
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x) {
      counts.at(x / block, y / block) += 1;
      for (int c = 0; c < picture.channels(); ++c) {
        const float v = picture.at(x, y, c) / 65535.0f;
        blocks.at(x / block, y / block, c) += v * v;
      }
    }
  for (int y = 0; y < blocks.height(); ++y)
    for (int x = 0; x < blocks.width(); ++x)
      for (int c = 0; c < blocks.channels(); ++c) blocks.at(x, y, c) /= counts.at(x, y);
  return blocks;
}

double block_change(const Image& a, const Image& b, int channels) {
  CS_CHECK(a.data().size() == b.data().size(), "pictures of different sizes");
  if (channels == 1 && a.channels() == 3) return block_change(luminance_mean(a), luminance_mean(b), 1);
  double sum = 0;
  for (std::size_t i = 0; i < a.data().size(); ++i) sum += std::abs(a.data()[i] - b.data()[i]);
  return sum / std::max<std::size_t>(1, a.data().size());
}

Companions companions(const Sequence& sequence, int position) {
  const Role& role = sequence.frames[position].role;
  Role inverse = role;
  inverse.inverse = !role.inverse;
  Companions found;
  for (int i = 0; i < static_cast<int>(sequence.frames.size()); ++i) {
    const Role& r = sequence.frames[i].role;
    const bool one_projector = sequence.projectors.size() == 1;  // then no name is the same as its name
    const bool same =
        r.projector == role.projector || (one_projector && (r.projector.empty() || role.projector.empty()));
    if (same && r.kind == "white" && found.white < 0) found.white = i;
    if (same && r.kind == "black" && found.black < 0) found.black = i;
    if ((role.kind == "gray" || role.kind == "xor") && r == inverse) found.inverse = i;
  }
  return found;
}

}  // namespace countershade::capture

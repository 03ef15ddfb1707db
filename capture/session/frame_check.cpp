#include "capture/session/frame_check.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"
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

// Of a row of bins: sums of the light of each channel of each bin, and what the stored numbers reach.
struct BinRow {
  std::vector<float> sum;  // [bin][channel]
  std::vector<std::uint8_t> valid;
  float brightest = 0;  // stored
  std::size_t saturated = 0;
};

// Stored numbers of one row of the photo, light_of each; the rows of a bin are added one after the other.
template <class LightOf>
void add_row(const float* stored, int bins, int bin, int channels, float limit, LightOf&& light_of, BinRow& row) {
  float brightest = row.brightest;
  for (int i = 0; i < bins * bin * channels; ++i) brightest = std::max(brightest, stored[i]);
  row.brightest = brightest;
  const float* p = stored;
  for (int b = 0; b < bins; ++b) {
    float sum[3] = {0, 0, 0};
    for (int x = 0; x < bin; ++x, p += channels)
      for (int c = 0; c < channels; ++c) sum[c] += light_of(p[c]);
    for (int c = 0; c < channels; ++c) row.sum[b * channels + c] += sum[c];
  }
  if (brightest < limit) return;  // mostly
  for (int x = 0; x < bins * bin; ++x) {
    bool saturated = false;
    for (int c = 0; c < channels; ++c) saturated = saturated || stored[x * channels + c] >= limit;
    if (saturated) row.valid[x / bin] = 0, ++row.saturated;
  }
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
  const int width = stored.width() / bin, height = stored.height() / bin, channels = stored.channels();
  Bins bins;
  bins.light = Image(width, height, 1);
  if (bin > 1) bins.colour = Image(width, height, channels);
  bins.valid = Mask(width, height, 1, 1);
  const auto pedestal = static_cast<float>(camera.pedestal), scale = static_cast<float>(1 / (full - camera.pedestal));
  const auto limit = static_cast<float>(kSaturation * full);
  const auto linear = [=](float v) { return (v - pedestal) * scale; };
  const auto last = static_cast<float>(table.size()) - 1;
  const auto looked_up = [&](float v) {
    return table[static_cast<int>(std::clamp(linear(v), 0.0f, 1.0f) * last + 0.5f)];
  };
  std::vector<BinRow> rows(height);
  parallel_for(height, [&](int by) {
    BinRow& row = rows[by];
    row.sum.assign(static_cast<std::size_t>(width) * channels, 0);
    row.valid.assign(width, 1);
    for (int y = by * bin; y < (by + 1) * bin; ++y)
      if (table.empty())
        add_row(stored.row(y), width, bin, channels, limit, linear, row);
      else
        add_row(stored.row(y), width, bin, channels, limit, looked_up, row);
    const auto pixels = static_cast<float>(bin * bin);
    for (int bx = 0; bx < width; ++bx) {
      float sum = 0;
      for (int c = 0; c < channels; ++c) sum += row.sum[bx * channels + c] / pixels;
      bins.light.at(bx, by) = sum / static_cast<float>(channels);
      for (int c = 0; c < bins.colour.channels(); ++c) bins.colour.at(bx, by, c) = row.sum[bx * channels + c] / pixels;
      bins.valid.at(bx, by) = row.valid[bx];
    }
  });
  std::size_t saturated = 0;
  float brightest = 0;
  for (const BinRow& row : rows) saturated += row.saturated, brightest = std::max(brightest, row.brightest);
  bins.brightest = std::max(0.0, (brightest - camera.pedestal) / (full - camera.pedestal));
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
  const Image &one = a.colour.empty() ? a.light : a.colour, &other = b.colour.empty() ? b.light : b.colour;
  CS_CHECK(one.channels() == other.channels(), "photos that are binned alike");
  double sum = 0;
  for (int y = 0; y < one.height(); ++y) {
    const float *p = one.row(y), *q = other.row(y);
    float row = 0;  // short enough for a float
    for (int i = 0; i < one.width() * one.channels(); ++i) row += std::abs(p[i] - q[i]);
    sum += row;
  }
  return sum / static_cast<double>(std::max<std::size_t>(1, one.data().size()));
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
  const int block = std::max(1, (picture.width() + 19) / 20), channels = picture.channels();
  Image blocks((picture.width() + block - 1) / block, (picture.height() + block - 1) / block, channels);
  parallel_for(blocks.height(), [&](int by) {
    const int rows = std::min(block, picture.height() - by * block);
    for (int bx = 0; bx < blocks.width(); ++bx) {
      const int columns = std::min(block, picture.width() - bx * block);
      float sum[3] = {0, 0, 0};
      for (int y = by * block; y < by * block + rows; ++y) {
        const std::uint16_t* p = picture.row(y) + static_cast<std::size_t>(bx) * block * channels;
        for (int x = 0; x < columns; ++x, p += channels)
          for (int c = 0; c < channels; ++c) {
            const float v = p[c] / 65535.0f;
            sum[c] += v * v;
          }
      }
      for (int c = 0; c < channels; ++c) blocks.at(bx, by, c) = sum[c] / static_cast<float>(rows * columns);
    }
  });
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

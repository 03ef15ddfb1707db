#include "capture/pattern/bits.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr int kFineBits = 4;   // their stripes are too narrow to modulate light that comes by way of other surfaces
constexpr int kWaiting = 64;   // bytes per pixel of photos that wait for a pass at most, where they can be judged
constexpr int kBandRows = 16;  // one task

// The photos of one bit, one row, and what a difference must exceed.
struct RowRules {
  float noise = 0, photon = 0;  // min_snr^2 (2 read^2 + photon (plain + inverse))
  float modulation = 0;         // of white - black
};

// Adds a bit to `code` where plain > inverse, and to `uncertain` unless
//   |plain - inverse| > modulation (white - black)   and   |plain - inverse| > limit + min_snr sigma,
// which takes no root when it is squared. limit: null = 0.
void read_bit(const float* plain, const float* inverse, const float* contrast, const float* limit, int width,
              std::uint32_t mask, const RowRules& rules, std::uint32_t* code, std::uint32_t* uncertain) {
  const auto read = [&](int x, float beyond) {
    const float difference = plain[x] - inverse[x], size = std::abs(difference);
    const float light = std::max(0.0f, plain[x] + inverse[x]), left = std::max(0.0f, size - beyond);
    const bool certain = (left * left > rules.noise + rules.photon * light) & (size > rules.modulation * contrast[x]);
    code[x] |= difference > 0 ? mask : 0u;
    uncertain[x] |= certain ? 0u : mask;
  };
  if (limit != nullptr) {
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) read(x, limit[x]);
  } else {
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) read(x, 0.0f);
  }
}

std::uint32_t binary_of(std::uint32_t gray) {
  for (int shift = 16; shift > 0; shift /= 2) gray ^= gray >> shift;
  return gray;
}

// Bits that were shown in exclusive or with another become those of the Gray code; where that one is in doubt, so are
// they.
void take_off_base(std::uint32_t combined, int base, int width, std::uint32_t* code, std::uint32_t* uncertain) {
  for (int x = 0; x < width; ++x) {
    if ((code[x] >> base) & 1) code[x] ^= combined;
    if ((uncertain[x] >> base) & 1) uncertain[x] |= combined;
  }
}

}  // namespace

// Buffers of one band of rows.
struct BitReading::Rows {
  std::vector<float> plain, inverse, limit;
  explicit Rows(int width) : plain(width), inverse(width), limit(width) {}
};

bool BitReading::is_fine(int axis, int bit) const {
  return bit < kFineBits || plan_.axis[axis].bits[bit].base >= 0;
}

bool BitReading::wants(int frame) const {
  if (done_) return false;
  if (!levels_ && LevelPhotos(plan_, {}).need(frame)) return true;
  for (int a = 0; a < 2; ++a)
    for (std::size_t b = 0; b < plan_.axis[a].bits.size(); ++b) {
      const BitFrames& frames = plan_.axis[a].bits[b];
      const bool read = b < read_[a].size() && read_[a][b];
      if (!read && (frames.plain == frame || frames.inverse == frame)) return true;
    }
  return false;
}

// Pairs that are there and can be judged: fine ones, and coarse ones once all fine ones of their axis and the one
// before are read or among these.
std::vector<BitReading::Pair> BitReading::ready(const StoredPhotos& photos) const {
  std::vector<Pair> pairs;
  bool fine_known = true;
  for (int a = 0; a < 2; ++a)
    for (const bool fine : {true, false})
      for (int b = 0; b < static_cast<int>(plan_.axis[a].bits.size()); ++b) {
        if (is_fine(a, b) != fine || (b < static_cast<int>(read_[a].size()) && read_[a][b])) continue;
        const auto plain = photos.find(plan_.axis[a].bits[b].plain), inverse = photos.find(plan_.axis[a].bits[b].inverse);
        const bool there = plain != photos.end() && inverse != photos.end();
        if (fine) fine_known = fine_known && there;
        if (there && (fine || fine_known)) pairs.push_back({a, b, fine, plain->second, inverse->second});
      }
  return pairs;
}

void BitReading::read(StoredPhotos& photos, bool all) {
  const LevelPhotos level_photos(plan_, photos);
  if (done_ || (!levels_ && !level_photos.complete())) return;
  const std::vector<Pair> pairs = ready(photos);
  std::size_t bytes = 0, left = 0;
  for (const Pair& p : pairs) bytes += p.plain->bytes() + p.inverse->bytes();
  for (int a = 0; a < 2; ++a)
    left += plan_.axis[a].bits.size() - std::count(read_[a].begin(), read_[a].end(), true);
  const std::size_t pixels = pairs.empty() ? 0 : std::size_t{1} * pairs[0].plain->width() * pairs[0].plain->height();
  if (pairs.empty() || (!all && pairs.size() < left && bytes < kWaiting * pixels)) return;
  const bool first = !levels_, last = pairs.size() == left;
  if (first) begin(level_photos);
  parallel_for((height_ + kBandRows - 1) / kBandRows, [&](int band) {
    Rows rows(width_);
    for (int y = band * kBandRows; y < std::min(height_, (band + 1) * kBandRows); ++y) {
      if (first) judge_row(level_photos, y, rows);
      read_row(pairs, y, rows);
      if (last) finish_row(y);
    }
  });
  done_ = last;
  for (const Pair& p : pairs) {
    const BitFrames& frames = plan_.axis[p.axis].bits[p.bit];
    read_[p.axis][p.bit] = true;
    photos.erase(frames.plain), photos.erase(frames.inverse);
  }
  photos.erase(plan_.white), photos.erase(plan_.black);
  if (!done_) return;
  for (std::vector<float>& fine : fine_) fine = {};
  for (AxisReading& axis : axes_)
    if (axis.bits) axis.contrast = contrast_;
}

void BitReading::begin(const LevelPhotos& photos) {
  levels_ = measure_levels(photos);
  width_ = photos.photo[0]->width(), height_ = photos.photo[0]->height();
  judged_ = Mask(width_, height_, 1), contrast_ = Image(width_, height_, 1);
  parallel_for(2, [&](int a) {
    const AxisCode& code = plan_.axis[a];
    read_[a].assign(code.bits.size(), false);
    if (code.bits.empty()) return;
    AxisReading& axis = axes_[a];
    axis.cell_px = code.cell_px, axis.length_px = code.length_px, axis.bits = static_cast<int>(code.bits.size());
    for (const BitFrames& bit : code.bits) axis.base = std::max(axis.base, bit.base);
    axis.q = axis.sigma = Image(width_, height_, 1, kNaN);
    axis.reason = Mask(width_, height_, 1);
    axis.code.assign(judged_.pixels(), 0), axis.uncertain.assign(judged_.pixels(), 0);
    fine_[a].assign(judged_.pixels(), 0.0f);
  });
}

// Pixels that no code is read from: dark or saturated.
void BitReading::judge_row(const LevelPhotos& photos, int y, Rows& rows) {
  std::uint8_t* reason = judged_.row(y);
  float *white = rows.plain.data(), *black = rows.inverse.data(), *contrast = contrast_.row(y);
  photos.row(y, white, black, reason);
  const double snr = options_.min_snr * options_.min_snr, read = levels_->noise.read;
  const auto noise = static_cast<float>(2 * snr * read * read), photon = static_cast<float>(snr * levels_->noise.photon);
  const auto dark = static_cast<float>(std::max(0.0, options_.dark_fraction * levels_->contrast));
  for (int x = 0; x < width_; ++x) {
    const float range = white[x] - black[x], light = std::max(0.0f, white[x]) + std::max(0.0f, black[x]);
    const bool lit = (range > dark) & (range * range > noise + photon * light);  // NaN is dark
    contrast[x] = range;
    reason[x] = static_cast<std::uint8_t>(!lit        ? Reason::kDark
                                          : reason[x] ? Reason::kSaturated
                                                      : Reason::kAccepted);
  }
}

// A direct share d of the light makes +-d of a bit's difference, light by way of other surfaces up to +-(1 - d): a
// coarse bit is certain only beyond what the latter can do against the former, 1 - 2 d (Xu & Aliaga 2007, robust pixel
// classification; their bounds for on and off, written for the difference). The strongest of several modulations is a
// few percent more than d.
void BitReading::read_row(const std::vector<Pair>& pairs, int y, Rows& rows) {
  const std::size_t start = static_cast<std::size_t>(y) * width_;
  const double snr = options_.min_snr * options_.min_snr, read = levels_->noise.read;
  const RowRules rules{static_cast<float>(2 * snr * read * read), static_cast<float>(snr * levels_->noise.photon),
                       static_cast<float>(options_.min_modulation)};
  const float* contrast = contrast_.row(y);
  int limits_of = -1;  // axis
  for (const Pair& pair : pairs) {
    pair.plain->light_row(y, rows.plain.data()), pair.inverse->light_row(y, rows.inverse.data());
    float* limit = rows.limit.data();
    if (pair.fine) {
      float* fine = fine_[pair.axis].data() + start;
      for (int x = 0; x < width_; ++x) fine[x] = std::max(fine[x], std::abs(rows.plain[x] - rows.inverse[x]));
    } else if (limits_of != pair.axis) {
      limits_of = pair.axis;
      std::fill(rows.limit.begin(), rows.limit.end(), 0.0f);
      for (int a = 0; a <= pair.axis; ++a)
        if (!fine_[a].empty())
          for (int x = 0; x < width_; ++x) limit[x] = std::max(limit[x], fine_[a][start + x]);
      for (int x = 0; x < width_; ++x) limit[x] = std::max(0.0f, contrast[x] - 1.8f * limit[x]);
    }
    AxisReading& axis = axes_[pair.axis];
    read_bit(rows.plain.data(), rows.inverse.data(), contrast, pair.fine ? nullptr : limit, width_, 1u << pair.bit,
             rules, axis.code.data() + start, axis.uncertain.data() + start);
  }
}

// Whether light is direct at all, and the coordinates that bits say [px]: a cell's middle, or the border of two where
// the one bit in doubt decides between them (Gray code changes one bit from cell to cell).
void BitReading::finish_row(int y) {
  const std::size_t start = static_cast<std::size_t>(y) * width_;
  std::uint8_t* judged = judged_.row(y);
  const float *contrast = contrast_.row(y), *fine_x = fine_[0].empty() ? nullptr : fine_[0].data() + start,
              *fine_y = fine_[1].empty() ? nullptr : fine_[1].data() + start;
  const auto least = static_cast<float>(options_.fine_modulation);
  for (int x = 0; x < width_; ++x) {
    const float fine = std::max(fine_x ? fine_x[x] : 0.0f, fine_y ? fine_y[x] : 0.0f);
    if (!judged[x] && fine < least * contrast[x]) judged[x] = static_cast<std::uint8_t>(Reason::kIndirect);
  }
  for (int a = 0; a < 2; ++a) {
    const AxisCode& frames = plan_.axis[a];
    AxisReading& axis = axes_[a];
    if (frames.bits.empty()) continue;
    std::uint32_t *code = axis.code.data() + start, *uncertain = axis.uncertain.data() + start, combined = 0;
    for (std::size_t b = 0; b < frames.bits.size(); ++b)
      if (frames.bits[b].base >= 0) combined |= 1u << b;
    if (combined) take_off_base(combined, axis.base, width_, code, uncertain);
    const float cell_px = static_cast<float>(axis.cell_px), half = 0.5f * (cell_px - 1);
    const float last = static_cast<float>(axis.length_px) - 0.5f;
    float* q = axis.q.row(y);
    std::uint8_t* reason = axis.reason.row(y);
    for (int x = 0; x < width_; ++x) {
      const std::uint32_t doubt = uncertain[x];
      const auto cell = static_cast<int>(binary_of(code[x])), other = static_cast<int>(binary_of(code[x] ^ doubt));
      const bool said = ((doubt & (doubt - 1)) == 0) & (cell - other <= 1) & (other - cell <= 1);
      const float at = 0.5f * static_cast<float>(cell + other) * cell_px + half;
      const Reason why = !said ? Reason::kUncertainBit : at > last ? Reason::kInconsistent : Reason::kAccepted;
      const int final = judged[x] ? judged[x] : static_cast<int>(why);
      reason[x] = static_cast<std::uint8_t>(final);
      q[x] = final ? kNaN : at;
    }
  }
}

}  // namespace countershade::capture

#include "capture/pattern/read/bits.h"

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

LaneBits binary_of(LaneBits gray) {
  for (int shift = 16; shift > 0; shift /= 2) gray ^= gray >> shift;
  return gray;
}

// Eight stored values, widened.
[[gnu::always_inline]] inline LaneMask stored(const std::uint8_t* from, int count) {
  return load_bytes(from, count);
}
[[gnu::always_inline]] inline LaneMask stored(const std::uint16_t* from, int count) {
  return __builtin_convertvector(load<LaneWords>(from, count), LaneMask);
}
[[gnu::always_inline]] inline Lanes stored(const float* from, int count) {
  return load<Lanes>(from, count);
}
inline Lanes light(LaneMask stored) {
  return __builtin_convertvector(stored, Lanes);
}
inline Lanes light(Lanes stored) {
  return stored;
}

}  // namespace

// One pass over the rows.
struct BitReading::Pass {
  const LevelPhotos& levels;
  const std::vector<Pair>& pairs;  // by axis, the fine ones first
  bool first = false, last = false;
  float noise = 0, photon = 0;  // min_snr^2 (2 read^2 + photon (plain + inverse))
  float gain = 1, offset = 0;   // of stored values
};

// The same row of all pairs.
template <class T>
struct BitReading::PairRows {
  struct Both {
    const T *plain, *inverse;
    std::uint32_t bit;
  };
  std::vector<Both> rows;
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
        const auto plain = photos.find(plan_.axis[a].bits[b].plain),
                   inverse = photos.find(plan_.axis[a].bits[b].inverse);
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
  for (int a = 0; a < 2; ++a) left += plan_.axis[a].bits.size() - std::count(read_[a].begin(), read_[a].end(), true);
  const std::size_t pixels = pairs.empty() ? 0 : std::size_t{1} * pairs[0].plain->width() * pairs[0].plain->height();
  if (pairs.empty() || (!all && pairs.size() < left && bytes < kWaiting * pixels)) return;
  const bool first = !levels_, last = pairs.size() == left;
  if (first) begin(level_photos);
  for (int a = 0; a < 2; ++a)
    if (axes_[a].bits && !last) fine_[a].resize(judged_.pixels());
  const double snr = options_.min_snr * options_.min_snr, read = levels_->noise.read;
  const Pass pass{level_photos,
                  pairs,
                  first,
                  last,
                  static_cast<float>(2 * snr * read * read),
                  static_cast<float>(snr * levels_->noise.photon),
                  pairs[0].plain->gain(),
                  pairs[0].plain->offset()};
  const auto all_store = [&]<class T>(T) {
    const auto does = [&](const StoredPhoto& p) {
      return p.linear_row<T>(0) != nullptr && p.gain() == pass.gain && p.offset() == pass.offset;
    };
    return std::all_of(pairs.begin(), pairs.end(), [&](const Pair& p) { return does(*p.plain) && does(*p.inverse); });
  };
  const bool bytes_only = all_store(std::uint8_t{}), words_only = all_store(std::uint16_t{});
  parallel_for((height_ + kBandRows - 1) / kBandRows, [&](int band) {
    const int first_row = band * kBandRows, last_row = std::min(height_, first_row + kBandRows);
    if (bytes_only)
      read_band<std::uint8_t>(pass, first_row, last_row);
    else if (words_only)
      read_band<std::uint16_t>(pass, first_row, last_row);
    else
      read_band<float>(pass, first_row, last_row);
  });
  done_ = last;
  for (const Pair& p : pairs) {
    const BitFrames& frames = plan_.axis[p.axis].bits[p.bit];
    read_[p.axis][p.bit] = true;
    photos.erase(frames.plain), photos.erase(frames.inverse);
  }
  photos.erase(plan_.white), photos.erase(plan_.black);
  if (done_) fine_ = {};
}

void BitReading::begin(const LevelPhotos& photos) {
  levels_ = measure_levels(photos);
  width_ = photos.photo[0]->width(), height_ = photos.photo[0]->height();
  parallel_for(3, [&](int a) {
    if (a == 2) {
      judged_ = Mask(width_, height_, 1), contrast_ = Image(width_, height_, 1);
      return;
    }
    const AxisCode& code = plan_.axis[a];
    read_[a].assign(code.bits.size(), false);
    if (code.bits.empty()) return;
    AxisReading& axis = axes_[a];
    axis.cell_px = code.cell_px, axis.length_px = code.length_px, axis.bits = static_cast<int>(code.bits.size());
    for (std::size_t b = 0; b < code.bits.size(); ++b)
      if (code.bits[b].base >= 0) axis.base = code.bits[b].base, combined_[a] |= 1u << b;
    axis.q = Image(width_, height_, 1), axis.sigma = Image(width_, height_, 1);
    axis.reason = Mask(width_, height_, 1);
    axis.code.resize(axis.q.pixels()), axis.uncertain.resize(axis.q.pixels());
  });
}

// Pixels that no code is read from: dark or saturated.
void BitReading::judge_row(const LevelPhotos& photos, int y, float* white, float* black) {
  std::uint8_t* reason = judged_.row(y);
  photos.row(y, white, black, reason);
  const double snr = options_.min_snr * options_.min_snr, read = levels_->noise.read;
  const auto noise = static_cast<float>(2 * snr * read * read),
             photon = static_cast<float>(snr * levels_->noise.photon);
  const Lanes dark = all(static_cast<float>(std::max(0.0, options_.dark_fraction * levels_->contrast))), none{};
  for_lanes(width_, [&](int x, auto count) {
    const auto w = load<Lanes>(white + x, count), b = load<Lanes>(black + x, count);
    const Lanes range = w - b;
    const LaneMask lit = (range > dark) & (range * range > noise + photon * (larger(w, none) + larger(b, none)));
    store(range, contrast_.row(y) + x, count);
    const auto saturated = load_bytes(reason + x, count) != 0;
    const LaneMask why = lit ? saturated & static_cast<int>(Reason::kSaturated)
                             : LaneMask{} + static_cast<int>(Reason::kDark);  // NaN is dark
    store_bytes(why, reason + x, count);
  });
}

// Where there is nothing to read.
template <class Count>
[[gnu::always_inline]] inline void BitReading::pass_over(int y, int x, Count count) {
  const LaneMask judged = load_bytes(judged_.row(y) + x, count);
  for (AxisReading& axis : axes_) {
    if (!axis.bits) continue;
    store_bytes(judged, axis.reason.row(y) + x, count);
    store(all(kNaN), axis.q.row(y) + x, count);
  }
}

// Whether light is direct at all, and the coordinates that bits say [px]: a cell's middle, or the border of two where
// the one bit in doubt decides between them (Gray code changes one bit from cell to cell).
template <class Count>
[[gnu::always_inline]] inline void BitReading::finish(int y, int x, Count count, const std::array<LaneBits, 2>& codes,
                                                      const std::array<LaneBits, 2>& doubts, Lanes fine,
                                                      Lanes contrast) {
  std::uint8_t* judged = judged_.row(y) + x;
  LaneMask why = load_bytes(judged, count);
  const LaneMask indirect = (why == 0) & (fine < static_cast<float>(options_.fine_modulation) * contrast);
  why = indirect ? LaneMask{} + static_cast<int>(Reason::kIndirect) : why;
  store_bytes(why, judged, count);
  for (int a = 0; a < 2; ++a) {
    AxisReading& axis = axes_[a];
    if (!axis.bits) continue;
    LaneBits code = codes[a], doubt = doubts[a];
    if (combined_[a]) {  // exclusive or is taken off; where the base bit is in doubt, so are the bits shown with it
      code ^= ((code >> axis.base) & 1) * combined_[a], doubt |= ((doubt >> axis.base) & 1) * combined_[a];
      const std::size_t at = static_cast<std::size_t>(y) * width_ + x;
      store(code, axis.code.data() + at, count), store(doubt, axis.uncertain.data() + at, count);
    }
    const auto cell = std::bit_cast<LaneMask>(binary_of(code)),
               other = std::bit_cast<LaneMask>(binary_of(code ^ doubt));
    const LaneMask said =
        std::bit_cast<LaneMask>((doubt & (doubt - 1)) == 0) & (cell - other <= 1) & (other - cell <= 1);
    const auto cell_px = static_cast<float>(axis.cell_px);
    const Lanes q = __builtin_convertvector(cell + other, Lanes) * (0.5f * cell_px) + 0.5f * (cell_px - 1);
    const LaneMask beyond = q > static_cast<float>(axis.length_px) - 0.5f;
    const LaneMask own =
        said ? beyond & static_cast<int>(Reason::kInconsistent) : LaneMask{} + static_cast<int>(Reason::kUncertainBit);
    const LaneMask final = why != 0 ? why : own;
    store_bytes(final, axis.reason.row(y) + x, count);
    store(final != 0 ? all(kNaN) : q, axis.q.row(y) + x, count);
  }
}

// Rows are brought together first: photos lie whole pages apart, where caches keep few lines.
template <class T>
void BitReading::read_band(const Pass& pass, int first_row, int last_row) {
  std::vector<T> values(static_cast<std::size_t>(width_) * 2 * pass.pairs.size());
  std::vector<float> levels(static_cast<std::size_t>(width_) * 2);
  PairRows<T> rows;
  for (std::size_t k = 0; k < pass.pairs.size(); ++k) {
    T* to = values.data() + 2 * k * width_;
    rows.rows.push_back({to, to + width_, 1u << pass.pairs[k].bit});
  }
  const auto bring = [&](const StoredPhoto& photo, int y, std::ptrdiff_t begin, std::ptrdiff_t end, T* to) {
    if constexpr (std::is_same_v<T, float>)
      photo.light_row(y, to);
    else
      std::copy(photo.linear_row<T>(y) + begin, photo.linear_row<T>(y) + end, to + begin);
  };
  for (int y = first_row; y < last_row; ++y) {
    if (pass.first) judge_row(pass.levels, y, levels.data(), levels.data() + width_);
    const std::uint8_t* judged = judged_.row(y);
    const auto is_lit = [](std::uint8_t reason) { return reason == 0; };
    const auto begin = std::find_if(judged, judged + width_, is_lit) - judged;
    const auto end =
        std::find_if(std::make_reverse_iterator(judged + width_), std::make_reverse_iterator(judged + begin), is_lit)
            .base() -
        judged;
    for (std::size_t k = 0; k < pass.pairs.size(); ++k) {
      bring(*pass.pairs[k].plain, y, begin, end, values.data() + 2 * k * width_);
      bring(*pass.pairs[k].inverse, y, begin, end, values.data() + (2 * k + 1) * width_);
    }
    read_row(pass, rows, y);
  }
}

// A bit is certain where its difference exceeds min_modulation of white - black, and `limit` by min_snr sigma (which
// takes no root when it is squared). A direct share d of the light makes +-d of a bit's difference, light by way of
// other surfaces up to +-(1 - d): the limit of coarse bits is what the latter can do against the former, 1 - 2 d (Xu &
// Aliaga 2007, robust pixel classification; their bounds for on and off, written for the difference). The strongest of
// several modulations is a few percent more than d.
template <class T>
void BitReading::read_row(const Pass& pass, const PairRows<T>& rows, int y) {
  const std::size_t start = static_cast<std::size_t>(y) * width_;
  const auto modulation = static_cast<float>(options_.min_modulation);
  // In stored values: gain^2 difference^2 > noise + photon (gain sum + 2 offset).
  constexpr bool kWhole = !std::is_same_v<T, float>;
  const float gain = kWhole ? pass.gain : 1, offset = kWhole ? pass.offset : 0;
  const Lanes none{}, noise = all(pass.noise), photon = all(pass.photon), scale = all(gain), twice = all(2 * offset);
  const auto* both = rows.rows.data();
  // Of each axis: how many of the pairs are fine, and where its pairs end.
  std::array<std::array<std::size_t, 2>, 2> ends{};
  for (std::size_t k = 0; k < pass.pairs.size(); ++k)
    for (int a = 0; a < 2; ++a)
      if (pass.pairs[k].axis <= a)
        ends[a][1] = k + 1, ends[a][0] = pass.pairs[k].fine || pass.pairs[k].axis < a ? k + 1 : ends[a][0];
  for_lanes(width_, [&](int x, auto count) {
    const LaneMask judged = load_bytes(judged_.row(y) + x, count);
    if (!any((kLane < int{count}) & (judged == 0))) {
      if (pass.last) pass_over(y, x, count);
      return;
    }
    const auto contrast = load<Lanes>(contrast_.row(y) + x, count);
    const Lanes least = modulation * contrast;
    std::array<LaneBits, 2> codes{}, doubts{};
    Lanes direct{};
    std::size_t k = 0;
    for (int a = 0; a < 2; ++a) {
      if (!axes_[a].bits) continue;
      LaneBits code{}, doubt{};
      Lanes fine{};
      if (!pass.first) {
        fine = load<Lanes>(fine_[a].data() + start + x, count);
        code = load<LaneBits>(axes_[a].code.data() + start + x, count);
        doubt = load<LaneBits>(axes_[a].uncertain.data() + start + x, count);
      }
      const auto read = [&](Lanes limit) __attribute__((always_inline)) {
        const auto plain = stored(both[k].plain + x, count), inverse = stored(both[k].inverse + x, count);
        const Lanes difference = light(plain - inverse) * scale, sum = light(plain + inverse) * scale + twice;
        const Lanes size = absolute(difference), left = larger(size - limit, none);
        const LaneMask certain = (left * left > noise + photon * larger(sum, none)) & (size > least);
        code |= std::bit_cast<LaneBits>(difference > 0) & both[k].bit;
        doubt |= ~std::bit_cast<LaneBits>(certain) & both[k].bit;
        return size;
      };
      for (; k < ends[a][0]; ++k) fine = larger(fine, read(none));
      direct = larger(direct, fine);
      const Lanes limit = larger(contrast - 1.8f * direct, none);
      for (; k < ends[a][1]; ++k) read(limit);
      if (!pass.last) store(fine, fine_[a].data() + start + x, count);
      store(code, axes_[a].code.data() + start + x, count);
      store(doubt, axes_[a].uncertain.data() + start + x, count);
      codes[a] = code, doubts[a] = doubt;
    }
    if (pass.last) finish(y, x, count, codes, doubts, direct, contrast);
  });
}

}  // namespace countershade::capture

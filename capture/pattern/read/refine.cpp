#include "capture/pattern/read/refine.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>

#include "calib/base/lanes.h"
#include "calib/base/parallel.h"
#include "capture/pattern/pattern.h"
#include "capture/pattern/read/half_lit.h"

namespace countershade::capture {

namespace {

constexpr int kRadius = 3, kSide = 2 * kRadius + 1;
constexpr int kFewest = 10;     // readings in a window that can support anything
constexpr float kReach = 1.6f;  // cells: neighbours may round to either side, and borders read half a cell
constexpr int kBandRows = 16;   // one task
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Eight neighbouring pixels are looked at together, or the seven columns of a window.
constexpr Lanes kColumn = {-3, -2, -1, 0, 1, 2, 3, 0};

// The readings of one axis, NaN where there is none, with a border of missing ones: windows end nowhere.
class Field {
 public:
  explicit Field(const Image& q)
      : width_(q.width()),
        height_(q.height()),
        stride_((q.width() + kLanes - 1) / kLanes * kLanes + 2 * kLanes),
        values_(std::make_unique_for_overwrite<float[]>(static_cast<std::size_t>(stride_) * (height_ + 2 * kRadius))) {
    parallel_for((height_ + 2 * kRadius + kBandRows - 1) / kBandRows, [&](int band) {
      for (int y = band * kBandRows - kRadius; y < std::min(height_ + kRadius, (band + 1) * kBandRows - kRadius); ++y) {
        float* to = values_.get() + static_cast<std::ptrdiff_t>(stride_) * (y + kRadius);
        const bool inside = y >= 0 && y < height_;
        std::fill(to, to + kLanes, kNaN);
        if (inside) std::copy(q.row(y), q.row(y) + width_, to + kLanes);
        std::fill(to + kLanes + (inside ? width_ : 0), to + stride_, kNaN);
      }
    });
  }
  int width() const { return width_; }
  int height() const { return height_; }
  // x from -kLanes, y from -kRadius.
  const float* at(int x, int y) const {
    return values_.get() + static_cast<std::ptrdiff_t>(stride_) * (y + kRadius) + x + kLanes;
  }

 private:
  int width_, height_, stride_;
  std::unique_ptr<float[]> values_;
};

// The readings of one window, NaN where there is none.
struct Window {
  std::array<Lanes, kSide> rows;  // the last lane is never a reading
  int count = 0;
  float value(int line, int column) const { return rows[line][column]; }
};

Window window_at(const Field& q, int x, int y) {
  Window w;
  LaneMask finite{};
  for (int line = 0; line < kSide; ++line) {
    Lanes row = load<Lanes>(q.at(x - kRadius, y + line - kRadius));
    row[kSide] = kNaN;
    w.rows[line] = row;
    finite += row == row;  // -1 each
  }
  w.count = count_of(finite);
  return w;
}

template <std::size_t N>
float median(std::array<float, N>& values, int count) {
  std::nth_element(values.begin(), values.begin() + count / 2, values.begin() + count);
  return values[count / 2];
}

// Median slope along the rows or the columns of a window, from pairs of readings as far apart as it has enough of: at
// the border of the photo or of a surface only one side of it is there.
std::optional<float> slope(const Window& w, bool along_rows) {
  std::array<float, 4 * kSide> slopes{};
  int count = 0;
  for (int reach = kSide - 1; reach >= kRadius && count < kSide; --reach)
    for (int line = 0; line < kSide; ++line)
      for (int start = 0; start + reach < kSide; ++start) {
        const float low = along_rows ? w.value(line, start) : w.value(start, line),
                    high = along_rows ? w.value(line, start + reach) : w.value(start + reach, line);
        if (std::isfinite(low) && std::isfinite(high) && count < static_cast<int>(slopes.size()))
          slopes[count++] = (high - low) / static_cast<float>(reach);
      }
  if (count == 0) return std::nullopt;
  return median(slopes, count);
}

// Slopes of the middles of 4 x 4 pixels, NaN where their windows have none: surfaces are smooth, so the pixels around
// share them. A pixel whose block has none is asked itself.
constexpr int kBlock = 4;
struct Slopes {
  Image x, y;

  explicit Slopes(const Field& q)
      : x(q.width() / kBlock + 1 + kLanes, q.height() / kBlock + 1, 1, kNaN), y(x.width(), x.height(), 1, kNaN) {
    parallel_for(x.height(), [&](int by) {
      for (int bx = 0; bx + kLanes <= x.width(); bx += kLanes) measure(q, bx, by);
    });
  }
  bool of_block(int bx, int by, float& gx, float& gy) const {
    if (bx < 0 || by < 0 || bx >= x.width() || by >= x.height()) return false;
    gx = x.at(bx, by), gy = y.at(bx, by);
    return std::isfinite(gx) && std::isfinite(gy);
  }
  // Of the pixel's window; false where there is none.
  bool of(const Window& w, int px, int py, float& gx, float& gy) const {
    if (of_block(px / kBlock, py / kBlock, gx, gy)) return true;
    const auto own_x = slope(w, true), own_y = slope(w, false);
    if (!own_x || !own_y) return false;
    gx = *own_x, gy = *own_y;
    return true;
  }

 private:
  // Eight blocks; where nothing is missing, the median of seven slopes across the whole window is all that is asked.
  void measure(const Field& q, int bx, int by) {
    std::array<Lanes, kSide> across{}, down{};
    for (int lane = 0; lane < kLanes; ++lane) {
      const int px = (bx + lane) * kBlock + kBlock / 2, py = by * kBlock + kBlock / 2;
      if (px - kBlock / 2 > q.width() || py - kBlock / 2 > q.height()) break;
      const Window w = window_at(q, std::min(q.width() - 1, px), std::min(q.height() - 1, py));
      if (w.count < kSide * kSide * 3 / 4) {  // beside an edge every pixel has its own
        across[0][lane] = kNaN;
      } else if (w.count < kSide * kSide) {
        if (const auto gx = slope(w, true)) x.at(bx + lane, by) = *gx;
        if (const auto gy = slope(w, false)) y.at(bx + lane, by) = *gy;
        across[0][lane] = kNaN;
      }
      const Lanes drop = w.rows[kSide - 1] - w.rows[0];
      for (int i = 0; i < kSide; ++i) {
        if (w.count == kSide * kSide) across[i][lane] = w.rows[i][kSide - 1] - w.rows[i][0];
        down[i][lane] = drop[i];
      }
    }
    const LaneMask whole = across[0] == across[0];
    const Lanes gx = median_of_seven(across) / static_cast<float>(kSide - 1),
                gy = median_of_seven(down) / static_cast<float>(kSide - 1);
    for (int lane = 0; lane < kLanes; ++lane)
      if (whole[lane]) x.at(bx + lane, by) = gx[lane], y.at(bx + lane, by) = gy[lane];
  }
};

// Where the window's readings put its centre: their median once the slopes are taken off.
float centre_of(const Window& w, float gx, float gy) {
  std::array<float, kSide * kSide> level{};
  int count = 0;
  for (int line = 0; line < kSide; ++line)
    for (int column = 0; column < kSide; ++column)
      if (const float value = w.value(line, column); std::isfinite(value))
        level[count++] = value - gx * static_cast<float>(column - kRadius) - gy * static_cast<float>(line - kRadius);
  return median(level, count);
}

// Sums of the least-squares fit r = c + a dx + b dy, of eight pixels' windows.
struct Sums {
  Lanes n{}, x{}, y{}, xx{}, xy{}, yy{}, r{}, xr{}, yr{}, rr{};
  Lanes edges{};  // readings that are a border between two cells
};

// Planes through the readings that agree with a centre, at the centre.
struct Planes {
  Lanes value{}, sigma{};  // sigma 0: those that agree do not span a plane
  Lanes agree{}, count{};  // of the readings of the window
};

// Where eight windows are: at the first of eight pixels; flags: 1 where a reading is a border, first of seven rows.
struct Place {
  const Field& q;
  int x, y;
  const std::uint8_t* flags;
  std::ptrdiff_t flags_stride;
};

// Readings are rounded to cells. A share e of them are borders, each of a zone up to 2 e cells wide (where every last
// bit is lost, borders are all that is read, two cells apart), the rest cells less their borders, so rounding has the
// variance cell^2 ((1 - e)^3 + 4 e^3) / 12. What the residuals show of it averages out (slowly: errors repeat along
// lines of equal code and swing only once or twice across a window, so that four pixels count as one); what they do not
// show, by more than a quarter, has gone into the plane unseen.
[[gnu::always_inline]] inline void solve(const Sums& s, Lanes centre, float cell, Planes& planes) {
  // Normal equations by Cramer's rule.
  const Lanes cx = s.xx * s.yy - s.xy * s.xy, cy = s.xy * s.y - s.x * s.yy, cz = s.x * s.xy - s.xx * s.y;
  const Lanes determinant = s.n * cx + s.x * cy + s.y * cz;
  const LaneMask spans = (s.n >= 6) & (determinant > 1e-3f * s.n * s.xx * s.yy);
  const Lanes scale = 1 / determinant;
  const Lanes c = (s.r * cx + s.xr * cy + s.yr * cz) * scale;
  const Lanes a = (s.r * cy + s.xr * (s.n * s.yy - s.y * s.y) + s.yr * (s.x * s.y - s.n * s.xy)) * scale;
  const Lanes b = (s.r * cz + s.xr * (s.x * s.y - s.n * s.xy) + s.yr * (s.n * s.xx - s.x * s.x)) * scale;
  const Lanes left = larger(s.rr - c * s.r - a * s.xr - b * s.yr, Lanes{}) * (1 / larger(s.n - 3, all(1)));
  const Lanes e = s.edges * (1 / s.n), inner = 1 - e;
  const Lanes rounding = cell * cell / 12 * (inner * inner * inner + 4 * e * e * e);
  planes.agree = s.n;
  planes.value = centre + c;
  planes.sigma = masked(spans, root(4 * left * (cx * scale) + larger(rounding - 1.25f * left, all(4e-4f))));
}

// Sums over one line of the windows of eight pixels, of readings less a plane that is common to four rows of them.
struct LineSums {
  Lanes sum{}, xsum{}, squares{}, highest, lowest;
  [[gnu::always_inline]] LineSums(const float* line, Lanes plane, Lanes gx) {
    highest = all(-HUGE_VALF), lowest = all(HUGE_VALF);
#pragma GCC unroll 7
    for (int column = -kRadius; column <= kRadius; ++column) {
      const auto dx = static_cast<float>(column);
      const Lanes off = load<Lanes>(line + column) - (plane + dx * gx);
      sum += off, xsum += dx * off, squares += off * off;
      highest = larger(highest, off), lowest = smaller(lowest, off);
    }
  }
  LineSums() = default;
};

// Where all readings of a window agree, all sums are those of its seven lines, and those of positions are known.
// centre: less the common plane. Gives the lanes of which that is true; `planes` is right in those.
[[gnu::always_inline]] inline LaneMask fit_whole(const LineSums* lines, Lanes centre, Lanes edges, float cell,
                                                 Planes& planes) {
  Sums s;
  Lanes sum{}, highest = lines[0].highest, lowest = lines[0].lowest;
  for (int line = 0; line < kSide; ++line) {
    sum += lines[line].sum, s.xr += lines[line].xsum, s.rr += lines[line].squares;
    s.yr += static_cast<float>(line - kRadius) * lines[line].sum;
    highest = larger(highest, lines[line].highest), lowest = smaller(lowest, lines[line].lowest);
  }
  constexpr auto kCount = static_cast<float>(kSide * kSide);
  const Lanes reach = all(kReach * cell);
  const LaneMask whole = (highest - centre <= reach) & (lowest - centre >= -reach) & (s.rr == s.rr);  // NaN: not all
  s.r = sum - kCount * centre, s.rr += centre * (kCount * centre - 2 * sum);
  s.n = all(kCount), s.xx = s.yy = all(kCount * kRadius * (kRadius + 1) / 3.0f), s.edges = edges;
  solve(s, centre, cell, planes);
  planes.count = s.n;
  return whole;
}

Planes fit_agreeing(const Place& p, Lanes centre, Lanes gx, Lanes gy, float cell) {
  const Lanes reach = all(kReach * cell);
  Sums s;
  LaneMask count{}, edges{};
  for (int line = -kRadius; line <= kRadius; ++line) {
    const auto dy = static_cast<float>(line);
    const float* row = p.q.at(p.x, p.y + line);
    const std::uint8_t* flags = p.flags + (line + kRadius) * p.flags_stride;
    const Lanes across = centre + dy * gy;
    Lanes n{}, x{}, xx{}, r{};
    for (int column = -kRadius; column <= kRadius; ++column) {
      const auto dx = static_cast<float>(column);
      const Lanes value = load<Lanes>(row + column), off = value - (across + dx * gx);
      const LaneMask agrees = absolute(off) <= reach;
      const Lanes one = masked(agrees, all(1)), residual = masked(agrees, off);
      count -= value == value, edges += agrees & load_bytes(flags + column);
      n += one, x += dx * one, xx += dx * dx * one;
      r += residual, s.xr += dx * residual, s.rr += residual * residual;
    }
    s.n += n, s.x += x, s.xx += xx, s.y += dy * n, s.xy += dy * x, s.yy += dy * dy * n;
    s.r += r, s.yr += dy * r;
  }
  s.edges = __builtin_convertvector(edges, Lanes);
  Planes planes;
  solve(s, centre, cell, planes);
  planes.count = __builtin_convertvector(count, Lanes);
  return planes;
}

// Whether a cell within one and a half of q has all the certain bits of the pixel.
bool confirmed(float q, std::uint32_t code, std::uint32_t uncertain, const AxisReading& reading) {
  const float cell = static_cast<float>(reading.cell_px);
  const int nearest = static_cast<int>(std::lround((q - 0.5f * (cell - 1)) / cell));
  for (int candidate = nearest - 1; candidate <= nearest + 1; ++candidate)
    if (candidate >= 0 && candidate * reading.cell_px < reading.length_px &&
        ((gray_from_binary(static_cast<unsigned>(candidate)) ^ code) & ~uncertain) == 0)
      return true;
  return false;
}

// Whether q is within half a cell of an edge of the base bit: there light is half of both, whatever the bits combined
// with it are.
bool on_base_edge(float q, const AxisReading& reading) {
  const float cell = static_cast<float>(reading.cell_px);
  const int left = static_cast<int>(std::floor((q - 0.5f * (cell - 1)) / cell));
  if (left < 0) return false;
  return ((gray_from_binary(static_cast<unsigned>(left)) ^ gray_from_binary(static_cast<unsigned>(left) + 1)) >>
          reading.base) &
         1;
}

// Whether the bit that others were shown in exclusive or with is in doubt, at its edge.
bool at_base_edge(std::size_t i, const AxisReading& reading) {
  return reading.base >= 0 && ((reading.uncertain[i] >> reading.base) & 1);
}

// Whether enough of a pixel's bits are certain to complete it.
bool may_be_completed(std::size_t i, const AxisReading& reading) {
  return at_base_edge(i, reading) || 2 * std::popcount(reading.uncertain[i]) <= reading.bits;
}

// Whether all certain bits of a pixel are those of q, which its neighbours say.
bool completes(float q, std::size_t i, const AxisReading& reading) {
  return (!at_base_edge(i, reading) || on_base_edge(q, reading)) &&
         confirmed(q, reading.code[i], reading.uncertain[i], reading);
}

void widen_by_surroundings(AxisReading& reading, const Mask& dark, int x, int y, float gx, float gy) {
  const float pull =
      dark.at(x, y) ? pull_beside_darkness(reading.contrast, x, y) : pull_of_surroundings(reading.contrast, x, y);
  float& sigma = reading.sigma.at(x, y);
  sigma = std::sqrt(sigma * sigma + pull * pull * (gx * gx + gy * gy));
}

}  // namespace

namespace {

// Refines bands of rows of an axis, eight pixels at a time.
class Refiner {
 public:
  explicit Refiner(AxisReading& reading)
      : reading_(reading), q_(reading.q), slopes_(q_), cell_(static_cast<float>(reading.cell_px)) {}

  void run() {
    parallel_for((q_.height() + kBandRows - 1) / kBandRows, [&](int band) {
      Band b(q_.width());
      const int first = band * kBandRows, last = std::min(q_.height(), first + kBandRows);
      for (int y = first - kRadius; y < last + kRadius; ++y) flag_edges(b, y - first + kRadius, y);
      for (int line = 0; line < last - first; ++line) count_edges(b, line), find_brightest(b, line, first + line);
      for (int y = first; y < last; y += kBlock)
        for_lanes(q_.width(), [&](int x, auto count) { refine_block(b, x, y, y - first, count); });
    });
  }

 private:
  // Of the rows of a band and those around; x from -kLanes.
  struct Band {
    int stride;
    std::vector<std::uint8_t> flags, edges, columns;  // a reading is a border; how many there are in a window, a column
    std::vector<float> brightest, highest;            // contrast within two pixels; within two rows
    explicit Band(int width)
        : stride((width + kLanes - 1) / kLanes * kLanes + 2 * kLanes),
          flags(static_cast<std::size_t>(stride) * (kBandRows + 2 * kRadius)),
          edges(static_cast<std::size_t>(stride) * kBandRows),
          columns(stride),
          brightest(static_cast<std::size_t>(stride) * kBandRows),
          highest(stride) {}
    template <class T>
    auto* at(T& rows, int x, int line) const {
      return rows.data() + static_cast<std::ptrdiff_t>(stride) * line + kLanes + x;
    }
  };
  // Eight pixels: what is known of them before their windows are looked at. Slopes are their own where their block has
  // none.
  struct Eight {
    LaneMask read{}, doubtful{};
    Lanes centre{}, gx{}, gy{};
  };

  void flag_edges(Band& band, int line, int y) const {
    const float half = 0.5f * (cell_ - 1), per_cell = 1 / cell_;
    for (int x = 0; x < q_.width(); x += kLanes) {  // coordinates are beyond -1: truncation rounds
      const Lanes in_cells = (load<Lanes>(q_.at(x, y)) - half) * per_cell;
      const Lanes cells = __builtin_convertvector(__builtin_convertvector(in_cells + 0.5f, LaneMask), Lanes);
      store_bytes((absolute(in_cells - cells) > 0.25f) & 1, band.at(band.flags, x, line));
    }
  }
  void count_edges(Band& band, int line) const {
    const std::uint8_t* flags = band.at(band.flags, -kLanes, line);
    std::uint8_t *columns = band.columns.data(), *edges = band.at(band.edges, 0, line);
    const int stride = band.stride, width = stride - 2 * kLanes;
    for (int x = 0; x < stride; ++x)
      columns[x] =
          static_cast<std::uint8_t>(flags[x] + flags[x + stride] + flags[x + 2 * stride] + flags[x + 3 * stride] +
                                    flags[x + 4 * stride] + flags[x + 5 * stride] + flags[x + 6 * stride]);
    const std::uint8_t* c = columns + kLanes - kRadius;
    for (int x = 0; x < width; ++x)
      edges[x] = static_cast<std::uint8_t>(c[x] + c[x + 1] + c[x + 2] + c[x + 3] + c[x + 4] + c[x + 5] + c[x + 6]);
  }
  void find_brightest(Band& band, int line, int y) const {
    const Image& contrast = reading_.contrast;
    float *highest = band.at(band.highest, 0, 0), *brightest = band.at(band.brightest, 0, line);
    for_lanes(q_.width(), [&](int x, auto count) {
      Lanes most{};
      for (int ny = std::max(0, y - 2); ny <= std::min(contrast.height() - 1, y + 2); ++ny)
        most = larger(load<Lanes>(contrast.row(ny) + x, count), most);
      store(most, highest + x);
    });
    for (int x = 0; x < q_.width(); x += kLanes) {
      Lanes most = load<Lanes>(highest + x);
      for (const int dx : {-2, -1, 1, 2}) most = larger(load<Lanes>(highest + x + dx), most);
      store(most, brightest + x);
    }
  }

  template <class Count>
  void refine_block(const Band& band, int x, int y, int line, Count count);
  template <class Count>
  void judge(const Eight& lanes, const Planes& planes, const float* brightest, int x, int y, Count count);
  template <class Count>
  Eight look(int x, int y, Lanes gx, Lanes gy, Count count) const;

  AxisReading& reading_;
  Field q_;
  Slopes slopes_;
  float cell_;
};

// Which of eight pixels are read or in doubt, where their windows are centred, and their slopes, given those of their
// blocks. What has no support is left out of both.
template <class Count>
Refiner::Eight Refiner::look(int x, int y, Lanes gx, Lanes gy, Count count) const {
  Eight lanes{.centre = load<Lanes>(q_.at(x, y)), .gx = gx, .gy = gy};
  const LaneMask reasons = load_bytes(reading_.reason.row(y) + x, count), here = kLane < int{count};
  lanes.read = here & (reasons == static_cast<int>(Reason::kAccepted));
  const LaneMask unasked = lanes.read & ~((gx == gx) & (gy == gy));
  LaneMask doubtful = here & (reasons == static_cast<int>(Reason::kUncertainBit));
  if (!any(unasked | doubtful)) return lanes;
  const std::size_t start = static_cast<std::size_t>(y) * q_.width() + x;
  for (int i = 0; i < count; ++i) {
    if (!unasked[i] && !(doubtful[i] && may_be_completed(start + i, reading_))) continue;
    const Window w = window_at(q_, x + i, y);
    float own_x = 0, own_y = 0;
    const bool supported = w.count >= kFewest && slopes_.of(w, x + i, y, own_x, own_y);
    if (unasked[i]) lanes.read[i] = supported ? -1 : 0;
    if (!supported) continue;
    lanes.gx[i] = own_x, lanes.gy[i] = own_y;
    if (doubtful[i]) lanes.doubtful[i] = -1, lanes.centre[i] = centre_of(w, own_x, own_y);
  }
  return lanes;
}

// Two blocks of four rows: their windows share lines and slopes.
template <class Count>
void Refiner::refine_block(const Band& band, int x, int y, int line, Count count) {
  const int rows = std::min(kBlock, q_.height() - y);
  const int bx = x / kBlock;
  static_assert(kLanes == 2 * kBlock);
  const float *block_x = slopes_.x.row(y / kBlock) + bx, *block_y = slopes_.y.row(y / kBlock) + bx;
  const Lanes gx = kLane < kBlock ? all(block_x[0]) : all(block_x[1]),
              gy = kLane < kBlock ? all(block_y[0]) : all(block_y[1]);
  std::array<Eight, kBlock> eights;
  Lanes plane = all(kNaN);
  LaneMask wanted{};
  for (int row = 0; row < rows; ++row) {
    eights[row] = look(x, y + row, gx, gy, count);
    plane = plane == plane ? plane : eights[row].centre, wanted |= eights[row].read | eights[row].doubtful;
  }
  std::array<LineSums, kBlock + 2 * kRadius> lines;
  if (any(wanted))
    for (int i = 0; i < rows + 2 * kRadius; ++i)
      lines[i] = LineSums(q_.at(x, y + i - kRadius), plane + static_cast<float>(i - kRadius) * gy, gx);
  for (int row = 0; row < rows; ++row) {
    const Eight& lanes = eights[row];
    const LaneMask these = lanes.read | lanes.doubtful;
    Planes planes;
    const LaneMask reasons = load_bytes(reading_.reason.row(y + row) + x, count);
    if (!any(these | (reasons == 0))) continue;  // nothing was read
    if (any(these)) {
      const Lanes edges = __builtin_convertvector(load_bytes(band.at(band.edges, x, line + row)), Lanes);
      const Lanes above = plane + static_cast<float>(row) * gy;
      const LaneMask whole = fit_whole(&lines[row], lanes.centre - above, edges, cell_, planes);
      planes.value += above;
      if (any(these & ~whole))
        planes = fit_agreeing({q_, x, y + row, band.at(band.flags, x, line + row), band.stride}, lanes.centre, lanes.gx,
                              lanes.gy, cell_);
    }
    judge(lanes, planes, band.at(band.brightest, x, line + row), x, y + row, count);
  }
}

template <class Count>
void Refiner::judge(const Eight& lanes, const Planes& planes, const float* brightest, int x, int y, Count count) {
  std::uint8_t* reason = reading_.reason.row(y) + x;
  const LaneMask supported = (planes.agree >= 6) & (planes.agree >= 0.3f * planes.count) & (planes.count >= kFewest);
  const LaneMask spans = planes.sigma > 0;
  // A line of pixels supports it but spans no plane: the reading stays.
  Lanes value = spans ? planes.value : lanes.centre, error = spans ? planes.sigma : all(0.29f * cell_);
  const auto here = load<Lanes>(reading_.contrast.row(y) + x, count);
  const Lanes pull = 0.8f * larger(1 - 1.1f * here / load<Lanes>(brightest), Lanes{});
  error = root(error * error + pull * pull * (lanes.gx * lanes.gx + lanes.gy * lanes.gy));
  LaneMask accepted = lanes.read & supported;
  if (any(~accepted)) {
    const LaneMask candidates = lanes.doubtful & supported & spans & (planes.agree >= 0.7f * planes.count);
    for (int i = 0; i < count; ++i) {
      const std::size_t at = static_cast<std::size_t>(y) * q_.width() + x + i;
      const auto why = static_cast<Reason>(reason[i]);
      if (candidates[i] && completes(value[i], at, reading_)) accepted[i] = -1;
      if (accepted[i])
        reason[i] = static_cast<std::uint8_t>(Reason::kAccepted);
      else if (why == Reason::kAccepted)
        reason[i] = static_cast<std::uint8_t>(lanes.read[i] && planes.count[i] >= kFewest ? Reason::kInconsistent
                                                                                          : Reason::kIsolated);
    }
  }
  store(accepted ? value : all(kNaN), reading_.q.row(y) + x, count);
  store(accepted ? error : all(kNaN), reading_.sigma.row(y) + x, count);
}

}  // namespace

void refine_by_neighbours(AxisReading& reading) {
  Refiner(reading).run();
}

namespace {

// How many of a window's readings agree with one at its centre.
int agreeing(const Window& w, float centre, float gx, float gy, float reach) {
  const Lanes across = all(centre) + gx * kColumn;
  LaneMask agree{};
  for (int line = 0; line < kSide; ++line) {
    const Lanes off = w.rows[line] - (across + static_cast<float>(line - kRadius) * gy);
    agree += (off <= reach) & (off >= -reach);  // -1 each
  }
  return count_of(agree);
}

}  // namespace

void check_by_neighbours(AxisReading& reading, const Image& other) {
  const Image raw = reading.q;
  Image judges = raw;  // doubtful readings judge only where there are hardly others
  for (std::size_t i = 0; i < judges.data().size(); ++i)
    if (reading.reason.data()[i]) judges.data()[i] = kNaN;
  const Field field(raw), judging(judges);
  const Slopes slopes(judging);
  const Mask dark = beside_darkness(reading.reason);
  parallel_for(raw.height(), [&](int y) {
    for (int x = 0; x < raw.width(); ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * raw.width() + x;
      if (!std::isfinite(raw.data()[i])) continue;
      const bool certain = std::isfinite(judges.data()[i]);
      Window w = window_at(judging, x, y);
      if (w.count < 2 * kFewest) w = window_at(field, x, y);
      Reason why = Reason::kIsolated;
      float gx = 0, gy = 0;
      if (w.count >= kFewest && slopes.of(w, x, y, gx, gy)) {
        // Surfaces bend, and pixels are noisy; another way to unwrap is many pixels away.
        const float reach = std::clamp(5 * reading.sigma.data()[i], 1.5f, 6.0f);
        const float least = certain ? 0.3f : 0.7f;
        why = certain ? Reason::kInconsistent : Reason::kUncertainBit;
        // Beside a crease the slope around is that of one side or of neither: the sides' own lie two blocks away.
        static constexpr int kAround[5][2] = {{0, 0}, {0, -2}, {0, 2}, {-2, 0}, {2, 0}};
        for (const auto& [bx, by] : kAround) {
          if ((bx || by) && !slopes.of_block(x / kBlock + bx, y / kBlock + by, gx, gy)) continue;
          for (const float q : {raw.data()[i], other.data()[i]}) {
            if (why == Reason::kAccepted || !std::isfinite(q)) continue;
            const int agree = agreeing(w, q, gx, gy, reach);
            if (agree < 6 || static_cast<float>(agree) < least * static_cast<float>(w.count)) continue;
            reading.q.data()[i] = q, why = Reason::kAccepted;
            widen_by_surroundings(reading, dark, x, y, gx, gy);
          }
          if (why == Reason::kAccepted) break;
        }
      }
      reading.reason.data()[i] = static_cast<std::uint8_t>(why);
    }
  });
  for (std::size_t i = 0; i < reading.q.data().size(); ++i)
    if (reading.reason.data()[i]) reading.q.data()[i] = kNaN;
  join_half_lit(reading);
}

}  // namespace countershade::capture

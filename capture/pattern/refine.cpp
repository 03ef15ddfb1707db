#include "capture/pattern/refine.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "calib/base/parallel.h"
#include "capture/pattern/half_lit.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

namespace {

constexpr int kRadius = 3, kSide = 2 * kRadius + 1;
constexpr int kFewest = 10;  // readings in a window that can support anything
constexpr int kStride = 8;   // floats in a row of a window: the last one is never a reading
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Eight floats at once; comparisons give masks of all bits (GCC and Clang).
using Row = float __attribute__((vector_size(4 * kStride)));
using RowMask = std::int32_t __attribute__((vector_size(4 * kStride)));
constexpr Row kColumn = {-3, -2, -1, 0, 1, 2, 3, 0};

Row masked(RowMask mask, Row values) {
  return std::bit_cast<Row>(mask & std::bit_cast<RowMask>(values));
}
float sum(Row r) {
  float s = 0;
  for (int i = 0; i < kStride; ++i) s += r[i];
  return s;
}
Row all(float v) {
  return Row{} + v;
}

// The readings of one window, NaN where there is none.
struct Window {
  std::array<Row, kSide> rows;
  int count = 0;
  float value(int line, int column) const { return rows[line][column]; }
};

Window window_at(const Image& q, int x, int y) {
  Window w;
  const bool inside = x >= kRadius && x + kRadius + 1 < q.width();
  RowMask finite{};
  for (int line = 0; line < kSide; ++line) {
    Row row = all(kNaN);
    const int ny = y + line - kRadius;
    if (ny >= 0 && ny < q.height()) {
      const float* from = q.row(ny) + x - kRadius;
      if (inside) {
        std::memcpy(&row, from, sizeof row);
        row[kSide] = kNaN;
      } else {
        for (int column = 0; column < kSide; ++column)
          if (x + column - kRadius >= 0 && x + column - kRadius < q.width()) row[column] = from[column];
      }
    }
    w.rows[line] = row;
    finite += row == row;  // -1 each
  }
  for (int i = 0; i < kStride; ++i) w.count -= finite[i];
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

  explicit Slopes(const Image& q)
      : x(q.width() / kBlock + 1, q.height() / kBlock + 1, 1, kNaN), y(x.width(), x.height(), 1, kNaN) {
    parallel_for(x.height(), [&](int by) {
      for (int bx = 0; bx < x.width(); ++bx) {
        const Window w = window_at(q, std::min(q.width() - 1, bx * kBlock + kBlock / 2),
                                   std::min(q.height() - 1, by * kBlock + kBlock / 2));
        if (w.count < kSide * kSide * 3 / 4) continue;  // beside an edge every pixel has its own
        if (const auto gx = slope(w, true)) x.at(bx, by) = *gx;
        if (const auto gy = slope(w, false)) y.at(bx, by) = *gy;
      }
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

// Plane through the readings that agree with `centre`, at the centre.
struct Plane {
  float value = 0, sigma = 0;  // sigma 0: those that agree do not span a plane
  int agree = 0;
};

// Sums of the least-squares fit r = c + a dx + b dy.
struct Sums {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0, r = 0, xr = 0, yr = 0, rr = 0;
  double edges = 0;  // readings that are a border between two cells
};

Sums sum_up(const Window& w, float centre, float gx, float gy, float cell) {
  // Neighbours may round to either side, and borders read half a cell.
  const Row reach = all(1.6f * cell), half = all(0.5f * (cell - 1)), per_cell = all(1 / cell);
  const Row across = all(centre) + gx * kColumn;
  Row n{}, r{}, rr{}, ny{}, nyy{}, ry{}, edges{};
  for (int line = 0; line < kSide; ++line) {
    const auto dy = static_cast<float>(line - kRadius);
    const Row value = w.rows[line], off = value - (across + dy * gy);
    const RowMask agrees = (off <= reach) & (off >= -reach);  // NaN never agrees
    const Row one = masked(agrees, all(1)), residual = masked(agrees, off);
    const Row in_cells = masked(agrees, (value - half) * per_cell);
    const Row away = in_cells - __builtin_convertvector(__builtin_convertvector(in_cells + 0.5f, RowMask), Row);
    edges += masked((away > 0.25f) | (away < -0.25f), one);  // coordinates are beyond -1: truncation rounds
    n += one, ny += dy * one, nyy += dy * dy * one;
    r += residual, ry += dy * residual, rr += residual * residual;
  }
  Sums s;
  s.n = sum(n), s.x = sum(n * kColumn), s.xx = sum(n * kColumn * kColumn);
  s.y = sum(ny), s.xy = sum(ny * kColumn), s.yy = sum(nyy);
  s.r = sum(r), s.xr = sum(r * kColumn), s.yr = sum(ry), s.rr = sum(rr), s.edges = sum(edges);
  return s;
}

// Readings are rounded to cells. A share e of them are borders, each of a zone up to 2 e cells wide (where every last
// bit is lost, borders are all that is read, two cells apart), the rest cells less their borders, so rounding has the
// variance cell^2 ((1 - e)^3 + 4 e^3) / 12. What the residuals show of it averages out (slowly: errors repeat along
// lines of equal code and swing only once or twice across a window, so that four pixels count as one); what they do not
// show, by more than a quarter, has gone into the plane unseen.
Plane fit(const Window& w, float centre, float gx, float gy, float cell) {
  const Sums s = sum_up(w, centre, gx, gy, cell);
  Plane plane;
  plane.agree = static_cast<int>(s.n);
  // Normal equations by Cramer's rule.
  const double cx = s.xx * s.yy - s.xy * s.xy, cy = s.xy * s.y - s.x * s.yy, cz = s.x * s.xy - s.xx * s.y;
  const double determinant = s.n * cx + s.x * cy + s.y * cz;
  if (s.n < 6 || determinant < 1e-3 * s.n * s.xx * s.yy) return plane;
  const double c = (s.r * cx + s.xr * cy + s.yr * cz) / determinant;
  const double a = (s.r * cy + s.xr * (s.n * s.yy - s.y * s.y) + s.yr * (s.x * s.y - s.n * s.xy)) / determinant;
  const double b = (s.r * cz + s.xr * (s.x * s.y - s.n * s.xy) + s.yr * (s.n * s.xx - s.x * s.x)) / determinant;
  const double left = std::max(0.0, s.rr - c * s.r - a * s.xr - b * s.yr) / std::max(1.0, s.n - 3);
  const double e = s.edges / s.n;
  const double rounding = cell * cell * (std::pow(1 - e, 3) + 4 * std::pow(e, 3)) / 12;
  plane.value = static_cast<float>(centre + c);
  plane.sigma = static_cast<float>(std::sqrt(4 * left * cx / determinant + std::max(4e-4, rounding - 1.25 * left)));
  return plane;
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

// A reading or the completion of one; nothing but the reason where it fails.
struct Refined {
  float q = kNaN, sigma = 0;
  Reason reason = Reason::kAccepted;
};

Refined refine_reading(const Window& w, float read, float gx, float gy, float cell) {
  const Plane plane = fit(w, read, gx, gy, cell);
  if (plane.agree < 6 || plane.agree < 0.3 * w.count) return {.reason = Reason::kInconsistent};
  // A line of pixels supports it but spans no plane: the reading stays.
  if (plane.sigma <= 0) return {read, 0.29f * cell, Reason::kAccepted};
  return {plane.value, plane.sigma, Reason::kAccepted};
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

Refined complete(const Window& w, float gx, float gy, std::size_t i, const AxisReading& reading) {
  const Refined rejected{.reason = Reason::kUncertainBit};
  const bool edge = reading.base >= 0 && ((reading.uncertain[i] >> reading.base) & 1);
  if (!edge && 2 * std::popcount(reading.uncertain[i]) > reading.bits) return rejected;
  const auto cell = static_cast<float>(reading.cell_px);
  const Plane plane = fit(w, centre_of(w, gx, gy), gx, gy, cell);
  if (plane.sigma <= 0 || plane.agree < 0.7 * w.count) return rejected;
  if (edge && !on_base_edge(plane.value, reading)) return rejected;
  if (!confirmed(plane.value, reading.code[i], reading.uncertain[i], reading)) return rejected;
  return {plane.value, plane.sigma, Reason::kAccepted};
}

void widen_by_surroundings(AxisReading& reading, int x, int y, float gx, float gy) {
  const float pull = pull_of_surroundings(reading.contrast, x, y);
  float& sigma = reading.sigma.at(x, y);
  sigma = std::sqrt(sigma * sigma + pull * pull * (gx * gx + gy * gy));
}

}  // namespace

void refine_by_neighbours(AxisReading& reading) {
  const Image raw = reading.q;
  const Slopes slopes(raw);
  const auto cell = static_cast<float>(reading.cell_px);
  parallel_for(raw.height(), [&](int y) {
    for (int x = 0; x < raw.width(); ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * raw.width() + x;
      const auto reason = static_cast<Reason>(reading.reason.data()[i]);
      if (reason != Reason::kAccepted && reason != Reason::kUncertainBit) continue;
      const Window w = window_at(raw, x, y);
      float gx = 0, gy = 0;
      const bool supported = w.count >= kFewest && slopes.of(w, x, y, gx, gy);
      const bool read = reason == Reason::kAccepted;
      const Refined refined = !supported ? Refined{.reason = read ? Reason::kIsolated : Reason::kUncertainBit}
                              : read     ? refine_reading(w, raw.at(x, y), gx, gy, cell)
                                         : complete(w, gx, gy, i, reading);
      reading.q.data()[i] = refined.q;
      reading.sigma.data()[i] = refined.sigma;
      widen_by_surroundings(reading, x, y, gx, gy);
      reading.reason.data()[i] = static_cast<std::uint8_t>(refined.reason);
    }
  });
}

namespace {

// How many of a window's readings agree with one at its centre.
int agreeing(const Window& w, float centre, float gx, float gy, float reach) {
  const Row across = all(centre) + gx * kColumn;
  RowMask agree{};
  for (int line = 0; line < kSide; ++line) {
    const Row off = w.rows[line] - (across + static_cast<float>(line - kRadius) * gy);
    agree += (off <= reach) & (off >= -reach);  // -1 each
  }
  int count = 0;
  for (int i = 0; i < kStride; ++i) count -= agree[i];
  return count;
}

}  // namespace

void check_by_neighbours(AxisReading& reading, const Image& other) {
  const Image raw = reading.q;
  Image judges = raw;  // doubtful readings judge only where there are hardly others
  for (std::size_t i = 0; i < judges.data().size(); ++i)
    if (reading.reason.data()[i]) judges.data()[i] = kNaN;
  const Slopes slopes(judges);
  parallel_for(raw.height(), [&](int y) {
    for (int x = 0; x < raw.width(); ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * raw.width() + x;
      if (!std::isfinite(raw.data()[i])) continue;
      const bool certain = std::isfinite(judges.data()[i]);
      Window w = window_at(judges, x, y);
      if (w.count < 2 * kFewest) w = window_at(raw, x, y);
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
            widen_by_surroundings(reading, x, y, gx, gy);
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

#include "tools/report/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace countershade::tools {

namespace {

constexpr double kLeft = 58, kRight = 14, kTop = 44, kBottom = 46;
constexpr double kLetter = 8.2;  // width of a letter on a narrow screen, where text is set larger

std::string tick_text(double value, double step) {
  if (std::abs(value) < 1e-9 * std::abs(step)) return "0";
  const int decimals = step < 1 ? std::min(6, static_cast<int>(std::ceil(-std::log10(step) - 1e-9))) : 0;
  const std::string digits = fmt::format("{:.{}f}", std::abs(value), decimals);
  return (value < 0 ? "\u2212" : "") + digits;
}

// Data coordinates to picture coordinates.
struct Frame {
  double x_low = 0, x_high = 1, y_low = 0, y_high = 1;
  bool log_y = false;
  int width = 640, height = 320;

  double right() const { return width - kRight; }
  double bottom() const { return height - kBottom; }
  double x(double value) const { return kLeft + (value - x_low) / (x_high - x_low) * (right() - kLeft); }
  double y(double value) const {
    const auto scale = [&](double v) { return log_y ? std::log10(std::max(v, y_low)) : v; };
    const double share = (scale(value) - scale(y_low)) / (scale(y_high) - scale(y_low));
    return bottom() - std::clamp(share, 0.0, 1.0) * (bottom() - kTop);
  }
};

struct Range {
  double low = HUGE_VAL, high = -HUGE_VAL;
  void add(double value) {
    if (std::isfinite(value)) low = std::min(low, value), high = std::max(high, value);
  }
  bool empty() const { return low > high; }
};

// Half the distance of the first two points: half a bar's width.
double half_step(const Series& s) {
  return s.x.size() > 1 ? (s.x[1] - s.x[0]) / 2 : 0.5;
}

Frame frame_of(const std::vector<Series>& series, const PlotOptions& o) {
  Range x, y;
  for (const Series& s : series) {
    const double margin = s.bars ? half_step(s) : 0;
    for (double v : s.x) x.add(v - margin), x.add(v + margin);
    for (double v : s.y) y.add(v);
  }
  if (x.empty()) x = {0, 1};
  if (y.empty()) y = {0, 1};
  Frame f{.log_y = o.log_y, .width = o.width, .height = o.height};
  std::tie(f.x_low, f.x_high) = o.x_range.value_or(std::pair{x.low, x.high});
  if (f.x_high <= f.x_low) f.x_low -= 0.5, f.x_high += 0.5;
  if (o.y_range) {
    std::tie(f.y_low, f.y_high) = *o.y_range;
  } else if (o.log_y) {
    f.y_high = std::pow(10, std::ceil(std::log10(std::max(y.high, 1e-12))));
    f.y_low = f.y_high / 1e4;
  } else {
    const std::vector<double> ticks = round_ticks(std::min(0.0, y.low), std::max(0.0, y.high), 5);
    f.y_low = ticks.front(), f.y_high = ticks.back();
  }
  if (f.y_high <= f.y_low) f.y_high = f.y_low + 1;
  return f;
}

std::string line(double x1, double y1, double x2, double y2, const char* style) {
  return fmt::format("<line x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}' class='{}'/>", x1, y1, x2, y2, style);
}

std::string text(double x, double y, const char* style, const char* anchor, const std::string& content) {
  return fmt::format("<text x='{:.1f}' y='{:.1f}' class='{}' text-anchor='{}'>{}</text>", x, y, style, anchor,
                     escaped(content));
}

std::string y_axis(const Frame& f) {
  std::string out;
  const auto mark = [&](double value, const std::string& label) {
    out += line(kLeft, f.y(value), f.right(), f.y(value), "grid");
    out += text(kLeft - 7, f.y(value) + 4, "tick", "end", label);
  };
  if (f.log_y) {
    for (double v = f.y_low; v <= f.y_high * 1.0001; v *= 10) mark(v, fmt::format("{:g}", v));
    return out;
  }
  const std::vector<double> ticks = round_ticks(f.y_low, f.y_high, 5);
  for (double v : ticks)
    if (v >= f.y_low - 1e-12 && v <= f.y_high + 1e-12) mark(v, tick_text(v, ticks[1] - ticks[0]));
  return out;
}

std::string x_axis(const Frame& f) {
  std::string out = line(kLeft, f.bottom(), f.right(), f.bottom(), "frame");
  const std::vector<double> ticks = round_ticks(f.x_low, f.x_high, 8);
  const double margin = 1e-9 * (f.x_high - f.x_low);
  for (double v : ticks) {
    if (v < f.x_low - margin || v > f.x_high + margin) continue;
    out += line(f.x(v), f.bottom(), f.x(v), f.bottom() + 4, "frame");
    out += text(f.x(v), f.bottom() + 18, "tick", "middle", tick_text(v, ticks[1] - ticks[0]));
  }
  return out;
}

std::string bars(const Series& s, const Frame& f) {
  std::string points;
  const double half = half_step(s);
  for (std::size_t i = 0; i < std::min(s.x.size(), s.y.size()); ++i)
    points +=
        fmt::format("{:.1f},{:.1f} {:.1f},{:.1f} ", f.x(s.x[i] - half), f.y(s.y[i]), f.x(s.x[i] + half), f.y(s.y[i]));
  if (points.empty()) return "";
  const std::string ends[2] = {fmt::format("{:.1f},{:.1f} ", f.x(s.x.front() - half), f.bottom()),
                               fmt::format("{:.1f},{:.1f}", f.x(s.x.back() + half), f.bottom())};
  return fmt::format("<polygon points='{}{}{}' fill='{}' fill-opacity='.28' stroke='{}' stroke-width='1.4'/>", ends[0],
                     points, ends[1], s.colour, s.colour);
}

std::string curve(const Series& s, const Frame& f) {
  std::string path;
  bool down = false;
  for (std::size_t i = 0; i < std::min(s.x.size(), s.y.size()); ++i) {
    const bool finite = std::isfinite(s.x[i]) && std::isfinite(s.y[i]);
    if (finite) path += fmt::format("{}{:.1f} {:.1f}", down ? "L" : "M", f.x(s.x[i]), f.y(s.y[i]));
    down = finite;
  }
  if (path.empty()) return "";
  return fmt::format("<path d='{}' fill='none' stroke='{}' stroke-width='1.7' stroke-linejoin='round'{}/>", path,
                     s.colour, s.dashed ? " stroke-dasharray='5 4'" : "");
}

// Bytes that begin a letter in UTF-8.
double letters(const std::string& text) {
  return static_cast<double>(std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xc0) != 0x80; }));
}

std::string legend(const std::vector<Series>& series) {
  std::string out;
  double x = kLeft;
  for (const Series& s : series) {
    if (s.name.empty()) continue;
    if (s.bars)
      out += fmt::format("<rect x='{:.1f}' y='11' width='18' height='10' fill='{}' fill-opacity='.4' stroke='{}'/>", x,
                         s.colour, s.colour);
    else
      out += fmt::format("<line x1='{:.1f}' y1='16' x2='{:.1f}' y2='16' stroke='{}' stroke-width='2.4'{}/>", x, x + 18,
                         s.colour, s.dashed ? " stroke-dasharray='5 4'" : "");
    out += text(x + 24, 20, "axis", "start", s.name);
    x += 24 + kLetter * letters(s.name) + 16;
  }
  return out;
}

std::string band(const Band& b, const Frame& f) {
  const double from = f.x(std::clamp(b.from, f.x_low, f.x_high)), to = f.x(std::clamp(b.to, f.x_low, f.x_high));
  return fmt::format("<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' class='band'/>", from, kTop, to - from,
                     f.bottom() - kTop) +
         text((from + to) / 2, kTop - 5, "tick", "middle", b.name);
}

bool has_data(const std::vector<Series>& series) {
  for (const Series& s : series)
    for (double v : s.y)
      if (std::isfinite(v)) return true;
  return false;
}

std::string opened(int width, int height, const char* style) {
  return fmt::format("<svg viewBox='0 0 {} {}' role='img' class='{}'>", width, height, style);
}

}  // namespace

std::vector<double> round_ticks(double low, double high, int count) {
  if (!(high > low)) high = low + 1;
  const double raw = (high - low) / std::max(1, count), power = std::pow(10, std::floor(std::log10(raw)));
  const double step = power * (raw <= 1.0001 * power ? 1 : raw <= 2.0001 * power ? 2 : raw <= 5.0001 * power ? 5 : 10);
  std::vector<double> ticks;
  const double first = std::floor(low / step + 1e-9), last = std::ceil(high / step - 1e-9);
  for (double i = first; i <= last; ++i) ticks.push_back(i * step);
  return ticks;
}

std::string escaped(const std::string& plain) {
  std::string out;
  for (char c : plain) switch (c) {
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '&':
        out += "&amp;";
        break;
      case '\'':
        out += "&#39;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  return out;
}

std::string plot_svg(const std::vector<Series>& series, const PlotOptions& o) {
  const Frame f = frame_of(series, o);
  std::string out = opened(o.width, o.height, "plot");
  for (const Band& b : o.bands) out += band(b, f);
  out += y_axis(f);
  for (const Series& s : series) out += s.bars ? bars(s, f) : curve(s, f);
  out += x_axis(f) + legend(series);
  if (!has_data(series)) out += text((kLeft + f.right()) / 2, (kTop + f.bottom()) / 2, "axis", "middle", "no data");
  out += text((kLeft + f.right()) / 2, o.height - 8, "axis", "middle", o.x_title);
  out += fmt::format("<text transform='translate(14 {:.1f}) rotate(-90)' class='axis' text-anchor='middle'>{}</text>",
                     (kTop + f.bottom()) / 2, escaped(o.y_title));
  return out + "</svg>\n";
}

std::string plot_svg(const std::vector<Series>& series, const std::string& x_title, const std::string& y_title) {
  PlotOptions options;
  options.x_title = x_title;
  options.y_title = y_title;
  return plot_svg(series, options);
}

std::string bars_svg(const std::vector<Bar>& bars, const std::string& x_title) {
  constexpr double kLabels = 165, kRow = 26, kWidth = 480, kValues = 60;
  double largest = 0;
  for (const Bar& b : bars)
    if (std::isfinite(b.value)) largest = std::max(largest, b.value);
  const double height = kRow * static_cast<double>(bars.size()) + 30;
  std::string out = opened(static_cast<int>(kWidth), static_cast<int>(height), "bars");
  double y = 4;
  for (const Bar& b : bars) {
    const double share = largest > 0 && std::isfinite(b.value) ? std::max(0.0, b.value / largest) : 0;
    const double length = share * (kWidth - kLabels - kValues);
    out += text(kLabels - 8, y + 15, "axis", "end", b.label);
    out += fmt::format("<rect x='{}' y='{:.1f}' width='{:.1f}' height='18' rx='2' fill='{}'/>", kLabels, y, length,
                       b.colour);
    out += text(kLabels + length + 7, y + 14, "axis", "start", b.text);
    y += kRow;
  }
  return out + line(kLabels, 0, kLabels, y, "frame") + text(kLabels, y + 18, "tick", "start", x_title) + "</svg>\n";
}

}  // namespace countershade::tools

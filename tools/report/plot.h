// Small plots as inline SVG, for reports. Colours of axes and text follow the page (CSS classes tick, axis, grid,
// frame).
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace countershade::tools {

struct Series {
  std::string name, colour;  // CSS colour
  std::vector<double> x, y;
  bool bars = false;    // filled steps of equal width centred on x, instead of a line
  bool dashed = false;  // a line with gaps
};

// A range of x shaded behind the curves.
struct Band {
  double from = 0, to = 0;
  std::string name;
};

struct PlotOptions {
  std::string x_title, y_title;
  std::optional<std::pair<double, double>> x_range, y_range;  // default: the data's, y including 0, at round numbers
  bool log_y = false;  // base 10; values below y_range's lower end (default 1e-2 of the largest decade) lie on the axis
  std::vector<Band> bands;
  int width = 640, height = 320;
};

// At most about `count` + 2 round numbers (1, 2 or 5 times a power of ten apart) that cover [low, high].
std::vector<double> round_ticks(double low, double high, int count);

// Axes with ticks, a legend, series in order. Points that are not finite break a line. Without any finite point: axes
// that say "no data".
std::string plot_svg(const std::vector<Series>& series, const PlotOptions& options);
std::string plot_svg(const std::vector<Series>& series, const std::string& x_title, const std::string& y_title);

// Horizontal bars from 0, one per label, the value written beside each.
struct Bar {
  std::string label;
  double value = 0;
  std::string text, colour;
};
std::string bars_svg(const std::vector<Bar>& bars, const std::string& x_title);

// & < > " ' as entities: for text and attributes of HTML and SVG.
std::string escaped(const std::string& text);

}  // namespace countershade::tools

#include "tools/job/test_pictures.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "calib/base/parallel.h"
#include "calib/base/random.h"

namespace countershade::tools {

namespace {

using Rgb = std::array<double, 3>;

// Smooth noise in [0, 1] on a lattice of integer points, C1 between them.
double lattice(std::uint64_t seed, double x, double y) {
  const double fx = std::floor(x), fy = std::floor(y);
  const auto value = [&](double ix, double iy) {
    const auto key =
        static_cast<std::uint64_t>(static_cast<std::int64_t>(ix) * 73856093 ^ static_cast<std::int64_t>(iy) * 19349663);
    return static_cast<double>(mix(seed ^ mix(key)) >> 11) * 0x1.0p-53;
  };
  const auto ease = [](double t) { return t * t * (3 - 2 * t); };
  const double u = ease(x - fx), v = ease(y - fy);
  return (value(fx, fy) * (1 - u) + value(fx + 1, fy) * u) * (1 - v) +
         (value(fx, fy + 1) * (1 - u) + value(fx + 1, fy + 1) * u) * v;
}

double octaves(std::uint64_t seed, double x, double y, int count) {
  double sum = 0, weight = 0, amplitude = 1;
  for (int i = 0; i < count; ++i, amplitude *= 0.6, x *= 2, y *= 2) {
    sum += amplitude * lattice(seed + i, x, y);
    weight += amplitude;
  }
  return sum / weight;
}

Rgb photo(int index, double u, double v) {
  Rgb rgb{};
  for (int c = 0; c < 3; ++c) {
    const double n = octaves(1000 + 17 * index + c / 2, 3 * u + 0.3 * c, 2 * v, 6);
    rgb[c] = 0.25 + 0.35 * std::clamp(1.8 * (n - 0.5) + 0.5, 0.0, 1.0);
  }
  return rgb;
}

Rgb window(int index, double u, double v) {
  const double left = index % 2 ? 0.1 : 0.55;
  const bool inside = u > left && u < left + 0.35 && v > 0.2 && v < 0.75;
  const bool bar = std::abs(u - left - 0.17) < 0.008 || std::abs(v - 0.47) < 0.012;
  const double n = octaves(50 + index, 4 * u, 4 * v, 4);
  if (inside && !bar) return {0.75 + 0.1 * n, 0.85 + 0.1 * n, 0.9 + 0.1 * n};
  return {0.03 + 0.03 * n, 0.025 + 0.03 * n, 0.02 + 0.03 * n};
}

// Lines of blocks that have the ink and the spacing of print.
Rgb text(int index, double u, double v) {
  const int line = static_cast<int>(v * 16), column = static_cast<int>(u * 48);
  const double in_line = v * 16 - line, in_column = u * 48 - column;
  const std::uint64_t word = mix(static_cast<std::uint64_t>(line * 131 + column + 7919 * index));
  const bool ink = line % 2 == 0 && word % 5 != 0 && in_line > 0.15 && in_line < 0.85 && in_column > 0.12 &&
                   in_column < 0.8 && ((word >> 8) % 3 != 0 || (in_line < 0.35 || in_line > 0.65));
  return ink ? Rgb{1, 1, 1} : Rgb{0, 0, 0};
}

Rgb saturated(int index, double u, double v) {
  static constexpr std::array<Rgb, 6> kHues{
      {{1, 0.05, 0.02}, {0.9, 0.85, 0.03}, {0.05, 0.8, 0.1}, {0.02, 0.7, 0.9}, {0.05, 0.08, 0.95}, {0.85, 0.05, 0.8}}};
  return kHues[(static_cast<int>(u * 4) + 2 * static_cast<int>(v * 3) + 3 * index) % 6];
}

// Primaries on the right wall, complements on the left, white around, as in the paper's figure 5a.
Rgb table_1(int index, double u, double v) {
  static constexpr std::array<Rgb, 12> kLeft{{{1, 0, 1},
                                              {1, 0, 1},
                                              {1, 1, 1},
                                              {1, 1, 0},
                                              {1, 1, 0},
                                              {1, 1, 0},
                                              {1, 1, 1},
                                              {0, 1, 1},
                                              {0, 1, 1},
                                              {0, 1, 1},
                                              {1, 1, 1},
                                              {1, 0, 1}}};
  static constexpr std::array<Rgb, 12> kRight{{{1, 1, 1},
                                               {1, 0, 0},
                                               {1, 0, 0},
                                               {1, 0, 0},
                                               {1, 1, 1},
                                               {0, 1, 0},
                                               {0, 1, 0},
                                               {0, 1, 0},
                                               {1, 1, 1},
                                               {0, 0, 1},
                                               {0, 0, 1},
                                               {0, 0, 1}}};
  const double from_edge = index % 2 ? u : 1 - u;
  if (from_edge > 0.45 || v < 0.04 || v > 0.96) return {1, 1, 1};
  const int area = std::min(11, static_cast<int>((v - 0.04) / 0.92 * 12));
  return index % 2 ? kRight[area] : kLeft[area];
}

const std::vector<std::pair<std::string, std::function<Rgb(int, double, double)>>>& pictures() {
  static const std::vector<std::pair<std::string, std::function<Rgb(int, double, double)>>> kPictures = {
      {"flat",
       [](int, double, double) {
         return Rgb{0.5, 0.5, 0.5};
       }},
      {"gradient",
       [](int index, double u, double v) {
         const double g = 0.2 + 0.6 * (index % 2 ? v : u);
         return Rgb{g, 0.9 * g, 0.8 * g};
       }},
      {"photo", photo},
      {"window", window},
      {"text", text},
      {"saturated", saturated},
      {"table-1", table_1}};
  return kPictures;
}

}  // namespace

const std::vector<std::string>& test_picture_names() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const auto& [name, function] : pictures()) names.push_back(name);
    return names;
  }();
  return kNames;
}

Result<Picture> test_picture(const std::string& name, int index, int width, int height) {
  for (const auto& [known, function] : pictures()) {
    if (known != name) continue;
    Picture picture(width, height, 3);
    parallel_for(height, [&](int y) {
      for (int x = 0; x < width; ++x) {
        const Rgb rgb = function(index, (x + 0.5) / width, (y + 0.5) / height);
        for (int c = 0; c < 3; ++c)
          picture.at(x, y, c) = static_cast<std::uint16_t>(257 * std::lround(255 * std::pow(rgb[c], 1 / 2.2)));
      }
    });
    return picture;
  }
  return error(ErrorCode::kBadValue, "no test picture '{}'; there are {}", name, fmt::join(test_picture_names(), ", "));
}

}  // namespace countershade::tools

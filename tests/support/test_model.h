// A small room for tests of the compensation: two walls of different size, angle and patches, two or three projectors
// of odd sizes whose pictures overlap over the crease, gains and albedo that vary. Symmetric in nothing. Made by hand,
// so that its truth does not depend on a fit.
#pragma once

#include <cmath>

#include "calib/base/random.h"
#include "solver/transport/form_factor.h"
#include "solver/transport/model.h"

namespace countershade::test {

struct RoomOptions {
  int projectors = 2;
  double k = .7;                                          // mean indirect gain
  std::vector<std::pair<int, int>> grid{{7, 5}, {6, 4}};  // patches per wall
  std::vector<std::array<int, 2>> pictures{{61, 43}, {57, 45}, {37, 29}};
  double black_level = .002;
};

// Slow waves between 1 - depth and 1 + depth, different for every (seed, c).
inline double wave(double u, double v, int c, int seed, double depth) {
  return 1 + depth * std::sin(1.3 * seed + 2.1 * c + 4.1 * u + 2.7 * v) * std::cos(.7 * seed + 1.9 * u - 3.3 * v);
}

inline std::vector<Image> gain_charts(const Patches& patches, int factor, int seed) {
  std::vector<Image> charts;
  for (int s = 0; s < patches.surfaces(); ++s) {
    Image chart(patches.nu(s) * factor, patches.nv(s) * factor, 3);
    for (int y = 0; y < chart.height(); ++y)
      for (int x = 0; x < chart.width(); ++x)
        for (int c = 0; c < 3; ++c)
          chart.at(x, y, c) = static_cast<float>(
              (.55 + .05 * c) * wave((x + .5) / chart.width(), (y + .5) / chart.height(), c, seed + 3 * s, .25));
    charts.push_back(std::move(chart));
  }
  return charts;
}

inline solver::ProjectorModel projector(const solver::Model& model, int q, std::array<int, 2> size,
                                        double black_level) {
  static const char* kNames[] = {"left", "right", "third"};
  const Eigen::Vector3d from[] = {{.7, .9, 3.2}, {-.55, .7, 3.0}, {.2, 1.4, 2.7}};
  const Eigen::Vector3d to[] = {{-.5, .8, .3}, {.55, .75, .2}, {.1, .6, .1}};
  solver::ProjectorModel p;
  p.id = kNames[q];
  p.response.curve = *Response::parse(q == 1 ? "srgb" : "gamma:2.2");
  p.response.black_level = black_level * (1 + .5 * q);
  p.device.lens = Lens::pinhole(size[0] * (1.05 + .1 * q), size[0] * .49, size[1] * .52, size[0], size[1]);
  p.device.device_from_world = look_at(from[q], to[q], {0, 1, 0}, .03 - .05 * q);
  p.map = solver::pixel_map(p.device, model.screen);
  p.gain = gain_charts(model.patches, model.gain_factor, 1 + q);
  return p;
}

// world: x right, y up, z away from the crease, which is the line x = z = 0.
inline solver::Model room(const RoomOptions& options = {}) {
  solver::Model model;
  model.planes = {std::make_shared<PlaneSurface>(Eigen::Vector3d(-1.8, 0, 1.3), Eigen::Vector3d(1.8, 0, -1.3),
                                                 Eigen::Vector3d(0, 1.6, 0)),
                  std::make_shared<PlaneSurface>(Eigen::Vector3d(0, .1, 0), Eigen::Vector3d(1.5, 0, 1.2),
                                                 Eigen::Vector3d(0, 1.4, 0))};
  model.screen.surfaces = {model.planes[0], model.planes[1]};
  model.patches = Patches(options.grid);
  SilentProgress silent;
  model.F = solver::form_factors(model.screen, model.patches, solver::FormFactorMethod::kExact, silent);
  model.G = solver::receiver_form_factors(model.screen, model.patches,
                                          solver::receiver_points(model.patches, model.receiver_factor), silent);
  const int P = model.patches.size();
  model.k.resize(P, 3);
  model.e.resize(P, 3);
  for (int i = 0; i < P; ++i) {
    const ChartPoint at = model.patches.centre(i);
    for (int c = 0; c < 3; ++c) {
      model.k(i, c) = static_cast<float>(options.k * (1 - .06 * c) * wave(at.u, at.v, c, 11 + at.surface, .1));
      model.e(i, c) = static_cast<float>(.004 * wave(at.u, at.v, c, 17 + at.surface, .3));
    }
  }
  model.white = .8;
  for (int q = 0; q < options.projectors; ++q)
    model.projectors.push_back(projector(model, q, options.pictures[q], options.black_level));
  return model;
}

// A smooth picture between the encoded values low and high (0..255 whole codes), with a dark block if asked.
inline Picture picture(const solver::ProjectorModel& p, int seed, int low, int high, bool dark_block = false) {
  Picture out(p.map.width, p.map.height, 3);
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x)
      for (int c = 0; c < 3; ++c) {
        const double w = .5 + .5 * (wave((x + .5) / out.width(), (y + .5) / out.height(), c, seed, 1) - 1);
        const bool dark = dark_block && 3 * x > out.width() && 2 * y > out.height();
        out.at(x, y, c) = static_cast<std::uint16_t>(dark ? 0 : 257 * std::lround(low + (high - low) * w));
      }
  return out;
}

inline std::vector<Picture> pictures(const solver::Model& model, int low, int high, bool dark_block = false) {
  std::vector<Picture> out;
  for (std::size_t q = 0; q < model.projectors.size(); ++q)
    out.push_back(picture(model.projectors[q], 5 + static_cast<int>(q), low, high, dark_block));
  return out;
}

inline solver::Radiosity random_radiosity(int rows, double low, double high, std::uint64_t seed) {
  Random random(seed);
  solver::Radiosity out(rows, 3);
  for (int i = 0; i < rows; ++i)
    for (int c = 0; c < 3; ++c) out(i, c) = static_cast<float>(random.uniform(low, high));
  return out;
}

}  // namespace countershade::test

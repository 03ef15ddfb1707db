// A camera that looks at surfaces lit by one projector, as formulas: which projector pixel each camera pixel sees is
// known exactly. Blur, noise, ambient light, bounced light, gaps and edges can be planted.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <string>
#include <utility>

#include "calib/base/random.h"
#include "capture/pattern/decode.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture::fake {

struct View {
  int width = 240, height = 150, channels = 1;        // camera
  int projector_width = 300, projector_height = 220;  // not powers of two
  // Projector coordinates under a camera coordinate [px]; outside the projector = not lit.
  std::function<std::pair<double, double>(double u, double v)> map = [](double u, double v) {
    return std::pair(14 + 1.13 * u - 0.11 * v + 0.0006 * u * v, 9 + 0.07 * u + 1.21 * v - 0.0004 * u * u);
  };
  std::function<double(double u, double v)> albedo = [](double u, double v) {
    return 0.55 + 0.2 * std::sin(u / 17) - 0.15 * std::cos(v / 11 + u / 40);
  };
  double gain = 0.8, ambient = 0.02;  // fractions of full scale
  double blur_px = 0;                 // sigma of the point spread, camera px
  double exponent = 2.2;              // of the projector's response
  double full_well = 0, read_e = 5;   // noise of a camera with that many electrons; 0 = none
  // Light that comes by way of other surfaces, as a multiple of albedo * gain: given the picture's share of lit columns
  // in the far half of the projector (x beyond the middle), which is where it comes from.
  std::function<double(double u, double v)> bounce = [](double, double) { return 0.0; };

  std::pair<double, double> truth(int u, int v) const { return map(u, v); }
  bool lit(double x, double y) const {
    return x >= -0.5 && y >= -0.5 && x < projector_width - 0.5 && y < projector_height - 0.5;
  }

  // Photos of a sequence that has this one projector, "p".
  PhotoSource photos(const Sequence& sequence, const std::string& seed) const {
    return [this, sequence, seed, taps = taps_of_pixels()](int index) -> Result<Photo> {
      for (const Frame& frame : sequence.frames)
        if (frame.index == index) {
          CS_TRY(const Picture picture, render_role(frame.role, "p", projector_width, projector_height));
          return photo(picture, taps, hash_name(seed) + static_cast<std::uint64_t>(index));
        }
      return error(ErrorCode::kBadFile, "no frame {}", index);
    };
  }

 private:
  // A sample of a camera pixel: where on the projector it looks, how much of it there is.
  struct Tap {
    int at = -1;                // index of the projector pixel left above; -1: not lit
    float right = 0, down = 0;  // shares of its neighbours
    float weight = 0;
  };
  static constexpr int kSide = 3, kTaps = kSide * kSide;  // across three sigma of the point spread, or the pixel

  std::vector<Tap> taps_of_pixels() const {
    std::vector<Tap> taps(static_cast<std::size_t>(width) * height * kTaps);
    std::size_t n = 0;
    double weights = 0;
    for (int k = 0; k < kTaps; ++k) weights += spread(k);
    const double reach = blur_px > 0 ? 1.5 * blur_px : 0.33;
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u)
        for (int k = 0; k < kTaps; ++k, ++n) {
          const double su = u + reach * (k % kSide - 1), sv = v + reach * (k / kSide - 1);
          const auto [x, y] = map(su, sv);
          if (lit(x, y)) {
            const double cx = std::clamp(x, 0.0, projector_width - 1.001),
                         cy = std::clamp(y, 0.0, projector_height - 1.001);
            taps[n].at = static_cast<int>(cy) * projector_width + static_cast<int>(cx);
            taps[n].right = static_cast<float>(cx - std::floor(cx)),
            taps[n].down = static_cast<float>(cy - std::floor(cy));
          }
          taps[n].weight = static_cast<float>(albedo(su, sv) * spread(k) / weights);
        }
    return taps;
  }
  double spread(int k) const {
    const double s = k % kSide - 1, t = k / kSide - 1;  // 1.5 sigma
    return blur_px > 0 ? std::exp(-1.125 * (s * s + t * t)) : 1;
  }

  Photo photo(const Picture& picture, const std::vector<Tap>& taps, std::uint64_t seed) const {
    Photo result{Image(width, height, channels), Mask(width, height, 1, 1), 0};
    const auto response = [table = response_table()](std::uint16_t value) { return table[value / 257]; };  // 8 bits
    double far = 0;
    for (int y = 0; y < projector_height; ++y)
      for (int x = projector_width / 2; x < projector_width; ++x) far += response(picture.at(x, y, 1));
    far /= projector_height * (projector_width - projector_width / 2);
    std::vector<float> shown(picture.pixels());
    for (std::size_t i = 0; i < shown.size(); ++i) shown[i] = response(picture.data()[3 * i + 1]);
    Random random(seed);
    std::size_t n = 0;
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u) {
        double light = 0;
        for (int k = 0; k < kTaps; ++k, ++n)
          if (taps[n].at >= 0) {
            const float *above = &shown[taps[n].at], *below = above + projector_width;
            light += taps[n].weight * std::lerp(std::lerp(above[0], above[1], taps[n].right),
                                                std::lerp(below[0], below[1], taps[n].right), taps[n].down);
          }
        light = ambient + gain * (light + albedo(u, v) * bounce(u, v) * far);
        for (int c = 0; c < channels; ++c) {
          double value = light * (1 - 0.2 * c);
          if (full_well > 0) value += random.normal() * std::sqrt(value * full_well + read_e * read_e) / full_well;
          if (value >= 1) result.valid.at(u, v) = 0;
          result.value.at(u, v, c) = static_cast<float>(std::min(1.0, value));
        }
      }
    return result;
  }

  std::array<float, 256> response_table() const {
    std::array<float, 256> table{};
    for (int i = 0; i < 256; ++i) table[i] = static_cast<float>(std::pow(i / 255.0, exponent));
    return table;
  }
};

// Seeds the noise of a test's photos.
inline std::string test_name() {
  return testing::UnitTest::GetInstance()->current_test_info()->name();
}

// A rig of projector "p" alone.
inline Rig rig_of(const View& view) {
  Rig rig;
  rig.projectors.resize(1);
  rig.projectors[0].id = "p";
  rig.projectors[0].resolution = {view.projector_width, view.projector_height};
  return rig;
}

// White, black and Gray code with inverse of projector "p".
struct CodeOptions {
  bool levels = true;  // white and black are there
  std::string axes = "xy";
  int cell_px = 1;
};
inline Sequence code_of(const View& view, const CodeOptions& options = {}) {
  Sequence s;
  s.projectors = {{"p", {view.projector_width, view.projector_height}}};
  const auto add = [&](const Role& role) { s.frames.push_back({static_cast<int>(s.frames.size()) + 3, role}); };
  Role role;
  role.projector = "p";
  if (options.levels)
    for (const char* kind : {"white", "black"}) role.kind = kind, add(role);
  role.kind = "gray", role.cell_px = options.cell_px;
  for (char axis : options.axes) {
    const int length = axis == 'x' ? view.projector_width : view.projector_height;
    for (int bit = gray_bits((length + options.cell_px - 1) / options.cell_px) - 1; bit >= 0; --bit)
      for (bool inverse : {false, true})
        role.axis = std::string(1, axis), role.bit = bit, role.inverse = inverse, add(role);
  }
  return s;
}

// Any code, by name; white and black first.
inline Sequence sequence_of(const View& view, const std::string& code) {
  Sequence s;
  s.projectors = {{"p", {view.projector_width, view.projector_height}}};
  ProjectorSpec spec;
  spec.id = "p", spec.resolution = {view.projector_width, view.projector_height};
  Role role;
  role.projector = "p";
  for (const char* kind : {"white", "black"})
    role.kind = kind, s.frames.push_back({static_cast<int>(s.frames.size()), role});
  const std::vector<Role> roles = *code_roles(code, spec);
  for (const Role& r : roles) s.frames.push_back({static_cast<int>(s.frames.size()), r});
  return s;
}

// What a decoded view is worth, against the truth.
struct Score {
  double lit = 0, accepted = 0;  // pixels whose centre the projector lights; those accepted, lit or not
  double wrong = 0;              // share of accepted that is off by more than 1.5 px
  double rms = 0;                // of one coordinate, over those that are not [px]
  double z2 = 0;                 // mean squared error over predicted variance
  double coverage() const { return accepted / lit; }
};
inline Score score(const View& view, const Correspondence& c) {
  Score s;
  double squares = 0;
  for (int v = 0; v < view.height; ++v)
    for (int u = 0; u < view.width; ++u) {
      const auto [x, y] = view.truth(u, v);
      s.lit += view.lit(x, y);
      if (c.reason.at(u, v)) continue;
      s.accepted += 1;
      double worst = 0, square = 0, axes = 0;
      for (const auto& [read, true_value] : {std::pair(c.x.at(u, v), x), std::pair(c.y.at(u, v), y)}) {
        if (!std::isfinite(read)) continue;
        worst = std::max(worst, std::abs(read - true_value));
        square += (read - true_value) * (read - true_value), axes += 1;
      }
      s.wrong += worst > 1.5;
      if (worst > 1.5) continue;
      squares += square / axes;
      s.z2 += square / axes / (c.sigma.at(u, v) * c.sigma.at(u, v));
    }
  const double good = std::max(1.0, s.accepted - s.wrong);
  s.rms = std::sqrt(squares / good), s.z2 /= good, s.wrong /= std::max(1.0, s.accepted);
  return s;
}

}  // namespace countershade::capture::fake

#include "capture/pattern/pattern.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "calib/base/parallel.h"
#include "calib/base/random.h"

namespace countershade::capture {

namespace {

constexpr std::uint16_t kFull = 65535;

std::uint16_t to_bits8(double encoded) {
  return static_cast<std::uint16_t>(257 * std::lround(255 * std::clamp(encoded, 0.0, 1.0)));
}

using Bits = std::array<std::uint16_t, 3>;

// shader(x, y): the picture's numbers there.
template <class Shader>
Picture draw(int width, int height, const Shader& shader) {
  Picture picture(width, height, 3);
  parallel_for(height, [&](int y) {
    std::uint16_t* row = picture.row(y);
    for (int x = 0; x < width; ++x) {
      const Bits bits = shader(x, y);
      std::copy(bits.begin(), bits.end(), row + 3 * static_cast<std::size_t>(x));
    }
  });
  return picture;
}

// A pattern that depends on one axis and is the same in all channels.
Picture draw_along(const std::string& axis, int width, int height, const std::function<double(int)>& value) {
  std::vector<std::uint16_t> line(axis == "x" ? width : height);
  for (std::size_t i = 0; i < line.size(); ++i) line[i] = to_bits8(value(static_cast<int>(i)));
  Picture picture(width, height, 3);
  if (axis == "x") {
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < 3; ++c) picture.at(x, 0, c) = line[x];
    for (int y = 1; y < height; ++y) std::copy(picture.row(0), picture.row(1), picture.row(y));
  } else {
    for (int y = 0; y < height; ++y) std::fill_n(picture.row(y), 3 * static_cast<std::size_t>(width), line[y]);
  }
  return picture;
}

// Full in the primaries that `channel` names.
Bits primary(const std::string& channel) {
  const auto has = [&](char c) { return channel.find(c) != std::string::npos ? kFull : std::uint16_t{0}; };
  return {has('r'), has('g'), has('b')};
}

// Which cells of the block pattern are lit: a checkerboard whose phase is pseudo-random per row and column pair, so
// that about half the cells are lit, every neighbourhood has lit and dark ones, and no row or column repeats another.
bool block_lit(int seed, int cell_x, int cell_y) {
  const std::uint64_t pair =
      mix(static_cast<std::uint64_t>(seed) * 1000003u + static_cast<std::uint64_t>(cell_x / 2) * 8191u +
          static_cast<std::uint64_t>(cell_y / 2));
  return ((cell_x + cell_y) & 1) ^ static_cast<int>(pair & 1);
}

// Smooth noise of one octave: random values at whole coordinates, eased between them.
class Octave {
 public:
  // Pixel (x, y) has the coordinates 10 + scale_x (x + .5), 10 + scale_y (y + .5).
  Octave(std::uint64_t seed, double scale_x, double scale_y, int width, int height) : scale_y_(scale_y) {
    columns_ = static_cast<int>(scale_x * width) + 3;
    const int rows = static_cast<int>(scale_y * height) + 3;
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns_; ++i) values_.push_back(value(seed, i + 10, j + 10));
    for (int x = 0; x < width; ++x) {
      const double at = scale_x * (x + 0.5);
      left_.push_back(static_cast<int>(at)), share_.push_back(ease(at - std::floor(at)));
    }
  }
  double at(int x, int y) const {
    const double row = scale_y_ * (y + 0.5), down = ease(row - std::floor(row));
    const double* above = &values_[static_cast<std::size_t>(row) * columns_ + left_[x]];
    const double* below = above + columns_;
    return std::lerp(std::lerp(above[0], above[1], share_[x]), std::lerp(below[0], below[1], share_[x]), down);
  }

 private:
  static double value(std::uint64_t seed, int i, int j) {
    return static_cast<double>(mix(seed ^ mix(static_cast<std::uint64_t>(i) * 0x9e3779b1u +
                                              static_cast<std::uint64_t>(j) * 0x85ebca77u)) >>
                               11) *
           0x1.0p-53;
  }
  static double ease(double t) { return t * t * (3 - 2 * t); }

  double scale_y_;
  int columns_ = 0;
  std::vector<double> values_;  // [row][column]
  std::vector<int> left_;       // of each x: column of the value left of it
  std::vector<double> share_;   // of each x: of the one right of it
};

// Photo-like: five octaves of smooth noise with slowly changing colour, encoded .35 to .95.
Picture held_out(int seed, int width, int height) {
  constexpr int kOctaves = 5, kColoured = 2;
  std::vector<std::array<Octave, 3>> octaves;
  double scale = 2, weight = 0, amplitude = 1;
  std::array<double, kOctaves> amplitudes{};
  for (int k = 0; k < kOctaves; ++k, amplitude *= 0.55, scale *= 2) {
    const auto octave = [&](int c) {
      const std::uint64_t key = mix(static_cast<std::uint64_t>(seed)) + k * 3u + (k < kColoured ? c : 0);
      return Octave(key, 1.6 * scale / height, scale / height, width, height);
    };
    octaves.push_back({octave(0), octave(1), octave(2)});
    amplitudes[k] = amplitude, weight += amplitude;
  }
  return draw(width, height, [&](int x, int y) {
    Bits bits{};
    double grey = 0;  // the same in all channels
    for (int k = kColoured; k < kOctaves; ++k) grey += amplitudes[k] * octaves[k][0].at(x, y);
    for (int c = 0; c < 3; ++c) {
      double sum = grey;
      for (int k = 0; k < kColoured; ++k) sum += amplitudes[k] * octaves[k][c].at(x, y);
      bits[c] = to_bits8(0.65 + 0.3 * std::clamp(3 * (sum / weight - 0.5), -1.0, 1.0));
    }
    return bits;
  });
}

}  // namespace

unsigned binary_from_gray(unsigned g) {
  for (unsigned shift = 16; shift > 0; shift >>= 1) g ^= g >> shift;
  return g;
}

int gray_bits(int count) {
  int bits = 0;
  while ((1 << bits) < count) ++bits;
  return std::max(1, bits);
}

double wave_shift(const Role& role) {
  return role.shift_rad.value_or(2 * std::numbers::pi * role.step / role.steps);
}

namespace {

double wave(const Role& role, int i) {
  const double shown = 0.5 + 0.5 * std::cos(2 * std::numbers::pi * i / role.period_px + wave_shift(role));
  return std::pow(shown, role.shown_exponent);
}

double stripe(const Role& role, int i) {
  const int period = 2 * role.cell_px, phase = ((i - role.step * role.cell_px / 2) % period + period) % period;
  return phase < role.cell_px ? 1.0 : 0.0;
}

double gray_stripe(const Role& role, int i) {
  const unsigned code = gray_from_binary(static_cast<unsigned>(i / role.cell_px));
  const unsigned base = role.kind == "xor" ? code >> role.base : 0;
  const bool lit = ((code >> role.bit) ^ base) & 1;
  return lit != role.inverse ? 1.0 : 0.0;
}

// The frames that show one projector's Gray code, white and black first.
void add_code(const ProjectorSpec& projector, std::vector<Role>& roles) {
  Role role;
  role.projector = projector.id;
  for (const char* kind : {"white", "black"}) role.kind = kind, roles.push_back(role);
  const std::vector<Role> code = *code_roles("gray", projector);
  roles.insert(roles.end(), code.begin(), code.end());
}

void add_photometric(const Rig& rig, int cell_px, std::vector<Role>& roles) {
  Role blocks;
  blocks.kind = "blocks", blocks.cell_px = cell_px, blocks.seed = 1;
  for (const char* channel : {"r", "g", "b"})
    for (bool inverse : {false, true}) blocks.channel = channel, blocks.inverse = inverse, roles.push_back(blocks);
  Role black;
  black.kind = "black";
  roles.push_back(black);
  Role primary;
  primary.kind = "primary";
  for (std::size_t q = 1; q < rig.projectors.size(); ++q)
    for (const char* channel : {"r", "g", "b"})
      primary.projector = rig.projectors[q].id, primary.channel = channel, roles.push_back(primary);
  Role held_out;
  held_out.kind = "held-out";
  for (int seed : {11, 12}) held_out.seed = seed, roles.push_back(held_out);
}

}  // namespace

Result<Picture> render_role(const Role& role, const std::string& projector_id, int width, int height) {
  if (!role.projector.empty() && role.projector != projector_id) return Picture(width, height, 3);
  const auto along = [&](double (*value)(const Role&, int)) {
    return draw_along(role.axis, width, height, [&](int i) { return value(role, i); });
  };
  if (role.kind == "white") return Picture(width, height, 3, kFull);
  if (role.kind == "black") return Picture(width, height, 3);
  if (role.kind == "gray" || role.kind == "xor") return along(gray_stripe);
  if (role.kind == "phase") return along(wave);
  if (role.kind == "mask") return along(stripe);
  const Bits lit = primary(role.channel);
  if (role.kind == "primary") return draw(width, height, [&](int, int) { return lit; });
  if (role.kind == "blocks")
    return draw(width, height, [&](int x, int y) {
      return block_lit(role.seed, x / role.cell_px, y / role.cell_px) != role.inverse ? lit : Bits{};
    });
  if (role.kind == "held-out")
    return held_out(role.seed + static_cast<int>(hash_name(projector_id) % 1000), width, height);
  return error(ErrorCode::kUnsupported,
               "frames of kind '{}' cannot be drawn by this version; it knows white, black, gray, xor, phase, blocks, "
               "primary, held-out, mask",
               role.kind);
}

namespace {

Sequence numbered(const Rig& rig, const std::vector<Role>& roles) {
  Sequence sequence;
  for (const ProjectorSpec& p : rig.projectors) sequence.projectors.emplace_back(p.id, p.resolution);
  for (const Role& role : roles) sequence.frames.push_back({static_cast<int>(sequence.frames.size()), role});
  return sequence;
}

int block_cell(const Rig& rig) {
  int widest = 1;
  for (const ProjectorSpec& p : rig.projectors) widest = std::max(widest, p.resolution[0]);
  return std::max(4, widest / 8);
}

std::vector<Role> base_of(const Rig& rig) {
  std::vector<Role> roles;
  for (const ProjectorSpec& p : rig.projectors) {
    const std::vector<Role> own = base_roles(p);
    roles.insert(roles.end(), own.begin(), own.end());
  }
  return roles;
}

}  // namespace

Sequence base_sequence(const Rig& rig) {
  return numbered(rig, base_of(rig));
}

Result<Sequence> sequence_with(const Rig& rig, const std::vector<std::string>& codes) {
  CS_CHECK(codes.size() == rig.projectors.size(), "one code per projector");
  std::vector<Role> roles = base_of(rig);
  const std::size_t base = roles.size();
  for (std::size_t q = 0; q < codes.size(); ++q) {
    CS_TRY(const std::vector<Role> code, code_roles(codes[q], rig.projectors[q]));
    for (const Role& role : code)
      if (std::find(roles.begin(), roles.begin() + static_cast<std::ptrdiff_t>(base), role) ==
          roles.begin() + static_cast<std::ptrdiff_t>(base))
        roles.push_back(role);
  }
  add_photometric(rig, block_cell(rig), roles);
  return numbered(rig, roles);
}

Sequence default_sequence(const Rig& rig) {
  std::vector<Role> roles;
  for (const ProjectorSpec& p : rig.projectors) add_code(p, roles);
  add_photometric(rig, block_cell(rig), roles);
  return numbered(rig, roles);
}

}  // namespace countershade::capture

#include "calib/file/toml_fields.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <toml.hpp>

#include "calib/photometry/response.h"

namespace countershade::fields {

namespace {

constexpr double kAny = std::numeric_limits<double>::max();

using Wrong = std::optional<std::string>;

const toml::value& as_toml(const void* value) { return *static_cast<const toml::value*>(value); }

std::string number_text(double v) {
  std::string text = fmt::format("{}", v);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

std::string toml_text(const std::string& text) {
  std::string out = "\"";
  for (char c : text) out += c == '"' || c == '\\' ? std::string("\\") + c : std::string(1, c);
  return out + "\"";
}

Wrong read_number(const toml::value& value, double low, double high, double& out) {
  double v = 0;
  if (value.is_floating()) v = value.as_floating();
  else if (value.is_integer()) v = static_cast<double>(value.as_integer());
  else return "must be a number";
  if (!std::isfinite(v)) return "must be a finite number";
  if (v < low || v > high) return fmt::format("is {}, must be from {} to {}", v, low, high == kAny ? "any" : fmt::format("{}", high));
  out = v;
  return std::nullopt;
}

template <std::size_t N>
Wrong read_numbers(const toml::value& value, double low, double high, std::array<double, N>& out) {
  if (!value.is_array() || value.as_array().size() != N) return fmt::format("must be {} numbers: [..]", N);
  std::array<double, N> numbers{};
  for (std::size_t i = 0; i < N; ++i)
    if (Wrong wrong = read_number(value.as_array()[i], low, high, numbers[i])) return wrong;
  out = numbers;
  return std::nullopt;
}

Field number(const char* name, double& v, double low, double high, const char* comment) {
  return {name, comment, [&v, low, high](const void* t) { return read_number(as_toml(t), low, high, v); }, [&v] { return number_text(v); }, [] { return true; }};
}

Field optional_number(const char* name, std::optional<double>& v, double low, double high, const char* comment) {
  return {name, comment,
          [&v, low, high](const void* t) -> Wrong {
            double x = 0;
            if (Wrong wrong = read_number(as_toml(t), low, high, x)) return wrong;
            v = x;
            return std::nullopt;
          },
          [&v] { return number_text(v.value_or(0)); }, [&v] { return v.has_value(); }};
}

template <class Int>
Field integer(const char* name, Int& v, double low, double high, const char* comment) {
  return {name, comment,
          [&v, low, high](const void* t) -> Wrong {
            if (!as_toml(t).is_integer()) return "must be a whole number";
            double x = 0;
            if (Wrong wrong = read_number(as_toml(t), low, high, x)) return wrong;
            v = static_cast<Int>(as_toml(t).as_integer());
            return std::nullopt;
          },
          [&v] { return fmt::format("{}", v); }, [] { return true; }};
}

template <std::size_t N>
Field numbers(const char* name, std::array<double, N>& v, double low, double high, const char* comment) {
  return {name, comment, [&v, low, high](const void* t) { return read_numbers(as_toml(t), low, high, v); },
          [&v] {
            std::vector<std::string> parts;
            for (double x : v) parts.push_back(number_text(x));
            return fmt::format("[{}]", fmt::join(parts, ", "));
          },
          [] { return true; }};
}

Field size2(const char* name, std::array<int, 2>& v, int low, int high, const char* comment, bool mandatory = false) {
  Field field{name, comment,
              [&v, low, high](const void* t) -> Wrong {
                std::array<double, 2> x{};
                if (Wrong wrong = read_numbers(as_toml(t), low, high, x)) return wrong;
                v = {static_cast<int>(x[0]), static_cast<int>(x[1])};
                return std::nullopt;
              },
              [&v] { return fmt::format("[{}, {}]", v[0], v[1]); }, [] { return true; }};
  field.mandatory = mandatory;
  return field;
}

Field text(const char* name, std::string& v, const char* comment, std::function<Wrong(const std::string&)> check = {}, bool mandatory = false) {
  Field field{name, comment,
              [&v, check](const void* t) -> Wrong {
                if (!as_toml(t).is_string()) return "must be text in quotes";
                const std::string s = as_toml(t).as_string().str;
                if (check)
                  if (Wrong wrong = check(s)) return wrong;
                v = s;
                return std::nullopt;
              },
              [&v] { return toml_text(v); }, [&v, mandatory] { return mandatory || !v.empty(); }};
  field.mandatory = mandatory;
  return field;
}

Field path(const char* name, std::filesystem::path& v, const char* comment) {
  return {name, comment,
          [&v](const void* t) -> Wrong {
            if (!as_toml(t).is_string()) return "must be a path in quotes";
            v = as_toml(t).as_string().str;
            return std::nullopt;
          },
          [&v] { return toml_text(v.string()); }, [&v] { return !v.empty(); }};
}

// One of `ready`; names in `later` are known but not built.
std::function<Wrong(const std::string&)> one_of(std::vector<std::string> ready, std::vector<std::string> later = {}) {
  return [=](const std::string& s) -> Wrong {
    if (std::find(ready.begin(), ready.end(), s) != ready.end()) return std::nullopt;
    const bool known = std::find(later.begin(), later.end(), s) != later.end();
    return fmt::format("is '{}', {}; available: {}", s, known ? "which this version cannot do yet" : "which is not known", fmt::join(ready, ", "));
  };
}

Wrong check_id(const std::string& s) {
  if (s.empty()) return "must not be empty";
  for (char c : s)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '_' && c != '-') return fmt::format("is '{}'; letters, digits, - and _ only, since files are named after it", s);
  return std::nullopt;
}

Wrong check_response(const std::string& s) {
  if (s == "measured") return "is 'measured', which this version cannot do yet; state linear, srgb or gamma:G";
  const auto parsed = Response::parse(s);
  return parsed ? Wrong() : Wrong(parsed.error().message);
}

Wrong read_known_length(const toml::value& value, std::optional<ScreenSpec::KnownLength>& out) {
  const char* shape = "must be { pixel_a = [x, y], pixel_b = [x, y], metres = d }";
  if (!value.is_table()) return shape;
  ScreenSpec::KnownLength known{};
  const auto& table = value.as_table();
  if (table.size() != 3 || !table.count("pixel_a") || !table.count("pixel_b") || !table.count("metres")) return shape;
  if (Wrong wrong = read_numbers(table.at("pixel_a"), -0.5, 1e5, known.pixel_a)) return wrong;
  if (Wrong wrong = read_numbers(table.at("pixel_b"), -0.5, 1e5, known.pixel_b)) return wrong;
  if (Wrong wrong = read_number(table.at("metres"), 1e-6, 1e4, known.metres)) return wrong;
  out = known;
  return std::nullopt;
}

}  // namespace

Fields camera(CameraSpec& c) {
  Field exposures{"exposures_ms", "exposure times [ms]; several are merged; default: the device's own",
                  [&c](const void* t) -> Wrong {
                    if (!as_toml(t).is_array()) return "must be a list of numbers";
                    std::vector<double> all;
                    for (const auto& item : as_toml(t).as_array()) {
                      double v = 0;
                      if (Wrong wrong = read_number(item, 1e-3, 1e5, v)) return wrong;
                      all.push_back(v);
                    }
                    c.exposures_ms = all;
                    return std::nullopt;
                  },
                  [&c] { return fmt::format("[{}]", fmt::join(c.exposures_ms, ", ")); }, [&c] { return !c.exposures_ms.empty(); }};
  return {text("id", c.id, "name; photos are stored under it", check_id, true),
          text("backend", c.backend, "folder | simulated", one_of({"folder", "simulated"}, {"aravis", "v4l2", "libcamera"})),
          text("device", c.device, "what the backend opens: serial number, device file, folder"),
          path("model", c.model, "lens: an mrcal .cameramodel, relative to this file; without one there is no geometry"),
          text("pose", c.pose, "unknown | known (then the model's extrinsics count)", one_of({"unknown"}, {"known"})),
          exposures,
          text("response", c.response, "stored value against light: linear | srgb | gamma:2.2", check_response),
          number("pedestal", c.pedestal, 0, 1e6, "stored value of no light"),
          optional_number("full_scale", c.full_scale, 1e-6, 1e9, "stored value of saturation; default: the file type's maximum")};
}

Fields projector(ProjectorSpec& p) {
  Field shift{"lens_shift", "centre of the picture off the lens axis, in picture widths and heights, right and down positive; unknown if left out",
              [&p](const void* t) -> Wrong {
                std::array<double, 2> v{};
                if (Wrong wrong = read_numbers(as_toml(t), -3, 3, v)) return wrong;
                p.lens_shift = v;
                return std::nullopt;
              },
              [&p] { const auto v = p.lens_shift.value_or(std::array<double, 2>{0, 0}); return fmt::format("[{}, {}]", number_text(v[0]), number_text(v[1])); },
              [&p] { return p.lens_shift.has_value(); }};
  return {text("id", p.id, "name; pictures are stored under it", check_id, true),
          size2("resolution", p.resolution, 1, 16384, "width and height [px], its own pixels, no scaling", true),
          text("output", p.output, "simulated | window | folder", one_of({"simulated", "window", "folder"})),
          text("monitor", p.monitor, "name of the monitor for output = \"window\""),
          text("response", p.response, "encoded value against light: linear | srgb | gamma:2.2", check_response),
          number("black_level", p.black_level, 0, 0.5, "light of black as a fraction of white (1 / contrast)"),
          optional_number("throw_ratio", p.throw_ratio, 0.05, 50, "distance / picture width, from the lens's data sheet; estimated if left out"),
          number("throw_ratio_sigma", p.throw_ratio_sigma, 1e-6, 1, "how well it is known, relative"),
          shift,
          number("lens_shift_sigma", p.lens_shift_sigma, 1e-6, 3, "how well it is known, in the same unit"),
          path("model", p.model, "whole lens and pose as .cameramodel, instead of estimating")};
}

Fields screen(ScreenSpec& s) {
  Field patches{"patches", "\"auto\", or patches per surface [along u, along v]",
                [&s](const void* t) -> Wrong {
                  if (as_toml(t).is_string()) {
                    if (as_toml(t).as_string().str != "auto") return "must be \"auto\" or [nu, nv]";
                    s.patches = {0, 0};
                    return std::nullopt;
                  }
                  std::array<double, 2> v{};
                  if (Wrong wrong = read_numbers(as_toml(t), 1, 256, v)) return wrong;
                  s.patches = {static_cast<int>(v[0]), static_cast<int>(v[1])};
                  return std::nullopt;
                },
                [&s] { return s.patches[0] ? fmt::format("[{}, {}]", s.patches[0], s.patches[1]) : std::string("\"auto\""); }, [] { return true; }};
  Field known{"known_length", "two pixels of the first camera and the distance of what they see; gives metres",
              [&s](const void* t) { return read_known_length(as_toml(t), s.known_length); },
              [&s] {
                const auto k = s.known_length.value_or(ScreenSpec::KnownLength{{100, 100}, {500, 100}, 1});
                return fmt::format("{{ pixel_a = [{}, {}], pixel_b = [{}, {}], metres = {} }}", number_text(k.pixel_a[0]), number_text(k.pixel_a[1]), number_text(k.pixel_b[0]),
                                   number_text(k.pixel_b[1]), number_text(k.metres));
              },
              [&s] { return s.known_length.has_value(); }};
  return {text("kind", s.kind, "measured (shape from structured light)", one_of({"measured", "planes"}, {"cylinder", "dome", "mesh"})),
          integer("planes", s.planes, 0, 6, "number of planes; 0 = found"), patches, known};
}

Fields board(BoardSpec& b) {
  return {text("kind", b.kind, "chessboard | apriltag | charuco, when a board was photographed", one_of({"chessboard", "apriltag", "charuco"})),
          size2("corners", b.corners, 2, 100, "inner corners along width and height"), number("square", b.square, 1e-6, 100, "edge of a square [m]")};
}

Fields intent(Rig& r) {
  return {text("target", r.target, "direct: as if no light bounced; falloff and colour of the screen stay", one_of({"direct"}, {"uniform"}))};
}

Fields simulation(Simulation& s) {
  return {text("room", s.room, "two-wall", one_of({"two-wall"}, {"cave4", "five-face", "closed-room", "cylinder", "dome", "cone"})),
          number("angle_deg", s.angle_deg, 15, 170, "dihedral angle [degrees]"),
          numbers("left_size", s.left_size, 1e-3, 100, "width and height of the left wall [m]"),
          numbers("right_size", s.right_size, 1e-3, 100, "of the right wall [m]"),
          number("left_rise", s.left_rise, -100, 100, "height of the left wall's lower edge [m]"),
          number("right_rise", s.right_rise, -100, 100, "of the right wall's [m]"),
          numbers("left_albedo", s.left_albedo, 0, 0.999, "diffuse reflectance r g b of the left wall"),
          numbers("right_albedo", s.right_albedo, 0, 0.999, "of the right wall"),
          number("texture", s.texture, 0, 0.5, "amplitude of a smooth variation of the albedo, fraction"),
          number("ambient", s.ambient, 0, 1, "radiance of the surround, fraction of reference white"),
          integer("seed", s.seed, 0, 9e15, "all noise depends on it"),
          integer("samples", s.samples, 16, 1048576, "directions traced per point that receives indirect light"),
          integer("block_px", s.block_px, 4, 512, "projector pixels per block of the indirect light")};
}

Fields simulated_camera(SimulatedCamera& c) {
  return {text("id", c.id, "which camera of the rig", check_id, true),
          numbers("position", c.position, -1000, 1000, "[m]; x right, y up, z from the edge to the audience"),
          numbers("target", c.target, -1000, 1000, "point it looks at [m]"),
          number("roll_deg", c.roll_deg, -180, 180, "[degrees]"),
          size2("resolution", c.resolution, 1, 16384, "[px]"),
          integer("channels", c.channels, 1, 3, "1 = monochrome, 3 = RGB"),
          number("focal_px", c.focal_px, 1, 1e6, "focal length [px]"),
          numbers("principal", c.principal, -1e5, 1e5, "principal point [px]"),
          numbers("distortion", c.distortion, -10, 10, "Brown-Conrady k1 k2 p1 p2 k3"),
          number("full_well_e", c.full_well_e, 1, 1e9, "electrons at full scale"),
          number("read_noise_e", c.read_noise_e, 0, 1e6, "[electrons]"),
          integer("bits", c.bits, 1, 16, "stored bits"),
          number("white_level", c.white_level, 0.001, 100, "what the brightest white reaches at the reference exposure, fraction of full scale"),
          number("reference_exposure_ms", c.reference_exposure_ms, 1e-3, 1e5, "[ms]"),
          number("psf_sigma_px", c.psf_sigma_px, 0, 20, "blur of the lens, standard deviation [px]"),
          number("vignetting", c.vignetting, 0, 0.9, "loss at the picture's corner, fraction")};
}

Fields simulated_projector(SimulatedProjector& p) {
  return {text("id", p.id, "which projector of the rig", check_id, true),
          numbers("position", p.position, -1000, 1000, "[m]"),
          numbers("target", p.target, -1000, 1000, "point the lens axis meets [m]"),
          number("roll_deg", p.roll_deg, -180, 180, "[degrees]"),
          number("throw_ratio", p.throw_ratio, 0.05, 50, "distance / picture width"),
          numbers("lens_shift", p.lens_shift, -3, 3, "centre of the picture off the lens axis, in widths and heights, right and down"),
          number("gain", p.gain, 0, 1000, "luminous power relative to the others"),
          numbers("gamma", p.gamma, 0.2, 5, "exponent of the response, r g b"),
          number("black_level", p.black_level, 0, 0.5, "1 / contrast"),
          number("falloff", p.falloff, 0, 0.95, "loss of illuminance at the picture's corner, fraction"),
          number("defocus_sigma_px", p.defocus_sigma_px, 0, 50, "blur, standard deviation [projector px]"),
          integer("latency_frames", p.latency_frames, 0, 100, "photos that still show the former picture")};
}

}  // namespace countershade::fields

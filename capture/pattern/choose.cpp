#include "capture/pattern/choose.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "capture/pattern/pattern.h"
#include "capture/pattern/read/levels.h"
#include "capture/pattern/read/phase.h"

namespace countershade::capture {

namespace {

// One pixel of the pre-scan: light of the white and the black frame, offset and amplitude of the sinusoid per axis.
struct Sample {
  double white = 0, black = 0, offset[2] = {0, 0}, amplitude[2] = {0, 0};
  double range() const { return white - black; }
  double weaker() const { return std::min(amplitude[0], amplitude[1]); }
  double direct() const { return std::clamp(2 * weaker() / range(), 0.01, 1.0); }  // share of the light
};

double normal_cdf(double z) {
  return 0.5 * std::erfc(-z / std::numbers::sqrt2);
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Offset and amplitude of three shifts a third of a turn apart.
void add_axis(const std::array<Image, 3>& light, std::size_t pixel, int axis, Sample& s) {
  const double a = light[0].data()[pixel], b = light[1].data()[pixel], c = light[2].data()[pixel];
  s.offset[axis] = (a + b + c) / 3;
  s.amplitude[axis] = std::hypot(2 * a - b - c, std::sqrt(3.0) * (b - c)) / 3;
}

struct Prescan {
  int white = -1, black = -1;
  std::array<int, 3> shift[2] = {{-1, -1, -1}, {-1, -1, -1}};
};

Result<Prescan> frames_of(const Sequence& sequence, const std::string& projector) {
  ProjectorSpec spec;
  spec.id = projector;
  const std::vector<Role> base = base_roles(spec);
  Prescan found;
  for (const Frame& f : sequence.frames) {
    if (f.role == base[0]) found.white = f.index;
    if (f.role == base[1]) found.black = f.index;
    for (int k = 0; k < 6; ++k)
      if (f.role == base[2 + k]) found.shift[k / 3][k % 3] = f.index;
  }
  const bool whole = found.white >= 0 && found.black >= 0 &&
                     std::min({found.shift[0][0], found.shift[0][1], found.shift[0][2]}) >= 0 &&
                     std::min({found.shift[1][0], found.shift[1][1], found.shift[1][2]}) >= 0;
  if (!whole)
    return error(ErrorCode::kRefused,
                 "projector '{}': the sequence lacks the white, black or sinusoid frames that a code is chosen by",
                 projector);
  return found;
}

// Every `step`-th pixel that is not saturated, of a camera's photos.
Result<std::vector<Sample>> sample_photos(const Prescan& frames, const PhotoSource& photos) {
  CS_TRY(const Photo white, photos(frames.white));
  CS_TRY(const Photo black, photos(frames.black));
  const Image w = luminance_mean(white.value), b = luminance_mean(black.value);
  std::vector<Sample> samples;
  std::vector<std::size_t> at;
  const std::size_t step = std::max<std::size_t>(1, w.pixels() / 200000);
  for (std::size_t i = 0; i < w.pixels(); i += step)
    if (white.valid.data()[i]) at.push_back(i), samples.push_back({w.data()[i], b.data()[i], {0, 0}, {0, 0}});
  for (int axis = 0; axis < 2; ++axis) {
    std::array<Image, 3> light;
    for (int k = 0; k < 3; ++k) {
      CS_TRY(const Photo photo, photos(frames.shift[axis][k]));
      if (!photo.value.same_size(w.width(), w.height()))
        return error(ErrorCode::kBadFile, "photo {:04} is {} x {} pixels, the others are {} x {}",
                     frames.shift[axis][k], photo.value.width(), photo.value.height(), w.width(), w.height());
      light[k] = luminance_mean(photo.value);
    }
    for (std::size_t i = 0; i < at.size(); ++i) add_axis(light, at[i], axis, samples[i]);
  }
  return samples;
}

// Means of three photos of each axis are the same light twice.
NoiseModel noise_of(const std::vector<Sample>& samples) {
  std::vector<float> residuals, light;
  for (const Sample& s : samples) {
    residuals.push_back(static_cast<float>(std::sqrt(1.5) * (s.offset[0] - s.offset[1])));
    light.push_back(static_cast<float>(std::max(0.0, 0.5 * (s.offset[0] + s.offset[1]))));
  }
  return noise_of_residuals(residuals, light, 1);
}

// Those that the projector lights directly: modulated beyond noise and beyond what artefacts make.
std::vector<Sample> lit_directly(const std::vector<Sample>& samples, const NoiseModel& noise) {
  std::vector<double> amplitudes;
  for (const Sample& s : samples) amplitudes.push_back(s.weaker());
  const double dark = 0.02 * percentile(amplitudes, 0.99);
  std::vector<Sample> lit;
  for (const Sample& s : samples)
    if (s.range() > 0 && s.weaker() > std::max(dark, 2.5 * noise.sigma(s.offset[0])) && s.weaker() > 0.02 * s.range())
      lit.push_back(s);
  return lit;
}

// Share of pixels that micro phase shifting does not unwrap, each axis with its own frames. Where a third of a
// neighbourhood is certain, it tells the others.
double lost_by_phase(const std::vector<Sample>& lit, const NoiseModel& noise, double distance) {
  double lost = 0;
  for (const Sample& s : lit) {
    const double z = distance * s.weaker() / noise.sigma(s.offset[0]);
    const double certain = normal_cdf((z * z - kClearOdds) / (2 * z));
    lost += (1 - certain) * (1 - std::clamp((certain - 0.2) / 0.3, 0.0, 0.98));
  }
  return lost / static_cast<double>(lit.size());
}

// sigma [px] per noise / amplitude: sqrt(2 / sum of omega^2) over the frames of an axis.
double sigma_of(const std::vector<Role>& code, const std::vector<Role>& base) {
  double information = 0;
  std::vector<Role> frames = base;
  for (const Role& r : code)
    if (std::find(base.begin(), base.end(), r) == base.end()) frames.push_back(r);
  for (const Role& r : frames)
    if (r.kind == "phase" && r.axis == "x") information += std::pow(2 * std::numbers::pi / r.period_px, 2);
  return std::sqrt(2 / information);
}

// Closest distance of two columns a turn apart, in amplitudes (Codes.MicroPhaseTellsColumnsApart).
double distance_of(const std::vector<Role>& code, int length) {
  double closest = 1e9;
  for (int lag = 8; lag < length; ++lag) {
    double sum = 0;
    for (const Role& r : code)
      if (r.axis == "x") sum += 2 * std::pow(std::sin(std::numbers::pi * lag / r.period_px), 2);
    closest = std::min(closest, sum);
  }
  return std::sqrt(closest);
}

}  // namespace

Result<CodeChoice> choose_code(const Sequence& sequence, const PhotoSource& photos, const std::string& projector,
                               const ChoiceOptions& options) {
  CS_TRY(const Prescan frames, frames_of(sequence, projector));
  CS_TRY(const std::vector<Sample> samples, sample_photos(frames, photos));
  const NoiseModel noise = noise_of(samples);
  const std::vector<Sample> lit = lit_directly(samples, noise);
  if (lit.size() < 200)
    return error(ErrorCode::kRefused,
                 "projector '{}': its fine stripes are not visible in the photos ({} of {} pixels show them). Is it on "
                 "and in focus, the lens cap off, the exposure long enough, and does the camera see its picture?",
                 projector, lit.size(), samples.size());
  CodeChoice choice;
  choice.projector = projector;
  std::vector<double> direct, relative;
  for (const Sample& s : lit) {
    direct.push_back(s.direct());
    relative.push_back(noise.sigma(s.offset[0]) / s.weaker());
  }
  choice.direct = percentile(direct, 0.5), choice.noise = percentile(relative, 0.5);
  ProjectorSpec spec;
  spec.id = projector;
  for (const auto& [id, size] : sequence.projectors)
    if (id == projector) spec.resolution = size;
  const std::vector<Role> base = base_roles(spec);
  const double indirect = (1 - choice.direct) / choice.direct;
  for (const char* code : {"micro-phase", "micro-phase-9"}) {
    CS_TRY(const std::vector<Role> roles, code_roles(code, spec));
    CodeForecast forecast;
    forecast.code = code;
    for (const Role& r : roles) forecast.frames += std::find(base.begin(), base.end(), r) == base.end();
    forecast.sigma_px = sigma_of(roles, base) * choice.noise;
    forecast.bias_px = 0.08 * std::pow(16.0 / 80, 1.8) * indirect;  // PHYSICS 8: .08 px at 80 px where both are equal
    forecast.lost = lost_by_phase(lit, noise, distance_of(roles, std::max(spec.resolution[0], spec.resolution[1])));
    forecast.good = forecast.lost <= options.most_lost && forecast.sigma_px <= options.most_sigma_px &&
                    forecast.bias_px <= options.most_bias_px;
    choice.forecasts.push_back(forecast);
  }
  std::stable_sort(choice.forecasts.begin(), choice.forecasts.end(),
                   [](const CodeForecast& a, const CodeForecast& b) { return a.frames < b.frames; });
  const auto good =
      std::find_if(choice.forecasts.begin(), choice.forecasts.end(), [](const auto& f) { return f.good; });
  const auto least = std::min_element(choice.forecasts.begin(), choice.forecasts.end(),
                                      [](const auto& a, const auto& b) { return a.lost < b.lost; });
  const CodeForecast& chosen = good != choice.forecasts.end() ? *good : *least;
  choice.code = chosen.code;
  choice.reason =
      fmt::format("{} of {} frames: {} (loses {:.2f} % of the pixels, bound {:.1f} %)", chosen.code, chosen.frames,
                  good != choice.forecasts.end() ? "the cheapest that stays below the bounds"
                                                 : "none stays below the bounds, this loses least",
                  100 * chosen.lost, 100 * options.most_lost);
  return choice;
}

std::string choice_text(const CodeChoice& choice) {
  std::string text =
      fmt::format("projector '{}': {:.0f} % of its light is direct, noise is {:.1f} % of the amplitude\n",
                  choice.projector, 100 * choice.direct, 100 * choice.noise);
  text += fmt::format("  {:<15}{:>8}{:>10}{:>12}{:>11}\n", "code", "frames", "lost %", "random px", "bias px");
  for (const CodeForecast& f : choice.forecasts)
    text += fmt::format("{} {:<15}{:>8}{:>10.2f}{:>12.3f}{:>11.4f}\n", f.code == choice.code ? ">" : " ", f.code,
                        f.frames, 100 * f.lost, f.sigma_px, f.bias_px);
  return text + "  " + choice.reason + "\n";
}

std::string choices_json(const std::vector<CodeChoice>& choices) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const CodeChoice& c : choices) {
    nlohmann::ordered_json table = nlohmann::ordered_json::array();
    for (const CodeForecast& f : c.forecasts)
      table.push_back({{"code", f.code},
                       {"frames", f.frames},
                       {"lost", f.lost},
                       {"sigma_px", f.sigma_px},
                       {"bias_px", f.bias_px},
                       {"good", f.good}});
    all.push_back({{"projector", c.projector},
                   {"code", c.code},
                   {"reason", c.reason},
                   {"direct", c.direct},
                   {"noise", c.noise},
                   {"forecasts", table}});
  }
  return nlohmann::ordered_json{{"format_version", 1}, {"choices", all}}.dump(1) + "\n";
}

}  // namespace countershade::capture

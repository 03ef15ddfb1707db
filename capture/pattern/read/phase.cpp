#include "capture/pattern/read/phase.h"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr double kShort = 2;              // times the shortest: periods that share offset and amplitude
constexpr double kTolerance = 0.01;       // of the amplitude: what the wave model is not trusted to know
constexpr double kLeastModulated = 0.02;  // of the light: below, a fringe is an artefact of the room's indirect light
constexpr double kSettled = 1e-3;         // px: a step that changes chi^2 by less than anyone sees
constexpr int kMostWaves = 64;
constexpr double kSameBlur = 1e-3;                 // px^2: while the blur of all is sought
constexpr double kLeastBlur = -1, kMostBlur = 25;  // px^2: less than none sharpens; of 16 px, a tenth is left
constexpr double kOwnBlur = 8;  // px^2: how far a pixel's blur may be from that of all: steep surfaces widen it most

struct Wave {
  double omega = 0, shift = 0;
  int photo = 0;
  double decay = 0;  // 2 pi^2 / period^2 less that of the base period [1 / px^2]
};

// Offset and phasor from the photos of one period, by least squares: (O, A cos p, A sin p) for light O + A cos(p +
// shift).
struct Group {
  double period = 0;
  std::vector<Wave> waves;
  Eigen::Matrix<double, 3, Eigen::Dynamic> solve;  // empty: fewer than three different shifts

  explicit Group(double period_px) : period(period_px) {}
  void prepare() {
    Eigen::MatrixX3d design(waves.size(), 3);
    for (std::size_t i = 0; i < waves.size(); ++i)
      design.row(i) << 1, std::cos(waves[i].shift), -std::sin(waves[i].shift);
    const Eigen::Matrix3d normal = design.transpose() * design;
    if (waves.size() >= 3 && normal.determinant() > 1e-3) solve = normal.inverse() * design.transpose();
  }
  bool full() const { return solve.cols() > 0; }
};

// The frames of an axis, sorted by what they are for.
struct Design {
  int length = 0;
  std::vector<Wave> waves;  // those that share offset and amplitude, the base period's first
  Group base{0};
  std::vector<Group> ladder;                           // longer periods, the longest first
  std::vector<std::vector<float>> cos_turn, sin_turn;  // per wave beyond the base's: of omega period m, m = -1, 0, ...
  int turns = 0;
  // Extra waves whose squares sum up to the same light at every phase (pairs in quadrature): they say how blurred a
  // pixel is before it is unwrapped. Their mean decay.
  std::vector<int> balanced;
  double balanced_decay = 0;

  int extra() const { return static_cast<int>(waves.size() - base.waves.size()); }
  bool has_longest() const { return !ladder.empty() && ladder[0].period > length - 1; }
};

std::vector<Group> groups_of(const AxisCode& code) {
  std::vector<Group> groups;
  for (std::size_t i = 0; i < code.waves.size(); ++i) {
    const WaveFrame& frame = code.waves[i];
    auto group =
        std::find_if(groups.begin(), groups.end(), [&](const Group& g) { return g.period == frame.period_px; });
    if (group == groups.end()) group = groups.insert(groups.end(), Group(frame.period_px));
    group->waves.push_back({kTurn / frame.period_px, frame.shift_rad, static_cast<int>(i)});
  }
  for (Group& g : groups) g.prepare();
  std::sort(groups.begin(), groups.end(), [](const Group& a, const Group& b) { return a.period > b.period; });
  return groups;
}

std::optional<Design> design_of(const AxisCode& code) {
  Design design;
  design.length = code.length_px;
  const std::vector<Group> groups = groups_of(code);
  const auto base = std::find_if(groups.rbegin(), groups.rend(), [](const Group& g) { return g.full(); });
  if (base == groups.rend()) return std::nullopt;
  design.base = *base;
  design.waves = base->waves;
  for (const Group& g : groups) {
    if (g.period == base->period) continue;
    if (g.period > kShort * base->period)
      design.ladder.push_back(g);
    else
      design.waves.insert(design.waves.end(), g.waves.begin(), g.waves.end());
  }
  std::erase_if(design.ladder, [](const Group& g) { return !g.full(); });
  const double base_omega = design.base.waves[0].omega;
  for (Wave& w : design.waves) w.decay = 0.5 * (w.omega * w.omega - base_omega * base_omega);
  for (const Group& g : groups) {
    if (g.period == base->period || g.period > kShort * base->period) continue;
    double c = 0, s = 0;
    for (const Wave& w : g.waves) c += std::cos(2 * w.shift), s += std::sin(2 * w.shift);
    if (std::hypot(c, s) > 1e-6) continue;
    for (std::size_t i = design.base.waves.size(); i < design.waves.size(); ++i)
      if (design.waves[i].omega == g.waves[0].omega) design.balanced.push_back(static_cast<int>(i));
  }
  for (const int i : design.balanced)
    design.balanced_decay += design.waves[i].decay / static_cast<double>(design.balanced.size());
  design.turns = static_cast<int>(std::ceil(code.length_px / design.base.period)) + 2;
  for (std::size_t i = design.base.waves.size(); i < design.waves.size(); ++i) {
    std::vector<float> c, s;
    for (int m = -1; m < design.turns - 1; ++m) {
      const double turn = design.waves[i].omega * design.base.period * m;
      c.push_back(static_cast<float>(std::cos(turn))), s.push_back(static_cast<float>(std::sin(turn)));
    }
    design.cos_turn.push_back(std::move(c)), design.sin_turn.push_back(std::move(s));
  }
  return design;
}

// The light of a wave at angle t, per amplitude of the base period, and its derivative.
struct Shape {
  double h2 = 0, h3 = 0, scale = 1;
  double value(double c) const { return scale * (-h2 + (1 - 3 * h3) * c + 2 * h2 * c * c + 4 * h3 * c * c * c); }
  double slope(double c, double s) const { return -scale * s * ((1 - 3 * h3) + 4 * h2 * c + 12 * h3 * c * c); }
};

std::vector<Shape> shapes_of(const Design& d, const WaveModel& model) {
  std::vector<Shape> shapes;
  for (const Wave& w : d.waves) {
    const double b = std::exp(-w.decay * model.blur);  // the n-th harmonic loses b^(n^2)
    shapes.push_back({model.h2 * b * b * b, model.h3 * std::pow(b, 8), b});
  }
  return shapes;
}

// What is known of a pixel: offset, amplitude, coordinate.
struct Fit {
  double offset = 0, amplitude = 0, q = 0, blur = 0;  // blur: beyond that of all pixels [px^2]
  double chi2 = 0, variance = 0;                      // of q; 0 where the frames do not determine it
};

// What a pixel's blur, beyond that of all, may be [px^2].
struct OwnBlur {
  double sigma = 0, least = 0;
};

using Values = std::array<double, kMostWaves>;

// Offset, amplitude and phase by the base period alone; q in [0, period).
Fit base_fit(const Design& d, const Values& v, const Shape& shape) {
  Fit fit;
  const std::vector<Wave>& waves = d.base.waves;
  double phase = 0;
  for (int pass = 0; pass < 3; ++pass) {
    Eigen::Vector3d solved = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < waves.size(); ++i) {
      double value = v[i];
      if (pass > 0) {
        const double c = std::cos(phase + waves[i].shift);
        value -= fit.amplitude * (shape.value(c) - c);
      }
      solved += value * d.base.solve.col(static_cast<Eigen::Index>(i));
    }
    fit.offset = solved[0];
    fit.amplitude = std::hypot(solved[1], solved[2]);
    phase = std::atan2(solved[2], solved[1]);
    if (shape.h2 == 0 && shape.h3 == 0) break;
  }
  if (phase < 0) phase += kTurn;
  fit.q = phase / kTurn * d.base.period;
  return fit;
}

// Gauss-Newton steps from a fit that is nearly right.
struct Normal {
  Eigen::Matrix4d inverse;
  Eigen::Matrix<double, 4, kMostWaves> jacobian;  // columns by wave; rows offset, amplitude, q, blur
  Values residual, weight;
};

void adjust(const Design& d, const Values& v, const Values& variance, const std::vector<Shape>& shapes,
            OwnBlur own_blur, int steps, Fit& fit, Normal& normal) {
  const std::size_t n = d.waves.size();
  for (int step = 0; step <= steps; ++step) {
    Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
    Eigen::Vector4d g = Eigen::Vector4d::Zero();
    A(3, 3) = 1 / (own_blur.sigma * own_blur.sigma);
    g[3] = -fit.blur * A(3, 3);
    fit.chi2 = fit.blur * fit.blur * A(3, 3);
    for (std::size_t i = 0; i < n; ++i) {
      const double t = d.waves[i].omega * fit.q + d.waves[i].shift, c = std::cos(t), s = std::sin(t);
      const double decay = d.waves[i].decay, own = decay == 0 ? 1 : std::exp(-decay * fit.blur);
      const double f = own * shapes[i].value(c);
      const Eigen::Vector4d j(1, f, fit.amplitude * own * d.waves[i].omega * shapes[i].slope(c, s),
                              -decay * fit.amplitude * f);
      const double allowed = kTolerance * fit.amplitude;
      normal.weight[i] = 1 / (variance[i] + allowed * allowed);
      normal.residual[i] = v[i] - fit.offset - fit.amplitude * f;
      normal.jacobian.col(static_cast<Eigen::Index>(i)) = j;
      A.noalias() += normal.weight[i] * j * j.transpose();
      g += normal.weight[i] * normal.residual[i] * j;
      fit.chi2 += normal.weight[i] * normal.residual[i] * normal.residual[i];
    }
    bool invertible = false;
    double determinant = 0;
    A.computeInverseAndDetWithCheck(normal.inverse, determinant, invertible, 1e-300);
    fit.variance = invertible ? normal.inverse(2, 2) : 0;
    if (!invertible || step == steps) return;
    const Eigen::Vector4d delta = normal.inverse * g;
    // A step of more than a sixth of a period has left where the model is linear.
    const double reach = d.base.period / 6;
    fit.offset += delta[0], fit.amplitude += delta[1], fit.q += std::clamp(delta[2], -reach, reach);
    fit.blur = std::clamp(fit.blur + delta[3], own_blur.least, kMostBlur);
    if (step > 0 && std::abs(delta[2]) < kSettled) return;
  }
}

// Cost of every way to unwrap, by the waves beyond the base's: cost[m + 1] for q = fit.q + m period.
void costs_of_turns(const Design& d, const Values& v, const Values& variance, const std::vector<Shape>& shapes,
                    const Fit& fit, std::vector<float>& cost) {
  cost.assign(d.turns, 0.0f);
  const std::size_t base = d.base.waves.size();
  const double allowed = kTolerance * fit.amplitude;
  for (int e = 0; e < d.extra(); ++e) {
    const Wave& wave = d.waves[base + e];
    const Shape& shape = shapes[base + e];
    const auto h2 = static_cast<float>(shape.h2), h3 = static_cast<float>(shape.h3);
    const double t = wave.omega * fit.q + wave.shift;
    const auto ca = static_cast<float>(std::cos(t)), sa = static_cast<float>(std::sin(t));
    const auto rest = static_cast<float>(v[base + e] - fit.offset),
               amplitude = static_cast<float>(fit.amplitude * shape.scale * std::exp(-wave.decay * fit.blur));
    const auto weight = static_cast<float>(1 / (variance[base + e] + allowed * allowed));
    const float *ct = d.cos_turn[e].data(), *st = d.sin_turn[e].data();
    float* out = cost.data();
    for (int m = 0; m < d.turns; ++m) {
      const float c = ca * ct[m] - sa * st[m];
      const float r = rest - amplitude * (-h2 + c * ((1 - 3 * h3) + c * (2 * h2 + c * (4 * h3))));
      out[m] += weight * r * r;
    }
  }
}

// The nearest coordinate of a group's phase to an estimate.
double nearest_of(const Group& g, const Eigen::Vector3d& solved, double estimate) {
  const double q = std::atan2(solved[2], solved[1]) / kTurn * g.period;
  return q + std::round((estimate - q) / g.period) * g.period;
}

// Everything read_phase does with one pixel.
class PixelReader {
 public:
  // blur_sigma: of a pixel's blur about the model's [px^2].
  PixelReader(const Design& design, const WavePhotos& photos, const WaveModel& model, double blur_sigma)
      : d_(design),
        photos_(photos),
        noise_(model.noise),
        shapes_(shapes_of(design, model)),
        own_blur_{blur_sigma, kLeastBlur - model.blur} {}

  void load(std::size_t pixel) {
    pixel_ = pixel;
    for (std::size_t i = 0; i < d_.waves.size(); ++i) {
      values_[i] = value(d_.waves[i]);
      variance_[i] = noise_.read * noise_.read + noise_.photon * std::max(0.0, values_[i]);
    }
  }
  // By the base period; with the blur that the amplitudes of the others say.
  Fit base() const {
    Fit fit = base_fit(d_, values_, shapes_[0]);
    if (d_.balanced.empty() || own_blur_.sigma < kOwnBlur) return fit;
    double measured = 0, expected = 0;
    for (const int i : d_.balanced) {
      const Shape& shape = shapes_[i];
      measured += std::pow(values_[i] - fit.offset, 2) - variance_[i];
      expected += std::pow(fit.amplitude * shape.scale, 2) * (1 + shape.h2 * shape.h2 + shape.h3 * shape.h3) / 2;
    }
    const double ratio = std::clamp(measured / expected, 0.25, 8.0);  // of squares
    fit.blur = std::clamp(-std::log(ratio) / (2 * d_.balanced_decay), own_blur_.least, kMostBlur);
    return fit;
  }
  double variance_of(int wave) const { return variance_[wave]; }

  // Where the longer periods put it; NaN where there are none.
  double ladder_estimate() const {
    if (!d_.has_longest()) return kNaN;
    double estimate = 0.5 * d_.length;
    for (const Group& g : d_.ladder) {
      Eigen::Vector3d solved = Eigen::Vector3d::Zero();
      for (std::size_t i = 0; i < g.waves.size(); ++i)
        solved += value(g.waves[i]) * g.solve.col(static_cast<Eigen::Index>(i));
      estimate = nearest_of(g, solved, estimate);
    }
    return estimate;
  }

  // The fits of the two likeliest ways to unwrap, or of those next to the estimate.
  void unwrap(Fit base, double estimate, Fit& best, Fit& second) {
    const int turns = d_.turns;
    costs_of_turns(d_, values_, variance_, shapes_, base, cost_);
    if (std::isfinite(estimate))
      for (int m = 0; m < turns; ++m)
        if (std::abs(base.q + (m - 1) * d_.base.period - estimate) > 0.75 * d_.base.period) cost_[m] += 1e9f;
    for (int m = 0; m < turns; ++m) {
      const double q = base.q + (m - 1) * d_.base.period;
      if (q < -1 || q > d_.length) cost_[m] += 1e9f;
    }
    const auto smallest = [&] { return std::min_element(cost_.begin(), cost_.end()) - cost_.begin(); };
    const auto first = smallest();
    const float first_cost = cost_[first];
    cost_[first] = 1e30f;
    const auto next = smallest();
    best = second = base;
    best.q += (static_cast<double>(first) - 1) * d_.base.period;
    fit(best);
    second.chi2 = 1e9, second.q += (static_cast<double>(next) - 1) * d_.base.period;
    // The costs still hold the base's noise: only what is far behind is out of the question.
    if (cost_[next] - first_cost < 12 * kClearOdds && cost_[next] < 1e8f) {
      fit(second);
      if (second.chi2 < best.chi2) std::swap(best, second);
    }
  }

  void fit(Fit& fit) { adjust(d_, values_, variance_, shapes_, own_blur_, 3, fit, normal_); }
  const Normal& normal() const { return normal_; }

 private:
  double value(const Wave& wave) const { return photos_.light[wave.photo].data()[pixel_]; }

  const Design& d_;
  const WavePhotos& photos_;
  NoiseModel noise_;
  std::vector<Shape> shapes_;
  OwnBlur own_blur_;  // its sigma is kSameBlur while the model is sought
  std::size_t pixel_ = 0;
  Values values_{}, variance_{};
  std::vector<float> cost_;
  Normal normal_;
};

float percentile99(std::vector<float> values) {
  if (values.empty()) return 0;
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// Pixels to fit the wave model to: those with the most modulation by the base period, evenly picked.
std::vector<std::size_t> modulated_most(const Design& d, const WavePhotos& photos, std::size_t most) {
  std::vector<std::pair<float, std::size_t>> amplitudes;
  const std::size_t step = std::max<std::size_t>(1, photos.skip.pixels() / (8 * most));
  WaveModel none;
  PixelReader reader(d, photos, none, kSameBlur);
  for (std::size_t i = 0; i < photos.skip.pixels(); i += step) {
    if (photos.skip.data()[i]) continue;
    reader.load(i);
    amplitudes.emplace_back(static_cast<float>(reader.base().amplitude), i);
  }
  std::vector<float> only(amplitudes.size());
  std::transform(amplitudes.begin(), amplitudes.end(), only.begin(), [](const auto& a) { return a.first; });
  const float least = 0.2f * percentile99(only);
  std::vector<std::size_t> picked;
  for (const auto& [amplitude, i] : amplitudes)
    if (amplitude > least) picked.push_back(i);
  if (picked.size() <= most) return picked;
  std::vector<std::size_t> fewer;
  for (std::size_t k = 0; k < most; ++k) fewer.push_back(picked[k * picked.size() / most]);
  return fewer;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

Fit likeliest(PixelReader& reader, std::size_t pixel, const Image* coarse) {
  reader.load(pixel);
  Fit best, second;
  const double estimate = coarse ? coarse->data()[pixel] : reader.ladder_estimate();
  reader.unwrap(reader.base(), estimate, best, second);
  return best;
}

// Harmonics of a sinusoid raised to a power (its Fourier series).
Shape raised(double e) {
  return {(e - 1) / (e + 2), (e - 1) * (e - 2) / ((e + 2) * (e + 3)), 1};
}

struct Sample {
  std::size_t pixel = 0;
  Fit fit;
};

std::vector<Sample> likeliest_of(const Design& d, const WavePhotos& photos, const WaveModel& model,
                                 const std::vector<std::size_t>& pixels, const Image* coarse) {
  std::vector<Sample> samples(pixels.size());
  constexpr std::size_t kChunk = 256;
  parallel_for(static_cast<int>((pixels.size() + kChunk - 1) / kChunk), [&](int chunk) {
    PixelReader reader(d, photos, model, kSameBlur);
    for (std::size_t k = chunk * kChunk; k < std::min(pixels.size(), (chunk + 1) * kChunk); ++k)
      samples[k] = {pixels[k], likeliest(reader, pixels[k], coarse)};
  });
  std::vector<double> costs;
  for (const Sample& s : samples) costs.push_back(s.fit.chi2);
  const double limit = 4 * median(costs) + 1e-12;
  std::erase_if(samples, [&](const Sample& s) { return s.fit.chi2 > limit; });
  return samples;
}

// Harmonics and blur that all pixels' residuals have in common: one Gauss-Newton step, the pixels' own unknowns
// eliminated.
void improve_waves(const Design& d, const WavePhotos& photos, const std::vector<Sample>& samples, WaveModel& model) {
  PixelReader reader(d, photos, model, kSameBlur);
  const auto n = static_cast<Eigen::Index>(d.waves.size());
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero(), all = g;
  for (const Sample& s : samples) {
    Fit fit = s.fit;
    reader.load(s.pixel);
    reader.fit(fit);
    const auto J = reader.normal().jacobian.leftCols(n).transpose();
    Eigen::MatrixX3d E(n, 3);
    Eigen::VectorXd r(n), w(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double t = d.waves[i].omega * fit.q + d.waves[i].shift;
      const double b = std::exp(-d.waves[i].decay * model.blur), A1 = fit.amplitude * b;
      const double A2 = A1 * b * b * b, A3 = A1 * std::pow(b, 8);  // of harmonics of strength 1
      E.row(i) << A2 * std::cos(2 * t), A3 * std::cos(3 * t),
          -d.waves[i].decay *
              (A1 * std::cos(t) + 4 * model.h2 * A2 * std::cos(2 * t) + 9 * model.h3 * A3 * std::cos(3 * t));
      r[i] = reader.normal().residual[i], w[i] = reader.normal().weight[i];
    }
    all += (E.array().square().colwise() * w.array()).colwise().sum().matrix().transpose();
    const Eigen::MatrixX3d own = E - J * (reader.normal().inverse * (J.transpose() * (w.asDiagonal() * E)));
    A += own.transpose() * w.asDiagonal() * own;
    g += own.transpose() * w.asDiagonal() * r;
  }
  // What the pixels' own unknowns can imitate (the third harmonic, in four steps; blur, of one period) is left alone.
  for (int h = 0; h < 3; ++h)
    if (!(A(h, h) > 0.05 * all[h])) A.row(h).setZero(), A.col(h).setZero(), A(h, h) = 1, g[h] = 0;
  const Eigen::Vector3d step = A.ldlt().solve(g);
  model.h2 = std::clamp(model.h2 + step[0], -0.5, 0.5);
  model.h3 = std::clamp(model.h3 + step[1], -0.3, 0.3);
  model.blur = std::clamp(model.blur + step[2], kLeastBlur, kMostBlur);
}

NoiseModel noise_left(const Design& d, const WavePhotos& photos, const std::vector<Sample>& samples,
                      const WaveModel& model) {
  PixelReader reader(d, photos, model, kSameBlur);
  std::vector<float> residuals, light;
  for (const Sample& s : samples) {
    Fit fit = s.fit;
    reader.load(s.pixel);
    reader.fit(fit);
    const Normal& n = reader.normal();
    for (std::size_t i = 0; i < d.waves.size(); ++i) {
      const auto j = n.jacobian.col(static_cast<Eigen::Index>(i));
      const double left = 1 - n.weight[i] * j.dot(n.inverse * j);
      if (left < 0.1) continue;
      residuals.push_back(static_cast<float>(n.residual[i] / std::sqrt(left)));
      light.push_back(photos.light[d.waves[i].photo].data()[s.pixel]);
    }
  }
  return noise_of_residuals(residuals, light, 1);
}

// Smallest distance, in amplitudes, between the light of two coordinates a turn or more apart.
double closest_turns(const Design& d) {
  double closest = 1e9;
  for (int m = 1; m <= d.turns; ++m)
    for (int j = -8; j <= 8; ++j) {
      const double lag = m * d.base.period + j * d.base.period / 24;
      if (lag > d.length) continue;
      double sum = 0;
      for (const Wave& w : d.waves) sum += 2 * std::pow(std::sin(0.5 * w.omega * lag), 2);
      closest = std::min(closest, sum);
    }
  return std::sqrt(closest);
}

}  // namespace

Result<void> check_waves(const AxisCode& code, const std::string& projector, const char* axis) {
  if (code.waves.size() > kMostWaves)
    return error(ErrorCode::kUnsupported, "projector '{}': {} phase frames of axis {}; at most {} can be decoded",
                 projector, code.waves.size(), axis, kMostWaves);
  const std::vector<Group> groups = groups_of(code);
  const auto design = design_of(code);
  if (!design)
    return error(ErrorCode::kRefused,
                 "projector '{}': no period of the phase frames of axis {} has three different shifts; the shortest "
                 "needs them, to tell offset, amplitude and phase apart",
                 projector, axis);
  for (const Group& g : groups)
    if (g.period > kShort * design->base.period && !g.full())
      return error(ErrorCode::kRefused,
                   "projector '{}': the phase frames of axis {} with period {} px need three different shifts, since "
                   "they are more than {} times as long as the shortest of {} px",
                   projector, axis, g.period, kShort, design->base.period);
  if (code.bits.empty() && !design->has_longest() && design->base.period < code.length_px &&
      closest_turns(*design) < 0.1)
    return error(ErrorCode::kRefused,
                 "projector '{}': the phase frames of axis {} do not say which time round they are: their periods "
                 "repeat together within {} px; add a Gray code, a period of {} px, or another short one",
                 projector, axis, code.length_px, code.length_px);
  return {};
}

WaveModel fit_wave_model(const AxisCode& code, const WavePhotos& photos, const Image* coarse, const NoiseModel& noise) {
  WaveModel model{0, 0, 0, noise.read > 0 ? noise : NoiseModel{5e-3, 0}};
  const auto design = design_of(code);
  CS_CHECK(design.has_value(), "check_waves was asked");
  if (design->waves.size() < 4) return model;
  const std::vector<std::size_t> pixels = modulated_most(*design, photos, 20000);
  std::vector<std::size_t> few;
  for (std::size_t k = 0; k < pixels.size(); k += std::max<std::size_t>(1, pixels.size() / 1500))
    few.push_back(pixels[k]);
  if (few.size() < 200) return model;
  // Any projector's response, from far off: 1 = the pattern was made for it.
  double least = std::numeric_limits<double>::infinity();
  for (double e : {1.0, 0.6, 0.8, 0.9, 1.1, 1.3, 1.6, 2.2, 2.8}) {
    const WaveModel tried{raised(e).h2, raised(e).h3, 0, {1e-3, 0}};
    std::vector<double> costs;
    for (const Sample& s : likeliest_of(*design, photos, tried, few, coarse)) costs.push_back(s.fit.chi2);
    if (const double cost = median(std::move(costs)); cost < least) least = cost, model = tried;
  }
  for (int round = 0; round < 4; ++round) {
    const auto samples = likeliest_of(*design, photos, model, round < 3 ? few : pixels, coarse);
    improve_waves(*design, photos, samples, model);
    model.noise = noise_left(*design, photos, samples, model);
  }
  return model;
}

PhaseReading read_phase(const AxisCode& code, const WavePhotos& photos, const WaveModel& model, const Image* coarse,
                        const DecodeOptions& options) {
  const auto design = design_of(code);
  CS_CHECK(design.has_value(), "check_waves was asked");
  const int width = photos.skip.width(), height = photos.skip.height();
  PhaseReading result;
  AxisReading& reading = result.reading;
  reading.length_px = code.length_px;
  reading.q = reading.sigma = result.other = Image(width, height, 1, kNaN);
  reading.contrast = Image(width, height, 1);
  reading.reason = Mask(width, height, 1);
  Image offset(width, height, 1);
  parallel_for(height, [&](int y) {
    PixelReader reader(*design, photos, model, kOwnBlur);
    const double dof = static_cast<double>(design->waves.size()) - (design->extra() > 0 ? 4 : 3);
    for (int x = 0; x < width; ++x) {
      const std::size_t i = static_cast<std::size_t>(y) * width + x;
      if (photos.skip.data()[i]) continue;
      reader.load(i);
      Fit base = reader.base(), best, second;
      reading.contrast.data()[i] = static_cast<float>(2 * base.amplitude);
      offset.data()[i] = static_cast<float>(base.offset);
      const double least = options.min_snr * std::sqrt(2 * reader.variance_of(0) / design->base.waves.size());
      Reason why = Reason::kAccepted;
      if (!(base.amplitude > least) || !std::isfinite(base.offset)) {
        why = Reason::kDark;
      } else {
        const double estimate = coarse ? coarse->data()[i] : reader.ladder_estimate();
        reader.unwrap(base, estimate, best, second);
        if (best.variance <= 0 || best.chi2 > dof + 9 * std::sqrt(2 * std::max(1.0, dof)))
          why = Reason::kPhase;
        else if (best.q < -1.25 || best.q > design->length + 0.25)
          why = Reason::kInconsistent;
        else if (second.chi2 - best.chi2 < kClearOdds)
          why = Reason::kUncertainBit;
        const double excess = dof > 0 ? std::max(1.0, best.chi2 / dof) : 1;
        reading.q.data()[i] = static_cast<float>(best.q);
        reading.sigma.data()[i] = static_cast<float>(std::sqrt(std::max(0.0, best.variance) * excess));
        if (second.chi2 - best.chi2 < kClearOdds) result.other.data()[i] = static_cast<float>(second.q);
      }
      reading.reason.data()[i] = static_cast<std::uint8_t>(why);
    }
  });
  const auto dark = static_cast<float>(options.dark_fraction * percentile99(reading.contrast.data()));
  const auto lit = static_cast<float>(options.dark_fraction * percentile99(offset.data()));
  for (std::size_t i = 0; i < reading.q.data().size(); ++i) {
    std::uint8_t& reason = reading.reason.data()[i];
    const float contrast = reading.contrast.data()[i];
    const bool weak = contrast < dark || contrast < kLeastModulated * 2 * offset.data()[i];
    if (photos.skip.data()[i]) continue;
    if (weak || reason == static_cast<std::uint8_t>(Reason::kDark))
      reason = static_cast<std::uint8_t>(offset.data()[i] > lit ? Reason::kIndirect : Reason::kDark);
    if (reason && reason != static_cast<std::uint8_t>(Reason::kUncertainBit)) reading.q.data()[i] = kNaN;
  }
  return result;
}

}  // namespace countershade::capture

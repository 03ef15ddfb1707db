// sim-truth: the simulator against theory: every law with its deviation in standard errors, over rooms and seeds that
// are fixed beforehand. What is random must deviate like a standard normal, what is not must not deviate.
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "simdata/device/sensor.h"
#include "simdata/render/patch_truth.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "solver/transport/form_factor.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

constexpr int kSeeds = 5;

struct Score {
  std::string law, room;
  int seed = 0;
  double z = 0;
};

// What a law of no randomness leaves.
struct Exact {
  std::string law, room;
  double deviation = 0, bound = 0;
};

struct Findings {
  std::vector<Score> scores;
  std::vector<Exact> exact;
};

std::uint64_t seed_of(int seed) {
  return mix(hash_name("sim-truth") + static_cast<std::uint64_t>(seed)) % 1000000007;
}

Result<std::shared_ptr<simdata::Simulator>> small(const std::string& kind, int seed,
                                                  const std::filesystem::path& folder, int samples = 1024) {
  CS_TRY(simdata::RigAndRoom room, simdata::default_room(kind));
  room = simdata::smaller(std::move(room), 8, 8, samples);
  room.simulation.block_px = 4;
  room.simulation.seed = seed_of(seed);
  for (const auto& [name, contents] : room.files) CS_TRY_VOID(write_atomically(folder / name, contents));
  for (SimulatedSurface& s : room.simulation.surfaces)
    if (!s.mesh.empty()) s.mesh = folder / s.mesh;
  SilentProgress quiet;
  return simdata::Simulator::make(room.rig, room.simulation, quiet);
}

// Different in every index, smooth, no two projectors alike.
std::vector<Picture> waves(const Rig& rig) {
  std::vector<Picture> pictures;
  for (const ProjectorSpec& spec : rig.projectors) {
    const int q = static_cast<int>(pictures.size());
    Picture p(spec.resolution[0], spec.resolution[1], 3);
    for (int y = 0; y < p.height(); ++y)
      for (int x = 0; x < p.width(); ++x)
        for (int c = 0; c < 3; ++c)
          p.at(x, y, c) = static_cast<std::uint16_t>(65535 * (0.5 + 0.3 * std::sin(0.03 * x + 0.02 * y + c + 2 * q) +
                                                              0.15 * std::cos(0.05 * y - 0.01 * x + q)));
    pictures.push_back(std::move(p));
  }
  return pictures;
}

// Pixels whose neighbours see the same surface, on a raster that starts at random.
std::vector<Eigen::Vector2d> pixels_of(const simdata::Simulator& simulator, int wanted, Random& random) {
  const simdata::TrueGeometry g = simulator.geometry(0);
  std::vector<Eigen::Vector2d> inside, chosen;
  for (int y = 1; y + 1 < g.surface.height(); ++y)
    for (int x = 1; x + 1 < g.surface.width(); ++x) {
      bool same = g.surface.at(x, y) >= 0 && g.albedo.at(x, y, 1) > 0;
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) same &= g.surface.at(x + dx, y + dy) == g.surface.at(x, y);
      if (same) inside.emplace_back(x, y);
    }
  for (int i = 0; i < wanted && !inside.empty(); ++i)
    chosen.push_back(inside[static_cast<std::size_t>(random.uniform() * static_cast<double>(inside.size()))]);
  return chosen;
}

// Light by the fast path against full path tracing, per pixel.
Result<void> fast_path(const std::string& kind, int seed, const std::filesystem::path& folder, Findings& findings) {
  CS_TRY(const auto simulator, small(kind, seed, folder));
  const std::vector<Picture> pictures = waves(simulator->rig());
  const Image fast = simulator->light(0, pictures).indirect;
  Random random(seed_of(seed) ^ hash_name(kind));
  const std::vector<Eigen::Vector2d> pixels = pixels_of(*simulator, 8, random);
  const auto traced = simulator->trace_indirect(0, pictures, pixels, 4000);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const double value = fast.at(static_cast<int>(pixels[i].x()), static_cast<int>(pixels[i].y()), 1);
    findings.scores.push_back(
        {"fast path = path tracing", kind, seed, (value - traced.mean[3 * i + 1]) / traced.standard_error[3 * i + 1]});
  }
  return {};
}

// Vertical stripes, finer than a block of 4 pixels or just as wide.
std::vector<Picture> stripes(const Rig& rig, int period_px) {
  std::vector<Picture> pictures;
  for (const ProjectorSpec& spec : rig.projectors) {
    Picture p(spec.resolution[0], spec.resolution[1], 3);
    for (int y = 0; y < p.height(); ++y)
      for (int x = 0; x < p.width(); ++x)
        for (int c = 0; c < 3; ++c) p.at(x, y, c) = 2 * (x % period_px) < period_px ? 65535 : 0;
    pictures.push_back(std::move(p));
  }
  return pictures;
}

// What the fast path gets wrong where a law is bounded only.
struct Bounded {
  double beside_percent = 0;  // of white, within a block's width of the crease under stripes as fine as a block
};

// Stripes of any fineness: the blocks of the fast path average them, which path tracing must not see but beside the
// crease, where a stripe lights its other side from near by.
Result<void> fine_stripes(int seed, const std::filesystem::path& folder, Findings& findings, Bounded& bounded) {
  constexpr double kBlock = 0.1;  // m: 4 of the picture's 160 pixels are 8 to 9 cm of the walls
  CS_TRY(const auto simulator, small("two-wall", seed, folder));
  CS_TRY(const Device camera, simdata::true_camera(simulator->simulation(), simulator->rig().cameras[0].id));
  const simdata::TrueGeometry g = simulator->geometry(0);
  Random random(seed_of(seed) ^ hash_name("stripes"));
  for (int period : {2, 4, 8}) {
    const std::vector<Picture> pictures = stripes(simulator->rig(), period);
    const Image fast = simulator->light(0, pictures).indirect;
    std::vector<Eigen::Vector2d> far, near;
    for (const Eigen::Vector2d& q : pixels_of(*simulator, 4000, random)) {
      const Ray ray = camera.ray(q);
      const Eigen::Vector3d x =
          ray.origin + g.depth.at(static_cast<int>(q.x()), static_cast<int>(q.y())) * ray.direction;
      const double from_crease = std::hypot(x.x(), x.z());
      if (from_crease > 2 * kBlock && far.size() < 4) far.push_back(q);
      if (from_crease < kBlock && near.size() < 12) near.push_back(q);
    }
    const auto at = [&](const Eigen::Vector2d& q) {
      return static_cast<double>(fast.at(static_cast<int>(q.x()), static_cast<int>(q.y()), 1));
    };
    const auto traced_far = simulator->trace_indirect(0, pictures, far, 4000),
               traced_near = simulator->trace_indirect(0, pictures, near, 40000);
    for (std::size_t i = 0; i < far.size(); ++i)
      findings.scores.push_back({"fast path = path tracing, fine stripes", "two-wall", seed,
                                 (at(far[i]) - traced_far.mean[3 * i + 1]) / traced_far.standard_error[3 * i + 1]});
    const double white = simulator->simulation().cameras[0].white_level;
    for (std::size_t i = 0; i < near.size(); ++i)
      bounded.beside_percent =
          std::max(bounded.beside_percent, 100 * std::abs(at(near[i]) - traced_near.mean[3 * i + 1]) / white);
  }
  return {};
}

// All indirect light of the glossy room, over many pixels and paths: light that has bounced before it meets gloss is a
// hundredth of it.
Result<double> gloss(const std::filesystem::path& folder, Findings& findings) {
  CS_TRY(const auto simulator, small("glossy", 0, folder));
  const std::vector<Picture> pictures = waves(simulator->rig());
  Random random(seed_of(0) ^ hash_name("gloss"));
  const std::vector<Eigen::Vector2d> pixels = pixels_of(*simulator, 150, random);
  const Image fast = simulator->light(0, pictures).indirect;
  const auto traced = simulator->trace_indirect(0, pictures, pixels, 60000);
  double sum = 0, expected = 0, variance = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    sum += fast.at(static_cast<int>(pixels[i].x()), static_cast<int>(pixels[i].y()), 1);
    expected += traced.mean[3 * i + 1];
    variance += traced.standard_error[3 * i + 1] * traced.standard_error[3 * i + 1];
  }
  findings.scores.push_back({"all indirect light = path tracing", "glossy", 0, (sum - expected) / std::sqrt(variance)});
  return sum / expected - 1;
}

void light_wholly(SimulatedSurface& s) {
  s.daylight = 1, s.daylight_from = {0, 0}, s.daylight_to = {1, 1};
}

// Path tracing in a closed room whose walls are all lit alike: radiosity rho / (1 - rho) of it.
Result<void> furnace(int seed, Findings& findings) {
  CS_TRY(simdata::RigAndRoom room, simdata::default_room("closed-room"));
  room = simdata::smaller(std::move(room), 8, 8, 64);
  room.simulation.seed = seed_of(seed);
  const std::array<double, 3> rho{0.4, 0.65, 0.85};
  for (SimulatedSurface& s : room.simulation.surfaces) s.albedo = rho, light_wholly(s);
  for (SimulatedProjector& p : room.simulation.projectors) p.black_level = 0;
  SilentProgress quiet;
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, quiet));
  Random random(seed_of(seed) ^ hash_name("furnace"));
  const std::vector<Eigen::Vector2d> pixels = pixels_of(*simulator, 4, random);
  const auto traced = simulator->trace_indirect(0, std::vector<Picture>(2), pixels, 4000);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    // One channel: all share their paths.
    const double expected = simulator->scale(0) * rho[0] * rho[0] / (1 - rho[0]);
    findings.scores.push_back(
        {"white furnace", "closed-room", seed, (traced.mean[3 * i] - expected) / traced.standard_error[3 * i]});
  }
  return {};
}

// Path tracing in part of a sphere, part of which is lit: rank one, in closed form.
Result<void> sphere(int seed, Findings& findings) {
  CS_TRY(simdata::RigAndRoom room, simdata::default_room("dome"));
  room = simdata::smaller(std::move(room), 8, 8, 64);
  room.simulation.seed = seed_of(seed);
  SimulatedSurface& dome = room.simulation.surfaces[0];
  Random random(seed_of(seed) ^ hash_name("sphere"));
  dome.daylight = 1, dome.daylight_from = {random.uniform(0, 0.4), random.uniform(0, 0.4)};
  dome.daylight_to = {random.uniform(0.5, 1), random.uniform(0.5, 1)};
  for (SimulatedProjector& p : room.simulation.projectors) p.black_level = 0;
  SilentProgress quiet;
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, quiet));
  const auto sine = [&](double v) {
    return std::sin((dome.elevation_deg[0] + v * (dome.elevation_deg[1] - dome.elevation_deg[0])) * std::numbers::pi /
                    180);
  };
  const double turn = (dome.azimuth_deg[1] - dome.azimuth_deg[0]) / 360;
  const double share = turn * (sine(1) - sine(0)) / 2, rho = dome.albedo[0];
  const double lit = turn * (dome.daylight_to[0] - dome.daylight_from[0]) *
                     (sine(dome.daylight_to[1]) - sine(dome.daylight_from[1])) / 2;
  const double expected = simulator->scale(0) * rho * rho * lit / (1 - rho * share);
  const std::vector<Eigen::Vector2d> pixels = pixels_of(*simulator, 4, random);
  const auto traced = simulator->trace_indirect(0, std::vector<Picture>(2), pixels, 4000);
  for (std::size_t i = 0; i < pixels.size(); ++i)
    findings.scores.push_back(
        {"rank-one sphere", "dome", seed, (traced.mean[3 * i] - expected) / traced.standard_error[3 * i]});
  return {};
}

// Form factors by rays against the exact ones of polygons, and against each other by reciprocity.
Result<void> form_factors_by_rays(const std::string& kind, int seed, Findings& findings) {
  CS_TRY(simdata::RigAndRoom room, simdata::default_room(kind));
  room = simdata::smaller(std::move(room), 8, 8, 64);
  room.simulation.seed = seed_of(seed);
  SilentProgress quiet;
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, quiet));
  constexpr int kNu = 4, kNv = 3;
  const simdata::PatchTruth truth = simulator->patch_truth(kNu, kNv, 40000, quiet);
  const Patches patches(std::vector<std::pair<int, int>>(simulator->screen().size(), {kNu, kNv}));
  const auto F = solver::form_factors(simulator->screen(), patches, solver::FormFactorMethod::kExact, quiet);
  Random random(seed_of(seed) ^ hash_name(kind) ^ hash_name("form factors"));
  for (int tries = 0, taken = 0; tries < 10000 && taken < 8; ++tries) {
    const int i = static_cast<int>(random.uniform() * patches.size()),
              j = static_cast<int>(random.uniform() * patches.size());
    if (!(truth.form_factor(i, j) > 2e-3) || i == j) continue;  // 80 rays and more: nearly normal
    findings.scores.push_back({"form factor by rays = exact", kind, seed,
                               (truth.form_factor(i, j) - F(i, j)) / truth.form_factor_sigma(i, j)});
    const double ij = truth.area[i] * truth.form_factor(i, j), ji = truth.area[j] * truth.form_factor(j, i);
    findings.scores.push_back({"reciprocity A F", kind, seed,
                               (ij - ji) / std::hypot(truth.area[i] * truth.form_factor_sigma(i, j),
                                                      truth.area[j] * truth.form_factor_sigma(j, i))});
    ++taken;
  }
  return {};
}

// Photon transfer: mean and variance of stored values at a level.
void sensor(int seed, Findings& findings) {
  SimulatedCamera camera;
  CameraSpec spec;
  spec.pedestal = 64;
  for (int level = 1; level <= 6; ++level) {
    const Image light(300, 200, 1, 0.13f * static_cast<float>(level));
    const capture::Exposure e = simdata::expose(light, camera, spec, camera.reference_exposure_ms,
                                                mix(seed_of(seed)) ^ static_cast<std::uint64_t>(level));
    double mean = 0, square = 0;
    for (float v : e.values.data()) mean += v, square += static_cast<double>(v) * v;
    const double n = static_cast<double>(e.values.data().size()), per_electron = (4095. - 64) / camera.full_well_e;
    mean /= n;
    const double variance = square / n - mean * mean;
    const double electrons = 0.13 * level * camera.full_well_e;
    const double expected =
        (electrons + camera.read_noise_e * camera.read_noise_e) * per_electron * per_electron + 1. / 12;
    findings.scores.push_back(
        {"sensor: mean", "-", seed, (mean - 64 - electrons * per_electron) / std::sqrt(expected / n)});
    findings.scores.push_back({"sensor: variance", "-", seed, (variance / expected - 1) / std::sqrt(2 / n)});
  }
}

// Laws without randomness: linearity, and one path being direct plus indirect.
Result<void> exact_laws(const std::string& kind, const std::filesystem::path& folder, Findings& findings) {
  CS_TRY(const auto simulator, small(kind, 0, folder, 64));
  const Rig& rig = simulator->rig();
  std::vector<Picture> left, right, both, none(rig.projectors.size());
  for (const ProjectorSpec& spec : rig.projectors) {
    Picture a(spec.resolution[0], spec.resolution[1], 3), b = a, sum = a;
    for (int y = 0; y < a.height(); ++y)
      for (int x = 0; x < a.width(); ++x)
        for (int c = 0; c < 3; ++c) {
          const bool first = x < a.width() / 3 + 5 * c;
          a.at(x, y, c) = first ? 50000 : 0, b.at(x, y, c) = first ? 0 : 30000, sum.at(x, y, c) = first ? 50000 : 30000;
        }
    left.push_back(a), right.push_back(b), both.push_back(sum);
  }
  const Image a = simulator->total_light(0, left), b = simulator->total_light(0, right),
              c = simulator->total_light(0, both), d = simulator->total_light(0, none);
  double worst = 0;
  for (std::size_t i = 0; i < a.data().size(); ++i)
    worst = std::max(worst, std::abs(static_cast<double>(a.data()[i]) + b.data()[i] - c.data()[i] - d.data()[i]));
  findings.exact.push_back({"linearity [full scale]", kind, worst, 1e-5});
  return {};
}

// Kolmogorov's distribution: P(sup |empirical - normal| >= observed).
double kolmogorov_smirnov(std::vector<double> z) {
  std::sort(z.begin(), z.end());
  const double n = static_cast<double>(z.size());
  double largest = 0;
  for (std::size_t i = 0; i < z.size(); ++i) {
    const double cdf = 0.5 * std::erfc(-z[i] / std::numbers::sqrt2);
    largest = std::max({largest, (static_cast<double>(i) + 1) / n - cdf, cdf - static_cast<double>(i) / n});
  }
  const double lambda = (std::sqrt(n) + 0.12 + 0.11 / std::sqrt(n)) * largest;  // Stephens 1970
  double p = 0;
  for (int k = 1; k <= 100; ++k) p += 2 * (k % 2 ? 1 : -1) * std::exp(-2.0 * k * k * lambda * lambda);
  return std::clamp(p, 0.0, 1.0);
}

}  // namespace

Result<Study> sim_truth(const StudyContext& context) {
  Study study{"The simulator against theory: deviations in standard errors, five seeds fixed beforehand",
              {"law", "room", "scores", "mean z", "rms z", "largest |z|"},
              {},
              {},
              "",
              "",
              false};
  const std::filesystem::path folder = context.output / "sim-truth";
  std::error_code code;
  std::filesystem::create_directories(folder, code);
  Findings findings;
  Bounded bounded;
  CS_TRY(const double glossy, gloss(folder, findings));
  for (int seed = 0; seed < kSeeds; ++seed) {
    context.progress->step("laws", seed, kSeeds);
    for (const auto& [kind, what] : simdata::room_kinds()) CS_TRY_VOID(fast_path(kind, seed, folder, findings));
    CS_TRY_VOID(fine_stripes(seed, folder, findings, bounded));
    CS_TRY_VOID(furnace(seed, findings));
    CS_TRY_VOID(sphere(seed, findings));
    for (const char* kind : {"two-wall", "workbench", "cave4", "closed-room"})
      CS_TRY_VOID(form_factors_by_rays(kind, seed, findings));
    sensor(seed, findings);
  }
  for (const auto& [kind, what] : simdata::room_kinds()) CS_TRY_VOID(exact_laws(kind, folder, findings));
  context.progress->step("laws", kSeeds, kSeeds);

  std::map<std::pair<std::string, std::string>, std::vector<double>> groups;
  std::vector<double> all;
  std::string scores = "law,room,seed,z\n";
  for (const Score& s : findings.scores) {
    groups[{s.law, s.room}].push_back(s.z);
    all.push_back(s.z);
    scores += fmt::format("{},{},{},{:.4f}\n", s.law, s.room, s.seed, s.z);
  }
  CS_TRY_VOID(write_atomically(context.output / "sim-truth-scores.csv", scores));
  double most = 0;
  for (const auto& [key, z] : groups) {
    double sum = 0, square = 0, largest = 0;
    for (double v : z) sum += v, square += v * v, largest = std::max(largest, std::abs(v));
    most = std::max(most, largest);
    study.rows.push_back({key.first, key.second, fmt::format("{}", z.size()), fmt::format("{:+.2f}", sum / z.size()),
                          fmt::format("{:.2f}", std::sqrt(square / z.size())), fmt::format("{:.2f}", largest)});
  }
  bool exact_ok = true;
  double worst = 0;
  for (const Exact& e : findings.exact) {
    exact_ok = exact_ok && e.deviation <= e.bound;
    worst = std::max(worst, e.deviation);
  }
  study.rows.push_back({"linearity, exactly", "all", fmt::format("{}", findings.exact.size()), "-", "-",
                        fmt::format("{:.1e} of full scale", worst)});
  study.rows.push_back({"bounded: stripes as fine as a block, beside the crease", "two-wall", "180", "-", "-",
                        fmt::format("{:.2f} % of white", bounded.beside_percent)});
  const double p = kolmogorov_smirnov(all);
  study.notes.push_back(
      "rooms are the default ones with an eighth of their pixels, blocks of 4 projector pixels; what is bounded only "
      "has "
      "no score");
  study.notes.push_back(fmt::format("all indirect light of the glossy room, 150 pixels: {:+.2f} %", 100 * glossy));
  study.notes.push_back("every score: sim-truth-scores.csv");
  study.figure = fmt::format("{} scores, |z| at most {:.2f}, Kolmogorov-Smirnov p {:.2f}", all.size(), most, p);
  study.bound = ">= 100 scores, <= 4, > .01";
  study.ok = all.size() >= 100 && most <= 4 && p > 0.01 && exact_ok;
  return study;
}

}  // namespace countershade::bench

// pre-scan: does the code that the first photos choose do as well as the best one that is no dearer?
#include <algorithm>
#include <cmath>

#include "calib/base/random.h"
#include "capture/pattern/choose.h"
#include "capture/pattern/pattern.h"
#include "tools/bench/decode/decode_trial.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

constexpr int kRooms = 60;
constexpr double kWithin = 1.1, kRounding = 0.005;  // of the best error; px that no one misses

struct Drawn {
  simdata::RigAndRoom room;
  std::string what;
};

// Rooms from easy to hopeless: kind, albedo, light, sensor, focus, surround.
Result<Drawn> draw_room(int number) {
  static const std::vector<std::string> kKinds = {"two-wall", "cave4", "five-face", "cylinder", "painted", "glossy"};
  Random random(hash_name("pre-scan") + static_cast<std::uint64_t>(number));
  const auto between = [&](double low, double high) { return low * std::pow(high / low, random.uniform()); };
  Drawn drawn;
  const std::string& kind = kKinds[number % kKinds.size()];
  CS_TRY(drawn.room, simdata::default_room(kind));
  drawn.room.rig.cameras.resize(1), drawn.room.simulation.cameras.resize(1);
  drawn.room = simdata::smaller(std::move(drawn.room), 3, 1, 1024);
  Simulation& s = drawn.room.simulation;
  s.seed = hash_name("pre-scan") + static_cast<std::uint64_t>(number);
  const double brightest = kind == "painted" ? 0.85 : 0.95;  // paint is up to a tenth brighter than its wall
  const double albedo = 0.4 + (brightest - 0.4) * random.uniform();
  for (SimulatedSurface& surface : s.surfaces) surface.albedo = {albedo, albedo, albedo};
  SimulatedCamera& camera = s.cameras[0];
  camera.white_level = between(0.05, 0.8);
  camera.full_well_e = between(1000, 20000);
  camera.read_noise_e = between(3, 20);
  s.ambient = random.uniform() < 0.3 ? between(0.01, 0.1) : 0;
  const double defocus = between(0.3, 2.5);
  for (SimulatedProjector& p : s.projectors) p.defocus_sigma_px = defocus;
  drawn.what = fmt::format("{} albedo {:.2f} white {:.2f} well {:.0f} e- defocus {:.1f} px", kind, albedo,
                           camera.white_level, camera.full_well_e, defocus);
  return drawn;
}

// A lost pixel counts as one that is a pixel off.
double error_of(const DecodeScore& s) {
  const double lost = std::clamp(1 - s.coverage(), 0.0, 1.0);
  return std::sqrt((1 - lost) * s.rms * s.rms + lost);
}

struct Tried {
  std::string code;
  int frames = 0;
  double forecast = 0, lost = 1, error = 1;
};

Result<std::vector<Tried>> try_codes(const DecodeRig& rig, int q, const capture::CodeChoice& choice) {
  std::vector<Tried> tried;
  Rig alone = rig.rig();
  alone.projectors = {rig.rig().projectors[q]};
  for (const char* code : {"micro-phase", "micro-phase-9", "gray", "xor-04"}) {
    CS_TRY(const Sequence whole, capture::sequence_with(alone, {code}));
    std::vector<Role> roles;
    for (const Frame& frame : whole.frames)
      if (frame.role.kind != "blocks" && frame.role.kind != "held-out" && !frame.role.projector.empty())
        roles.push_back(frame.role);
    CS_TRY(const DecodeRig::Photos taken, rig.photograph(q, roles));
    SilentProgress quiet;
    const auto source = [&](int index) -> Result<Photo> { return taken.photos[index]; };
    const auto decoded =
        capture::decode_frames(taken.sequence, source, rig.rig().cameras[0].id, choice.projector, {}, quiet);
    Tried t{code, static_cast<int>(roles.size()) - 8, std::nan(""), 1, 1};
    for (const capture::CodeForecast& f : choice.forecasts)
      if (f.code == code) t.forecast = f.lost;
    if (decoded) {
      const DecodeScore s = score_decode(rig.truth(), q, *decoded);
      t.lost = 1 - s.coverage(), t.error = error_of(s);
    }
    tried.push_back(t);
  }
  return tried;
}

// No dearer code is blamed for; one that loses many pixels where another would not is.
bool as_good_as(const Tried& chosen, const std::vector<Tried>& all, double most_lost) {
  double best = 1, least_lost = 1;
  for (const Tried& t : all) {
    if (t.frames <= chosen.frames) best = std::min(best, t.error);
    least_lost = std::min(least_lost, t.lost);
  }
  const bool keeps = chosen.lost <= 2 * most_lost || chosen.lost <= 1.25 * least_lost;
  return chosen.error <= kWithin * best + kRounding && keeps;
}

}  // namespace

Result<Study> pre_scan(const StudyContext& context) {
  Study study;
  study.title = "The code that the first photos choose, in 60 rooms from easy to hopeless";
  study.columns = {"room", "what", "code", "frames", "forecast lost %", "lost %", "error px", "chosen", "good"};
  int good = 0, judged = 0, refused = 0;
  std::map<std::string, int> chosen_codes;
  for (int number = 0; number < kRooms; ++number) {
    context.progress->step("pre-scan", number, kRooms);
    CS_TRY(const Drawn drawn, draw_room(number));
    SilentProgress quiet;
    CS_TRY(const DecodeRig rig, DecodeRig::make(drawn.room, quiet));
    const int q = number % static_cast<int>(rig.rig().projectors.size());
    CS_TRY(const DecodeRig::Photos base, rig.photograph(q, capture::base_roles(rig.rig().projectors[q])));
    const auto source = [&](int index) -> Result<Photo> { return base.photos[index]; };
    const auto choice = capture::choose_code(base.sequence, source, rig.rig().projectors[q].id, {});
    if (!choice) {
      ++refused;
      study.rows.push_back({fmt::format("{}", number), drawn.what, "refused", "-", "-", "-", "-", "-", "-"});
      continue;
    }
    CS_TRY(const std::vector<Tried> tried, try_codes(rig, q, *choice));
    const Tried& chosen =
        *std::find_if(tried.begin(), tried.end(), [&](const Tried& t) { return t.code == choice->code; });
    const bool fine = as_good_as(chosen, tried, capture::ChoiceOptions().most_lost);
    ++judged, good += fine, ++chosen_codes[choice->code];
    for (const Tried& t : tried) {
      const bool is_chosen = t.code == choice->code;
      study.rows.push_back({fmt::format("{}", number), drawn.what, t.code, fmt::format("{}", t.frames),
                            std::isfinite(t.forecast) ? fmt::format("{:.2f}", 100 * t.forecast) : "-",
                            fmt::format("{:.2f}", 100 * t.lost), fmt::format("{:.3f}", t.error), is_chosen ? "yes" : "",
                            is_chosen ? fine ? "yes" : "NO" : ""});
    }
  }
  std::string counts;
  for (const auto& [code, n] : chosen_codes) counts += fmt::format("{}{} {}", counts.empty() ? "" : ", ", code, n);
  study.notes.push_back(
      "error: rms over visible pixels, a lost one counts as 1 px; frames: beside white, black and the "
      "six sinusoids that every code has");
  study.notes.push_back(fmt::format("chosen: {}; refused: {}", counts, refused));
  study.figure = fmt::format(
      "the chosen code is as good as any that is no dearer in {} of {} rooms ({:.0f} %), {} "
      "refused",
      good, judged, 100.0 * good / std::max(1, judged), refused);
  study.bound = ">= 90 %";
  study.ok = good >= 0.9 * kRooms;
  return study;
}

}  // namespace countershade::bench

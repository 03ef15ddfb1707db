// decode-hard and decode-economy: which projector pixel is it, by every code, where walls light each other.
#include <algorithm>
#include <cmath>

#include "calib/base/random.h"
#include "capture/pattern/pattern.h"
#include "tools/bench/decode/decode_trial.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

constexpr int kSeeds = 5;

// A default room with one albedo; a seed moves its projectors a little and draws other noise.
Result<simdata::RigAndRoom> room_of(const std::string& kind, double albedo, const std::string& study, int seed) {
  CS_TRY(simdata::RigAndRoom room, simdata::default_room(kind));
  Random random(hash_name(study) + static_cast<std::uint64_t>(seed));
  for (SimulatedSurface& s : room.simulation.surfaces) s.albedo = {albedo, albedo, albedo};
  for (SimulatedProjector& p : room.simulation.projectors)
    for (double& x : p.position) x += 0.06 * (random.uniform() - 0.5);
  room.simulation.seed = hash_name(study) + static_cast<std::uint64_t>(seed);
  room.rig.cameras.resize(1), room.simulation.cameras.resize(1);
  return room;
}

Result<capture::Correspondence> decode_photos(const DecodeRig& rig, int projector, const DecodeRig::Photos& taken) {
  SilentProgress quiet;
  const auto source = [&](int index) -> Result<Photo> { return taken.photos[index]; };
  return capture::decode_frames(taken.sequence, source, rig.rig().cameras[0].id, rig.rig().projectors[projector].id, {},
                                quiet);
}

std::string text(double value, int digits) {
  return fmt::format("{:.{}f}", value, digits);
}

struct Case {
  std::string room;
  double albedo, least_accepted;
};

// Of all seeds and projectors of a case and code: the worst.
struct Worst {
  std::size_t frames = 0;
  double coverage = 1, wrong = 0, rms = 0, bias = 0, z2 = 0;
  bool refused = false;
  void take(const DecodeScore& s) {
    coverage = std::min(coverage, s.coverage()), wrong = std::max(wrong, s.wrong_share());
    rms = std::max(rms, s.rms), bias = std::max(bias, s.bias), z2 = std::max(z2, s.z2);
  }
};

}  // namespace

Result<Study> decode_hard(const StudyContext& context) {
  const std::vector<Case> cases = {{"five-face", 0.95, 0.97}, {"cave4", 0.9, 0.995}, {"two-wall", 0.8, 0.995}};
  constexpr double kMostWrong = 1e-4;
  Study study;
  study.title = "Decoding where every wall lights every other (worst of five seeds and all projectors)";
  study.columns = {"room",   "albedo",  "code",   "frames", "accepted % of visible", "wrong of 1e4 accepted",
                   "rms px", "bias px", "mean z2"};
  std::string figure;
  study.ok = true;
  int done = 0;
  for (const Case& c : cases) {
    std::map<std::string, Worst> worst;
    std::vector<std::string> order = {"fixed thresholds"};
    for (const auto& [code, what] : capture::codes()) order.push_back(code);
    for (int seed = 0; seed < kSeeds; ++seed) {
      context.progress->step("decode-hard", done++, kSeeds * static_cast<double>(cases.size()));
      SilentProgress quiet;
      CS_TRY(const simdata::RigAndRoom room, room_of(c.room, c.albedo, "decode-hard", seed));
      CS_TRY(const DecodeRig rig, DecodeRig::make(room, quiet));
      const int q = seed % static_cast<int>(rig.rig().projectors.size());  // every seed another projector
      for (const auto& [code, what] : capture::codes()) {
        CS_TRY(const std::vector<Role> roles, roles_of(code, rig.rig().projectors[q], true));
        CS_TRY(const DecodeRig::Photos taken, rig.photograph(q, roles));
        worst[code].frames = roles.size();
        const auto decoded = decode_photos(rig, q, taken);
        if (decoded)
          worst[code].take(score_decode(rig.truth(), q, *decoded));
        else
          worst[code].refused = true;
        if (code != "gray") continue;
        CS_TRY(const auto fixed, decode_by_fixed_thresholds(taken, rig.rig().projectors[q]));
        worst[order[0]].frames = roles.size();
        worst[order[0]].take(score_decode(rig.truth(), q, fixed));
      }
    }
    std::string best;
    for (const std::string& code : order) {
      const Worst& w = worst[code];
      study.rows.push_back({c.room, text(c.albedo, 2), code, fmt::format("{}", w.frames),
                            w.refused ? "refused" : text(100 * w.coverage, 2), text(1e4 * w.wrong, 2), text(w.rms, 3),
                            text(w.bias, 3), text(w.z2, 2)});
      const bool good = !w.refused && w.coverage >= c.least_accepted && w.wrong <= kMostWrong;
      if (good && (best.empty() || w.frames < worst[best].frames)) best = code;
    }
    study.ok = study.ok && !best.empty();
    figure += (figure.empty() ? "" : "; ") + c.room + ": " +
              (best.empty() ? "none is good enough"
                            : fmt::format("{} accepts {:.2f} %, wrong {:.1e}", best, 100 * worst[best].coverage,
                                          worst[best].wrong));
  }
  study.notes.push_back(
      "visible: pixels whose centre the projector lights; wrong: more than 1 px off, or not lit, not even in part");
  study.notes.push_back("frames: with white and black; the sinusoids do without them");
  study.figure = figure;
  study.bound = "wrong <= 1e-4; accepted >= 97 % in the five-face room, >= 99.5 % in the others";
  return study;
}

Result<Study> decode_economy(const StudyContext& context) {
  Study study;
  study.title = "Error against the number of patterns, two-wall .8, 1920 x 1080, projector exponents 2.0, 2.2, 2.4";
  study.columns = {"code",       "patterns",     "albedo",  "exponent", "seed",
                   "accepted %", "wrong of 1e4", "bias px", "random px"};
  struct Tried {
    std::string code;
    bool levels;
  };
  std::vector<Tried> tried;
  for (const auto& [code, what] : capture::codes()) tried.push_back({code, code[0] == 'g' || code[0] == 'x'});
  constexpr double kBright = 0.8, kDark = 0.02;  // walls that light each other, and walls that hardly do
  double bias = 0, random = 0, coverage = 1;
  std::map<std::string, double> dark_bias, bright_bias;  // by code; of exponent 2.2
  std::size_t patterns = 0;
  int done = 0;
  const std::vector<std::pair<double, double>> kinds = {{kBright, 2.0}, {kBright, 2.2}, {kBright, 2.4}, {kDark, 2.2}};
  for (int seed = 0; seed < kSeeds; ++seed)
    for (const auto& [albedo, exponent] : kinds) {
      context.progress->step("decode-economy", done++, static_cast<double>(kinds.size()) * kSeeds);
      SilentProgress quiet;
      CS_TRY(simdata::RigAndRoom room, room_of("two-wall", albedo, "decode-economy", seed));
      for (ProjectorSpec& p : room.rig.projectors) p.resolution = {1920, 1080};
      for (SimulatedProjector& p : room.simulation.projectors) p.gamma = {exponent, exponent, exponent};
      room.simulation.block_px = 8;  // half a period: what the walls make of the sinusoids is in it
      CS_TRY(const DecodeRig rig, DecodeRig::make(room, quiet));
      const int q = seed % 2;
      for (const Tried& t : tried) {
        if (t.levels && exponent != 2.2) continue;  // bits are on or off, whatever the exponent
        CS_TRY(const std::vector<Role> roles, roles_of(t.code, rig.rig().projectors[q], t.levels));
        CS_TRY(const DecodeRig::Photos taken, rig.photograph(q, roles));
        CS_TRY(const capture::Correspondence c, decode_photos(rig, q, taken));
        const DecodeScore s = score_decode(rig.truth(), q, c);
        study.rows.push_back({t.code, fmt::format("{}", roles.size()), text(albedo, 2), text(exponent, 1),
                              fmt::format("{}", seed), text(100 * s.coverage(), 2), text(1e4 * s.wrong_share(), 2),
                              text(s.bias, 4), text(s.random, 4)});
        double& same = (albedo == kDark ? dark_bias : bright_bias)[t.code];
        if (exponent == 2.2) same = std::max(same, s.bias);
        if (t.code != "micro-phase" || albedo == kDark) continue;
        patterns = roles.size();
        bias = std::max(bias, s.bias), random = std::max(random, s.random), coverage = std::min(coverage, s.coverage());
      }
    }
  for (const auto& [code, dark] : dark_bias)
    study.notes.push_back(fmt::format("{}: bias with walls of albedo {} is {:.4f} px at worst, of {} {:.4f} px", code,
                                      kBright, bright_bias[code], kDark, dark));
  study.figure = fmt::format("micro-phase: {} patterns, bias {:.3f} px, random {:.3f} px, {:.1f} % accepted at worst",
                             patterns, bias, random, 100 * coverage);
  study.bound = "<= 14 patterns, <= .02 px, <= .1 px";
  study.ok = patterns <= 14 && bias <= 0.02 && random <= 0.1;
  return study;
}

}  // namespace countershade::bench

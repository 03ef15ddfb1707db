// Sweeps of real light: displays that are late, photos with holes, colour wheels and pulses that an exposure cuts,
// light that swings or comes on, people who walk in.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "capture/pattern/pattern.h"
#include "tools/bench/sweep/sweep.h"

namespace countershade::bench {

namespace {

constexpr int kPhotos = 400;  // more than any stage takes

double frames_of(const SweepSetting& setting) {
  return static_cast<double>(capture::default_sequence(setting.room.rig).frames.size());
}

void expose(SweepSetting& s, double ms) {
  s.room.rig.cameras[0].exposures_ms = {ms};
  s.room.simulation.cameras[0].reference_exposure_ms = ms;
}

// ---- late displays ----

// When a picture is seen at the latest, after it was sent [ms]: latency, what may be added to it, a refresh.
Result<double> latest(const PredictorInput& in, Progress&) {
  const SimulatedProjector& p = in.setting.room.simulation.projectors[0];
  return p.latency_ms + p.latency_jitter_ms + 1e3 / p.refresh_hz;
}

void be_late(SweepSetting& setting, double latency_ms, double jitter_ms) {
  for (SimulatedProjector& p : setting.room.simulation.projectors)
    p.latency_ms = latency_ms, p.latency_jitter_ms = jitter_ms;
}

Sweep latency() {
  return {
      "latency",
      "Displays that are late",
      "latency, or by how much more it varies, ms",
      "when a picture is seen at the latest, ms",
      latest,
      {{"always as late", {0, 33, 100, 200, 400}, {100}, [](double ms, SweepSetting& s) { be_late(s, ms, 0); }},
       {"33 ms, and by chance later", {17, 50, 150, 400}, {}, [](double ms, SweepSetting& s) { be_late(s, 33, ms); }}},
      {}};
}

// ---- holes ----

// Share of the rows of all photos of the capture that are missing [%].
Result<double> missing_rows(const PredictorInput& in, Progress&) {
  double rows = 0;
  for (const simdata::Fault& f : in.setting.faults)
    if (static_cast<double>(f.photo) < frames_of(in.setting)) rows += f.value;
  return 100 * rows / frames_of(in.setting);
}

// As a driver hands them over that does not say so; what says so is taken again (the study loss).
Sweep holes() {
  return {"holes",
          "Photos with black bands that the camera's driver does not own up to",
          "share of the photos, or of the rows of one, %",
          "missing rows of all, %",
          missing_rows,
          {{"a tenth of the rows, in some photos",
            {0, 1, 3, 10, 40},
            {3},
            [](double percent, SweepSetting& s) {
              for (int photo = 0; photo < kPhotos; ++photo)
                if (std::floor((photo + 1) * percent / 100 + 0.5) > std::floor(photo * percent / 100 + 0.5))
                  add_fault(s, "missing-packets", 0.1, photo);
            }},
           {"one photo",
            {1, 5, 20, 80},
            {},
            [](double percent, SweepSetting& s) { add_fault(s, "missing-packets", percent / 100, 45); }}},
          {}};
}

// ---- colour wheel and exposure ----

// By how much an exposure that begins at chance is brighter or darker than others, at most [%]: what it has of a turn
// that it does not finish, over all that it has.
Result<double> cut_turns(const PredictorInput& in, Progress&) {
  const SimulatedProjector& p = in.setting.room.simulation.projectors[0];
  const double turns = in.setting.room.rig.cameras[0].exposures_ms[0] * 1e-3 * std::max(p.colour_wheel_hz, p.pwm_hz);
  return 100 * std::abs(turns - std::round(turns)) / turns;
}

Sweep wheel() {
  constexpr double kHz = 120;
  const auto take_turns = [](double turns, SweepSetting& s) { expose(s, 1e3 * turns / kHz); };
  return {"wheel",
          "Exposures that cut a colour wheel's turn or a pulse",
          "exposure, in turns of 1/120 s",
          "swing of a photo's light by the moment at which it begins, %",
          cut_turns,
          {{"colour wheel",
            {0.5, 0.95, 1, 1.05, 1.5, 2, 2.05, 4.5},
            {1, 1.5},
            [=](double turns, SweepSetting& s) {
              for (SimulatedProjector& p : s.room.simulation.projectors) p.colour_wheel_hz = kHz;
              take_turns(turns, s);
            }},
           {"pulses",
            {1.05, 1.5, 2, 2.05, 4.5},
            {},
            [=](double turns, SweepSetting& s) {
              for (SimulatedProjector& p : s.room.simulation.projectors) p.pwm_hz = kHz;
              take_turns(turns, s);
            }}},
          {}};
}

// ---- light that changes ----

double fault_value(const SweepSetting& setting, const std::string& name) {
  for (const simdata::Fault& f : setting.faults)
    if (f.kind->name == name) return f.value;
  return 0;
}

// Half the range of the lamps' light in photos that begin at chance [full scale].
double mains_swing(const PredictorInput& in) {
  const Simulation& room = in.setting.room.simulation;
  if (room.ambient_swing == 0) return 0;
  std::vector<Picture> black;
  for (const ProjectorSpec& p : in.setting.room.rig.projectors) black.emplace_back(p.resolution[0], p.resolution[1], 3);
  const Image dark = in.simulator.total_light(0, black);
  const double lamps = std::accumulate(dark.data().begin(), dark.data().end(), 0.0) / dark.data().size();
  const double half = std::numbers::pi * room.ambient_hz * in.setting.room.rig.cameras[0].exposures_ms[0] * 1e-3;
  return lamps * room.ambient_swing * std::abs(std::sin(half) / half);
}

// Change of the light between the photos of a capture, over white [%].
Result<double> change_of_light(const PredictorInput& in, Progress&) {
  return 100 * (fault_value(in.setting, "exposure-jitter") + fault_value(in.setting, "warm-up") +
                (fault_value(in.setting, "lamp-switched-on") + mains_swing(in)) / in.white);
}

// Lamps on mains that are not quite 50 Hz, so that no display keeps step with them.
void be_lit(SweepSetting& s, double swing) {
  s.room.simulation.ambient = 0.3, s.room.simulation.ambient_swing = swing, s.room.simulation.ambient_hz = 99.9;
}

Sweep flicker() {
  const auto add = [](const char* fault, std::uint64_t photo) {
    return [=](double percent, SweepSetting& s) {
      if (percent > 0) add_fault(s, fault, percent / 100, photo);
    };
  };
  return {"flicker",
          "Light that changes while photos are taken",
          "swing of lamps or exposures, light added (of full scale) or lost, %; exposure, ms",
          "change of the light, % of white",
          change_of_light,
          {{"lamps on the mains, 1/60 s",
            {0, 10, 30, 100},
            {30},
            [](double percent, SweepSetting& s) { expose(s, 1e3 / 60), be_lit(s, percent / 100); }},
           {"lamps that swing fully, by exposure",
            {5, 8.33, 10, 20, 33.3, 50},
            {50},
            [](double ms, SweepSetting& s) { expose(s, ms), be_lit(s, 1); }},
           {"the same, rolling shutter of 15 ms",
            {10, 16.7, 50},
            {},
            [](double ms, SweepSetting& s) {
              expose(s, ms), be_lit(s, 1);
              s.room.simulation.cameras[0].rolling_shutter_ms = 15;
            }},
           {"exposures that jitter", {0.1, 0.3, 1, 3, 10}, {1}, add("exposure-jitter", 0)},
           {"a lamp is switched on at photo 60", {0.3, 1, 3, 10}, {}, add("lamp-switched-on", 60)},
           {"the projectors warm up", {1, 3, 10, 30}, {}, add("warm-up", 0)}},
          {}};
}

// ---- someone walks in ----

// Photos of the capture in which somebody stands, times the share of the picture that he hides [%].
Result<double> hidden(const PredictorInput& in, Progress&) {
  double photos = 0;
  const double frames = frames_of(in.setting);
  for (const simdata::Fault& f : in.setting.in_capture) {
    const bool stays = std::string_view(f.kind->name) == "person-stays";
    const double until = frames - static_cast<double>(f.photo);
    photos += std::numbers::pi * 0.5 * f.value * 0.55 * 0.75 * (stays ? until : std::min(15., until));
  }
  return 100 * photos / frames;
}

Sweep visitor() {
  const auto come = [](const char* fault, std::uint64_t photo) {
    return [=](double percent, SweepSetting& s) {
      if (percent > 0) add_fault(s.in_capture, fault, percent / 100, photo);
    };
  };
  const auto walk_in = [=](std::uint64_t photo) { return come("person-walks-in", photo); };
  return {"visitor",
          "Somebody crosses the picture during 15 photos of the capture, or stays",
          "width of the person, % of the picture's",
          "hidden share of all photos, %",
          hidden,
          {{"during the first projector's code", {0, 5, 12, 30}, {12}, walk_in(30)},
           {"during the second one's", {5, 12}, {}, walk_in(60)},
           {"during the frames of light", {2, 5, 12, 30}, {}, walk_in(80)},
           {"comes during the first code and stays", {2, 5, 12, 30}, {12}, come("person-stays", 30)},
           {"comes during the frames of light and stays", {2, 5, 12, 30}, {}, come("person-stays", 80)},
           {"stands there from the beginning", {5, 12, 30}, {}, come("person-stays", 0)}},
          {}};
}

}  // namespace

std::vector<Sweep> light_sweeps() {
  return {latency(), holes(), wheel(), flicker(), visitor()};
}

}  // namespace countershade::bench

#include "tools/job/check/self_check.h"

#include <algorithm>

#include "capture/device/window.h"
#include "tools/job/devices.h"

namespace countershade::tools {

namespace {

// Light of the room, of full scale: from where on less of it would be better, and from where on white has no place
// above it. It is measured and takes no part in the show; it adds noise.
constexpr double kDark = 0.05, kTooBright = 0.4;

// Value below which `share` of the samples lie.
double percentile(const Image& image, double share) {
  std::vector<float> values = image.data();
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(share * (values.size() - 1));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

double mean_difference(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.data().size(); ++i) sum += std::abs(a.data()[i] - b.data()[i]);
  return sum / a.data().size();
}

Picture flat(const capture::Projector& p, std::uint16_t value) {
  return Picture(p.width(), p.height(), 3, value);
}

// After what every display takes.
Result<Photo> photo_with(const capture::Devices& devices, capture::Camera& camera, const CameraSpec& spec, int lit,
                         bool all) {
  for (std::size_t q = 0; q < devices.projectors.size(); ++q) {
    capture::Projector& p = *devices.projectors[q];
    CS_TRY_VOID(p.show(flat(p, all || static_cast<int>(q) == lit ? 65535 : 0)));
  }
  devices.wait(kSettledMs);
  CS_TRY(const capture::Exposure exposure, camera.trigger());
  return photo_of(exposure, spec);
}

struct Latency {
  int photos = 0;    // that go by before one looks like the last, for the slowest projector
  double ms = 0;     // from the first photo to that one, by the camera's clock
  bool seen = true;  // there was one, before the last
};

// From settled black to white.
Result<Latency> measure_latency(const capture::Devices& devices, capture::Camera& camera, const CameraSpec& spec,
                                const Photo& black) {
  std::vector<Photo> after;
  std::vector<double> time_s;
  for (const auto& p : devices.projectors) CS_TRY_VOID(p->show(flat(*p, 65535)));
  constexpr std::size_t kLeast = 5, kMost = 40;  // of a slow camera, and of one whose clock stands still
  while (after.size() < kLeast || (time_s.back() - time_s.front() < 1e-3 * kSettledMs && after.size() < kMost)) {
    CS_TRY(const capture::Exposure exposure, camera.trigger());
    after.push_back(photo_of(exposure, spec));
    time_s.push_back(exposure.timestamp_s);
  }
  const double settled = mean_difference(after.back().value, black.value);
  int latency = static_cast<int>(after.size()) - 1;  // light that swings is no latency
  while (latency > 0 && mean_difference(after[latency - 1].value, after.back().value) < 0.3 * settled) --latency;
  const bool seen = latency + 1 < static_cast<int>(after.size());
  return Latency{latency, 1e3 * (time_s[latency] - time_s[0]), seen};
}

Result<void> check_camera(const CameraSpec& spec, const capture::Devices& devices, capture::Camera& camera,
                          std::vector<Finding>& findings) {
  CS_TRY_VOID(camera.arm(spec.exposures_ms.empty() ? 0 : spec.exposures_ms.front()));
  CS_TRY(const Photo black, photo_with(devices, camera, spec, -1, false));
  const double dark = percentile(black.value, 0.5);
  Finding room{fmt::format("camera {}: room in the dark", spec.id), fmt::format("{:.2f} % of full scale", 100 * dark),
               "other light than the projectors': switch lamps off, close blinds, or state the camera's pedestal",
               dark < kTooBright};
  room.caution = dark >= kDark;
  findings.push_back(std::move(room));
  CS_TRY(const Latency late, measure_latency(devices, camera, spec, black));
  findings.push_back(
      {fmt::format("camera {}: latency", spec.id),
       fmt::format("{} photos before a picture is seen ({:.0f} ms)", late.photos, late.ms),
       fmt::format("pictures arrive later than the {:.0f} ms that are waited for: switch the projector's "
                   "and the display's frame interpolation off (game mode)",
                   kSettledMs),
       late.seen && late.ms <= kSettledMs});
  for (std::size_t q = 0; q < devices.projectors.size(); ++q) {
    CS_TRY(const Photo white, photo_with(devices, camera, spec, static_cast<int>(q), false));
    const double change = mean_difference(white.value, black.value);
    findings.push_back({fmt::format("camera {}: sees projector {}", spec.id, devices.projectors[q]->id()),
                        fmt::format("mean change {:.2f} % of full scale", 100 * change),
                        "the photo did not change with the picture: wrong display, lens cap, or a stale frame (the "
                        "camera photographs before the projector shows)",
                        change > 0.01});
  }
  CS_TRY(const Photo full, photo_with(devices, camera, spec, -1, true));
  const double bright = percentile(full.value, 0.99);
  std::size_t saturated = 0;
  for (std::uint8_t v : full.valid.data()) saturated += v == 0;
  const double share = static_cast<double>(saturated) / full.valid.data().size();
  findings.push_back({fmt::format("camera {}: exposure of white", spec.id),
                      fmt::format("99th percentile at {:.0f} % of full scale", 100 * bright),
                      fmt::format("aim at 60-90 %: multiply exposures_ms by {:.2f}", 0.8 / std::max(bright, 1e-3)),
                      bright > 0.3 && bright < 0.95});
  findings.push_back({fmt::format("camera {}: saturated pixels", spec.id), fmt::format("{:.3f} %", 100 * share),
                      "shorten exposures_ms", share < 0.001});
  CS_TRY(const Photo again, photo_with(devices, camera, spec, -1, false));
  const double left =
      mean_difference(again.value, black.value) / std::max(1e-9, mean_difference(full.value, black.value));
  findings.push_back({fmt::format("camera {}: stale frames", spec.id),
                      fmt::format("black after white keeps {:.1f} % of it", 100 * left),
                      "the photo still shows the former picture: wait longer between showing and photographing",
                      left < 0.05});
  return {};
}

// What the desktop says that it does to the pictures of projectors that are its monitors; of windows without a monitor,
// to those of the first one.
Result<void> check_displays(const Rig& rig, std::vector<Finding>& findings) {
  const auto is_window = [](const ProjectorSpec& p) { return p.output == "window"; };
  if (std::none_of(rig.projectors.begin(), rig.projectors.end(), is_window)) return {};
  CS_TRY(const std::vector<capture::Monitor> monitors, capture::list_monitors());
  for (const ProjectorSpec& p : rig.projectors)
    for (const capture::Monitor& m : monitors) {
      if (!is_window(p) || (p.monitor.empty() ? &m != &monitors[0] : !m.is(p.monitor))) continue;
      Finding f{fmt::format("projector {}: desktop of monitor '{}'", p.id, m.name),
                m.trap.empty() ? "changes nothing that it tells of" : "changes pictures", m.trap};
      f.caution = !m.trap.empty();
      findings.push_back(std::move(f));
    }
  return {};
}

}  // namespace

Finding health_of(const capture::Camera& camera) {
  const capture::Health health = camera.health();
  const std::string why = health.unhealthy();
  Finding f{fmt::format("camera {}: health", camera.id()),
            why.empty()
                ? fmt::format("{} photos, {} taken again since they did not arrive whole", health.photos, health.again)
                : "unhealthy: " + why,
            "cable, network card, hub; fewer programs on this computer; switch the camera off and on again",
            why.empty()};
  f.caution = health.again > 0;
  return f;
}

Result<std::vector<Finding>> self_check(const Rig& rig, const capture::Devices& devices, Progress& progress) {
  std::vector<Finding> findings;
  CS_TRY_VOID(check_displays(rig, findings));
  for (std::size_t i = 0; i < devices.cameras.size(); ++i) {
    progress.step("check", i, devices.cameras.size());
    const CameraSpec* spec = rig.camera(devices.cameras[i]->id());
    CS_CHECK(spec, "a device of another rig");
    const auto checked = check_camera(*spec, devices, *devices.cameras[i], findings);
    if (checked) continue;
    const bool its_own = checked.error().code == ErrorCode::kDevice && !devices.cameras[i]->health().failure.empty();
    if (!its_own) return checked.error();
    findings.push_back(health_of(*devices.cameras[i]));
  }
  progress.step("check", devices.cameras.size(), devices.cameras.size());
  return findings;
}

}  // namespace countershade::tools

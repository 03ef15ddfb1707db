// The pictures of docs/rooms.md: every room plain, its indirect light alone, a pattern, and its truth.
#include <cmath>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/pattern/pattern.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr int kShrink = 5;  // devices have a fifth of their pixels, four pictures stand side by side
constexpr int kGap = 6;

// Light, sRGB-like, into the strip at column `x0`.
void place(Image& strip, const Image& light, int x0, double gain) {
  for (int y = 0; y < light.height(); ++y)
    for (int x = 0; x < light.width(); ++x)
      for (int c = 0; c < 3; ++c)
        strip.at(x0 + x, y, c) =
            static_cast<float>(255 * std::pow(std::clamp(gain * light.at(x, y, c), 0.0, 1.0), 1 / 2.2));
}

// Which projector pixel lights each point: hue by projector, contours every eighth of the picture; grey by depth where
// none does.
void place_truth(Image& strip, const simdata::TrueGeometry& g, const Rig& rig, int x0) {
  constexpr float kHues[5][3] = {{1, .45f, .3f}, {.3f, .6f, 1}, {.45f, .9f, .4f}, {.95f, .85f, .3f}, {.8f, .45f, .95f}};
  for (int y = 0; y < g.depth.height(); ++y)
    for (int x = 0; x < g.depth.width(); ++x) {
      if (std::isnan(g.depth.at(x, y))) continue;
      float colour[3] = {0, 0, 0};
      int lit = 0;
      for (std::size_t q = 0; q < g.projector_x.size(); ++q) {
        if (std::isnan(g.projector_x[q].at(x, y))) continue;
        const double u = 8 * g.projector_x[q].at(x, y) / rig.projectors[q].resolution[0],
                     v = 8 * g.projector_y[q].at(x, y) / rig.projectors[q].resolution[1];
        const float level = (static_cast<int>(u) + static_cast<int>(v)) % 2 ? 1.f : .6f;
        for (int c = 0; c < 3; ++c) colour[c] += level * kHues[q % 5][c];
        ++lit;
      }
      const float grey = .5f / (1 + .15f * g.depth.at(x, y));
      for (int c = 0; c < 3; ++c) strip.at(x0 + x, y, c) = 255 * (lit ? colour[c] / static_cast<float>(lit) : grey);
    }
}

Result<void> render(const std::string& kind, const fs::path& folder, const fs::path& scratch) {
  CS_TRY(simdata::RigAndRoom room, simdata::default_room(kind));
  room = simdata::smaller(std::move(room), kShrink, 2, 1024);
  for (const auto& [name, contents] : room.files) CS_TRY_VOID(write_atomically(scratch / name, contents));
  for (SimulatedSurface& s : room.simulation.surfaces)
    if (!s.mesh.empty()) s.mesh = scratch / s.mesh;
  SilentProgress quiet;
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, quiet));
  std::vector<Picture> white, stripes;
  Role role;
  role.kind = "gray", role.bit = 5;
  for (const ProjectorSpec& spec : room.rig.projectors) {
    white.emplace_back(spec.resolution[0], spec.resolution[1], 3, 65535);
    CS_TRY(stripes.emplace_back(), capture::render_role(role, spec.id, spec.resolution[0], spec.resolution[1]));
  }
  const simdata::TrueLight light = simulator->light(0, white);
  const int width = light.direct.width();
  Image strip(4 * width + 3 * kGap, light.direct.height(), 3, 0);
  for (int i = 1; i < 4; ++i)
    for (int y = 0; y < strip.height(); ++y)
      for (int x = i * (width + kGap) - kGap; x < i * (width + kGap); ++x)
        for (int c = 0; c < 3; ++c) strip.at(x, y, c) = 255;
  place(strip, simulator->total_light(0, white), 0, 1.2);
  place(strip, light.indirect, width + kGap, 4);
  place(strip, simulator->total_light(0, stripes), 2 * (width + kGap), 1.2);
  place_truth(strip, simulator->geometry(0), room.rig, 3 * (width + kGap));
  return write_png8(folder / (kind + ".png"), strip);
}

}  // namespace

Result<void> render_gallery(const StudyContext& context) {
  std::error_code code;
  const fs::path scratch = context.output / ".gallery";
  fs::create_directories(scratch, code);
  const auto& kinds = simdata::room_kinds();
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    context.progress->step("rooms", static_cast<double>(i), static_cast<double>(kinds.size()));
    CS_TRY_VOID(render(kinds[i].first, context.output, scratch));
  }
  context.progress->step("rooms", 1, 1);
  fs::remove_all(scratch, code);
  return {};
}

}  // namespace countershade::bench

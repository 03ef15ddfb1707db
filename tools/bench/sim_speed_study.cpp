// sim-speed: what a simulated photo costs, and what full path tracing would cost for the same noise.
#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "calib/base/random.h"
#include "capture/pattern/pattern.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

double peak_gib() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss / 1048576.0;
}

// The documentation's room with a camera of `width` x 9/16 width, and `projectors` of 1080p: copies beyond two stand a
// little aside.
simdata::RigAndRoom room_of(int width, int projectors) {
  simdata::RigAndRoom room = simdata::default_two_wall();
  SimulatedCamera& camera = room.simulation.cameras[0];
  const double scale = width / 1920.0;
  camera.principal = {(camera.principal[0] + 0.5) * scale - 0.5, (camera.principal[1] + 0.5 - 60) * scale - 0.5};
  camera.focal_px *= scale;
  camera.resolution = {width, width * 9 / 16};
  const std::vector<ProjectorSpec> specs = room.rig.projectors;
  const std::vector<SimulatedProjector> simulated = room.simulation.projectors;
  room.rig.projectors.clear();
  room.simulation.projectors.clear();
  for (int q = 0; q < projectors; ++q) {
    ProjectorSpec spec = specs[q % 2];
    SimulatedProjector projector = simulated[q % 2];
    spec.id = projector.id = fmt::format("p{}", q);
    spec.resolution = {1920, 1080};
    projector.position[1] += 0.07 * (q / 2);
    room.rig.projectors.push_back(spec);
    room.simulation.projectors.push_back(projector);
  }
  return room;
}

struct Cost {
  std::shared_ptr<simdata::Simulator> simulator;
  double setup_s = 0, photo_s = 0;
};

Result<Cost> cost_of(const simdata::RigAndRoom& room) {
  SilentProgress quiet;
  Cost cost;
  auto start = Clock::now();
  CS_TRY(cost.simulator, simdata::Simulator::make(room.rig, room.simulation, quiet));
  cost.setup_s = seconds_since(start);
  const capture::Devices devices = simdata::simulated_devices(cost.simulator);
  CS_TRY_VOID(devices.cameras[0]->arm(0));
  std::vector<Picture> patterns;  // as a capture shows them: stripes, ever finer
  for (int bit = 10; bit > 2; --bit) {
    Role role;
    role.kind = "gray", role.axis = "x", role.bit = bit;
    CS_TRY(Picture picture, capture::render_role(role, room.rig.projectors[0].id, 1920, 1080));
    patterns.push_back(std::move(picture));
  }
  start = Clock::now();
  for (std::size_t i = 0; i < patterns.size(); ++i) {
    for (std::size_t q = 0; q < devices.projectors.size(); ++q)
      CS_TRY_VOID(devices.projectors[q]->show(patterns[(i + q) % patterns.size()]));
    CS_TRY_VOID(devices.cameras[0]->trigger());
  }
  cost.photo_s = seconds_since(start) / static_cast<double>(patterns.size());
  return cost;
}

// Mean squares of what differs between the fast path and path tracing, with the tracer's own noise taken off, and of
// one path's noise. A difference that drowns in the noise counts as that noise.
struct Noise {
  double fast_pixel = 0, fast_box = 0, path = 0, seconds_per_path = 0;
  bool pixel_resolved = false, box_resolved = false;  // false: the fast path's error is at most what stands here
};

Noise compare(const simdata::Simulator& simulator, std::span<const Picture> pictures) {
  constexpr int kBoxes = 24, kSide = 16, kPaths = 1024;
  const simdata::TrueGeometry geometry = simulator.geometry(0);
  const Image fast = simulator.light(0, pictures).indirect;
  Random random(hash_name("sim-speed boxes"));
  std::vector<Eigen::Vector2d> pixels;
  while (static_cast<int>(pixels.size()) < kBoxes * kSide * kSide) {
    const int x0 = static_cast<int>(random.uniform() * (fast.width() - kSide)),
              y0 = static_cast<int>(random.uniform() * (fast.height() - kSide));
    bool on_wall = true;  // a box over a wall's end has pixels without light
    for (int y : {y0, y0 + kSide - 1})
      for (int x : {x0, x0 + kSide - 1}) on_wall = on_wall && geometry.surface.at(x, y) >= 0;
    for (int k = 0; on_wall && k < kSide * kSide; ++k) pixels.emplace_back(x0 + k % kSide, y0 + k / kSide);
  }
  const auto start = Clock::now();
  const auto traced = simulator.trace_indirect(0, pictures, pixels, kPaths);
  Noise noise;
  noise.seconds_per_path = seconds_since(start) / (static_cast<double>(pixels.size()) * kPaths);
  const int box_pixels = kSide * kSide;
  double pixel2 = 0, pixel_noise2 = 0, box2 = 0;
  for (int box = 0; box < kBoxes; ++box)
    for (int c = 0; c < 3; ++c) {
      double sum = 0;
      for (int k = 0; k < box_pixels; ++k) {
        const std::size_t i = static_cast<std::size_t>(box) * box_pixels + k;
        const double d =
            fast.at(static_cast<int>(pixels[i].x()), static_cast<int>(pixels[i].y()), c) - traced.mean[3 * i + c];
        sum += d / box_pixels;
        pixel2 += d * d / (kBoxes * 3 * box_pixels);
        pixel_noise2 += std::pow(traced.standard_error[3 * i + c], 2) / (kBoxes * 3 * box_pixels);
      }
      box2 += sum * sum / (kBoxes * 3);
    }
  noise.path = pixel_noise2 * kPaths;
  const double box_noise2 = pixel_noise2 / box_pixels;
  // Differences of mean squares scatter by about a tenth of the noise here; below that nothing is known.
  noise.pixel_resolved = pixel2 - pixel_noise2 > 0.1 * pixel_noise2;
  noise.box_resolved = box2 - box_noise2 > box_noise2;
  noise.fast_pixel = std::max(pixel2 - pixel_noise2, 0.1 * pixel_noise2);
  noise.fast_box = std::max(box2 - box_noise2, box_noise2);
  return noise;
}

}  // namespace

Result<Study> sim_speed(const StudyContext& context) {
  Study study{"Simulated photos: seconds to set up and per photo, 1080p projectors, two-wall room; ratios in this run",
              {"camera Mpx", "projectors", "set-up s", "photos per s", "peak GiB"},
              {},
              {},
              "",
              "",
              false};
  struct Point {
    int width, projectors;
  };
  double per_second = 0, setup = 0, photo = 0, ratio = HUGE_VAL;
  const std::vector<Point> points = {{1920, 2}, {944, 2}, {3776, 2}, {1920, 1}, {1920, 4}, {1920, 8}};
  for (std::size_t i = 0; i < points.size(); ++i) {
    context.progress->step("simulators", static_cast<double>(i), static_cast<double>(points.size()));
    const auto [width, projectors] = points[i];
    CS_TRY(const Cost cost, cost_of(room_of(width, projectors)));
    study.rows.push_back({fmt::format("{:.1f}", width * (width * 9 / 16) / 1e6), fmt::format("{}", projectors),
                          fmt::format("{:.1f}", cost.setup_s), fmt::format("{:.2f}", 1 / cost.photo_s),
                          fmt::format("{:.1f}", peak_gib())});
    if (i > 0) continue;
    per_second = 1 / cost.photo_s, setup = cost.setup_s, photo = cost.photo_s;
    const std::vector<Picture> white(2, Picture(1920, 1080, 3, 65535));
    const Noise n = compare(*cost.simulator, white);
    const double photo_pixels = static_cast<double>(width) * (width * 9 / 16);
    const double by_pixel = photo_pixels * n.path / n.fast_pixel * n.seconds_per_path / photo,
                 by_box = photo_pixels * n.path / 256 / n.fast_box * n.seconds_per_path / photo;
    ratio = std::min(by_pixel, by_box);
    study.notes.push_back(
        fmt::format("full path tracing for the same noise takes {}{:.0f} times as long by pixel, {}{:.0f} times in "
                    "16 x 16 boxes ({:.0f} and {:.0f} paths a pixel); the set-up pays off after {:.3f} photos",
                    n.pixel_resolved ? "" : "at least ", by_pixel, n.box_resolved ? "" : "at least ", by_box,
                    n.path / n.fast_pixel, n.path / 256 / n.fast_box, setup / std::max(1e-9, ratio * photo - photo)));
  }
  context.progress->step("simulators", 1, 1);
  study.notes.push_back("peak memory is that of the process so far");
  study.figure = fmt::format("{:.1f} photos/s at 1080p with two projectors, {:.0f}x full path tracing at equal noise",
                             per_second, ratio);
  study.bound = ">= 6, >= 50x";
  study.ok = per_second >= 6 && ratio >= 50;
  return study;
}

}  // namespace countershade::bench

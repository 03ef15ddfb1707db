// The sweeps of decoding: which projector pixel is it, where light, geometry or the camera make it hard (PHYSICS 8).
// Every predictor is what a tenth of the pixels exceeds: as many as may be lost before a point is no longer right.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "capture/pattern/pattern.h"
#include "simdata/render/emitter.h"
#include "simdata/room/framing.h"
#include "tools/bench/sweep/sweep.h"

namespace countershade::bench {

namespace {

constexpr double kPeriod = 16;  // px, the finest sinusoid
constexpr double kDegrees = 180 / std::numbers::pi;

// Keeps the first projector of the rig.
void alone(SweepSetting& s) {
  s.room.rig.projectors.resize(1), s.room.simulation.projectors.resize(1);
}

double exceeded_by_a_tenth(std::vector<double> values) {
  if (values.empty()) return kUnknown;
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(0.9 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// Values of `of(projector, x, y)` at the pixels that a projector lights; all projectors.
template <class Of>
std::vector<double> over_visible(const simdata::TrueGeometry& g, Of of) {
  std::vector<double> values;
  for (std::size_t q = 0; q < g.projector_x.size(); ++q)
    for (int y = 0; y < g.depth.height(); ++y)
      for (int x = 0; x < g.depth.width(); ++x)
        if (std::isfinite(g.projector_x[q].at(x, y))) values.push_back(of(static_cast<int>(q), x, y));
  std::erase_if(values, [](double v) { return std::isnan(v); });
  return values;
}

// Projector pixels per camera pixel in the direction where they are most: the larger singular value of the Jacobian.
double steepness(const simdata::TrueGeometry& g, int q, int x, int y) {
  if (x + 1 >= g.depth.width() || y + 1 >= g.depth.height()) return kUnknown;
  if (g.surface.at(x, y) != g.surface.at(x + 1, y) || g.surface.at(x, y) != g.surface.at(x, y + 1)) return kUnknown;
  const Image &px = g.projector_x[q], &py = g.projector_y[q];
  Eigen::Matrix2d J;
  J << px.at(x + 1, y) - px.at(x, y), px.at(x, y + 1) - px.at(x, y), py.at(x + 1, y) - py.at(x, y),
      py.at(x, y + 1) - py.at(x, y);
  if (!J.allFinite()) return kUnknown;
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(J.transpose() * J).eigenvalues()[1]);
}

// One projector's white, or black of all for q < 0.
std::vector<Picture> white_of(const Rig& rig, int q) {
  std::vector<Picture> pictures(rig.projectors.size());
  if (q >= 0) pictures[q] = Picture(rig.projectors[q].resolution[0], rig.projectors[q].resolution[1], 3, 65535);
  return pictures;
}

// ---- indirect light ----

Result<double> indirect_over_direct(const PredictorInput& in, Progress&) {
  std::vector<Image> ratio;
  const simdata::TrueLight black = in.simulator.light(0, white_of(in.setting.room.rig, -1));
  for (std::size_t q = 0; q < in.setting.room.rig.projectors.size(); ++q) {
    const simdata::TrueLight white = in.simulator.light(0, white_of(in.setting.room.rig, static_cast<int>(q)));
    ratio.push_back(luminance_mean(white.indirect));
    const Image direct = luminance_mean(white.direct), dark = luminance_mean(black.direct),
                bounced = luminance_mean(black.indirect);
    for (std::size_t i = 0; i < direct.data().size(); ++i)
      ratio[q].data()[i] =
          (ratio[q].data()[i] - bounced.data()[i]) / std::max(1e-9f, direct.data()[i] - dark.data()[i]);
  }
  return exceeded_by_a_tenth(
      over_visible(in.simulator.geometry(0), [&](int q, int x, int y) { return ratio[q].at(x, y); }));
}

Sweep indirect() {
  const auto room = [](const char* kind) {
    return [made = simdata::default_room(kind).value()](double albedo, SweepSetting& s) {
      move_to(made, s);
      for (SimulatedSurface& surface : s.room.simulation.surfaces) surface.albedo = {albedo, albedo, albedo};
    };
  };
  return {"indirect",
          "Decoding where more light arrives by way of other walls than directly",
          "albedo of all walls",
          "indirect over direct light that a tenth of the pixels exceeds",
          indirect_over_direct,
          {{"five faces", {0.3, 0.8, 0.99}, {}, room("five-face")},
           {"four-sided CAVE", {0.95}, {}, room("cave4")},
           {"two walls",
            {0.8, 0.99},
            {0.99},
            [](double albedo, SweepSetting& s) {
              for (SimulatedSurface& surface : s.room.simulation.surfaces) surface.albedo = {albedo, albedo, albedo};
            }}},
          {},
          Judged::kDecoding};
}

// ---- grazing projector or camera ----

Result<double> steepness_of(const PredictorInput& in, Progress&) {
  const simdata::TrueGeometry g = in.simulator.geometry(0);
  return exceeded_by_a_tenth(over_visible(g, [&](int q, int x, int y) { return steepness(g, q, x, y); }));
}

// A wall's corners, and a place so far from its middle, `degrees` off its normal, upwards and a little aside.
std::vector<Eigen::Vector3d> corners(const Surface& wall) {
  return {wall.point(0, 0), wall.point(1, 0), wall.point(0, 1), wall.point(1, 1)};
}
std::array<double, 3> above(const Surface& wall, double degrees, double distance) {
  const Eigen::Vector3d up = (wall.point(0, 1) - wall.point(0, 0)).normalized(),
                        aside = (wall.point(0, 0) - wall.point(1, 0)).normalized();
  const Eigen::Vector3d along = 0.96 * up + 0.28 * aside;
  return simdata::array(wall.point(0.5, 0.5) + distance * (std::cos(degrees / kDegrees) * wall.normal(0.5, 0.5) +
                                                           std::sin(degrees / kDegrees) * along));
}

// The projector stands above the left wall and looks down along it.
void graze(double degrees, SweepSetting& s) {
  alone(s);
  const Screen room = simdata::room_screen(s.room.simulation);
  SimulatedProjector& p = s.room.simulation.projectors[0];
  p.position = above(*room.surfaces[0], degrees, 3.2), p.lens_shift = {0, 0};
  CS_CHECK(simdata::aim_projector(corners(*room.surfaces[0]), s.room.rig, p), "a projector before its wall");
}

Sweep grazing() {
  return {"grazing",
          "Decoding where projector or camera look along the wall",
          "angle between the axis and the wall's normal, degrees",
          "projector px per camera px that a tenth of the pixels exceeds",
          steepness_of,
          {{"projector", {0, 60, 75, 80, 85}, {75}, graze},
           {"camera",
            {60, 75, 85},
            {},
            [](double degrees, SweepSetting& s) {
              alone(s);
              const Screen room = simdata::room_screen(s.room.simulation);
              SimulatedCamera& c = s.room.simulation.cameras[0];
              c.position = above(*room.surfaces[0], degrees, 4.5);
              CS_CHECK(simdata::aim_camera(corners(*room.surfaces[0]), c), "a camera before its wall");
            }}},
          {},
          Judged::kDecoding};
}

// ---- ambient light ----

// Noise of a photo at the mean of a fringe, over the fringe's amplitude:
//
//   sqrt(((B + W) / 2 / full well + read^2) / channels) / ((W - B) / 2)
//
// B, W: light of a pixel with black and with white; of W - B only what is direct.
Result<double> noise_over_fringe(const PredictorInput& in, Progress&) {
  const SimulatedCamera& camera = in.setting.room.simulation.cameras[0];
  const Rig& rig = in.setting.room.rig;
  const Image dark = luminance_mean(in.simulator.total_light(0, white_of(rig, -1)));
  const Image black = luminance_mean(in.simulator.light(0, white_of(rig, -1)).direct);
  const double read = std::pow(camera.read_noise_e / camera.full_well_e, 2);
  std::vector<Image> white, direct;
  for (std::size_t q = 0; q < rig.projectors.size(); ++q) {
    const simdata::TrueLight light = in.simulator.light(0, white_of(rig, static_cast<int>(q)));
    direct.push_back(luminance_mean(light.direct)), white.push_back(luminance_mean(light.indirect));
  }
  return exceeded_by_a_tenth(over_visible(in.simulator.geometry(0), [&](int q, int x, int y) {
    const double middle = (dark.at(x, y) + white[q].at(x, y) + direct[q].at(x, y)) / 2;
    const double amplitude = (direct[q].at(x, y) - black.at(x, y)) / 2;
    return std::sqrt((middle / camera.full_well_e + read) / camera.channels) / std::max(1e-9, amplitude);
  }));
}

Sweep ambient() {
  return {"ambient",
          "Decoding in a room that is not dark",
          "other light over the projector's white",
          "noise of a photo over the amplitude of a fringe that a tenth of the pixels exceeds",
          noise_over_fringe,
          {{"from all around, exposure made shorter",
            {0, 1, 3, 6, 10},
            {3},
            [](double v, SweepSetting& s) { alone(s), s.room.simulation.ambient = v; }},
           {"the sun on half a wall, exposure made shorter",
            {3, 10, 30},
            {},
            [](double v, SweepSetting& s) {
              alone(s);
              SimulatedSurface& wall = s.room.simulation.surfaces[0];
              wall.daylight = v, wall.daylight_from = {0.1, 0.05}, wall.daylight_to = {0.7, 0.8};
            }},
           {"a lamp, switched on between the photos",
            {0.02, 0.1, 0.4},
            {},
            [](double v, SweepSetting& s) {
              alone(s);
              s.room.simulation.cameras[0].white_level = 0.5;
              add_fault(s, "lamp-switched-on", 0.5 * v, 18);
            }}},
          {},
          Judged::kDecoding};
}

// ---- defocus and depth ----

// Blur of projector and camera together, in projector px, over the finest period.
Result<double> blur_over_period(const PredictorInput& in, Progress&) {
  const SweepSetting& setting = in.setting;
  const simdata::TrueGeometry g = in.simulator.geometry(0);
  CS_TRY(const Device camera, simdata::true_camera(setting.room.simulation, setting.room.rig.cameras[0].id));
  std::vector<simdata::Emitter> emitters;
  std::vector<Device> projectors;
  for (const SimulatedProjector& p : setting.room.simulation.projectors) {
    CS_TRY(projectors.emplace_back(), simdata::true_projector(setting.room.simulation, setting.room.rig, p.id));
    emitters.emplace_back(p, projectors.back(), 16);
  }
  return exceeded_by_a_tenth(over_visible(g, [&](int q, int x, int y) {
    const Ray ray = camera.ray({1. * x, 1. * y});
    const Eigen::Vector3d at = ray.origin + g.depth.at(x, y) * ray.direction.normalized();
    const double psf = setting.room.simulation.cameras[0].psf_sigma_px * steepness(g, q, x, y);
    return std::sqrt(emitters[q].blur_variance((projectors[q].device_from_world * at).z()) + psf * psf) / kPeriod;
  }));
}

Sweep defocus() {
  return {"defocus",
          "Decoding out of focus, everywhere and at some depths only",
          "sigma of the blur where it is most, px of the device that makes it",
          "sigma of all blur over the finest period that a tenth of the pixels exceeds",
          blur_over_period,
          {{"projector, everywhere",
            {0.5, 3, 5, 6, 8},
            {3, 5},
            [](double v, SweepSetting& s) { alone(s), s.room.simulation.projectors[0].defocus_sigma_px = v; }},
           {"projector aslant, in focus at the near end",
            {3, 6, 9},
            {},
            [](double v, SweepSetting& s) {
              graze(55, s);
              SimulatedProjector& p = s.room.simulation.projectors[0];
              const Device device = simdata::true_projector(s.room.simulation, s.room.rig, p.id).value();
              double near = HUGE_VAL, far = 0;
              for (const Eigen::Vector3d& x : corners(*simdata::room_screen(s.room.simulation).surfaces[0])) {
                const double depth = (device.device_from_world * x).z();
                near = std::min(near, depth), far = std::max(far, depth);
              }
              p.focus_distance = near;
              p.aperture_mm = 1e3 * 4 * v / (p.throw_ratio * device.lens.width() * (1 / near - 1 / far));
            }},
           {"camera",
            {2, 4, 6},
            {},
            [](double v, SweepSetting& s) { alone(s), s.room.simulation.cameras[0].psf_sigma_px = v; }}},
          {},
          Judged::kDecoding};
}

// ---- a camera that moves ----

// Photos that a capture takes before its first frame, and again where it goes on with the code that was chosen: two of
// a light that has settled, one of another.
constexpr int kBefore = 3;

// Number of the photo of a frame of one projector's micro phase shifting.
std::uint64_t photo_of_frame(const ProjectorSpec& projector, int position) {
  const int base = static_cast<int>(capture::base_roles(projector).size());
  return position + (position < base ? kBefore : 2 * kBefore);
}

// Rms of how far the picture of the room stood from where it stood at rest, in the photos of the code of an axis (the
// worse), times projector px per camera px.
Result<double> shift_of_photos(const PredictorInput& in, Progress& progress) {
  CS_TRY(const double steep, steepness_of(in, progress));
  const SweepSetting& setting = in.setting;
  CS_TRY(const Device camera, simdata::true_camera(setting.room.simulation, setting.room.rig.cameras[0].id));
  const simdata::Faults faults(setting.faults, setting.room.simulation.seed);
  const simdata::TrueGeometry g = in.simulator.geometry(0);
  const Eigen::Vector2d middle((camera.lens.width() - 1) / 2, (camera.lens.height() - 1) / 2);
  const Eigen::Vector3d x = g.depth.at(static_cast<int>(middle.x()), static_cast<int>(middle.y())) *
                            camera.lens.unproject(middle).normalized();
  CS_TRY(const Sequence sequence, capture::sequence_with(setting.room.rig, {"micro-phase"}));
  double worst = 0;
  for (const char* axis : {"x", "y"}) {
    double sum = 0, count = 0;
    for (std::size_t f = 0; f < sequence.frames.size(); ++f) {
      const Role& role = sequence.frames[f].role;
      if (role.kind != "phase" || role.axis != axis) continue;
      const auto move = faults.camera_move(photo_of_frame(setting.room.rig.projectors[0], static_cast<int>(f)));
      if (move) sum += (camera.lens.project(*move * x) - middle).squaredNorm();
      count += 1;
    }
    worst = std::max(worst, std::sqrt(sum / count));
  }
  return worst * steep;
}

Sweep moving() {
  const auto degrees = [](double px, const SweepSetting& s) {
    return px / s.room.simulation.cameras[0].focal_px * kDegrees;
  };
  return {"moving",
          "Decoding with a camera that moves",
          "camera px: rms from photo to photo, from first to last photo of the code, or at once",
          "rms shift of the code's photos from rest, projector px",
          shift_of_photos,
          {{"shaken from photo to photo",
            {0, 0.1, 0.2, 0.4, 0.8, 3.2},
            {0.4},
            [=](double px, SweepSetting& s) {
              alone(s);
              if (px > 0) add_fault(s, "camera-shaken", degrees(px, s));
            }},
           {"gives way all the time",
            {0.2, 0.5, 1, 2, 4},
            {},
            [=](double px, SweepSetting& s) {
              alone(s);
              const double photos = static_cast<double>(photo_of_frame(s.room.rig.projectors[0], 15));
              add_fault(s, "camera-drifts", degrees(px, s) / photos);
            }},
           {"touched between the axes",
            {0.5, 1, 2, 4},
            {1},
            [=](double px, SweepSetting& s) {
              alone(s);
              add_fault(s, "camera-turned", degrees(px, s), photo_of_frame(s.room.rig.projectors[0], 12));
            }}},
          {},
          Judged::kDecoding};
}

}  // namespace

std::vector<Sweep> decode_sweeps() {
  return {indirect(), grazing(), ambient(), defocus(), moving()};
}

}  // namespace countershade::bench

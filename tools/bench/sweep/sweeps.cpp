// The sweeps: what is driven, over which range, and the predictor on which the curves should collapse (PHYSICS 10).
#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/photometry/response.h"
#include "capture/pattern/pattern.h"
#include "solver/fit/geometry_fit.h"
#include "solver/transport/form_factor.h"
#include "tools/bench/sweep/sweep.h"

namespace countershade::bench {

void add_fault(std::vector<simdata::Fault>& faults, const std::string& name, double value, std::uint64_t photo) {
  for (const simdata::FaultKind& kind : simdata::fault_kinds())
    if (kind.name == name) faults.push_back({&kind, value, photo});
}
void add_fault(SweepSetting& setting, const std::string& name, double value, std::uint64_t photo) {
  add_fault(setting.faults, name, value, photo);
}

namespace {

// Value of a fault that acts on all photos; `otherwise` where there is none.
double fault_value(const SweepSetting& setting, const std::string& name, double otherwise) {
  for (const simdata::Fault& f : setting.faults)
    if (f.kind->name == name) return f.value;
  return otherwise;
}

double mean(const Image& image) {
  double sum = 0;
  for (float v : image.data()) sum += v;
  return sum / static_cast<double>(image.data().size());
}

// ---- noise and bit depth ----

// Camera pixels of one wall, the fewer.
double pixels_per_wall(const simdata::Simulator& simulator) {
  const Image surface = simulator.geometry(0).surface;
  double fewest = HUGE_VAL;
  for (int wall = 0; wall < simulator.screen().size(); ++wall)
    fewest = std::min(fewest, static_cast<double>(
                                  std::count(surface.data().begin(), surface.data().end(), static_cast<float>(wall))));
  return fewest;
}

// What noise and rounding leave in means of many pixels [% of W]. With read noise s (of full scale), converter step
// q = 1 / (2^bits - 1), stored pedestal P (of full scale) and N pixels of a wall, whose patches share one gain:
//
//   predictor = 100 / W sqrt(b^2 + r^2 + (s^2 + W / (2 full well) + q^2 / 12) / N)
//   b = s (phi(P / s) - P / s Phi(-P / s))           what clipping at zero adds to dark pixels: .4 s without a pedestal
//   r = q / (sqrt(2) pi) exp(-2 pi^2 s^2 / q^2)      a staircase's first harmonic, smeared by s (Widrow & Kollar 2008)
//
// b and r do not fall with the number of pixels; the noise of a patch mean alone (b = r = 0, N of a patch) is no
// predictor: at 1 % of W of photon noise a tenth of it is left.
Result<double> dark_error(const PredictorInput& in, Progress&) {
  const SimulatedCamera& camera = in.setting.room.simulation.cameras[0];
  const double full = std::ldexp(1.0, camera.bits) - 1, pi = std::numbers::pi, q = 1 / full;
  const double s = std::max(1e-9, camera.read_noise_e / camera.full_well_e);
  const double above = in.setting.room.rig.cameras[0].pedestal / full / s;
  const double b =
      s * (std::exp(-above * above / 2) / std::sqrt(2 * pi) - above * std::erfc(above / std::numbers::sqrt2) / 2);
  const double r = q / (std::numbers::sqrt2 * pi) * std::exp(-2 * pi * pi * s * s / (q * q));
  const double random = (s * s + in.white / 2 / camera.full_well_e + q * q / 12) / pixels_per_wall(in.simulator);
  return 100 / in.white * std::sqrt(b * b + r * r + random);
}

Sweep noise() {
  // All in % of full scale: standard deviation of one pixel in the dark, of one at full scale, and the step of the
  // converter. What a series does not drive stands at the fixed conditions: .05 %, 1 %, 12 bits.
  const auto camera = [](SweepSetting& s) -> SimulatedCamera& { return s.room.simulation.cameras[0]; };
  return {
      "noise",
      "Noise and bit depth of the camera",
      "noise of a pixel or step of the converter, % of full scale",
      "what noise and rounding leave in the mean of dark pixels, % of W",
      dark_error,
      {{"read noise",
        {0.05, 0.5, 1.5, 5, 15},
        {0.05, 5},
        [=](double v, SweepSetting& s) { camera(s).read_noise_e = v / 100 * camera(s).full_well_e; }},
       {"read noise above a pedestal",
        {1.5, 5},
        {},
        [=](double v, SweepSetting& s) {
          camera(s).read_noise_e = v / 100 * camera(s).full_well_e;
          s.room.rig.cameras[0].pedestal = std::round(0.04 * v * std::ldexp(1.0, camera(s).bits));  // 4 sigma
        }},
       {"photon noise",
        {2, 10},
        {},
        [=](double v, SweepSetting& s) {
          const double ratio = camera(s).read_noise_e / camera(s).full_well_e;
          camera(s).full_well_e = std::pow(100 / v, 2);
          camera(s).read_noise_e = ratio * camera(s).full_well_e;
        }},
       {"bits 8, 7, 6, 5",
        {0.392, 0.787, 1.587, 3.226},
        {1.587},
        [=](double v, SweepSetting& s) { camera(s).bits = static_cast<int>(std::lround(std::log2(100 / v + 1))); }}},
      {}};
}

// ---- veiling glare ----

// Light that the camera sees everywhere [% of W]: glare share times mean light of the photo of the show, over W.
Result<double> veil(const PredictorInput& in, Progress&) {
  const Image photo = in.simulator.optics(0, in.simulator.total_light(0, in.emitted));
  return 100 * fault_value(in.setting, "glare", 0) * mean(photo) / in.white;
}

Sweep glare() {
  const auto add = [](double percent, SweepSetting& s) {
    if (percent > 0) add_fault(s, "glare", percent / 100);
  };
  return {"glare",
          "Veiling glare in the camera",
          "glare, % of the photo's mean light",
          "glare share times mean light, % of W",
          veil,
          {{"walls fill the photo", {0, 0.3, 1, 3, 4, 5, 10}, {0, 3}, add},
           {"from farther away",
            {0, 3, 7, 10},
            {},
            [=](double percent, SweepSetting& s) {
              // Three quarters of the walls' size in the photo: half the mean light, the same W.
              s.room.simulation.cameras[0].focal_px *= 0.75;
              s.lens = simdata::true_camera(s.room.simulation, s.room.rig.cameras[0].id).value();
              s.lens.device_from_world = {};
              add(percent, s);
            }}},
          {},
          {}};
}

// ---- gamma ----

// Largest deviation of the projectors' real curve from the stated one over the encoded values of the picture [% of
// white]: 100 max_v |v^(b g) - stated(v)|, b the fault's exponent, g the real gamma.
Result<double> curve_deviation(const PredictorInput& in, Progress&) {
  const SweepSetting& setting = in.setting;
  const double bend = fault_value(setting, "gamma-wrong", 1);
  double most = 0;
  for (std::size_t q = 0; q < in.plain.size(); ++q) {
    CS_TRY(const Response stated, Response::parse(setting.room.rig.projectors[q].response));
    const auto [low, high] = std::minmax_element(in.plain[q].data().begin(), in.plain[q].data().end());
    for (int v = *low; v <= *high; v += 64)
      for (double gamma : setting.room.simulation.projectors[q].gamma)
        most = std::max(most, std::abs(std::pow(v / 65535.0, bend * gamma) - stated.decode(v / 65535.0)));
  }
  return 100 * most;
}

Sweep gamma() {
  return {"gamma",
          "The projectors' real response differs from the stated one",
          "real exponent over stated exponent",
          "largest deviation of the curves in the picture's range, % of white",
          curve_deviation,
          {{"picture mode bends it",
            {0.8, 0.9, 1, 1.1, 1.25, 1.6},
            {1.25},
            [](double ratio, SweepSetting& s) {
              if (ratio != 1) add_fault(s, "gamma-wrong", ratio);
            }},
           {"stated wrongly",
            {0.8, 0.9, 1.1, 1.25},
            {0.8},
            [](double ratio, SweepSetting& s) {
              for (ProjectorSpec& p : s.room.rig.projectors) p.response = fmt::format("gamma:{:.4f}", 2.2 / ratio);
            }}},
          {}};
}

// ---- geometry ----

// The true polygon under a patch of a wrong geometry: what a ray through the same camera pixels meets.
std::vector<Eigen::Vector3d> true_polygon(const Device& handed, const Device& camera, const Surface& wall,
                                          std::span<const Eigen::Vector3d> corners) {
  std::vector<Eigen::Vector3d> polygon;
  for (const Eigen::Vector3d& x : corners) {
    const Ray ray = camera.ray(handed.project(x));
    const Eigen::Vector3d n = wall.normal(0, 0);
    polygon.push_back(ray.origin + n.dot(wall.point(0, 0) - ray.origin) / n.dot(ray.direction) * ray.direction);
  }
  return polygon;
}

// Relative change of the form factors that the wrong lens causes and no gain of the receiving patch absorbs [%]:
// geometry fitted to the simulator's own correspondences with the lens that is handed over, against the true walls
// under the same camera pixels,
//
//   100 sum_ij |g_i F_ij - F^true_ij| / sum_ij F^true_ij,   g_i = sum_j F^true_ij / sum_j F_ij,   8 x 6 patches a wall
//
// Without the gains (g = 1) the series do not meet: a focal length 30 % too short changes F by 31 % and leaves .26 % of
// white, a principal point 10 % off changes it by 12 % and leaves .30 %. Unknown where the fit refuses.
Result<double> form_factor_change(const PredictorInput& in, Progress& progress) {
  const simdata::TrueGeometry truth = in.simulator.geometry(0);
  const Rig& rig = in.setting.room.rig;
  const Image sigma(truth.depth.width(), truth.depth.height(), 1, 0.3f);
  std::vector<solver::ProjectorObservation> observations;
  for (std::size_t q = 0; q < rig.projectors.size(); ++q)
    observations.push_back({rig.projectors[q], &truth.projector_x[q], &truth.projector_y[q], &sigma});
  const auto fit = solver::fit_geometry(in.setting.lens, observations, rig.screen, {}, progress);
  if (!fit) return kUnknown;
  CS_TRY(const Device camera, simdata::true_camera(in.setting.room.simulation, rig.cameras[0].id));
  const Screen& walls = in.simulator.screen();
  const Patches patches(std::vector<std::pair<int, int>>(fit->screen.size(), {8, 6}));
  const Eigen::MatrixXf F = solver::form_factors(fit->screen, patches, solver::FormFactorMethod::kExact, progress);
  std::vector<std::vector<Eigen::Vector3d>> polygons;
  for (int i = 0; i < patches.size(); ++i) {
    const int s = patches.surface_of(i);
    const ChartPoint wall = walls.intersect(camera.ray(in.setting.lens.project(fit->screen.point({s, 0.5, 0.5}))));
    if (wall.surface < 0) return kUnknown;
    polygons.push_back(
        true_polygon(in.setting.lens, camera, *walls.surfaces[wall.surface], patch_corners(fit->screen, patches, i)));
  }
  double change = 0, all = 0;
  for (int i = 0; i < patches.size(); ++i) {
    Eigen::VectorXd exact = Eigen::VectorXd::Zero(patches.size());
    for (int j = 0; j < patches.size(); ++j)
      if (patches.surface_of(i) != patches.surface_of(j)) exact[j] = solver::form_factor(polygons[i], polygons[j]);
    const Eigen::VectorXd fitted = F.row(i).transpose().cast<double>();
    const double gain = fitted.sum() > 0 ? exact.sum() / fitted.sum() : 1;
    change += (gain * fitted - exact).cwiseAbs().sum(), all += exact.sum();
  }
  return all > 0 ? 100 * change / all : kUnknown;
}

// Multiplies the focal length of the lens that is handed over and moves its principal point [px].
void spoil_lens(SweepSetting& setting, double focal, double move_x, double move_y) {
  std::vector<double> k = setting.lens.lens.intrinsics();
  k[0] *= focal, k[1] *= focal, k[2] += move_x, k[3] += move_y;
  const Lens& lens = setting.lens.lens;
  setting.lens.lens = Lens::make(lens.model(), k, lens.width(), lens.height()).value();
}

Sweep geometry() {
  return {"geometry",
          "A wrong camera lens is handed over",
          "error of the lens, % of the focal length or of the picture's width",
          "change of the form factors that no gain absorbs, %",
          form_factor_change,
          {{"focal length",
            {-30, -10, 0, 3, 10, 30},
            {3},
            [](double percent, SweepSetting& s) { spoil_lens(s, 1 + percent / 100, 0, 0); }},
           {"principal point",
            {3, 10, 20, 30},
            {10},
            [](double percent, SweepSetting& s) {
              const double px = percent / 100 * s.lens.lens.width();
              spoil_lens(s, 1, 0.8 * px, -0.6 * px);
            }}},
          {}};
}

// ---- a frame off by one ----

constexpr int kPhotos = 400;  // more than any stage takes

// Share of the capture's frames that show the former picture, times the mean difference of neighbouring frames [% of
// white], in the light that the projectors are sent.
Result<double> wrong_frames(const PredictorInput& in, Progress&) {
  const Rig& rig = in.setting.room.rig;
  const Sequence sequence = capture::default_sequence(rig);
  double difference = 0;
  for (const ProjectorSpec& p : rig.projectors) {
    CS_TRY(const Response curve, Response::parse(p.response));
    const std::vector<float> light = curve.decode_table(65536);
    Picture former;
    for (const Frame& frame : sequence.frames) {
      CS_TRY(Picture picture, capture::render_role(frame.role, p.id, p.resolution[0], p.resolution[1]));
      double sum = 0;
      for (std::size_t i = 0; i < former.data().size(); ++i)
        sum += std::abs(light[picture.data()[i]] - light[former.data()[i]]);
      difference += sum / static_cast<double>(picture.data().size());
      former = std::move(picture);
    }
  }
  const auto frames = static_cast<double>(sequence.frames.size());
  const auto wrong = std::count_if(in.setting.faults.begin(), in.setting.faults.end(),
                                   [&](const simdata::Fault& f) { return static_cast<double>(f.photo) < frames; });
  return 100 * static_cast<double>(wrong) / frames * difference / (frames - 1) /
         static_cast<double>(rig.projectors.size());
}

// Spreads a fault of single photos evenly over `percent` of all photos, beginning with the middle of the first gap.
void spread(SweepSetting& setting, const std::string& fault, double percent) {
  for (int photo = 0; photo < kPhotos; ++photo)
    if (std::floor((photo + 1) * percent / 100 + 0.5) > std::floor(photo * percent / 100 + 0.5))
      add_fault(setting, fault, 1, photo);
}

Sweep frames() {
  return {"frames",
          "Photos that still show the former picture",
          "share of the photos, %",
          "share times mean difference of neighbouring frames, % of white",
          wrong_frames,
          {{"photographed too early",
            {0, 1, 10, 100},
            {10},
            [](double percent, SweepSetting& s) { spread(s, "stale-frame", percent); }},
           {"handed over twice",
            {1, 10, 30, 100},
            {10},
            [](double percent, SweepSetting& s) { spread(s, "duplicated-frame", percent); }},
           {"handed over twice, last photos only",
            {3, 10},
            {},
            [](double percent, SweepSetting& s) {
              const auto frames = static_cast<double>(capture::default_sequence(s.room.rig).frames.size());
              const int count = static_cast<int>(std::lround(frames * percent / 100));
              for (int i = 0; i < count; ++i) add_fault(s, "duplicated-frame", 1, static_cast<int>(frames) - 1 - i);
            }}},
          {}};
}

// ---- rooms of all kinds ----

// Share of the plain show's light that has bounced [%].
Result<double> bounced_share(const PredictorInput& in, Progress&) {
  const simdata::TrueLight light = in.simulator.light(0, in.emitted);
  const double direct = mean(light.direct), indirect = mean(light.indirect);
  return 100 * indirect / std::max(1e-12, direct + indirect);
}

Sweep rooms() {
  std::vector<SweepSeries> series;
  for (const auto& [name, what] : simdata::room_kinds()) {
    const simdata::RigAndRoom made = simdata::default_room(name).value();
    if (!made.files.empty()) continue;  // a mesh needs its file
    const auto surfaces = static_cast<double>(made.simulation.surfaces.size());
    series.push_back({name,
                      {surfaces},
                      name == "workbench" ? std::vector<double>{surfaces} : std::vector<double>(),
                      [made](double, SweepSetting& s) { move_to(made, s); }});
  }
  return {"rooms",
          "Every room that `countershade new` writes, on the defaults",
          "surfaces of the room",
          "share of the plain show's light that has bounced, %",
          bounced_share,
          std::move(series),
          {}};
}

}  // namespace

void move_to(const simdata::RigAndRoom& room, SweepSetting& s) {
  const int shrink = 1920 / s.room.simulation.cameras[0].resolution[0];
  const std::array<int, 2> pixels = s.room.rig.projectors[0].resolution;
  s.room = simdata::smaller(room, shrink, 1, s.room.simulation.samples);
  for (ProjectorSpec& p : s.room.rig.projectors) p.resolution = pixels;
  s.lens = simdata::true_camera(s.room.simulation, s.room.rig.cameras[0].id).value();
  s.lens.device_from_world = {};
}

const std::vector<Sweep>& sweeps() {
  static const std::vector<Sweep> all = [] {
    std::vector<Sweep> list = {noise(), glare(), gamma(), geometry(), frames(), rooms()};
    for (Sweep& s : decode_sweeps()) list.push_back(std::move(s));
    for (Sweep& s : light_sweeps()) list.push_back(std::move(s));
    return list;
  }();
  return all;
}

}  // namespace countershade::bench

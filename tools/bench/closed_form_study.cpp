// closed-form: D = (I - K) R is shown to the path tracer; what it shows must be R.
#include <algorithm>
#include <cmath>

#include "calib/base/random.h"
#include "simdata/room/rooms.h"
#include "solver/runtime/runtime.h"
#include "tools/bench/study.h"
#include "tools/bench/truth.h"
#include "tools/job/show.h"

namespace countershade::bench {

namespace {

// Camera pixels whose truth is known, away from the borders of pictures and walls.
std::vector<Eigen::Vector2d> probes(const solver::Model& model, const solver::PixelGeometry& pixels, int count) {
  std::vector<Eigen::Vector2d> chosen;
  Random random(hash_name("closed-form probes"));
  while (static_cast<int>(chosen.size()) < count) {
    const int x = static_cast<int>(random.uniform() * pixels.width),
              y = static_cast<int>(random.uniform() * pixels.height);
    const std::size_t i = static_cast<std::size_t>(y) * pixels.width + x;
    const ChartPoint& at = pixels.chart[i];
    if (at.surface < 0 || at.u < 0.03 || at.u > 0.97 || at.v < 0.05 || at.v > 0.95) continue;
    bool lit = false;
    for (std::size_t q = 0; q < model.projectors.size(); ++q) lit = lit || !std::isnan(pixels.beam[q][i].x());
    if (lit) chosen.emplace_back(x, y);
  }
  return chosen;
}

struct Deviation {
  double rms = 0, noise = 0;  // of white
};

Result<Deviation> show_to_tracer(const simdata::Simulator& simulator, const TrueModel& truth,
                                 std::span<const Picture> plain) {
  solver::CompensateOptions options;
  options.bits = 16;
  options.dither = false;
  const std::vector<Picture> shown = solver::compensate_frame(truth.model, plain, options).pictures;
  const Image wanted = simulator.light(0, plain).direct, direct = simulator.light(0, shown).direct;
  const auto pixels = probes(truth.model, truth.pixels, 400);
  const simdata::Simulator::Traced traced = simulator.trace_indirect(0, shown, pixels, 4096);
  Deviation d;
  const int channels = wanted.channels();
  for (std::size_t i = 0; i < pixels.size(); ++i)
    for (int c = 0; c < channels; ++c) {
      const int x = static_cast<int>(pixels[i].x()), y = static_cast<int>(pixels[i].y());
      const double B = direct.at(x, y, c) + traced.mean[i * channels + c];
      d.rms += std::pow((B - wanted.at(x, y, c)) / truth.model.white, 2) / (pixels.size() * channels);
      d.noise += std::pow(traced.standard_error[i * channels + c] / truth.model.white, 2) / (pixels.size() * channels);
    }
  d.rms = std::sqrt(d.rms);
  d.noise = std::sqrt(d.noise);
  return d;
}

// Largest deviation of the GL runtime's receivers from the CPU's, of white.
Result<double> gl_deviation(const TrueModel& truth, std::span<const Picture> plain, solver::Precision precision) {
  CS_TRY(const auto context, solver::HeadlessContext::make());
  CS_TRY(const auto runtime, solver::Runtime::make(truth.model, {}, precision));
  CS_TRY_VOID(runtime->render(plain));
  CS_TRY(const solver::Radiosity gl, runtime->read_receiver_indirect());
  const solver::Compensator compensator(truth.model);
  solver::FrameReport report;
  const solver::Radiosity cpu = compensator.receiver_indirect(compensator.patch_target(plain), {}, report);
  return (gl - cpu).cwiseAbs().maxCoeff() / truth.model.white;
}

}  // namespace

Result<Study> closed_form(const StudyContext& context) {
  const simdata::RigAndRoom room = simdata::default_two_wall();
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, *context.progress));
  Study study{
      "D = (I - K) R shown to the path tracer: rms of |B - R| at 400 camera pixels, true model, 16-bit pictures; GL "
      "against CPU",
      {"patches per wall", "rms % W", "tracer's standard error % W", "beyond noise % W", "GL half", "GL float"},
      {},
      {},
      "",
      "",
      false};
  std::vector<double> beyond;
  double half = 0, full = 0;
  for (int n : {4, 8, 16}) {
    CS_TRY(const TrueModel truth, true_model(*simulator, n, n, *context.progress));
    CS_TRY(const std::vector<Picture> plain, tools::test_pictures(truth.model, "photo"));
    CS_TRY(const Deviation d, show_to_tracer(*simulator, truth, plain));
    CS_TRY(const double gl_half, gl_deviation(truth, plain, solver::Precision::kHalf));
    CS_TRY(const double gl_full, gl_deviation(truth, plain, solver::Precision::kFloat));
    half = std::max(half, gl_half), full = std::max(full, gl_full);
    beyond.push_back(std::sqrt(std::max(0.0, d.rms * d.rms - d.noise * d.noise)));
    study.rows.push_back({fmt::format("{0} x {0}", n), fmt::format("{:.3f}", 100 * d.rms),
                          fmt::format("{:.3f}", 100 * d.noise), fmt::format("{:.3f}", 100 * beyond.back()),
                          fmt::format("{:.1e}", gl_half), fmt::format("{:.1e}", gl_full)});
  }
  const double order = beyond[2] > 0 ? std::log2(beyond[0] / beyond[2]) / 2 : HUGE_VAL;
  study.figure = fmt::format("discretisation error falls at order {:.2f}, GL = CPU to {:.1e} (half) and {:.1e} (float)",
                             order, half, full);
  study.bound = "order >= 1, <= 2e-3, <= 1e-5";
  study.ok = order >= 1 && half <= 2e-3 && full <= 1e-5;
  return study;
}

}  // namespace countershade::bench

// first-speed: the paper's Algorithm 2 against the closed form, on GL and on the CPU, with the error of each.
#include <chrono>
#include <cmath>

#include "simdata/room/rooms.h"
#include "solver/compensate/compensate.h"
#include "solver/runtime/runtime.h"
#include "tools/bench/study.h"
#include "tools/bench/truth.h"
#include "tools/job/show.h"

namespace countershade::bench {

namespace {

// Seconds of the fastest of `repeats` calls.
template <class Call>
double seconds_of(int repeats, Call&& call) {
  double best = HUGE_VAL;
  for (int i = 0; i < repeats; ++i) {
    const auto start = std::chrono::steady_clock::now();
    call();
    best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
  return best;
}

// A tiny camera suffices: the speed of a patch solve does not depend on it.
simdata::RigAndRoom small_camera_room() {
  simdata::RigAndRoom room = simdata::default_two_wall();
  SimulatedCamera& camera = room.simulation.cameras[0];
  camera.focal_px *= 0.25;
  for (int i = 0; i < 2; ++i) camera.resolution[i] /= 4, camera.principal[i] = (camera.principal[i] + 0.5) / 4 - 0.5;
  room.simulation.samples = 256;
  for (SimulatedSurface& wall : room.simulation.surfaces) wall.albedo = {0.8, 0.8, 0.8};
  return room;
}

double rms_error(const solver::Model& model, const solver::Radiosity& direct, const solver::Radiosity& target) {
  return std::sqrt((solver::forward(model, direct) - target).squaredNorm() / target.squaredNorm());
}

}  // namespace

Result<Study> first_speed(const StudyContext& context) {
  const simdata::RigAndRoom room = small_camera_room();
  CS_TRY(const auto simulator, simdata::Simulator::make(room.rig, room.simulation, *context.progress));
  CS_TRY(const auto gl, solver::HeadlessContext::make());
  Study study{
      "Algorithm 2 (Bimber et al. 2006) against the closed form; M = .8, picture `photo`, exit at 1/255 of white; " +
          gl->description(),
      {"patches", "method", "passes", "error (% rms)", "GL ms", "CPU ms", "GL ratio", "CPU ratio"},
      {},
      {},
      "",
      "",
      false};
  double figure = 0;
  for (int n : {16, 32}) {
    CS_TRY(const TrueModel truth, true_model(*simulator, n / 2, n, *context.progress));
    const solver::Model& model = truth.model;
    CS_TRY(const std::vector<Picture> pictures, tools::test_pictures(model, "photo"));
    const solver::Radiosity target = solver::Compensator(model).patch_target(pictures).target;
    const solver::Gather K = solver::Gather::patches(model);
    CS_TRY(const auto runtime, solver::Runtime::make(model, {}, solver::Precision::kHalf));
    CS_TRY_VOID(runtime->render(pictures));
    CS_TRY(const solver::Radiosity first, runtime->solve_patches(0, 1));  // warm
    CS_CHECK(first.rows() == target.rows(), "the GL solve answers for every patch");
    const int repeats = n == 16 ? 9 : 5;
    solver::Radiosity direct;
    const double cpu_closed = seconds_of(repeats, [&] { direct = solver::direct_for(K, target); });
    const double gl_closed = seconds_of(repeats, [&] { (void)runtime->solve_patches(0, 1).has_value(); });
    const std::string patches = fmt::format("{0} x {0}", n);
    study.rows.push_back({patches, "closed form", "1", fmt::format("{:.4f}", 100 * rms_error(model, direct, target)),
                          fmt::format("{:.3f}", 1e3 * gl_closed), fmt::format("{:.3f}", 1e3 * cpu_closed), "1", "1"});
    for (int H : {1, 2, 7}) {
      solver::PaperSolution paper;
      const double cpu = seconds_of(
          3, [&] { paper = solver::paper_direct_for(K, target, H, static_cast<float>(model.white / 255), 100); });
      const double on_gl = seconds_of(3, [&] { (void)runtime->solve_patches(H, paper.passes).has_value(); });
      study.rows.push_back({patches, fmt::format("algorithm 2, H = {}", H), fmt::format("{}", paper.passes),
                            fmt::format("{:.4f}", 100 * rms_error(model, paper.direct, target)),
                            fmt::format("{:.3f}", 1e3 * on_gl), fmt::format("{:.3f}", 1e3 * cpu),
                            fmt::format("{:.1f}", on_gl / gl_closed), fmt::format("{:.1f}", cpu / cpu_closed)});
      if (n == 32 && H == 7) figure = on_gl / gl_closed;
    }
  }
  study.notes.push_back("GL times include the read-back of the patches, the same for every method");
  study.figure = fmt::format("H = 7 costs {:.1f}x the closed form on GL at 32 x 32", figure);
  study.bound = ">= 35x";
  study.ok = figure >= 35;
  return study;
}

}  // namespace countershade::bench

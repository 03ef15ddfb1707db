#include "tools/bench/sweep/sweep.h"

#include <algorithm>

#include "calib/file/file.h"
#include "capture/session/runner.h"
#include "solver/compensate/compensate.h"
#include "solver/compensate/gather.h"
#include "tools/bench/sweep/stages.h"
#include "tools/bench/truth.h"
#include "tools/job/devices.h"
#include "tools/job/test_pictures.h"
#include "tools/job/verification.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr const char* kPicture = "photo";
constexpr std::uint64_t kLate = 1u << 20;  // a photo on which every lasting fault acts

const std::vector<std::string> kMethods = {"none", "paper H=1", "one k", "ours"};

// The show as it is, without a camera's noise or faults: what a viewer in the camera's place sees.
struct Truth {
  const simdata::Simulator& simulator;
  simdata::Faults faults;
  std::vector<Picture> plain, emitted;
  Image target, uncompensated;
  Mask lit;
  double white = 0;

  Truth(const simdata::Simulator& made, const std::vector<simdata::Fault>& acting, std::vector<Picture> pictures);
  // Residual of a show.
  Residual of(const std::vector<Picture>& pictures) const;

 private:
  Image seen(const std::vector<Picture>& light) const { return simulator.optics(0, simulator.total_light(0, light)); }
};

// W: 99th percentile of the direct light of the strongest single projector at full white, mean of channels.
double white_of(const simdata::Simulator& simulator) {
  double white = 0;
  const auto& projectors = simulator.rig().projectors;
  for (std::size_t q = 0; q < projectors.size(); ++q) {
    std::vector<Picture> shown(projectors.size());
    shown[q] = Picture(projectors[q].resolution[0], projectors[q].resolution[1], 3, 65535);
    const Image light = luminance_mean(true_target(simulator, 0, shown));
    std::vector<float> lit;
    for (float v : light.data())
      if (v > 0.02) lit.push_back(v);  // far above black, far below any lit wall
    if (lit.empty()) continue;
    const auto nth = lit.begin() + static_cast<std::ptrdiff_t>(0.99 * (lit.size() - 1));
    std::nth_element(lit.begin(), nth, lit.end());
    white = std::max<double>(white, *nth);
  }
  return white;
}

Truth::Truth(const simdata::Simulator& made, const std::vector<simdata::Fault>& acting, std::vector<Picture> pictures)
    : simulator(made), faults(acting, made.simulation().seed), plain(std::move(pictures)) {
  emitted = faults.emitted(plain, kLate);
  target = true_target(simulator, 0, emitted);
  uncompensated = seen(emitted);
  white = white_of(simulator);
  lit = Mask(target.width(), target.height(), 1);
  const Image light = luminance_mean(target);
  for (std::size_t i = 0; i < lit.data().size(); ++i) lit.data()[i] = light.data()[i] > 0.02 * white;
}

Residual Truth::of(const std::vector<Picture>& pictures) const {
  const Image shown = seen(faults.emitted(pictures, kLate));
  tools::VerifyInput input;
  input.uncompensated = &uncompensated, input.compensated = &shown, input.target = &target;
  input.lit = &lit, input.white = white;
  const tools::ZoneNumbers all = tools::measure(input).all;
  return {all.compensated.mean_percent, all.suppression};
}

// The paper's Algorithm 1 (its loop with one bounce) on the calibrated gains.
std::vector<Picture> paper_show(const solver::Model& model, std::span<const Picture> plain) {
  const solver::Compensator compensator(model);
  solver::FrameReport report;
  const solver::PatchTarget target = compensator.patch_target(plain);
  const auto solution = solver::paper_direct_for(model, target.target, 1, static_cast<float>(1e-5 * model.white), 200);
  return compensator.remove(plain, solver::Gather::receivers(model)(solution.direct), {}, report);
}

std::vector<Picture> one_gain_show(solver::Model model, std::span<const Picture> plain) {
  for (int c = 0; c < 3; ++c) model.k.col(c).setConstant(model.k.col(c).mean());
  return solver::compensate_frame(model, plain, {}).pictures;
}

Result<std::vector<Picture>> pictures_of(const Rig& rig) {
  std::vector<Picture> pictures;
  for (const ProjectorSpec& p : rig.projectors) {
    CS_TRY(Picture picture,
           tools::test_picture(kPicture, static_cast<int>(pictures.size()), p.resolution[0], p.resolution[1]));
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

// The job of one point, stage by stage, as its verbs run it.
class Job {
 public:
  Job(const SweepSetting& setting, std::shared_ptr<const simdata::Simulator> simulator, fs::path folder, int exposures)
      : setting_(setting), simulator_(std::move(simulator)), folder_(std::move(folder)), exposures_(exposures) {}

  Result<void> run(const Truth& truth, SweepPoint& point);

 private:
  capture::Devices devices() const { return simdata::simulated_devices(simulator_, setting_.faults); }
  // False where the program refuses to go on.
  bool calibrate(SweepPoint& point);
  Result<void> compensate(const Truth& truth, SweepPoint& point);

  const SweepSetting& setting_;
  std::shared_ptr<const simdata::Simulator> simulator_;
  fs::path folder_;
  int exposures_;
};

bool Job::calibrate(SweepPoint& point) {
  Listener listener;
  const Rig& rig = setting_.room.rig;
  std::vector<simdata::Fault> faults = setting_.faults;
  faults.insert(faults.end(), setting_.in_capture.begin(), setting_.in_capture.end());
  const auto captured =
      capture::capture_session(rig, "", capture::default_sequence(rig), simdata::simulated_devices(simulator_, faults),
                               folder_ / "session", {}, listener);
  point.notes = listener.first();
  if (!captured) {
    point.refusal = "capture: " + captured.error().message;
    return false;
  }
  const auto made = tools::calibrate(folder_ / "session", folder_ / "calibration", {}, listener);
  point.notes = listener.first();
  if (!made) {
    point.refusal = "calibrate: " + made.error().message;
    return false;
  }
  point.held_out_percent = 100 * made->held_out_error;
  point.chi2 = made->chi2;
  point.reprojection_px = 0;
  for (double rms : made->reprojection_px) point.reprojection_px = std::max(point.reprojection_px, rms);
  return true;
}

Result<void> Job::compensate(const Truth& truth, SweepPoint& point) {
  SilentProgress quiet;
  CS_TRY(const tools::Calibration calibration, tools::open_calibration(folder_ / "calibration"));
  const solver::Model& model = calibration.model;
  CS_TRY(const tools::Show show, tools::compensate_show(model, truth.plain, {}, tools::Engine::kCpu, quiet));
  point.methods.push_back(truth.of(paper_show(model, truth.plain)));
  point.methods.push_back(truth.of(one_gain_show(model, truth.plain)));
  point.methods.push_back(truth.of(show.compensated.pictures));
  const solver::PixelGeometry pixels = tools::pixels_of(calibration);
  const capture::Devices open = devices();
  const auto photos = tools::photograph(open, setting_.room.rig.cameras[0], pixels, truth.plain,
                                        show.compensated.pictures, calibration.summary.veil, exposures_, quiet);
  if (!photos) {
    point.pass = false, point.failure = photos.error().message;
    return {};
  }
  CS_TRY(const tools::Verification verified, tools::report_verification(calibration, folder_ / "calibration", pixels,
                                                                        *photos, &show, {}, folder_ / "report"));
  point.pass = verified.verdict.pass;
  point.verify_suppression = verified.numbers.unclipped.suppression;
  if (!verified.verdict.failures.empty()) point.failure = verified.verdict.failures.front();
  return {};
}

Result<void> Job::run(const Truth& truth, SweepPoint& point) {
  std::error_code ignored;
  for (const char* name : {"session", "calibration", "report"}) fs::remove_all(folder_ / name, ignored);
  point.methods = {truth.of(truth.plain)};
  check_rig(setting_, simulator_, point);
  if (!calibrate(point)) return {};
  return compensate(truth, point);
}

Result<SweepSetting> fresh_setting(bool quick) {
  SweepSetting setting{
      quick ? simdata::small_two_wall(4, {320, 200}, 256) : simdata::small_two_wall(3, {480, 300}, 1024), {}, {}};
  CS_TRY(setting.lens, simdata::true_camera(setting.room.simulation, setting.room.rig.cameras[0].id));
  setting.lens.device_from_world = {};
  return setting;
}

// Rooms are traced only when they differ from the former point's.
class Rooms {
 public:
  Result<std::shared_ptr<const simdata::Simulator>> of(const simdata::RigAndRoom& room, Progress& progress) {
    std::string key = canonical_rig_text(room.rig) + simulation_text(room.simulation);
    if (!simulator_ || key != key_) {
      CS_TRY(simulator_, simdata::Simulator::make(room.rig, room.simulation, progress));
      key_ = std::move(key);
    }
    return simulator_;
  }

 private:
  std::string key_;
  std::shared_ptr<const simdata::Simulator> simulator_;
};

// One point; `rooms` keeps the traced room for the next one.
Result<SweepPoint> run_point(const Sweep& sweep, const SweepSeries& series, double value, bool quick,
                             const fs::path& folder, Rooms& rooms) {
  SilentProgress silent;
  SweepPoint point;
  point.series = series.name, point.value = value;
  CS_TRY(SweepSetting setting, fresh_setting(quick));
  series.apply(value, setting);
  if (sweep.judged == Judged::kDecoding) {
    setting.room.rig.cameras[0].model.clear();  // decoding asks for no lens
    CS_TRY(const auto simulator, rooms.of(setting.room, silent));
    CS_TRY(point.predictor, sweep.predictor({setting, *simulator, {}, {}}, silent));
    CS_TRY_VOID(run_decoding(setting, simulator, folder, point));
    return point;
  }
  CameraSpec& camera = setting.room.rig.cameras[0];
  camera.model = folder / "camera.cameramodel";
  CS_TRY_VOID(write_cameramodel(camera.model, setting.lens));
  CS_TRY(const auto simulator, rooms.of(setting.room, silent));
  CS_TRY(const std::vector<Picture> plain, pictures_of(setting.room.rig));
  const Truth truth(*simulator, setting.faults, plain);
  CS_TRY(point.predictor, sweep.predictor({setting, *simulator, truth.plain, truth.emitted, truth.white}, silent));
  CS_TRY_VOID(Job(setting, simulator, folder, quick ? 4 : 16).run(truth, point));
  return point;
}

}  // namespace

Result<Study> run_sweep(const Sweep& sweep, bool quick, const StudyContext& context) {
  const fs::path folder = context.output / sweep.name;
  std::error_code code;
  fs::create_directories(folder, code);
  std::vector<SweepPoint> points;
  Rooms rooms;
  int total = 0;
  for (const SweepSeries& s : sweep.series) total += static_cast<int>((quick ? s.quick : s.values).size());
  for (const SweepSeries& s : sweep.series)
    for (double value : quick ? s.quick : s.values) {
      context.progress->step(sweep.name, static_cast<double>(points.size()), total);
      CS_TRY(SweepPoint point, run_point(sweep, s, value, quick, folder, rooms));
      points.push_back(std::move(point));
    }
  context.progress->step(sweep.name, total, total);
  Study study;
  study.title = sweep.title;
  fill_table(kMethods, points, sweep.bounds, study);
  const SweepVerdict verdict = judge(points, sweep.bounds);
  study.figure = text_of(verdict);
  const bool decoding = sweep.judged == Judged::kDecoding;
  study.bound =
      decoding
          ? fmt::format(
                "no silence beyond {} % wrong, below {:.0f} % accepted, or sigma {:.0f}x too small; not all refused",
                sweep.bounds.wrong_percent, sweep.bounds.accepted_percent, sweep.bounds.z)
          : fmt::format("no silence beyond {} % of white; not all refused", sweep.bounds.residual_percent);
  study.ok = verdict.ok();
  study.notes.push_back(fmt::format(
      "departs from the fixed conditions: the documentation's room with 1/{} of its camera's pixels in each "
      "direction, one seed, {}",
      quick ? 4 : 3,
      decoding ? "the code that the scene chooses; truth is the view before somebody touched the camera, or after, "
                 "whichever is nearer; of several projectors the worst"
               : "picture `photo`; residuals are the simulator's own light, without noise"));
  study.labels = {{"unit", sweep.unit},
                  {"predictor", sweep.predictor_name},
                  {"bound", fmt::format("{}", decoding ? sweep.bounds.wrong_percent : sweep.bounds.residual_percent)}};
  if (decoding) study.labels.emplace_back("lost bound", fmt::format("{}", 100 - sweep.bounds.accepted_percent));
  return study;
}

}  // namespace countershade::bench

// camera-throughput: photos per second of a GigE Vision camera, beside a loop of Aravis' own; and of live decoding.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <thread>

#include "calib/image/image_file.h"
#include "capture/device/aravis/aravis.h"
#include "capture/pattern/pattern.h"
#include "capture/session/live_decoding.h"
#include "capture/session/session_folder.h"
#include "tests/device/aravis/gige_camera.h"
#include "tools/bench/capture/arv_loop.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;
using testing::GigeCamera;
using testing::GigeOptions;

constexpr int kWidth = 1920, kHeight = 1080;
constexpr int kRounds = 5, kPhotos = 60;  // of each client in turns; photos of a round

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
double process_cpu_s() {
  timespec used{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

struct Speed {
  double seconds = 0, cpu_s = 0;  // of the client: without the camera's
  int photos = 0, lost = 0;
  std::vector<double> each_s;  // whole photos
  // By the median, since other programs make single photos wait.
  double rate() const {
    std::vector<double> sorted = each_s;
    std::sort(sorted.begin(), sorted.end());
    return 1 / sorted.at(sorted.size() / 2);
  }
};

Result<Speed> time_ours(const GigeCamera& plugged, const std::string& serial) {
  CS_TRY(const auto camera, capture::open_aravis_camera("camera", serial));
  CS_TRY_VOID(camera->arm(kArvLoopExposureMs));
  CS_TRY(const capture::Exposure warm, camera->trigger());
  Speed speed;
  const double from = now_s(), cpu = process_cpu_s() - plugged.cpu_s();
  for (int i = 0; i < kPhotos; ++i) {
    const double asked = now_s();
    CS_TRY(const capture::Exposure taken, camera->trigger());
    speed.each_s.push_back(now_s() - asked);
    speed.lost += taken.lost, ++speed.photos;
  }
  speed.seconds = now_s() - from, speed.cpu_s = process_cpu_s() - plugged.cpu_s() - cpu;
  return speed;
}

Result<Speed> time_aravis(const GigeCamera& plugged) {
  CS_TRY(const auto loop, ArvLoop::open("127.0.0.1"));
  CS_TRY(const bool warm, loop->photo());
  Speed speed;
  speed.lost = !warm;
  const double from = now_s(), cpu = process_cpu_s() - plugged.cpu_s();
  while (speed.photos < kPhotos && now_s() - from < 60) {
    const double asked = now_s();
    CS_TRY(const bool whole, loop->photo());
    speed.lost += !whole, speed.photos += whole;
    if (whole) speed.each_s.push_back(now_s() - asked);
  }
  speed.seconds = now_s() - from, speed.cpu_s = process_cpu_s() - plugged.cpu_s() - cpu;
  return speed;
}

std::vector<std::string> row(int packet, const char* client, const Speed& s) {
  return {fmt::format("{}", packet),
          client,
          fmt::format("{}", s.photos),
          fmt::format("{}", s.lost),
          fmt::format("{:.1f}", s.rate()),
          fmt::format("{:.2f}", s.cpu_s / s.seconds),
          fmt::format("{:.1f}", 1e3 * s.cpu_s / s.photos)};
}

void add(Speed& to, const Speed& s) {
  to.seconds += s.seconds, to.cpu_s += s.cpu_s, to.photos += s.photos, to.lost += s.lost;
  to.each_s.insert(to.each_s.end(), s.each_s.begin(), s.each_s.end());
}

// A session of a camera that sees each projector pixel in one of its own.
Result<Sequence> write_session(const fs::path& folder, const std::string& code) {
  Rig rig;
  CameraSpec camera;
  camera.id = "camera", camera.backend = "folder";
  ProjectorSpec projector;
  projector.id = "projector", projector.resolution = {kWidth, kHeight};
  rig.cameras = {camera}, rig.projectors = {projector};
  CS_TRY(const Sequence sequence, capture::sequence_with(rig, {code}));
  CS_TRY_VOID(write_session_header(folder, rig, "", sequence));
  fs::create_directories(folder / "photos/camera");
  CS_TRY(const auto decoder, capture::Decoder::make(sequence, "camera", "projector", {}));
  for (const int index : decoder.frames())
    for (const Frame& f : sequence.frames) {
      if (f.index != index) continue;
      CS_TRY(const Picture shown, capture::render_role(f.role, "projector", kWidth, kHeight));
      Image photo(kWidth, kHeight, 1);
      for (std::size_t i = 0; i < photo.data().size(); ++i)  // 8 bits, as a capture stores them
        photo.data()[i] = static_cast<float>(257 * std::lround(8 + 200 * std::pow(shown.data()[3 * i] / 65535.0, 2.2)));
      CS_TRY_VOID(write_stored16(folder / "photos/camera" / capture::photo_name(index, "", ".tif"), photo));
    }
  return sequence;
}

struct Decoded {
  int photos = 0;
  double seconds = 0, cpu_s = 0, behind_s = 0, accepted = 0;
};

// Decodes the session's photos, handed over one each period_s.
Result<Decoded> decode_live(const fs::path& folder, const Sequence& sequence, double period_s) {
  CS_TRY(const auto decoder, capture::Decoder::make(sequence, "camera", "projector", {}));
  Decoded decoded;
  capture::LiveDecoding live(folder, sequence, "camera");
  const double from = now_s(), cpu = process_cpu_s();
  for (const int frame : decoder.frames()) {
    std::this_thread::sleep_for(std::chrono::duration<double>(from + period_s * decoded.photos++ - now_s()));
    live.stored(frame);
  }
  const double handed = now_s();
  CS_TRY(const capture::Correspondence found, live.finish().at(0));
  decoded.cpu_s = process_cpu_s() - cpu;
  decoded.seconds = now_s() - from, decoded.behind_s = now_s() - handed;
  decoded.accepted = static_cast<double>(found.accepted) / (kWidth * kHeight);
  return decoded;
}

}  // namespace

Result<Study> camera_throughput(const StudyContext& context) {
  Study study{"A GigE Vision camera of 1080p in Mono8, software trigger: photos per second",
              {"packet bytes", "client", "photos", "lost", "photos/s", "CPU share", "CPU ms per photo"},
              {},
              {},
              "",
              "",
              false};
  if (!capture::has_aravis()) return error(ErrorCode::kUnsupported, "camera-throughput: built without Aravis");
  if (const std::string why = testing::enter_private_network(); !why.empty())
    return error(ErrorCode::kUnsupported, "camera-throughput: {}", why);
  double worst = HUGE_VAL, fastest = 0;
  int done = 0;
  for (const int packet : {1400, 8000}) {
    GigeOptions options;
    options.width = kWidth, options.height = kHeight, options.formats = {"Mono8"}, options.largest_packet = packet;
    std::vector<std::uint16_t> seen(static_cast<std::size_t>(kWidth) * kHeight);
    for (std::size_t i = 0; i < seen.size(); ++i) seen[i] = static_cast<std::uint16_t>(i * 2654435761u >> 7);
    const GigeCamera plugged(options, [&seen](double) { return seen; });
    Speed ours, aravis;
    for (int round = 0; round < kRounds; ++round) {
      context.progress->step("camera-throughput", done++, 2 * kRounds);
      CS_TRY(const Speed a, time_ours(plugged, options.serial));
      CS_TRY(const Speed b, time_aravis(plugged));
      add(ours, a), add(aravis, b);
    }
    study.rows.push_back(row(packet, "countershade", ours));
    study.rows.push_back(row(packet, "Aravis alone", aravis));
    worst = std::min(worst, ours.rate() / aravis.rate());
    fastest = std::max(fastest, ours.rate());
  }
  context.progress->step("camera-throughput", done, done);
  std::string decoded;
  bool keeps_up = true;
  for (const char* code : {"gray", "micro-phase"}) {
    const fs::path session = context.output / "camera-throughput" / code;
    std::error_code ignored;
    fs::remove_all(session, ignored);
    fs::create_directories(session);
    CS_TRY(const Sequence sequence, write_session(session, code));
    CS_TRY(const Decoded at_once, decode_live(session, sequence, 0));
    CS_TRY(const Decoded fed, decode_live(session, sequence, 1 / fastest));
    const double rate = at_once.photos / at_once.seconds;
    keeps_up = keeps_up && rate >= fastest;
    decoded += fmt::format("{}{:.1f} ({})", decoded.empty() ? "" : " and ", rate, code);
    study.notes.push_back(fmt::format(
        "live decoding of {}, {} photos of 1080p from their files: {:.1f} photos/s ({:.0f} ms of CPU each), {:.1f} % "
        "accepted; "
        "handed over at the camera's fastest rate here it is over {:.0f} ms after the last one",
        code, at_once.photos, rate, 1e3 * at_once.cpu_s / at_once.photos, 100 * at_once.accepted, 1e3 * fed.behind_s));
  }
  study.notes.push_back(
      "the camera works on the same processor cores; CPU share is that of one core, without the camera's. A capture "
      "adds exposure, display and storing to each photo");
  study.figure =
      fmt::format("{:.0f} % of the rate of Aravis alone at worst; {} photos/s decoded", 100 * worst, decoded);
  study.bound = ">= 90 %; decoding as fast as the camera";
  study.ok = worst >= 0.9 && keeps_up;
  return study;
}

}  // namespace countershade::bench

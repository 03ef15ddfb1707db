// decode-speed: 42 photos of 1.3 Mpx, ours against a loop of OpenCV's GrayCodePattern::getProjPixel, two threads each.
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/structured_light.hpp>
#include <thread>

#include "calib/base/random.h"
#include "calib/file/session.h"
#include "tools/bench/decode/decode_trial.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;

constexpr int kThreads = 2, kRepeats = 9;

// Photos as bytes: `ours` by frame, `patterns` in OpenCV's order (every pattern and its inverse, columns first, the
// coarsest first); both look at the same memory.
struct BytePhotos {
  Sequence sequence;
  std::vector<std::shared_ptr<const StoredPhoto>> ours;
  std::vector<cv::Mat> patterns;
  std::vector<fs::path> files;
  std::array<int, 2> resolution{0, 0};
  int width = 0, height = 0;
};

// One 8-bit photo, kept once more as OpenCV's matrix (a copy of its own, so that neither waits for the other's cache).
void add_photo(const cv::Mat& bytes, const Frame& frame, BytePhotos& photos) {
  Raster<std::uint8_t> stored(bytes.cols, bytes.rows, 1);
  std::copy(bytes.data, bytes.data + bytes.total(), stored.data().begin());
  photos.ours.push_back(std::make_shared<const StoredPhoto>(std::move(stored), StoredScale{}));
  photos.sequence.frames.push_back({static_cast<int>(photos.ours.size()) - 1, frame.role});
  photos.width = bytes.cols, photos.height = bytes.rows;
  if (frame.role.kind == "gray") photos.patterns.push_back(bytes.clone());
}

Result<void> write_files(const fs::path& folder, const std::vector<cv::Mat>& photos, std::vector<fs::path>& files) {
  fs::create_directories(folder);
  for (std::size_t i = 0; i < photos.size(); ++i) {
    files.push_back(folder / fmt::format("{:04}.png", i));
    if (!cv::imwrite(files.back().string(), photos[i]))
      return error(ErrorCode::kIo, "cannot write '{}'; free some space", files.back().string());
  }
  return {};
}

// Two walls of albedo .8 under the fixed conditions of every study, with a camera of 1440 x 900 pixels and 8 bits, and
// 42 patterns: 21 bits of both axes of 1280 x 800, each with its inverse.
simdata::RigAndRoom room_of_study() {
  simdata::RigAndRoom room = simdata::default_two_wall();
  for (SimulatedSurface& s : room.simulation.surfaces) s.albedo = {0.8, 0.8, 0.8};
  room.rig.cameras.resize(1), room.simulation.cameras.resize(1);
  SimulatedCamera& camera = room.simulation.cameras[0];
  camera.focal_px *= 0.75;
  for (int i = 0; i < 2; ++i)
    camera.resolution[i] = camera.resolution[i] * 3 / 4, camera.principal[i] = (camera.principal[i] + 0.5) * 0.75 - 0.5;
  room.simulation.seed = hash_name("decode-speed");
  return room;
}

Result<BytePhotos> render(const DecodeRig& rig, const fs::path& folder) {
  CS_TRY(const std::vector<Role> roles, roles_of("gray", rig.rig().projectors[0], false));
  CS_TRY(const DecodeRig::Photos taken, rig.photograph(0, roles));
  BytePhotos photos;
  photos.sequence.projectors = taken.sequence.projectors;
  photos.resolution = rig.rig().projectors[0].resolution;
  std::vector<cv::Mat> all;
  for (std::size_t i = 0; i < taken.photos.size(); ++i) {
    const Image light = luminance_mean(taken.photos[i].value);
    cv::Mat bytes(light.height(), light.width(), CV_8U);
    for (int y = 0; y < light.height(); ++y)
      for (int x = 0; x < light.width(); ++x)
        bytes.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(255 * light.at(x, y));
    add_photo(bytes, taken.sequence.frames[i], photos);
    all.push_back(bytes);
  }
  CS_TRY_VOID(write_files(folder, all, photos.files));
  return photos;
}

Result<BytePhotos> real_photos(const fs::path& data) {
  CS_TRY(const Sequence sequence, read_sequence(data / "sequence.json"));
  BytePhotos photos;
  photos.sequence.projectors = sequence.projectors;
  photos.resolution = sequence.projectors[0].second;
  for (const Frame& frame : sequence.frames) {
    photos.files.push_back(data / "pose_0" / "photos" / fmt::format("{:04}.png", frame.index));
    const cv::Mat bytes = cv::imread(photos.files.back().string(), cv::IMREAD_GRAYSCALE);
    if (bytes.empty()) return error(ErrorCode::kBadFile, "cannot read '{}'", photos.files.back().string());
    add_photo(bytes, frame, photos);
  }
  return photos;
}

// What OpenCV knows of every pixel: a column and a row, or none.
struct Looped {
  std::vector<cv::Point> at;
  std::vector<std::uint8_t> none;
};
Looped loop_opencv(const std::vector<cv::Mat>& patterns, const BytePhotos& photos) {
  cv::structured_light::GrayCodePattern::Params size;
  size.width = photos.resolution[0], size.height = photos.resolution[1];
  const auto decoder = cv::structured_light::GrayCodePattern::create(size);
  Looped result{std::vector<cv::Point>(std::size_t{1} * photos.width * photos.height), {}};
  result.none.resize(result.at.size());
  std::vector<std::thread> threads;
  for (int k = 0; k < kThreads; ++k)
    threads.emplace_back([&, k] {
      for (int y = photos.height * k / kThreads; y < photos.height * (k + 1) / kThreads; ++y)
        for (int x = 0; x < photos.width; ++x) {
          const std::size_t i = static_cast<std::size_t>(y) * photos.width + x;
          result.none[i] = decoder->getProjPixel(patterns, x, y, result.at[i]);
        }
    });
  for (std::thread& t : threads) t.join();
  return result;
}

capture::Correspondence as_correspondence(const Looped& looped, const BytePhotos& photos) {
  capture::Correspondence c;
  c.x = c.y = Image(photos.width, photos.height, 1);
  c.sigma = Image(photos.width, photos.height, 1, 0.29f);
  c.reason = Mask(photos.width, photos.height, 1);
  for (std::size_t i = 0; i < looped.at.size(); ++i) {
    c.x.data()[i] = static_cast<float>(looped.at[i].x), c.y.data()[i] = static_cast<float>(looped.at[i].y);
    if (looped.none[i]) c.reason.data()[i] = static_cast<std::uint8_t>(capture::Reason::kUncertainBit);
    c.accepted += !looped.none[i];
  }
  return c;
}

Result<capture::Correspondence> decode_in_memory(const BytePhotos& photos) {
  CS_TRY(capture::Decoder decoder,
         capture::Decoder::make(photos.sequence, "camera", photos.sequence.projectors[0].first, {}));
  for (const int frame : decoder.frames()) CS_TRY_VOID(decoder.add(frame, photos.ours[frame]));
  return decoder.finish();
}

Result<capture::Correspondence> decode_files(const BytePhotos& photos) {
  CameraSpec camera;
  camera.id = "camera";
  SilentProgress quiet;
  return capture::decode_frames(
      photos.sequence, [&](int index) { return read_photo(photos.files[index], camera); }, "camera",
      photos.sequence.projectors[0].first, {}, quiet);
}

// Reads all patterns with two threads, then loops.
Looped loop_files(const BytePhotos& photos) {
  std::vector<std::size_t> wanted;
  for (std::size_t i = 0; i < photos.files.size(); ++i)
    if (photos.sequence.frames[i].role.kind == "gray") wanted.push_back(i);
  std::vector<cv::Mat> patterns(wanted.size());
  std::vector<std::thread> threads;
  for (int k = 0; k < kThreads; ++k)
    threads.emplace_back([&, k] {
      for (std::size_t i = k; i < wanted.size(); i += kThreads)
        patterns[i] = cv::imread(photos.files[wanted[i]].string(), cv::IMREAD_GRAYSCALE);
    });
  for (std::thread& t : threads) t.join();
  return loop_opencv(patterns, photos);
}

// Of all threads together: what else the machine does hardly shows in it.
double processor_ms() {
  return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

// Adds the time of a call, and of the processors in it.
struct Times {
  std::vector<double> wall, processor;
  template <class Call>
  void add(Call&& call) {
    const auto start = std::chrono::steady_clock::now();
    const double before = processor_ms();
    call();
    processor.push_back(processor_ms() - before);
    wall.push_back(1e3 * std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  }
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

// Both decoders on the same photos, by turns.
struct Race {
  capture::Correspondence ours, theirs;
  Times ours_ms, theirs_ms, ours_files_ms, theirs_files_ms;
  double ratio() const {  // median of those of single turns: what else the machine did hits both
    std::vector<double> ratios;
    for (std::size_t i = 0; i < ours_ms.wall.size(); ++i) ratios.push_back(theirs_ms.wall[i] / ours_ms.wall[i]);
    return median(ratios);
  }
};
Result<Race> race(const BytePhotos& photos, Progress& progress) {
  Race r;
  const auto keep = [&](Result<capture::Correspondence> c) -> Result<void> {
    CS_TRY(r.ours, std::move(c));
    return {};
  };
  CS_TRY_VOID(keep(decode_in_memory(photos)));  // warm
  for (int i = 0; i < kRepeats; ++i) {
    progress.step("decode-speed", i, kRepeats);
    Looped looped;
    Result<capture::Correspondence> ours = error(ErrorCode::kRefused, "not decoded");
    r.theirs_ms.add([&] { looped = loop_opencv(photos.patterns, photos); });
    r.ours_ms.add([&] { ours = decode_in_memory(photos); });
    CS_TRY_VOID(keep(std::move(ours)));
    if (i == 0) r.theirs = as_correspondence(looped, photos);
    if (i % 3 != 0) continue;
    r.theirs_files_ms.add([&] { looped = loop_files(photos); });
    r.ours_files_ms.add([&] { ours = decode_files(photos); });
    CS_TRY_VOID(keep(std::move(ours)));
  }
  return r;
}

}  // namespace

Result<Study> decode_speed(const StudyContext& context) {
  const tbb::global_control threads(tbb::global_control::max_allowed_parallelism, kThreads);
  Study study;
  study.title = "42 photos of 1.3 Mpx, 8 bits: ours against a loop of OpenCV's getProjPixel, two threads each";
  study.columns = {"photos", "decoder",  "ms in memory", "processor ms", "ms with files",
                   "ratio",  "accepted", "right",        "wrong",        "mean z2"};
  SilentProgress quiet;
  CS_TRY(const DecodeRig rig, DecodeRig::make(room_of_study(), quiet));
  CS_TRY(const BytePhotos rendered, render(rig, context.output / "decode-speed"));
  CS_TRY(const Race r, race(rendered, *context.progress));
  const DecodeScore ours = score_decode(rig.truth(), 0, r.ours), theirs = score_decode(rig.truth(), 0, r.theirs);
  const auto add = [&](const std::string& photos, const Race& race, const DecodeScore* score, bool is_ours) {
    const auto count = [&](double n) { return score ? fmt::format("{:.0f}", n) : std::string("-"); };
    study.rows.push_back({photos, is_ours ? "ours" : "getProjPixel",
                          fmt::format("{:.1f}", median((is_ours ? race.ours_ms : race.theirs_ms).wall)),
                          fmt::format("{:.1f}", median((is_ours ? race.ours_ms : race.theirs_ms).processor)),
                          fmt::format("{:.0f}", median((is_ours ? race.ours_files_ms : race.theirs_files_ms).wall)),
                          is_ours ? fmt::format("{:.1f}", race.ratio()) : "1",
                          fmt::format("{}", is_ours ? race.ours.accepted : race.theirs.accepted),
                          count(score ? score->accepted - score->wrong : 0), count(score ? score->wrong : 0),
                          score && is_ours ? fmt::format("{:.2f}", score->z2) : "-"});
  };
  add("two-wall .8", r, &theirs, false), add("two-wall .8", r, &ours, true);
  const fs::path data = fs::path(COUNTERSHADE_SOURCE_DIR).parent_path() / "shared" / "data" / "graycode-board";
  if (fs::exists(data)) {
    CS_TRY(const BytePhotos real, real_photos(data));
    CS_TRY(const Race board, race(real, *context.progress));
    add("graycode-board pose 0", board, nullptr, false), add("graycode-board pose 0", board, nullptr, true);
  }
  study.notes.push_back(fmt::format("medians of {} turns (files: {}); the ratio is the median of single turns'",
                                    kRepeats, (kRepeats + 2) / 3));
  study.notes.push_back("right: within 1 px of the simulator's truth on both axes; wrong: accepted and not right");
  study.notes.push_back(
      "processor ms: of both threads, in memory; less than twice the ms where others had the machine too");
  const double right = ours.accepted - ours.wrong, their_right = theirs.accepted - theirs.wrong;
  study.figure = fmt::format(
      "{:.1f}x getProjPixel ({:.0f} ms against {:.0f}); right {:.0f} pixels, it {:.0f}; wrong {:.0f}, it {:.0f}",
      r.ratio(), median(r.ours_ms.wall), median(r.theirs_ms.wall), right, their_right, ours.wrong, theirs.wrong);
  study.bound = ">= 20x, more pixels right";
  study.ok = r.ratio() >= 20 && right > their_right;
  return study;
}

}  // namespace countershade::bench

// loss: what becomes of photos when packets are lost on the way. It looks into the stored photos, pixel for pixel.
#include <chrono>
#include <mutex>

#include "calib/image/image_file.h"
#include "capture/device/aravis/aravis.h"
#include "tests/device/aravis/gige_camera.h"
#include "tools/bench/study.h"

namespace countershade::bench {

namespace {

namespace fs = std::filesystem;
using testing::GigeCamera;
using testing::GigeOptions;

constexpr int kPhotos = 60;  // of each kind
constexpr double kExposureMs = 2;

// Photos of which no two have a pixel in common, so that whatever is left of another one shows.
class Truth {
 public:
  explicit Truth(std::size_t pixels) : latest_(pixels) {}
  std::vector<std::uint16_t> next() {
    const std::lock_guard lock(mutex_);
    ++photo_;
    for (std::size_t i = 0; i < latest_.size(); ++i)
      latest_[i] = static_cast<std::uint16_t>(((i * 2654435761u >> 11) + 37u * photo_) << 8);  // of 8 bits
    return latest_;
  }
  std::vector<std::uint16_t> latest() {
    const std::lock_guard lock(mutex_);
    return latest_;
  }

 private:
  std::mutex mutex_;
  std::vector<std::uint16_t> latest_;
  unsigned photo_ = 0;
};

struct Counts {
  int stored = 0, with_hole = 0, retakes = 0, refused = 0, resent = 0;
  double seconds = 0;
};

Result<Counts> photograph(const GigeOptions& options, const fs::path& file) {
  const auto truth = std::make_shared<Truth>(static_cast<std::size_t>(options.width) * options.height);
  GigeCamera plugged(options, [truth](double) { return truth->next(); });
  CS_TRY(const auto camera, capture::open_aravis_camera("camera", options.serial));
  CS_TRY_VOID(camera->arm(kExposureMs));
  Counts counts;
  for (int i = 0; i < kPhotos; ++i) {
    const auto begun = std::chrono::steady_clock::now();
    const auto taken = camera->trigger();
    counts.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
    if (!taken) {
      ++counts.refused;
      continue;
    }
    counts.retakes += taken->lost;
    ++counts.stored;
    CS_TRY_VOID(write_stored16(file, taken->values));
    CS_TRY(const StoredImage stored, read_image(file));
    const std::vector<std::uint16_t> expected = truth->latest();
    bool right = stored.values.data().size() == expected.size();
    for (std::size_t p = 0; right && p < expected.size(); ++p) right = stored.values.data()[p] == expected[p] >> 8;
    counts.with_hole += !right;
  }
  counts.resent = plugged.resent();
  return counts;
}

}  // namespace

Result<Study> loss_study(const StudyContext& context) {
  Study study{"Packets lost at random: is each stored photo the one that was taken, pixel for pixel?",
              {"packets lost %", "asked for again", "photos", "stored", "with a hole", "taken again", "refused",
               "packets sent again", "ms per photo"},
              {},
              {},
              "",
              "",
              false};
  if (!capture::has_aravis()) return error(ErrorCode::kUnsupported, "loss: this program was built without Aravis");
  if (const std::string why = testing::enter_private_network(); !why.empty())
    return error(ErrorCode::kUnsupported, "loss: {}", why);
  const fs::path folder = context.output / "loss";
  fs::create_directories(folder);
  int holes = 0, stored = 0, refused_with_resend = 0, done = 0;
  constexpr double kLoss[] = {0, .001, .005, .01, .02, .05};
  for (const bool deaf : {false, true})
    for (const double loss : kLoss) {
      context.progress->step("loss", done++, 2 * std::size(kLoss));
      GigeOptions options;
      options.width = 640, options.height = 480, options.formats = {"Mono8"};
      options.largest_packet = 1400, options.loss = loss, options.deaf = deaf;
      CS_TRY(const Counts c, photograph(options, folder / "photo.tif"));
      holes += c.with_hole, stored += c.stored;
      if (!deaf) refused_with_resend += c.refused;
      study.rows.push_back({fmt::format("{:.1f}", 100 * loss), deaf ? "no" : "yes", fmt::format("{}", kPhotos),
                            fmt::format("{}", c.stored), fmt::format("{}", c.with_hole), fmt::format("{}", c.retakes),
                            fmt::format("{}", c.refused), fmt::format("{}", c.resent),
                            fmt::format("{:.1f}", 1e3 * c.seconds / kPhotos)});
    }
  context.progress->step("loss", done, done);
  study.notes.push_back(
      "640 x 480 in Mono8, 227 packets of 1400 bytes, exposure 2 ms; packets that are sent again are lost as often. "
      "Refused: four photos in a row had holes; a capture ends there with a message, and resumes");
  study.figure = fmt::format("{} of {} stored photos with a hole; {} refused where the camera sends packets again",
                             holes, stored, refused_with_resend);
  study.bound = "0";
  study.ok = holes == 0 && stored > 0;
  return study;
}

}  // namespace countershade::bench

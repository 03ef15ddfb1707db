#include "capture/session/runner.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "calib/image/image_file.h"
#include "capture/session/frame_judge.h"
#include "capture/session/latency.h"
#include "capture/session/session_folder.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

constexpr double kStaggerMs = 7;              // between the trials, in other steps than refreshes come
constexpr double kLongestLatencyMs = 300;     // that a picture is waited for when it was shown often enough
constexpr std::size_t kMostPhotos = 16;       // in that time
constexpr int kTrials = 6, kTrialsLate = 11;  // of the latency, where there is none and where there is some

struct CameraSlot {
  Camera* device = nullptr;
  const CameraSpec* spec = nullptr;
  std::vector<double> exposures;  // at least one; 0 = the device's default
};

// The photos of one camera of one frame that were missing; empty where all are stored.
struct Shot {
  std::vector<Image> stored;            // per exposure; empty image = already stored
  Bins bins;                            // first exposure
  double from_ms = 0, exposure_ms = 0;  // of it, by the camera's clock
};

class Capture {
 public:
  Capture(const Rig& rig, const Sequence& sequence, const Devices& devices, const fs::path& folder,
          const CaptureOptions& options, Progress& progress)
      : rig_(rig),
        sequence_(sequence),
        devices_(devices),
        folder_(folder),
        options_(options),
        progress_(progress),
        judge_(rig, sequence) {}

  Result<void> find_devices();
  Result<void> load_stored();
  Result<void> take_missing();

 private:
  using Pictures = std::vector<Picture>;  // per projector of the sequence

  int frames() const { return static_cast<int>(sequence_.frames.size()); }
  fs::path photo_path(int f, const CameraSlot& camera, std::size_t e) const {
    const std::string exposure = camera.exposures.size() > 1 ? exposure_text(camera.exposures[e]) : "";
    return folder_ / "photos" / camera.spec->id / photo_name(sequence_.frames[f].index, exposure, ".tif");
  }
  bool complete(int f) const;
  Result<void> load_photo(int f, std::size_t c, std::size_t e);

  Result<Pictures> pictures_of(int f) const;
  Pictures plain_pictures(std::uint16_t value) const;
  Result<void> show(const Pictures& pictures, double wait_ms);
  Result<Exposure> expose(const CameraSlot& camera, std::size_t e) const;
  Result<std::vector<Shot>> photograph(const std::vector<std::vector<bool>>& wanted) const;
  std::vector<std::vector<bool>> wanted(int f, bool all) const;
  Result<void> store(int f, const std::vector<Shot>& shots);

  Result<void> show_until_seen(const Pictures& pictures);
  Result<Views> settle(const Pictures& pictures);
  std::vector<std::vector<bool>> first_exposures() const;
  struct Arrival {
    bool seen = false;
    double after_ms = 0;  // since the first photo's start
    double exposure_ms = 0;
    Views settled;
  };
  Result<Arrival> wait_for(const Pictures& pictures, int shows, double wait_ms);
  Result<void> count_shows(const Pictures& pictures);
  Result<void> measure_latency(const Pictures& pictures, const Pictures& former);
  std::vector<int> telling_frames() const;
  Result<void> start();
  Result<void> take_frame(int f);
  Result<void> accept(int f, const std::vector<Image>& blocks, const Views& now, const std::vector<Shot>& shots,
                      int attempt);
  Result<void> retake(int f);
  Result<bool> agrees(int f);
  Result<bool> all_agree();
  Result<void> set_aside();
  Result<void> check_view();
  Result<void> take_all();
  Result<bool> answers(const std::vector<Image>& blocks, const Pictures& pictures, const Views& now);

  Result<Bins> stored_pixels(int f, std::size_t c) const;
  Views bins_of(int f, const std::vector<Shot>& shots) const;

  const Rig& rig_;
  const Sequence& sequence_;
  const Devices& devices_;
  const fs::path& folder_;
  const CaptureOptions& options_;
  Progress& progress_;
  std::vector<CameraSlot> cameras_;
  std::vector<Projector*> projectors_;
  std::vector<std::vector<std::vector<bool>>> have_;  // [frame][camera][exposure]
  std::vector<std::array<int, 3>> size_;              // per camera: width, height, channels; 0 = not known yet
  int shows_ = 1;                                     // how often a picture is shown before its photo
  double wait_ms_ = 0;                                // between the last show and the photo
  bool contradicted_ = false;                         // a frame was given up since it and another one do not add up
  bool late_ = false;                                 // the former frame came late
  FrameJudge judge_;
};

Result<void> Capture::find_devices() {
  for (const CameraSpec& spec : rig_.cameras) {
    CameraSlot slot;
    slot.spec = &spec;
    slot.exposures = spec.exposures_ms.empty() ? std::vector<double>{0} : spec.exposures_ms;
    for (const auto& device : devices_.cameras)
      if (device->id() == spec.id) slot.device = device.get();
    if (slot.device == nullptr)
      return error(ErrorCode::kDevice, "camera '{}' of the rig is not open: connect it, or remove it from the rig",
                   spec.id);
    CS_TRY_VOID(slot.device->arm(slot.exposures[0]));
    cameras_.push_back(std::move(slot));
  }
  for (const auto& [id, size] : sequence_.projectors) {
    Projector* device = devices_.projector(id);
    if (device == nullptr)
      return error(ErrorCode::kDevice, "projector '{}' of the rig is not open: connect it, or remove it from the rig",
                   id);
    if (device->width() != size[0] || device->height() != size[1])
      return error(ErrorCode::kDevice,
                   "projector '{}' shows {}x{} pixels, the rig says {}x{}: set the display's mode or correct the rig",
                   id, device->width(), device->height(), size[0], size[1]);
    projectors_.push_back(device);
  }
  size_.resize(cameras_.size());
  return {};
}

// ---- what is stored already ----

bool Capture::complete(int f) const {
  for (const auto& camera : have_[f])
    if (std::find(camera.begin(), camera.end(), false) != camera.end()) return false;
  return true;
}

Result<void> Capture::load_photo(int f, std::size_t c, std::size_t e) {
  const fs::path path = photo_path(f, cameras_[c], e);
  if (!fs::exists(path)) return {};
  const auto read = read_image(path);
  if (!read) {
    progress_.warn(fmt::format("{}; it is taken again", read.error().message));
    return {};
  }
  const Image& values = read->values;
  const std::array<int, 3> size{values.width(), values.height(), values.channels()};
  if (size_[c][0] == 0) size_[c] = size;
  if (size_[c] != size)
    return error(ErrorCode::kRefused,
                 "'{}' has {}x{} pixels, the photos before it {}x{}: remove the ones that are wrong", path.string(),
                 size[0], size[1], size_[c][0], size_[c][1]);
  have_[f][c][e] = true;
  if (e == 0) judge_.keep(f, c, bin_photo(values, read->full_scale, *cameras_[c].spec));
  return {};
}

Result<void> Capture::load_stored() {
  for (int f = 0; f < frames(); ++f) {
    have_.emplace_back();
    for (const CameraSlot& camera : cameras_) have_[f].emplace_back(camera.exposures.size(), false);
  }
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    const fs::path folder = folder_ / "photos" / cameras_[c].spec->id;
    std::error_code reason;
    fs::create_directories(folder, reason);
    if (reason)
      return error(ErrorCode::kIo, "folder '{}' cannot be created: {}; check the disk and its permissions",
                   folder.string(), reason.message());
    CS_TRY_VOID(remove_unfinished(folder));
    for (int f = 0; f < frames(); ++f)
      for (std::size_t e = 0; e < cameras_[c].exposures.size(); ++e) CS_TRY_VOID(load_photo(f, c, e));
  }
  for (int f = 0; f < frames(); ++f)
    if (options_.stored && complete(f)) options_.stored(sequence_.frames[f].index);
  return {};
}

// ---- showing and photographing ----

Result<Capture::Pictures> Capture::pictures_of(int f) const {
  Pictures pictures;
  for (const auto& [id, size] : sequence_.projectors) {
    CS_TRY(Picture picture, render_role(sequence_.frames[f].role, id, size[0], size[1]));
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

Capture::Pictures Capture::plain_pictures(std::uint16_t value) const {
  Pictures pictures;
  for (const auto& [id, size] : sequence_.projectors) pictures.emplace_back(size[0], size[1], 3, value);
  return pictures;
}

Result<void> Capture::show(const Pictures& pictures, double wait_ms) {
  for (std::size_t p = 0; p < projectors_.size(); ++p) CS_TRY_VOID(projectors_[p]->hand_over(pictures[p]));
  devices_.wait(wait_ms);
  for (Projector* projector : projectors_) CS_TRY_VOID(projector->taken());
  return {};
}

// Stored numbers of one exposure, scaled to 16 bits where the rig does not say what full scale is.
Result<Exposure> Capture::expose(const CameraSlot& camera, std::size_t e) const {
  if (camera.exposures.size() > 1) CS_TRY_VOID(camera.device->arm(camera.exposures[e]));
  CS_TRY(Exposure exposure, camera.device->trigger());
  if (!camera.spec->full_scale && exposure.full_scale != 65535)
    for (float& v : exposure.values.data()) v = static_cast<float>(v * 65535.0 / exposure.full_scale);
  for (float& v : exposure.values.data()) v = std::round(std::clamp(v, 0.0f, 65535.0f));
  return exposure;
}

std::vector<std::vector<bool>> Capture::wanted(int f, bool all) const {
  auto wanted = have_[f];
  for (auto& camera : wanted)
    for (std::size_t e = 0; e < camera.size(); ++e) camera[e] = all || !camera[e];
  return wanted;
}

Result<std::vector<Shot>> Capture::photograph(const std::vector<std::vector<bool>>& wanted) const {
  std::vector<Shot> shots(cameras_.size());
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    shots[c].stored.resize(wanted[c].size());
    for (std::size_t e = 0; e < wanted[c].size(); ++e) {
      if (!wanted[c][e]) continue;
      CS_TRY(Exposure exposure, expose(cameras_[c], e));
      if (e == 0) shots[c].from_ms = 1e3 * exposure.timestamp_s, shots[c].exposure_ms = exposure.exposure_ms;
      shots[c].stored[e] = std::move(exposure.values);
      const Image& photo = shots[c].stored[e];
      const std::array<int, 3> size{photo.width(), photo.height(), photo.channels()};
      if (size_[c][0] != 0 && size != size_[c])
        return error(ErrorCode::kDevice, "camera '{}' gave a photo of {}x{} pixels after ones of {}x{}: lock its mode",
                     cameras_[c].spec->id, size[0], size[1], size_[c][0], size_[c][1]);
      if (e == 0) shots[c].bins = bin_photo(photo, 65535, *cameras_[c].spec);
    }
  }
  return shots;
}

Result<void> Capture::store(int f, const std::vector<Shot>& shots) {
  for (std::size_t c = 0; c < cameras_.size(); ++c)
    for (std::size_t e = 0; e < shots[c].stored.size(); ++e) {
      const Image& photo = shots[c].stored[e];
      if (photo.empty()) continue;
      CS_TRY_VOID(write_stored16(photo_path(f, cameras_[c], e), photo));
      size_[c] = {photo.width(), photo.height(), photo.channels()};
      have_[f][c][e] = true;
      if (e == 0) judge_.keep(f, c, shots[c].bins);
    }
  if (options_.stored && complete(f)) options_.stored(sequence_.frames[f].index);
  return {};
}

// ---- the start: a known light, so that the first photo can be judged too ----

// Shows pictures that differ much from what is seen, and photographs them, from wait_ms after they were handed over on,
// until two photos agree on them.
Result<Capture::Arrival> Capture::wait_for(const Pictures& pictures, int shows, double wait_ms) {
  for (int i = 1; i < shows; ++i) CS_TRY_VOID(show(pictures, options_.retake_wait_ms));
  CS_TRY_VOID(show(pictures, wait_ms));
  std::vector<Views> views;
  std::vector<StepPhoto> photos;
  Arrival arrival;
  while (photos.size() < 2 ||
         (photos.size() < kMostPhotos && photos.back().from_ms - photos.front().from_ms < kLongestLatencyMs)) {
    CS_TRY(const std::vector<Shot> shots, photograph(first_exposures()));
    Views now;
    for (const Shot& shot : shots) now.push_back(shot.bins);
    arrival.seen = judge_.any_change(now);
    const bool settled = arrival.seen && !views.empty() && !judge_.differ(views.back(), now);
    views.push_back(std::move(now));
    photos.push_back({shots[0].from_ms, shots[0].exposure_ms, 0});
    if (settled) break;
  }
  for (std::size_t i = 0; i < photos.size(); ++i) photos[i].share = judge_.share_of_change(views[i], views.back());
  arrival.after_ms = arrival.seen ? appeared_after_ms(photos) : 0;
  arrival.exposure_ms = photos.front().exposure_ms;
  arrival.settled = std::move(views.back());
  return arrival;
}

// How often a picture must be shown until a camera sees it.
Result<void> Capture::count_shows(const Pictures& pictures) {
  for (shows_ = 1; shows_ <= options_.retakes + 1; ++shows_) {
    CS_TRY(Arrival arrival, wait_for(pictures, 1, 0));  // once more
    if (!arrival.seen) continue;
    if (shows_ > 1)
      progress_.note(
          fmt::format("the display or the camera is late: each picture is shown {} times before its photo", shows_));
    judge_.saw({blocks_of(pictures), std::move(arrival.settled)});
    return {};
  }
  return error(
      ErrorCode::kDevice,
      "no camera sees a change between black and white on all projectors, after {} tries. Check that the projectors "
      "are on and show this computer's pictures (right monitor, no screen saver), lens caps, and exposure",
      options_.retakes + 1);
}

// How long a photo must wait, by steps at moments that are spread between two refreshes. Where the picture is there in
// each of the first ones as soon as the display has taken it, there is nothing to wait for. Else the next ones are
// photographed so that the change falls into the exposure, which times it to a part of a millisecond.
Result<void> Capture::measure_latency(const Pictures& pictures, const Pictures& former) {
  if (options_.lateness != nullptr && options_.lateness->shows > 0) {
    shows_ = options_.lateness->shows, wait_ms_ = options_.lateness->wait_ms;
    return {};
  }
  CS_TRY_VOID(count_shows(pictures));
  bool there = true;
  const auto step = [&](int trial, double wait_ms) -> Result<Arrival> {
    devices_.wait(trial * kStaggerMs);
    const Pictures& next = there ? former : pictures;
    CS_TRY(Arrival arrival, wait_for(next, shows_, wait_ms));
    if (arrival.seen) judge_.saw({blocks_of(next), arrival.settled});
    there = there != arrival.seen;
    return arrival;
  };
  double bound_ms = 0;
  for (int trial = 1; trial <= kTrials; ++trial) {
    CS_TRY(const Arrival arrival, step(trial, 0));
    bound_ms = std::max(bound_ms, arrival.after_ms);
  }
  if (bound_ms == 0) return {};
  const double refresh_ms = devices_.refresh_ms();
  double longest_ms = 0, shortest_ms = HUGE_VAL, exposure_ms = 0;
  bound_ms += refresh_ms;  // of being taken, which is not waited for any more
  for (int trial = 1; trial <= kTrialsLate; ++trial) {
    const double wait_ms = std::max(refresh_ms, (longest_ms > 0 ? longest_ms : bound_ms) - 0.8 * exposure_ms);
    CS_TRY(const Arrival arrival, step(trial, wait_ms));
    if (!arrival.seen) continue;  // a frame that comes as late is judged and taken again
    const double after_ms = wait_ms + arrival.after_ms;
    exposure_ms = arrival.exposure_ms;
    if (trial == 1) continue;  // its exposure was not known
    longest_ms = std::max(longest_ms, after_ms), shortest_ms = std::min(shortest_ms, after_ms);
  }
  wait_ms_ = longest_ms + refresh_ms;
  progress_.note(fmt::format("pictures are seen {:.0f} to {:.0f} ms after they were shown: photos wait for {:.0f} ms",
                             shortest_ms, longest_ms, wait_ms_));
  return {};
}

std::vector<std::vector<bool>> Capture::first_exposures() const {
  std::vector<std::vector<bool>> first;
  for (const CameraSlot& camera : cameras_) {
    first.emplace_back(camera.exposures.size(), false);
    first.back()[0] = true;
  }
  return first;
}

// Shows often and long enough that no latency is left.
Result<void> Capture::show_until_seen(const Pictures& pictures) {
  for (int i = 0; i <= options_.retakes; ++i) CS_TRY_VOID(show(pictures, options_.retake_wait_ms));
  devices_.wait((12 - options_.retakes - 1) * options_.retake_wait_ms);
  return {};
}

// The same, then photographs twice.
Result<Views> Capture::settle(const Pictures& pictures) {
  CS_TRY_VOID(show_until_seen(pictures));
  CS_TRY(const std::vector<Shot> one, photograph(first_exposures()));
  CS_TRY(const std::vector<Shot> two, photograph(first_exposures()));
  Views bins;
  for (std::size_t c = 0; c < cameras_.size(); ++c) {
    judge_.learn_noise(c, one[c].bins, two[c].bins, judge_.pixels_of(one[c].stored[0], c),
                       judge_.pixels_of(two[c].stored[0], c));
    bins.push_back(two[c].bins);
  }
  judge_.saw({blocks_of(pictures), bins});
  return bins;
}

// Stored frames that are not dark: a dark photo cannot tell whether the camera moved.
std::vector<int> Capture::telling_frames() const {
  std::vector<std::pair<int, double>> light;
  double brightest = 0;
  for (int f = 0; f < frames(); ++f) {
    if (!complete(f)) continue;
    double sum = 0;
    for (std::size_t c = 0; c < cameras_.size(); ++c) sum += mean_light(*judge_.kept(f, c));
    light.emplace_back(f, sum);
    brightest = std::max(brightest, sum);
  }
  std::vector<int> telling;
  for (const auto& [f, sum] : light)
    if (sum >= 0.3 * brightest) telling.push_back(f);
  return telling;
}

Result<void> Capture::start() {
  const std::vector<int> telling = telling_frames();
  if (telling.empty()) {
    CS_TRY(Views dark, settle(plain_pictures(0)));
    judge_.saw_dark(std::move(dark));
    return measure_latency(plain_pictures(65535), plain_pictures(0));
  }
  const int reference = telling.back();
  progress_.note(fmt::format("resuming: {} is photographed again and compared", judge_.name_of(reference)));
  CS_TRY(const Pictures pictures, pictures_of(reference));
  CS_TRY(const Views now, settle(pictures));
  if (const std::string why = judge_.moved(reference, now); !why.empty()) return error(ErrorCode::kRefused, "{}", why);
  return measure_latency(plain_pictures(0), pictures);  // the reference is not dark
}

// ---- is this the frame that was asked for? ----

// First exposure of a frame in single pixels, from its file; empty where that is not stored.
Result<Bins> Capture::stored_pixels(int f, std::size_t c) const {
  if (!have_[f][c][0]) return Bins();
  CS_TRY(const StoredImage photo, read_image(photo_path(f, cameras_[c], 0)));
  return judge_.pixels_of(photo.values, c);
}

Views Capture::bins_of(int f, const std::vector<Shot>& shots) const {
  Views bins;
  for (std::size_t c = 0; c < cameras_.size(); ++c)
    bins.push_back(shots[c].bins.light.empty() ? *judge_.kept(f, c) : shots[c].bins);
  return bins;
}

// ---- frame after frame ----

// The partner of a frame once more, with every latency waited out.
Result<void> Capture::retake(int f) {
  CS_TRY(const Pictures pictures, pictures_of(f));
  CS_TRY_VOID(settle(pictures));
  CS_TRY_VOID(show(pictures, 0));  // as every stored photo: the first after a show
  CS_TRY(const std::vector<Shot> shots, photograph(wanted(f, true)));
  return store(f, shots);
}

Result<void> Capture::take_frame(int f) {
  CS_TRY(const Pictures pictures, pictures_of(f));
  const std::vector<Image> blocks = blocks_of(pictures);
  for (int attempt = 0, shows = shows_;; ++attempt) {
    for (int i = 1; i < shows; ++i) CS_TRY_VOID(show(pictures, options_.retake_wait_ms));
    CS_TRY_VOID(show(pictures, wait_ms_ + attempt * options_.retake_wait_ms));
    CS_TRY(const std::vector<Shot> shots, photograph(wanted(f, false)));
    const Views now = bins_of(f, shots);
    const auto pixels = [&](std::size_t c) { return judge_.pixels_of(shots[c].stored[0], c); };
    std::string why = judge_.stale(blocks, now);
    if (why.empty()) why = judge_.repeats(f, pixels);
    const bool is_stale = !why.empty();
    if (!is_stale) {
      CS_TRY(why, judge_.wrong_pair(f, pixels, [this](int g, std::size_t c) { return stored_pixels(g, c); }));
    }
    if (why.empty()) return accept(f, blocks, now, shots, attempt);
    if (is_stale && attempt == options_.retakes) {
      CS_TRY(const bool seen, answers(blocks, pictures, now));
      if (seen) {
        progress_.note(
            fmt::format("{}: no camera sees this picture change the light, though the projectors answer: its light "
                        "falls beside what "
                        "the cameras see",
                        judge_.name_of(f)));
        return accept(f, blocks, now, shots, 0);
      }
    }
    contradicted_ = attempt >= options_.retakes && !is_stale;
    if (attempt >= options_.retakes)
      return error(ErrorCode::kDevice,
                   "{}, after {} tries. Check that the display shows the pictures (right monitor, no screen saver, no "
                   "overlay), that its latency is below {} pictures, and that the camera's exposure is locked; what is "
                   "stored is kept, and the same command resumes",
                   why, attempt + 1, options_.retakes + 1);
    progress_.note(fmt::format("{}: {}; taking it again", judge_.name_of(f), why));
    if (attempt > 0 && !is_stale) CS_TRY_VOID(retake(companions(sequence_, f).inverse));
    shows = is_stale ? 1 : options_.retakes + 1;  // of a wrong pair nobody knows how late it is
  }
}

// Whether a frame that seems to be stale is not: every projector whose picture should have changed the light does
// change it when it is inverted as a whole, and the frame's own light comes back. So its picture was there, where
// nobody sees.
Result<bool> Capture::answers(const std::vector<Image>& blocks, const Pictures& pictures, const Views& now) {
  const FrameJudge::Seen before = judge_.seen();
  bool all = true;
  for (std::size_t p = 0; p < blocks.size() && all; ++p) {
    if (block_change(before.blocks[p], blocks[p], 3) < 0.5 * FrameJudge::kPredictable) continue;
    double mean = 0;
    for (float v : blocks[p].data()) mean += v / static_cast<double>(blocks[p].data().size());
    Pictures probe = pictures;
    probe[p] = Picture(pictures[p].width(), pictures[p].height(), 3, mean < 0.5 ? 65535 : 0);
    CS_TRY(const Views probed, settle(probe));
    judge_.saw({blocks, now});
    all = judge_.any_change(probed);
  }
  CS_TRY(const Views again, settle(pictures));
  judge_.saw({blocks, now});
  all = all && !judge_.any_change(again);
  judge_.saw(before);
  return all;
}

// Stores a frame; when it came late, the next ones are shown as often before they are photographed.
Result<void> Capture::accept(int f, const std::vector<Image>& blocks, const Views& now, const std::vector<Shot>& shots,
                             int attempt) {
  CS_TRY_VOID(store(f, shots));
  judge_.saw({blocks, now});
  Views pixels;
  if (f + 1 < frames() && sequence_.frames[f + 1].role.kind == "phase")
    for (std::size_t c = 0; c < cameras_.size(); ++c) pixels.push_back(judge_.pixels_of(shots[c].stored[0], c));
  judge_.saw_pixels(std::move(pixels));
  const bool again = std::exchange(late_, attempt > 0) && attempt > 0;
  if (attempt == 0) return {};
  // Once is a hiccup, which waiting longer covers; twice in a row, and the display holds pictures back.
  wait_ms_ += attempt * options_.retake_wait_ms;
  if (again) shows_ = std::min(shows_ + attempt, options_.retakes + 1);
  progress_.note(
      fmt::format("the display or the camera is late: from here on each picture is shown {} times, and its photo waits "
                  "for {:.0f} ms",
                  shows_, wait_ms_));
  return {};
}

// ---- does the session still show what stands there? ----

// Whether a frame is still seen as it was stored.
Result<bool> Capture::agrees(int f) {
  CS_TRY(const Pictures pictures, pictures_of(f));
  CS_TRY_VOID(show_until_seen(pictures));
  CS_TRY(const std::vector<Shot> shots, photograph(first_exposures()));
  Views now;
  for (const Shot& shot : shots) now.push_back(shot.bins);
  return judge_.moved(f, now).empty();
}

// Whether the first frame of each projector is: one alone may have moved.
Result<bool> Capture::all_agree() {
  const std::vector<int> telling = telling_frames();
  for (const auto& [id, size] : sequence_.projectors) {
    const auto of_this = [&](int f) {
      const std::string& lit = sequence_.frames[f].role.projector;
      return lit.empty() || lit == id;
    };
    const auto first = std::find_if(telling.begin(), telling.end(), of_this);
    if (first == telling.end()) continue;
    CS_TRY(const bool same, agrees(*first));
    if (!same) return false;
  }
  return true;
}

// The session's photos go where nobody takes them for the session's.
Result<void> Capture::set_aside() {
  for (int f = 0; f < frames(); ++f)
    for (std::size_t c = 0; c < cameras_.size(); ++c)
      for (std::size_t e = 0; e < cameras_[c].exposures.size(); ++e) {
        const fs::path from = photo_path(f, cameras_[c], e);
        const fs::path to = folder_ / "outdated" / cameras_[c].spec->id / from.filename();
        std::error_code reason;
        if (!have_[f][c][e]) continue;
        fs::create_directories(to.parent_path(), reason);
        if (!reason) fs::rename(from, to, reason);
        if (reason)
          return error(ErrorCode::kIo, "'{}' cannot be moved to '{}': {}; check the disk and its permissions",
                       from.string(), to.string(), reason.message());
        have_[f][c][e] = false;
      }
  return {};
}

// Photographs frames of the beginning again. Where they show something else, all is taken again, once: which frames are
// of before no photo can tell for sure, since some would look the same.
Result<void> Capture::check_view() {
  CS_TRY(const bool still, all_agree());
  if (still) return {};
  progress_.warn(
      fmt::format("camera, a projector or the room moved, or the light changed, while photos were taken: all {} frames "
                  "are taken again; the former photos are kept in '{}'",
                  frames(), (folder_ / "outdated").string()));
  CS_TRY_VOID(set_aside());
  CS_TRY_VOID(take_all());
  CS_TRY(const bool now, all_agree());
  if (now) return {};
  return error(ErrorCode::kRefused,
               "the view changed again while photos were taken: camera, projectors and room must stand still and the "
               "light must stay; then capture in another folder than '{}'",
               folder_.string());
}

Result<void> Capture::take_missing() {
  int done = 0;
  for (int f = 0; f < frames(); ++f) done += complete(f);
  progress_.step("capture", done, frames());
  if (done == frames()) return {};
  CS_TRY_VOID(start());
  if (const auto taken = take_all(); !taken) {
    // Photos that contradict one another may be of two views.
    if (!contradicted_) return taken.error();
    const auto still = all_agree();
    if (!still || *still) return taken.error();
  }
  if (options_.lateness != nullptr) *options_.lateness = {shows_, wait_ms_};
  return check_view();
}

Result<void> Capture::take_all() {
  int done = 0;
  for (int f = 0; f < frames(); ++f) done += complete(f);
  for (int f = 0; f < frames(); ++f) {
    if (complete(f)) continue;
    if (const auto taken = take_frame(f); !taken) {
      Error failure = taken.error();
      if (failure.code == ErrorCode::kDevice)
        failure.message = fmt::format("{}: {}", judge_.name_of(f), failure.message);
      return failure;
    }
    progress_.step("capture", ++done, frames());
  }
  return {};
}

}  // namespace

Result<void> capture_session(const Rig& rig, const std::string& simulation_toml, const Sequence& sequence,
                             const Devices& devices, const fs::path& folder, const CaptureOptions& options,
                             Progress& progress) {
  if (options.retakes < 0)
    return error(ErrorCode::kBadValue, "retakes = {} is below 0: give 0 or more", options.retakes);
  CS_TRY_VOID(check_sequence(rig, sequence));
  Capture capture(rig, sequence, devices, folder, options, progress);
  CS_TRY_VOID(capture.find_devices());
  CS_TRY_VOID(claim_folder(folder));
  CS_TRY(const FolderLock lock, FolderLock::take(folder));
  CS_TRY_VOID(write_or_compare_header(folder, rig, simulation_toml, sequence, options.extend));
  CS_TRY_VOID(capture.load_stored());
  return capture.take_missing();
}

}  // namespace countershade::capture

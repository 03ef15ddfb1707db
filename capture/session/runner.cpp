#include "capture/session/runner.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "calib/base/parallel.h"
#include "calib/image/image_file.h"
#include "capture/session/frame_judge.h"
#include "capture/session/session_folder.h"
#include "capture/session/stage.h"
#include "capture/session/view_shift.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

constexpr double kShiftedPx = 0.25;  // that a photo may be beside a stored one
constexpr double kGivesWayPx = 1;    // by which a view may go on shifting when all has been taken again
constexpr int kShakePhotos = 4;      // more that are taken of what seems to have moved

bool is_striped(const Role& role) {
  return role.kind == "gray" || role.kind == "xor" || role.kind == "phase";
}

class Capture {
 public:
  Capture(const Rig& rig, const Sequence& sequence, const Devices& devices, const fs::path& folder,
          const CaptureOptions& options, Progress& progress)
      : sequence_(sequence),
        folder_(folder),
        options_(options),
        progress_(progress),
        judge_(rig, sequence),
        stage_(rig, sequence, devices, options, judge_, progress) {}

  Result<void> find_devices() { return stage_.find_devices(); }
  Result<void> load_stored();
  Result<void> take_missing();

 private:
  int frames() const { return static_cast<int>(sequence_.frames.size()); }
  fs::path photo_path(int f, const CameraSlot& camera, std::size_t e) const {
    const std::string exposure = camera.exposures.size() > 1 ? exposure_text(camera.exposures[e]) : "";
    return folder_ / "photos" / camera.spec->id / photo_name(sequence_.frames[f].index, exposure, ".tif");
  }
  bool complete(int f) const;
  Result<void> load_photos(std::size_t c);
  Wanted wanted(int f, bool all) const;
  Result<void> store(int f, const std::vector<Shot>& shots);
  std::vector<int> telling_frames() const;

  struct Change {
    std::string why;      // empty: there is none
    double shift_px = 0;  // 0: it is no mere shift, or too large a one to measure
  };
  Result<Change> start();
  Result<void> take_all();
  Result<void> take_frame(int f);
  Result<void> accept(int f, const std::vector<Image>& blocks, const Views& now, const std::vector<Shot>& shots,
                      const FrameJudge::Pixels& pixels, int attempt);
  Result<void> show_next(int f);
  Result<void> retake(int f);
  Result<bool> answers(const std::vector<Image>& blocks, const Pictures& pictures, const Views& now);
  Result<Bins> stored_pixels(int f, std::size_t c) const;
  Views bins_of(int f, const std::vector<Shot>& shots) const;

  Result<Change> moved(int f, std::vector<Shot> now, const std::function<Result<void>()>& show_again = {});
  Result<Change> shifted(int f, const std::vector<Shot>& now, double shake_px) const;
  std::vector<int> frames_to_compare(const std::string& projector) const;
  Result<Change> view_changed();
  Result<void> set_aside();
  Result<void> take_all_again(const std::string& changed);

  const Sequence& sequence_;
  const fs::path& folder_;
  const CaptureOptions& options_;
  Progress& progress_;
  std::vector<Wanted> have_;   // [frame][camera][exposure]
  bool contradicted_ = false;  // a frame was given up since it and another one do not add up
  std::optional<int> ahead_;   // frame that is shown already
  Pictures ahead_pictures_;
  FrameJudge judge_;
  Stage stage_;
};

// ---- what is stored already ----

bool Capture::complete(int f) const {
  for (const auto& camera : have_[f])
    if (std::find(camera.begin(), camera.end(), false) != camera.end()) return false;
  return true;
}

Result<void> Capture::load_photos(std::size_t c) {
  struct Stored {
    int f;
    std::size_t e;
    fs::path path;
    std::string unreadable;
    std::array<int, 3> size{0, 0, 0};
    Bins bins;
  };
  std::vector<Stored> stored;
  for (int f = 0; f < frames(); ++f)
    for (std::size_t e = 0; e < stage_.cameras()[c].exposures.size(); ++e)
      if (fs::path path = photo_path(f, stage_.cameras()[c], e); fs::exists(path))
        stored.push_back({f, e, std::move(path), {}, {}, {}});
  parallel_for(static_cast<int>(stored.size()), [&](int i) {
    Stored& one = stored[i];
    const auto read = read_image(one.path);
    if (!read) {
      one.unreadable = read.error().message;
      return;
    }
    one.size = {read->values.width(), read->values.height(), read->values.channels()};
    if (one.e == 0) one.bins = bin_photo(read->values, read->full_scale, *stage_.cameras()[c].spec);
  });
  for (Stored& one : stored) {
    if (!one.unreadable.empty()) {
      progress_.warn(one.unreadable + "; it is taken again");
      continue;
    }
    if (stage_.size(c)[0] == 0) stage_.size(c) = one.size;
    if (stage_.size(c) != one.size)
      return error(ErrorCode::kRefused,
                   "'{}' has {}x{} pixels, the photos before it {}x{}: remove the ones that are wrong",
                   one.path.string(), one.size[0], one.size[1], stage_.size(c)[0], stage_.size(c)[1]);
    have_[one.f][c][one.e] = true;
    if (one.e == 0) judge_.keep(one.f, c, std::move(one.bins));
  }
  return {};
}

Result<void> Capture::load_stored() {
  for (int f = 0; f < frames(); ++f) {
    have_.emplace_back();
    for (const CameraSlot& camera : stage_.cameras()) have_[f].emplace_back(camera.exposures.size(), false);
  }
  for (std::size_t c = 0; c < stage_.cameras().size(); ++c) {
    const fs::path folder = folder_ / "photos" / stage_.cameras()[c].spec->id;
    std::error_code reason;
    fs::create_directories(folder, reason);
    if (reason)
      return error(ErrorCode::kIo, "folder '{}' cannot be created: {}; check the disk and its permissions",
                   folder.string(), reason.message());
    CS_TRY_VOID(remove_unfinished(folder));
    CS_TRY_VOID(load_photos(c));
  }
  for (int f = 0; f < frames(); ++f)
    if (options_.stored && complete(f)) options_.stored(sequence_.frames[f].index);
  return {};
}

Wanted Capture::wanted(int f, bool all) const {
  auto wanted = have_[f];
  for (auto& camera : wanted)
    for (std::size_t e = 0; e < camera.size(); ++e) camera[e] = all || !camera[e];
  return wanted;
}

Result<void> Capture::store(int f, const std::vector<Shot>& shots) {
  for (std::size_t c = 0; c < stage_.cameras().size(); ++c)
    for (std::size_t e = 0; e < shots[c].stored.size(); ++e) {
      const Image& photo = shots[c].stored[e];
      if (photo.empty()) continue;
      CS_TRY_VOID(write_stored16(photo_path(f, stage_.cameras()[c], e), photo));
      stage_.size(c) = {photo.width(), photo.height(), photo.channels()};
      have_[f][c][e] = true;
      if (e == 0) judge_.keep(f, c, shots[c].bins);
    }
  if (options_.stored && complete(f)) options_.stored(sequence_.frames[f].index);
  return {};
}

// Stored frames that are not dark: a dark photo cannot tell whether the camera moved.
std::vector<int> Capture::telling_frames() const {
  std::vector<std::pair<int, double>> light;
  double brightest = 0;
  for (int f = 0; f < frames(); ++f) {
    if (!complete(f)) continue;
    double sum = 0;
    for (std::size_t c = 0; c < stage_.cameras().size(); ++c) sum += mean_light(*judge_.kept(f, c));
    light.emplace_back(f, sum);
    brightest = std::max(brightest, sum);
  }
  std::vector<int> telling;
  for (const auto& [f, sum] : light)
    if (sum >= 0.3 * brightest) telling.push_back(f);
  return telling;
}

// What has changed since the stored frames; those that this very run has taken can be taken again, others are refused.
Result<Capture::Change> Capture::start() {
  const std::vector<int> telling = telling_frames();
  if (telling.empty()) {
    CS_TRY(const std::vector<Shot> dark, stage_.settle(stage_.plain(0)));
    judge_.saw_dark(views_of(dark));
    CS_TRY_VOID(stage_.measure_latency(stage_.plain(65535), stage_.plain(0)));
    return Change();
  }
  const int reference = telling.back();
  progress_.note(fmt::format("resuming: {} is photographed again and compared", judge_.name_of(reference)));
  CS_TRY(const Pictures pictures, stage_.pictures_of(sequence_.frames[reference]));
  CS_TRY(std::vector<Shot> now, stage_.settle(pictures));
  CS_TRY(Change change, moved(reference, std::move(now)));
  const bool own = options_.lateness != nullptr && options_.lateness->shows > 0;
  if (!change.why.empty() && !own)
    return error(ErrorCode::kRefused,
                 "{}: camera, projector or room moved: put them back as they were, or capture a new session in another "
                 "folder",
                 change.why);
  CS_TRY_VOID(stage_.measure_latency(stage_.plain(0), pictures));  // the reference is not dark
  return change;
}

// ---- is this the frame that was asked for? ----

// First exposure of a frame in single pixels, from its file; empty where that is not stored.
Result<Bins> Capture::stored_pixels(int f, std::size_t c) const {
  if (!have_[f][c][0]) return Bins();
  CS_TRY(const StoredImage photo, read_image(photo_path(f, stage_.cameras()[c], 0)));
  return judge_.pixels_of(photo.values, c);
}

Views Capture::bins_of(int f, const std::vector<Shot>& shots) const {
  Views bins;
  for (std::size_t c = 0; c < stage_.cameras().size(); ++c)
    bins.push_back(shots[c].bins.light.empty() ? *judge_.kept(f, c) : shots[c].bins);
  return bins;
}

// ---- frame after frame ----

// The partner of a frame once more, with every latency waited out.
Result<void> Capture::retake(int f) {
  CS_TRY(const Pictures pictures, stage_.pictures_of(sequence_.frames[f]));
  CS_TRY_VOID(stage_.settle(pictures));
  CS_TRY_VOID(stage_.show(pictures, 0));  // as every stored photo: the first after a show
  CS_TRY(const std::vector<Shot> shots, stage_.photograph(wanted(f, true)));
  return store(f, shots);
}

Result<void> Capture::take_frame(int f) {
  const bool shown = ahead_ == f;  // already
  CS_TRY(const Pictures pictures, shown ? std::move(ahead_pictures_) : stage_.pictures_of(sequence_.frames[f]));
  ahead_.reset();
  const std::vector<Image> blocks = blocks_of(pictures);
  for (int attempt = 0, shows = stage_.shows();; ++attempt) {
    CS_TRY_VOID(shown && attempt == 0 ? stage_.await_photo() : stage_.show_for_photo(pictures, shows, attempt));
    CS_TRY(const std::vector<Shot> shots, stage_.photograph(wanted(f, false)));
    const Views now = bins_of(f, shots);
    std::vector<std::optional<Bins>> in_pixels(shots.size());
    const auto pixels = [&](std::size_t c) -> const Bins& {
      if (!in_pixels[c]) in_pixels[c] = judge_.pixels_of(shots[c].stored[0], c);
      return *in_pixels[c];
    };
    std::string why = judge_.stale(blocks, now);
    if (why.empty()) why = judge_.repeats(f, pixels);
    const bool is_stale = !why.empty();
    if (!is_stale) {
      CS_TRY(why, judge_.wrong_pair(f, pixels, [this](int g, std::size_t c) { return stored_pixels(g, c); }));
    }
    if (why.empty()) return accept(f, blocks, now, shots, pixels, attempt);
    if (is_stale && attempt == options_.retakes) {
      CS_TRY(const bool seen, answers(blocks, pictures, now));
      if (seen) {
        progress_.note(
            fmt::format("{}: no camera sees this picture change the light, though the projectors answer: its light "
                        "falls beside what "
                        "the cameras see",
                        judge_.name_of(f)));
        return accept(f, blocks, now, shots, pixels, 0);
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
    CS_TRY(const std::vector<Shot> probed, stage_.settle(probe));
    judge_.saw({blocks, now});
    all = judge_.any_change(views_of(probed));
  }
  CS_TRY(const std::vector<Shot> again, stage_.settle(pictures));
  judge_.saw({blocks, now});
  all = all && !judge_.any_change(views_of(again));
  judge_.saw(before);
  return all;
}

// Shows the frame after f that is missing, so that it is on its way while f is stored.
Result<void> Capture::show_next(int f) {
  int next = f + 1;
  while (next < frames() && complete(next)) ++next;
  if (next == frames() || stage_.shows() > 1) return {};
  CS_TRY(ahead_pictures_, stage_.pictures_of(sequence_.frames[next]));
  ahead_ = next;
  return stage_.show_ahead(ahead_pictures_);
}

// Stores a frame; when it came late, the next ones are shown as often before they are photographed.
Result<void> Capture::accept(int f, const std::vector<Image>& blocks, const Views& now, const std::vector<Shot>& shots,
                             const FrameJudge::Pixels& pixels, int attempt) {
  if (attempt == 0) CS_TRY_VOID(show_next(f));
  CS_TRY_VOID(store(f, shots));
  judge_.saw({blocks, now});
  Views in_pixels;
  if (f + 1 < frames() && sequence_.frames[f + 1].role.kind == "phase")
    for (std::size_t c = 0; c < stage_.cameras().size(); ++c) in_pixels.push_back(pixels(c));
  judge_.saw_pixels(std::move(in_pixels));
  stage_.came_late(attempt);
  return {};
}

// ---- does the session still show what stands there? ----

// Whether the cameras see frame f, which is shown, as it was stored. A camera that shakes is given more photos to find
// back; show_again: where f is not shown any more. Of stripes a shift is looked for first: a small one moves much of
// their light.
Result<Capture::Change> Capture::moved(int f, std::vector<Shot> now, const std::function<Result<void>()>& show_again) {
  const bool stripes = is_striped(sequence_.frames[f].role);
  double shake_px = 0, shake = 0;
  for (int photo = 0;; ++photo) {
    Change change;
    if (!stripes) change.why = judge_.moved(f, views_of(now), shake);
    if (change.why.empty()) {
      CS_TRY(change, shifted(f, now, shake_px));
    }
    if (change.why.empty() && stripes) change.why = judge_.moved(f, views_of(now), shake);
    if (change.why.empty() || photo == kShakePhotos) return change;
    if (photo == 0 && show_again) CS_TRY_VOID(show_again());
    CS_TRY(std::vector<Shot> next, stage_.look());
    for (std::size_t c = 0; c < next.size(); ++c) {
      shake = std::max(shake, change_of_view(now[c].bins, next[c].bins).first);
      shake_px = std::max(shake_px,
                          view_shift_px(judge_.pixels_of(now[c].stored[0], c), judge_.pixels_of(next[c].stored[0], c)));
    }
    now = std::move(next);
  }
}

// Of the camera that looks farthest from where it looked.
Result<Capture::Change> Capture::shifted(int f, const std::vector<Shot>& now, double shake_px) const {
  Change largest;
  const double allowed = kShiftedPx + 2 * shake_px;
  for (std::size_t c = 0; c < stage_.cameras().size(); ++c) {
    CS_TRY(const Bins before, stored_pixels(f, c));
    if (before.light.empty()) continue;
    const double px = view_shift_px(before, judge_.pixels_of(now[c].stored[0], c));
    if (px <= std::max(allowed, largest.shift_px)) continue;
    largest = {fmt::format("camera '{}' sees {} shifted by {:.2f} px since it was stored (allowed {:.2f} px: {:.2f}, "
                           "and twice what it shakes)",
                           stage_.cameras()[c].spec->id, judge_.name_of(f), px, allowed, kShiftedPx),
               px};
  }
  return largest;
}

// Frames that tell whether a projector and the cameras stand where they stood: its first bright one, since one
// projector alone may have moved, and its first stripes on each axis, since a picture may shift where white does not.
std::vector<int> Capture::frames_to_compare(const std::string& projector) const {
  const auto of_this = [&](int f) {
    const std::string& lit = sequence_.frames[f].role.projector;
    return lit.empty() || lit == projector;
  };
  std::vector<int> chosen;
  const std::vector<int> telling = telling_frames();
  const auto bright = std::find_if(telling.begin(), telling.end(), of_this);
  if (bright != telling.end()) chosen.push_back(*bright);
  for (const char* axis : {"x", "y"})
    for (int f = 0; f < frames(); ++f)
      if (complete(f) && of_this(f) && is_striped(sequence_.frames[f].role) && sequence_.frames[f].role.axis == axis) {
        if (std::find(chosen.begin(), chosen.end(), f) == chosen.end()) chosen.push_back(f);
        break;
      }
  return chosen;
}

// Whether such frames of all projectors are still seen as they were stored; of several changes the gravest. Stripes
// whose light is elsewhere, though nobody can tell by how much, weigh less than a shift that was measured.
Result<Capture::Change> Capture::view_changed() {
  std::vector<int> looked_at;
  for (const auto& [id, size] : sequence_.projectors)
    for (const int f : frames_to_compare(id)) looked_at.push_back(f);
  Change largest;
  bool shown = false;  // the next one, while the one before was looked at
  for (std::size_t i = 0; i < looked_at.size(); ++i) {
    const int f = looked_at[i];
    const auto show = [&]() -> Result<void> {
      CS_TRY(const Pictures pictures, stage_.pictures_of(sequence_.frames[f]));
      shown = false;
      return stage_.show_for_photo(pictures, stage_.shows(), 1);
    };
    CS_TRY_VOID(shown ? stage_.await_photo(1) : show());
    CS_TRY(std::vector<Shot> now, stage_.look());
    if (shown = i + 1 < looked_at.size() && stage_.shows() == 1; shown) {
      CS_TRY(const Pictures next, stage_.pictures_of(sequence_.frames[looked_at[i + 1]]));
      CS_TRY_VOID(stage_.show_ahead(next));
    }
    CS_TRY(Change change, moved(f, std::move(now), shown ? std::function<Result<void>()>(show) : nullptr));
    if (change.why.empty()) continue;
    if (change.shift_px == 0 && !is_striped(sequence_.frames[f].role)) return change;
    if (largest.why.empty() || change.shift_px > largest.shift_px) largest = std::move(change);
  }
  return largest;
}

// The session's photos go where nobody takes them for the session's.
Result<void> Capture::set_aside() {
  for (int f = 0; f < frames(); ++f)
    for (std::size_t c = 0; c < stage_.cameras().size(); ++c)
      for (std::size_t e = 0; e < stage_.cameras()[c].exposures.size(); ++e) {
        const fs::path from = photo_path(f, stage_.cameras()[c], e);
        const fs::path to = folder_ / "outdated" / stage_.cameras()[c].spec->id / from.filename();
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

// All of it, once more: which frames are of before a change no photo can tell for sure, since some would look the same.
Result<void> Capture::take_all_again(const std::string& changed) {
  progress_.warn(
      fmt::format("camera, a projector or the room moved, or the light changed, while photos were taken: all {} frames "
                  "are taken again; the former photos are kept in '{}' ({})",
                  frames(), (folder_ / "outdated").string(), changed));
  CS_TRY_VOID(set_aside());
  if (options_.set_aside) options_.set_aside();
  CS_TRY_VOID(take_all());
  CS_TRY(const Change again, view_changed());
  if (again.why.empty()) return {};
  if (again.shift_px > 0 && again.shift_px <= kGivesWayPx) {  // to take it a third time would not help
    progress_.warn(fmt::format(
        "the view goes on shifting while photos are taken ({}): what is decoded is as much beside; find what "
        "gives way (stand, mount, a projector that warms up), and capture again in another folder",
        again.why));
    return {};
  }
  return error(ErrorCode::kRefused,
               "the view changed again while photos were taken: camera, projectors and room must stand still and the "
               "light must stay; then capture in another folder than '{}' ({})",
               folder_.string(), again.why);
}

Result<void> Capture::take_missing() {
  int done = 0;
  for (int f = 0; f < frames(); ++f) done += complete(f);
  progress_.step("capture", done, frames());
  if (done == frames()) return {};
  CS_TRY(Change change, start());
  if (change.why.empty()) {
    const auto taken = take_all();
    if (!taken && !contradicted_) return taken;  // photos that contradict one another may be of two views
    auto changed = view_changed();
    if (!taken && (!changed || changed->why.empty())) return taken;
    if (!changed) return changed.error();
    change = std::move(*changed);
  }
  if (!change.why.empty()) CS_TRY_VOID(take_all_again(change.why));
  if (options_.lateness != nullptr) *options_.lateness = stage_.lateness();
  if (stage_.lost() > 0)
    progress_.note(fmt::format("{} photos did not arrive whole and were taken again", stage_.lost()));
  return {};
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
  const std::vector<std::string> before = unhealthy_cameras(folder);
  for (const std::string& line : before) progress.note(line + " (when this session was left)");
  const auto taken = capture.take_missing();
  mark_unhealthy(folder, devices);
  if (const std::vector<std::string> now = unhealthy_cameras(folder); taken && now != before)
    for (const std::string& line : now) progress.warn(line);
  return taken;
}

}  // namespace countershade::capture

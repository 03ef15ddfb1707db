#include "capture/session/stage.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr double kStaggerMs = 7;              // between the trials, in other steps than refreshes come
constexpr double kLongestLatencyMs = 300;     // that a picture is waited for when it was shown often enough
constexpr std::size_t kMostPhotos = 16;       // in that time
constexpr int kTrials = 6, kTrialsLate = 11;  // of the latency, where there is none and where there is some

}  // namespace

Result<void> Stage::find_devices() {
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

Result<Pictures> Stage::pictures_of(const Frame& frame) const {
  Pictures pictures;
  for (const auto& [id, size] : sequence_.projectors) {
    CS_TRY(Picture picture, render_role(frame.role, id, size[0], size[1]));
    pictures.push_back(std::move(picture));
  }
  return pictures;
}

Pictures Stage::plain(std::uint16_t value) const {
  Pictures pictures;
  for (const auto& [id, size] : sequence_.projectors) pictures.emplace_back(size[0], size[1], 3, value);
  return pictures;
}

// ---- showing and photographing ----

Views views_of(const std::vector<Shot>& shots) {
  Views views;
  for (const Shot& shot : shots) views.push_back(shot.bins);
  return views;
}

Result<void> Stage::hand_over(const Pictures& pictures) {
  for (std::size_t p = 0; p < projectors_.size(); ++p) CS_TRY_VOID(projectors_[p]->hand_over(pictures[p]));
  return {};
}

Result<void> Stage::wait_until_taken(double wait_ms) {
  devices_.wait(wait_ms);
  for (Projector* projector : projectors_) CS_TRY_VOID(projector->taken());
  return {};
}

Result<void> Stage::show(const Pictures& pictures, double wait_ms) {
  CS_TRY_VOID(hand_over(pictures));
  return wait_until_taken(wait_ms);
}

Result<void> Stage::show_for_photo(const Pictures& pictures, int shows, int late) {
  for (int i = 1; i < shows; ++i) CS_TRY_VOID(show(pictures, options_.retake_wait_ms));
  return show(pictures, lateness_.wait_ms + late * options_.retake_wait_ms);
}

Result<void> Stage::show_ahead(const Pictures& pictures) {
  CS_TRY_VOID(hand_over(pictures));
  ahead_since_ = std::chrono::steady_clock::now();
  return {};
}

Result<void> Stage::await_photo(int late) {
  const std::chrono::duration<double, std::milli> passed = std::chrono::steady_clock::now() - ahead_since_;
  // On a clock of their own no time has passed for the devices.
  const double wait_ms = lateness_.wait_ms + late * options_.retake_wait_ms;
  return wait_until_taken(std::max(0.0, wait_ms - (devices_.clock ? 0 : passed.count())));
}

// Stored numbers of one exposure, scaled to 16 bits where the rig does not say what full scale is.
Result<Exposure> Stage::expose(const CameraSlot& camera, std::size_t e) {
  if (camera.exposures.size() > 1) CS_TRY_VOID(camera.device->arm(camera.exposures[e]));
  CS_TRY(Exposure exposure, camera.device->trigger());
  lost_ += exposure.lost;
  const bool scaled = !camera.spec->full_scale && exposure.full_scale != 65535;
  const auto scale = static_cast<float>(scaled ? 65535 / exposure.full_scale : 1);
  const int values = exposure.values.width() * exposure.values.channels();
  parallel_for(exposure.values.height(), [&](int y) {
    float* row = exposure.values.row(y);  // to whole numbers, by instructions that work on many at once
    for (int i = 0; i < values; ++i)
      row[i] = static_cast<float>(static_cast<int>(std::clamp(row[i] * scale, 0.0f, 65535.0f) + 0.5f));
  });
  return exposure;
}

Result<std::vector<Shot>> Stage::photograph(const Wanted& wanted) {
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

Wanted Stage::first_exposures() const {
  Wanted first;
  for (const CameraSlot& camera : cameras_) {
    first.emplace_back(camera.exposures.size(), false);
    first.back()[0] = true;
  }
  return first;
}

Result<std::vector<Shot>> Stage::settle(const Pictures& pictures) {
  for (int i = 0; i <= options_.retakes; ++i) CS_TRY_VOID(show(pictures, options_.retake_wait_ms));
  devices_.wait((12 - options_.retakes - 1) * options_.retake_wait_ms);
  CS_TRY(const std::vector<Shot> one, look());
  CS_TRY(std::vector<Shot> two, look());
  for (std::size_t c = 0; c < cameras_.size(); ++c)
    judge_.learn_noise(c, one[c].bins, two[c].bins, judge_.pixels_of(one[c].stored[0], c),
                       judge_.pixels_of(two[c].stored[0], c));
  judge_.saw({blocks_of(pictures), views_of(two)});
  return two;
}

// ---- how late the display is ----

// Shows pictures that differ much from what is seen, and photographs them, from wait_ms after they were handed over on,
// until two photos agree on them.
Result<Stage::Arrival> Stage::wait_for(const Pictures& pictures, int shows, double wait_ms) {
  for (int i = 1; i < shows; ++i) CS_TRY_VOID(show(pictures, options_.retake_wait_ms));
  CS_TRY_VOID(show(pictures, wait_ms));
  std::vector<Views> views;
  std::vector<StepPhoto> photos;
  Arrival arrival;
  while (photos.size() < 2 ||
         (photos.size() < kMostPhotos && photos.back().from_ms - photos.front().from_ms < kLongestLatencyMs)) {
    CS_TRY(const std::vector<Shot> shots, look());
    Views now = views_of(shots);
    arrival.seen = judge_.any_change(now);
    const bool settled = arrival.seen && !views.empty() && !judge_.differ(views.back(), now);
    views.push_back(std::move(now));
    photos.push_back({shots[0].from_ms, shots[0].exposure_ms, 0});
    if (settled) break;
  }
  for (std::size_t i = 0; i < photos.size(); ++i) photos[i].share = judge_.share_of_change(views[i], views.back());
  if (arrival.seen) arrival.appeared = appearance(photos);
  // A camera's clock may jump or stand still: none is waited for longer than this, nor less where the clock cannot be
  // right, since one photo is begun when the one before is exposed.
  const auto lies = [](const StepPhoto& a, const StepPhoto& b) {
    const double passed = b.from_ms - a.from_ms;
    return !(passed >= 0.5 * a.exposure_ms && passed < 1e6);
  };
  Appearance& at = arrival.appeared;
  if (arrival.seen && photos.front().share <= kWholeChange &&
      std::adjacent_find(photos.begin(), photos.end(), lies) != photos.end())
    at = {kLongestLatencyMs, kLongestLatencyMs};
  at = {std::clamp(at.earliest_ms, 0.0, kLongestLatencyMs), std::clamp(at.latest_ms, 0.0, kLongestLatencyMs)};
  arrival.exposure_ms = photos.front().exposure_ms;
  arrival.settled = std::move(views.back());
  return arrival;
}

// How often a picture must be shown until a camera sees it.
Result<void> Stage::count_shows(const Pictures& pictures) {
  for (lateness_.shows = 1; lateness_.shows <= options_.retakes + 1; ++lateness_.shows) {
    CS_TRY(Arrival arrival, wait_for(pictures, 1, 0));  // once more
    if (!arrival.seen) continue;
    if (lateness_.shows > 1)
      progress_.note(fmt::format("the display or the camera is late: each picture is shown {} times before its photo",
                                 lateness_.shows));
    judge_.saw({blocks_of(pictures), std::move(arrival.settled)});
    return {};
  }
  return error(
      ErrorCode::kDevice,
      "no camera sees a change between black and white on all projectors, after {} tries. Check that the projectors "
      "are on and show this computer's pictures (right monitor, no screen saver), lens caps, and exposure",
      options_.retakes + 1);
}

// By steps at moments that are spread between two refreshes. Where the picture is there in each of the first ones as
// soon as the display has taken it, there is nothing to wait for. From the first that is not the next ones are
// photographed so that the change falls into the exposure, which times it to a part of a millisecond.
Result<void> Stage::measure_latency(const Pictures& pictures, const Pictures& former) {
  if (options_.lateness != nullptr && options_.lateness->shows > 0) {
    lateness_ = *options_.lateness;
    return {};
  }
  CS_TRY_VOID(count_shows(pictures));
  bool there = true;
  const auto step = [&](int trial, double wait_ms) -> Result<Arrival> {
    devices_.wait(std::fmod(trial * kStaggerMs, devices_.refresh_ms()));
    const Pictures& next = there ? former : pictures;
    CS_TRY(Arrival arrival, wait_for(next, lateness_.shows, wait_ms));
    if (arrival.seen) judge_.saw({blocks_of(next), arrival.settled});
    there = there != arrival.seen;
    return arrival;
  };
  double latest_ms = 0;
  for (int trial = 1; trial <= kTrials && latest_ms == 0; ++trial) {
    CS_TRY(const Arrival arrival, step(trial, 0));
    latest_ms = arrival.appeared.latest_ms;
  }
  if (latest_ms == 0) return {};
  const double refresh_ms = devices_.refresh_ms();
  latest_ms += refresh_ms;           // of being taken, which is not waited for any more
  std::vector<Appearance> appeared;  // since they were handed over
  double before_ms = 0;              // that the exposure begins before the moment at which the change is expected
  for (int trial = 1; trial <= kTrialsLate; ++trial) {
    const double wait_ms = std::max(refresh_ms, latest_ms - before_ms);
    CS_TRY(const Arrival arrival, step(trial, wait_ms));
    if (!arrival.seen) continue;  // a frame that comes as late is judged and taken again
    const Appearance& at = arrival.appeared;
    if (at.latest_ms > 0) appeared.push_back({wait_ms + at.earliest_ms, wait_ms + at.latest_ms});
    const bool found = std::any_of(appeared.begin(), appeared.end(), [](const Appearance& a) { return a.timed(); });
    // Until one is timed they are looked for earlier and earlier; then later ones are, since the latest counts.
    latest_ms = appeared.empty() ? wait_ms : longest_ms(appeared);
    if (!found && at.latest_ms == 0) latest_ms = wait_ms;
    before_ms = (found ? 0.3 : 0.8) * arrival.exposure_ms;
  }
  lateness_.wait_ms = latest_ms + refresh_ms;
  progress_.note(fmt::format("pictures are seen up to {:.0f} ms after they were shown: photos wait for {:.0f} ms",
                             latest_ms, lateness_.wait_ms));
  return {};
}

void Stage::came_late(int attempt) {
  const bool again = std::exchange(late_, attempt > 0) && attempt > 0;
  if (attempt == 0) return;
  // Once is a hiccup, which waiting longer covers; twice in a row, and the display holds pictures back.
  lateness_.wait_ms += attempt * options_.retake_wait_ms;
  if (again) lateness_.shows = std::min(lateness_.shows + attempt, options_.retakes + 1);
  progress_.note(
      fmt::format("the display or the camera is late: from here on each picture is shown {} times, and its photo waits "
                  "for {:.0f} ms",
                  lateness_.shows, lateness_.wait_ms));
}

}  // namespace countershade::capture

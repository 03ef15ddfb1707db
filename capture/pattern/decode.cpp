#include "capture/pattern/decode.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "calib/base/lanes.h"
#include "calib/base/parallel.h"
#include "capture/pattern/plan.h"
#include "capture/pattern/read/bits.h"
#include "capture/pattern/read/levels.h"
#include "capture/pattern/read/phase.h"
#include "capture/pattern/read/refine.h"
#include "capture/pattern/read/reject.h"

namespace countershade::capture {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Joins the axes: a pixel is accepted when every axis with a code is.
void join(const Mask& judged, AxisReading* axes[2], Correspondence& c) {
  c.reason = judged;
  const int width = judged.width(), height = judged.height();
  for (int a = 0; a < 2; ++a) (a ? c.y : c.x) = axes[a] ? std::move(axes[a]->q) : Image(width, height, 1, kNaN);
  c.sigma = std::move(axes[axes[0] ? 0 : 1]->sigma);
  const Image* other = axes[0] && axes[1] ? &axes[1]->sigma : nullptr;
  std::vector<std::array<std::size_t, 2>> counts(height);  // lit, accepted
  parallel_for(height, [&](int v) {
    LaneMask lit{}, accepted{};  // -1 each
    for_lanes(width, [&](int u, auto count) {
      LaneMask why = load_bytes(c.reason.row(v) + u, count);
      for (int a = 0; a < 2; ++a)
        if (axes[a]) why = why != 0 ? why : load_bytes(axes[a]->reason.row(v) + u, count);
      store_bytes(why, c.reason.row(v) + u, count);
      const LaneMask good = why == static_cast<int>(Reason::kAccepted);
      const LaneMask here = kLane < int{count};
      lit += here & (why != static_cast<int>(Reason::kDark)) & (why != static_cast<int>(Reason::kIndirect));
      accepted += here & good;
      auto sigma = load<Lanes>(c.sigma.row(v) + u, count);
      if (other) sigma = larger(sigma, load<Lanes>(other->row(v) + u, count));
      store(good ? sigma : all(kNaN), c.sigma.row(v) + u, count);
      if (!any(~good)) return;
      for (Image* q : {&c.x, &c.y}) store(good ? load<Lanes>(q->row(v) + u, count) : all(kNaN), q->row(v) + u, count);
    });
    counts[v] = {static_cast<std::size_t>(count_of(lit)), static_cast<std::size_t>(count_of(accepted))};
  });
  for (const auto& [lit, accepted] : counts) c.lit += lit, c.accepted += accepted;
}

Error nothing_decoded(const Correspondence& c, const Levels& levels) {
  const auto saturated =
      std::count(c.reason.data().begin(), c.reason.data().end(), static_cast<std::uint8_t>(Reason::kSaturated));
  const bool too_bright = saturated > static_cast<std::ptrdiff_t>(c.reason.data().size() / 100);
  return error(ErrorCode::kRefused,
               "projector '{}': no camera pixel can be decoded: {} (brightest white {:.1f} %, darkest black {:.1f} % "
               "of full scale). {}",
               c.projector,
               too_bright                        ? "every lit pixel is saturated"
               : c.lit < c.reason.pixels() / 100 ? "none is lit by it"
                                                 : "its code is not visible where it lights the scene",
               100 * levels.brightest, 100 * levels.darkest,
               too_bright ? "Shorten exposures_ms"
                          : "Is the projector on and in focus, the lens cap off, the exposure long enough, does the "
                            "camera see its picture, and is each photo of the frame that sequence.json says?");
}

}  // namespace

// What has arrived, and what was made of it.
struct Decoder::State {
  CodePlan plan;
  DecodeOptions options;
  std::string camera, projector;
  StoredPhotos waiting;
  std::array<int, 2> size{0, 0};  // of the photos; 0 = not known yet
  std::optional<BitReading> bits;
  Levels levels;  // of the bits; of the sinusoids, where there are no bits
  Mask judged;    // Reason of pixels that no code is read from
  AxisReading readings[2];
  std::optional<PhaseReading> waves[2];
  bool bits_read = false;

  bool wants(int frame) const;
  bool has_bits() const { return !plan.axis[0].bits.empty() || !plan.axis[1].bits.empty(); }
  void advance(bool all);
  void take_bits();
  std::optional<WavePhotos> take_waves(const AxisCode& code);
  void read_waves(int axis, const WavePhotos& photos);
  void settle_waves();
};

bool Decoder::State::wants(int frame) const {
  if (bits && bits->wants(frame)) return true;
  for (int a = 0; a < 2; ++a)
    for (const WaveFrame& wave : plan.axis[a].waves)
      if (wave.index == frame) return !waves[a];
  return false;
}

// Reads what the photos that are there allow. All: does not wait for more to make it worth a pass.
void Decoder::State::advance(bool all) {
  if (bits && !bits_read) {
    bits->read(waiting, all);
    if (bits->done()) take_bits();
  }
  for (int a = 0; a < 2; ++a) {
    if (plan.axis[a].waves.empty() || waves[a] || bits_read != has_bits()) continue;
    if (const auto photos = take_waves(plan.axis[a])) read_waves(a, *photos);
  }
}

void Decoder::State::take_bits() {
  bits_read = true;
  levels = bits->levels(), judged = std::move(bits->judged());
  for (int a = 0; a < 2; ++a) {
    if (plan.axis[a].bits.empty()) continue;
    readings[a] = std::move(bits->axis(a));
    readings[a].contrast = std::move(bits->contrast());
    refine_by_neighbours(readings[a]);
    bits->contrast() = std::move(readings[a].contrast);
  }
}

// Photos of all sinusoids of an axis, once they are there.
std::optional<WavePhotos> Decoder::State::take_waves(const AxisCode& code) {
  for (const WaveFrame& wave : code.waves)
    if (!waiting.contains(wave.index)) return std::nullopt;
  WavePhotos loaded;
  loaded.skip = Mask(size[0], size[1], 1);
  for (const WaveFrame& wave : code.waves) {
    const StoredPhoto& photo = *waiting.at(wave.index);
    loaded.light.push_back(light_of(photo));
    for (int y = 0; y < size[1]; ++y) photo.mark_saturated(y, loaded.skip.row(y));
  }
  for (const WaveFrame& wave : code.waves) waiting.erase(wave.index);
  return loaded;
}

void Decoder::State::read_waves(int axis, const WavePhotos& photos) {
  const AxisCode& code = plan.axis[axis];
  const bool alone = judged.empty() || code.bits.empty();
  if (judged.empty()) judged = Mask(photos.skip.width(), photos.skip.height(), 1);
  for (std::size_t i = 0; i < judged.data().size(); ++i)
    if (photos.skip.data()[i] && !judged.data()[i]) judged.data()[i] = static_cast<std::uint8_t>(Reason::kSaturated);
  if (!has_bits())
    for (const Image& light : photos.light)
      for (const float v : light.data())
        levels.brightest = std::max(levels.brightest, v), levels.darkest = std::min(levels.darkest, v);
  const Image* coarse = alone ? nullptr : &readings[axis].q;
  const WaveModel model = fit_wave_model(code, photos, coarse, levels.noise);
  waves[axis] = read_phase(code, photos, model, coarse, options);
}

// Once the sinusoids of both axes are read. A pixel that is lit in part may keep its contrast on one of them, where
// what is left of it is less blurred: the axes share the smaller one.
void Decoder::State::settle_waves() {
  if (waves[0] && waves[1]) {
    std::vector<float>&x = waves[0]->reading.contrast.data(), &y = waves[1]->reading.contrast.data();
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = y[i] = std::min(x[i], y[i]);
  }
  for (int a = 0; a < 2; ++a) {
    if (!waves[a]) continue;
    AxisReading& read = waves[a]->reading;
    check_by_neighbours(read, waves[a]->other);
    AxisReading& result = readings[a];
    if (plan.axis[a].bits.empty()) {
      result = std::move(read);
      continue;
    }
    for (std::size_t i = 0; i < judged.data().size(); ++i)  // where sinusoids say nothing, the Gray code does
      if (!result.reason.data()[i] && !read.reason.data()[i]) {
        result.q.data()[i] = read.q.data()[i];
        result.sigma.data()[i] = read.sigma.data()[i];
      }
  }
}

Decoder::Decoder(std::unique_ptr<State> state) : state_(std::move(state)) {}
Decoder::Decoder(Decoder&&) noexcept = default;
Decoder& Decoder::operator=(Decoder&&) noexcept = default;
Decoder::~Decoder() = default;

Result<Decoder> Decoder::make(const Sequence& sequence, const std::string& camera, const std::string& projector,
                              const DecodeOptions& options) {
  auto state = std::make_unique<State>();
  CS_TRY(state->plan, plan_code(sequence, projector));
  state->options = options, state->camera = camera, state->projector = projector;
  if (state->has_bits()) state->bits.emplace(state->plan, state->options);
  return Decoder(std::move(state));
}

std::vector<int> Decoder::frames() const {
  const CodePlan& plan = state_->plan;
  std::vector<int> order;
  const auto add = [&](int frame) {
    if (frame >= 0 && std::find(order.begin(), order.end(), frame) == order.end()) order.push_back(frame);
  };
  if (state_->has_bits())
    for (const int frame : LevelPhotos(plan, {}).index) add(frame);
  for (const AxisCode& code : plan.axis)
    for (const BitFrames& bit : code.bits) add(bit.plain), add(bit.inverse);
  for (const AxisCode& code : plan.axis)
    for (const WaveFrame& wave : code.waves) add(wave.index);
  return order;
}

Result<void> Decoder::add(int frame, std::shared_ptr<const StoredPhoto> photo) {
  if (!state_->wants(frame)) return {};
  std::array<int, 2>& size = state_->size;
  if (size[0] == 0) size = {photo->width(), photo->height()};
  if (photo->width() != size[0] || photo->height() != size[1])
    return error(ErrorCode::kBadFile,
                 "photo {:04} is {} x {} pixels, the others are {} x {}; all photos of a camera have one size", frame,
                 photo->width(), photo->height(), size[0], size[1]);
  state_->waiting[frame] = std::move(photo);
  state_->advance(false);
  return {};
}

Result<Correspondence> Decoder::finish() {
  State& s = *state_;
  s.advance(true);
  for (const int frame : frames())
    if (s.wants(frame) && !s.waiting.contains(frame))
      return error(ErrorCode::kRefused, "projector '{}': photo {:04} of its code is missing", s.projector, frame);
  s.settle_waves();
  Correspondence c;
  c.camera = s.camera, c.projector = s.projector;
  c.projector_resolution = {s.plan.axis[0].length_px, s.plan.axis[1].length_px};
  AxisReading* axes[2] = {nullptr, nullptr};
  for (int a = 0; a < 2; ++a)
    if (s.plan.axis[a].exists()) axes[a] = &s.readings[a];
  join(s.judged, axes, c);
  if (c.accepted == 0) return nothing_decoded(c, s.levels);
  name_mixed(c);
  return c;
}

Result<Correspondence> decode_frames(const Sequence& sequence, const PhotoSource& photos, const std::string& camera,
                                     const std::string& projector, const DecodeOptions& options, Progress& progress) {
  CS_TRY(Decoder decoder, Decoder::make(sequence, camera, projector, options));
  const std::vector<int> frames = decoder.frames();
  const std::string stage = "decode " + projector;
  for (std::size_t first = 0; first < frames.size(); first += 2) {
    progress.step(stage, static_cast<double>(first), static_cast<double>(frames.size()));
    std::array<std::optional<Result<Photo>>, 2> read;
    parallel_for(static_cast<int>(std::min<std::size_t>(2, frames.size() - first)),
                 [&](int k) { read[k] = photos(frames[first + k]); });
    for (int k = 0; k < 2 && read[k]; ++k) {
      if (!*read[k]) return read[k]->error();
      Photo& photo = **read[k];
      if (photo.value.channels() > 1) photo.value = luminance_mean(photo.value);  // less to keep
      CS_TRY_VOID(decoder.add(frames[first + k], std::make_shared<const StoredPhoto>(std::move(photo))));
    }
  }
  Result<Correspondence> c = decoder.finish();
  progress.step(stage, static_cast<double>(frames.size()), static_cast<double>(frames.size()));
  return c;
}

Result<Correspondence> decode(const Session& session, const std::string& camera, const std::string& projector,
                              const DecodeOptions& options, Progress& progress) {
  return decode_frames(
      session.sequence(), [&](int index) { return session.photo(camera, index); }, camera, projector, options,
      progress);
}

}  // namespace countershade::capture

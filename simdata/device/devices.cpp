// Simulated cameras and projectors: one room, shown and photographed through the interfaces of real devices.
#include <algorithm>
#include <bit>
#include <cstring>
#include <map>
#include <mutex>
#include <numbers>

#include "calib/base/random.h"
#include "simdata/device/sensor.h"
#include "simdata/device/timeline.h"
#include "simdata/render/simulator.h"

namespace countershade::simdata {

namespace {

std::uint64_t hash_picture(const Picture& picture) {
  std::uint64_t h = mix(static_cast<std::uint64_t>(picture.width()) << 32 | picture.height());
  const std::vector<std::uint16_t>& values = picture.data();
  std::uint64_t four = 0;
  std::size_t i = 0;
  for (; i + 4 <= values.size(); i += 4) {
    std::memcpy(&four, values.data() + i, sizeof four);
    h = (h ^ four) * 0x9e3779b97f4a7c15ull;
    h ^= h >> 32;
  }
  for (; i < values.size(); ++i) h = mix(h ^ values[i]);
  return mix(h);
}

constexpr double kReadOut = 0.02;  // s

// Mean over each row's exposure of swing * cos(2 pi hz t), t since the devices were switched on: what lamps on the
// mains add to their mean light, over that. One value where all rows are exposed at once; none where nothing swings.
std::vector<double> swings(const RowExposure& e, double swing, double hz) {
  std::vector<double> at;
  if (swing == 0) return at;
  const double half = std::numbers::pi * hz * e.exposure;
  const double left = half > 0 ? std::sin(half) / half : 1;
  for (int y = 0; y < (e.rolling > 0 ? e.rows : 1); ++y) {
    const double from = e.start + (e.rows > 1 ? e.rolling * y / (e.rows - 1) : 0);
    at.push_back(swing * left * std::cos(2 * std::numbers::pi * hz * (from + e.exposure / 2)));
  }
  return at;
}

Shown shown_of(const Picture& picture) {
  return {std::make_shared<const Picture>(picture), hash_picture(picture)};
}

using Parts = std::vector<Timeline::Part>;  // of one projector

// The state of the room as a number: equal ones, equal light.
std::uint64_t hash_parts(std::uint64_t state, const Parts& parts) {
  for (const Timeline::Part& part : parts) {
    state = mix(state ^ part.shown.hash);
    const bool whole = part.share.size() == 1 && (part.share[0].head<3>() == 1).all();
    for (std::size_t y = 0; y < part.share.size() && !whole; ++y)
      for (int c = 0; c < 3; ++c) state = mix(state ^ std::bit_cast<std::uint32_t>(part.share[y][c]));
  }
  return parts.empty() ? mix(~state) : state;
}

// The room as all devices share it.
struct Stage {
  std::shared_ptr<const Simulator> simulator;
  Faults faults;
  std::mutex mutex;
  double now = 0;  // s
  std::vector<Timeline> projectors;
  // Per camera and exposure [ms], since the newest show() of any projector.
  std::vector<std::map<double, std::uint64_t>> photos_since_show;
};

class SimulatedProjectorDevice final : public capture::Projector {
 public:
  SimulatedProjectorDevice(std::shared_ptr<Stage> stage, int index, const ProjectorSpec& spec,
                           const SimulatedProjector& truth)
      : stage_(std::move(stage)),
        refresh_hz_(truth.refresh_hz),
        index_(index),
        id_(spec.id),
        width_(spec.resolution[0]),
        height_(spec.resolution[1]),
        stereo_(truth.stereo) {}
  const std::string& id() const override { return id_; }
  int width() const override { return width_; }
  int height() const override { return height_; }
  double refresh_hz() const override { return refresh_hz_; }
  Result<void> show(const Picture& picture) override {
    CS_TRY_VOID(hand_over(picture));
    return taken();
  }
  Result<void> hand_over(const Picture& picture) override {
    const Shown shown = checked(picture);
    send(shown, shown);
    return {};
  }
  Result<void> taken() override {
    const std::lock_guard lock(stage_->mutex);
    stage_->now = std::max(stage_->now, taken_at_);
    return {};
  }
  Result<void> show_stereo(const Picture& left, const Picture& right) override {
    if (!stereo_)
      return error(ErrorCode::kUnsupported,
                   "projector '{}' shows one picture to both eyes; set stereo = true in its [[simulation.projector]]",
                   id_);
    send(checked(left), checked(right));
    return taken();
  }

 private:
  Shown checked(const Picture& picture) const {
    CS_CHECK(picture.same_size(width_, height_) && picture.channels() == 3,
             "projector '" + id_ + "' is sent a picture that is not of its size");
    return shown_of(picture);
  }
  void send(const Shown& left, const Shown& right) {
    const std::lock_guard lock(stage_->mutex);
    taken_at_ = stage_->projectors[index_].show(left, right, stage_->now);
    for (auto& of_camera : stage_->photos_since_show) of_camera.clear();
  }

  std::shared_ptr<Stage> stage_;
  double refresh_hz_;
  double taken_at_ = 0;  // s: when the computer goes on after the newest picture
  int index_;
  std::string id_;
  int width_, height_;
  bool stereo_;
};

class SimulatedCameraDevice final : public capture::Camera {
 public:
  SimulatedCameraDevice(std::shared_ptr<Stage> stage, int index, const SimulatedCamera& spec)
      : stage_(std::move(stage)), index_(index), spec_(spec) {
    if (spec.eye == "left") glasses_.right = spec.glasses_leak;
    if (spec.eye == "right") glasses_.left = spec.glasses_leak;
  }
  const std::string& id() const override { return spec_.id; }
  Result<void> arm(double exposure_ms) override {
    if (!(exposure_ms >= 0))
      return error(ErrorCode::kBadValue, "camera '{}': exposure of {} ms; it must be positive, or 0 for the default",
                   spec_.id, exposure_ms);
    exposure_ms_ = exposure_ms > 0 ? exposure_ms : spec_.reference_exposure_ms;
    return {};
  }
  Result<capture::Exposure> trigger() override {
    CS_CHECK(exposure_ms_ > 0, "camera '" + spec_.id + "' is triggered before it is armed");
    const std::lock_guard lock(stage_->mutex);
    const Faults& faults = stage_->faults;
    const std::uint64_t photo = taken_++;
    counter_ += faults.dropped(photo);
    const RowExposure rows{stage_->now, exposure_ms_ * 1e-3, spec_.rolling_shutter_ms * 1e-3, spec_.resolution[1]};
    std::vector<Parts> seen;
    std::uint64_t state = faults.acting(photo);
    for (const Timeline& p : stage_->projectors) {
      seen.push_back(p.parts(rows, glasses_, faults.stale(photo)));
      state = hash_parts(state, seen.back());
    }
    const Simulation& room = stage_->simulator->simulation();
    const std::vector<double> swing = swings(rows, room.ambient > 0 ? room.ambient_swing : 0, room.ambient_hz);
    for (const double s : swing) state = mix(state ^ std::bit_cast<std::uint64_t>(s));
    if (light_.empty() || light_state_ != state)
      light_ = stage_->simulator->optics(index_, look(std::move(seen), swing, photo)), light_state_ = state;
    // Stops beside the reference exposure, so that each exposure of a bracket has its own noise, whichever were before.
    const auto stops = std::llround(1e3 * std::log2(exposure_ms_ / spec_.reference_exposure_ms));
    const std::uint64_t nth = stage_->photos_since_show[index_][exposure_ms_]++;
    const std::uint64_t draw = mix(state) ^ mix(nth + (static_cast<std::uint64_t>(stops) << 32));
    capture::Exposure exposure = faults.empty() ? exposed(light_, exposure_ms_, draw) : faulty(light_, photo, draw);
    exposure.counter = counter_++;
    exposure.timestamp_s = rows.start * (1 + 1e-6 * spec_.clock_drift_ppm) + 1e-3 * spec_.timestamp_offset_ms;
    stage_->now += rows.exposure + rows.rolling + kReadOut;
    return exposure;
  }

 private:
  // An exposure that says it is what was asked for, whatever the camera or the faults make of it.
  capture::Exposure exposed(const Image& light, double exposure_ms, std::uint64_t draw) const {
    capture::Exposure exposure =
        stage_->simulator->expose(index_, light, adapted_exposure_ms(light, spec_, exposure_ms), draw);
    exposure.exposure_ms = exposure_ms_;
    return exposure;
  }
  capture::Exposure faulty(Image light, std::uint64_t photo, std::uint64_t draw) {
    const Faults& faults = stage_->faults;
    if (faults.duplicated(photo) && !former_.values.empty()) return former_;
    faults.light(light, photo);
    capture::Exposure exposure = exposed(light, exposure_ms_ * faults.exposure_factor(light, photo), draw);
    faults.arrived(exposure, photo);
    return former_ = exposure;
  }

  // What the projectors really emit instead of the parts' pictures.
  void emit(std::vector<Parts>& seen, std::uint64_t photo) const {
    std::size_t layers = 0;
    for (const Parts& parts : seen) layers = std::max(layers, parts.size());
    for (std::size_t i = 0; i < layers; ++i) {
      std::vector<Picture> pictures;
      for (const Parts& parts : seen)
        pictures.push_back(parts.empty() ? Picture() : *parts[std::min(i, parts.size() - 1)].shown.picture);
      pictures = stage_->faults.emitted(std::move(pictures), photo);
      for (std::size_t q = 0; q < seen.size(); ++q)
        if (i < seen[q].size()) seen[q][i].shown.picture = std::make_shared<const Picture>(std::move(pictures[q]));
    }
  }

  // The camera's view, where somebody has moved it by that photo; else none.
  const View* moved_view(std::uint64_t photo) {
    const std::optional<Pose> move = stage_->faults.camera_move(photo);
    if (!move) return nullptr;
    if (!moved_ || move->translation != moved_to_.translation || move->rotation != moved_to_.rotation)
      moved_ = stage_->simulator->moved_view(index_, *move), moved_to_ = *move;
    return moved_.get();
  }

  // Light before the lens: what is the same for all rows at once, then each part that differs, row by row. `swing`: of
  // the surround, per row or one for all.
  Image look(std::vector<Parts> seen, const std::vector<double>& swing, std::uint64_t photo) {
    using Share = Simulator::PictureShare;
    if (!stage_->faults.empty()) emit(seen, photo);
    const View* moved = moved_view(photo);
    const auto light_of = [&](std::span<const std::vector<Share>> shown) {
      return stage_->simulator->mixed_light(index_, shown, moved);
    };
    // Closed glasses are as dark for the surround: all light through open ones, then dimmed.
    const double dim = (glasses_.left + glasses_.right) / 2;
    const std::vector<std::vector<Share>> dark(seen.size());
    Image surround;  // no projector's light
    const auto nothing = [&]() -> const Image& {
      if (surround.empty()) surround = light_of(dark);
      return surround;
    };
    std::vector<std::vector<Share>> steady = dark;
    for (std::size_t q = 0; q < seen.size(); ++q)
      for (const Timeline::Part& part : seen[q])
        if (part.share.size() == 1)
          steady[q].push_back({part.shown.picture.get(), part.share[0] / static_cast<float>(dim)});
    Image light = light_of(steady);
    std::map<std::uint64_t, Image> used;
    for (std::size_t q = 0; q < seen.size(); ++q)
      for (const Timeline::Part& part : seen[q]) {
        if (part.share.size() == 1) continue;
        const bool grey = std::all_of(part.share.begin(), part.share.end(),
                                      [](const Light4& s) { return s[0] == s[1] && s[1] == s[2]; });
        for (int c = 0; c < (grey ? 1 : 3); ++c) {
          const std::uint64_t key = mix(mix(part.shown.hash ^ stage_->faults.acting(photo)) ^ (8 * q + (grey ? 3 : c)));
          Image& alone = used[key];
          if (const auto known = alone_.find(key); known != alone_.end()) {
            alone = std::move(known->second);
          } else {
            std::vector<std::vector<Share>> one = dark;
            one[q].push_back(
                {part.shown.picture.get(), grey ? Light4(Light4::Ones()) : Light4(Eigen::Vector4f::Unit(c).array())});
            alone = light_of(one);
            for (std::size_t i = 0; i < alone.data().size(); ++i) alone.data()[i] -= nothing().data()[i];
          }
          for (int y = 0; y < light.height(); ++y)
            for (int i = 0; i < light.width() * light.channels(); ++i)
              light.row(y)[i] += part.share[y][c] / static_cast<float>(dim) * alone.row(y)[i];
        }
      }
    alone_ = std::move(used);
    for (int y = 0; y < light.height() && !swing.empty(); ++y)
      for (int i = 0; i < light.width() * light.channels(); ++i)
        light.row(y)[i] += static_cast<float>(swing[swing.size() > 1 ? y : 0]) * nothing().row(y)[i];
    if (dim != 1)
      for (float& v : light.data()) v *= static_cast<float>(dim);
    return light;
  }

  std::shared_ptr<Stage> stage_;
  int index_;
  SimulatedCamera spec_;
  Glasses glasses_;
  double exposure_ms_ = 0;
  std::uint64_t counter_ = 0, taken_ = 0;
  capture::Exposure former_;
  std::shared_ptr<const View> moved_;  // of a camera that somebody moved
  Pose moved_to_;
  std::uint64_t light_state_ = 0;
  Image light_;                           // of the last state, after optics; empty = none
  std::map<std::uint64_t, Image> alone_;  // light of single pictures that the last photo's rows saw for different times
};

}  // namespace

capture::Devices simulated_devices(std::shared_ptr<const Simulator> simulator, std::vector<Fault> faults) {
  auto stage = std::make_shared<Stage>();
  stage->simulator = simulator;
  const Rig& rig = simulator->rig();
  const Simulation& simulation = simulator->simulation();
  stage->faults = Faults(std::move(faults), simulation.seed);
  stage->photos_since_show.resize(rig.cameras.size());
  capture::Devices devices;
  for (std::size_t q = 0; q < rig.projectors.size(); ++q) {
    const ProjectorSpec& spec = rig.projectors[q];
    for (const SimulatedProjector& p : simulation.projectors)
      if (p.id == spec.id) {
        stage->projectors.emplace_back(p, simulation.seed,
                                       shown_of(Picture(spec.resolution[0], spec.resolution[1], 3)));
        devices.projectors.push_back(std::make_unique<SimulatedProjectorDevice>(stage, static_cast<int>(q), spec, p));
      }
  }
  for (std::size_t c = 0; c < rig.cameras.size(); ++c)
    for (const SimulatedCamera& camera : simulation.cameras)
      if (camera.id == rig.cameras[c].id)
        devices.cameras.push_back(std::make_unique<SimulatedCameraDevice>(stage, static_cast<int>(c), camera));
  devices.clock = [stage](double ms) {
    const std::lock_guard lock(stage->mutex);
    stage->now += 1e-3 * ms;
  };
  return devices;
}

}  // namespace countershade::simdata

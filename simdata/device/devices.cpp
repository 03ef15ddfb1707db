// Simulated cameras and projectors: one room, shown and photographed through the interfaces of real devices.
#include <algorithm>
#include <cstring>
#include <map>
#include <mutex>

#include "calib/base/random.h"
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

struct Shown {
  Picture picture;  // empty = black
  std::uint64_t hash = 0;
};

// The room as all devices share it.
struct Stage {
  std::shared_ptr<const Simulator> simulator;
  Faults faults;
  std::mutex mutex;
  struct Screening {
    Shown former, newest;
    std::vector<int> photos;  // per camera, since the newest show()
    int latency = 0;
  };
  std::vector<Screening> projectors;
  std::vector<std::uint64_t> photos_since_show;  // per camera, since the newest show() of any projector
  struct Cache {
    std::uint64_t state = 0;
    Image light;  // after optics; empty = none
  };
  std::vector<Cache> caches;  // per camera
};

class SimulatedProjectorDevice final : public capture::Projector {
 public:
  SimulatedProjectorDevice(std::shared_ptr<Stage> stage, int index, const ProjectorSpec& spec)
      : stage_(std::move(stage)),
        index_(index),
        id_(spec.id),
        width_(spec.resolution[0]),
        height_(spec.resolution[1]) {}
  const std::string& id() const override { return id_; }
  int width() const override { return width_; }
  int height() const override { return height_; }
  Result<void> show(const Picture& picture) override {
    CS_CHECK(picture.same_size(width_, height_) && picture.channels() == 3,
             "projector '" + id_ + "' is sent a picture that is not of its size");
    Shown shown{picture, hash_picture(picture)};
    const std::lock_guard lock(stage_->mutex);
    Stage::Screening& screening = stage_->projectors[index_];
    screening.former = std::move(screening.newest);
    screening.newest = std::move(shown);
    std::fill(screening.photos.begin(), screening.photos.end(), 0);
    std::fill(stage_->photos_since_show.begin(), stage_->photos_since_show.end(), 0);
    return {};
  }

 private:
  std::shared_ptr<Stage> stage_;
  int index_;
  std::string id_;
  int width_, height_;
};

class SimulatedCameraDevice final : public capture::Camera {
 public:
  SimulatedCameraDevice(std::shared_ptr<Stage> stage, int index, const std::string& id, double reference_ms)
      : stage_(std::move(stage)), index_(index), id_(id), reference_ms_(reference_ms) {}
  const std::string& id() const override { return id_; }
  Result<void> arm(double exposure_ms) override {
    if (!(exposure_ms >= 0))
      return error(ErrorCode::kBadValue, "camera '{}': exposure of {} ms; it must be positive, or 0 for the default",
                   id_, exposure_ms);
    exposure_ms_ = exposure_ms > 0 ? exposure_ms : reference_ms_;
    return {};
  }
  Result<capture::Exposure> trigger() override {
    CS_CHECK(exposure_ms_ > 0, "camera '" + id_ + "' is triggered before it is armed");
    const std::lock_guard lock(stage_->mutex);
    const Faults& faults = stage_->faults;
    const std::uint64_t photo = taken_++;
    counter_ += faults.dropped(photo);
    std::vector<const Shown*> seen;
    std::uint64_t state = faults.acting(photo);
    for (Stage::Screening& p : stage_->projectors) {
      const bool late = p.photos[index_]++ < p.latency || faults.stale(photo);
      seen.push_back(late ? &p.former : &p.newest);
      state = mix(state ^ seen.back()->hash);
    }
    Stage::Cache& cache = stage_->caches[index_];
    if (cache.light.empty() || cache.state != state) cache = {state, look(seen, photo)};
    const std::uint64_t draw = mix(state) ^ mix(stage_->photos_since_show[index_]++);
    capture::Exposure exposure = faults.empty() ? stage_->simulator->expose(index_, cache.light, exposure_ms_, draw)
                                                : faulty(cache.light, photo, draw);
    exposure.counter = counter_++;
    clock_s_ += exposure_ms_ * 1e-3 + 0.02;  // a device clock that runs on photos alone
    exposure.timestamp_s = clock_s_;
    return exposure;
  }

 private:
  // An exposure that says it is what was asked for, whatever the faults make of it.
  capture::Exposure faulty(Image light, std::uint64_t photo, std::uint64_t draw) {
    const Faults& faults = stage_->faults;
    if (faults.duplicated(photo) && !former_.values.empty()) return former_;
    faults.light(light, photo);
    const double real_ms = exposure_ms_ * faults.exposure_factor(light, photo);
    capture::Exposure exposure = stage_->simulator->expose(index_, light, real_ms, draw);
    exposure.exposure_ms = exposure_ms_;
    faults.arrived(exposure, photo);
    return former_ = exposure;
  }

  Image look(const std::vector<const Shown*>& seen, std::uint64_t photo) const {
    std::vector<Picture> pictures;
    for (const Shown* s : seen) pictures.push_back(s->picture);
    pictures = stage_->faults.emitted(std::move(pictures), photo);
    return stage_->simulator->optics(index_, stage_->simulator->total_light(index_, pictures));
  }

  std::shared_ptr<Stage> stage_;
  int index_;
  std::string id_;
  double reference_ms_, exposure_ms_ = 0, clock_s_ = 0;
  std::uint64_t counter_ = 0, taken_ = 0;
  capture::Exposure former_;
};

}  // namespace

capture::Devices simulated_devices(std::shared_ptr<const Simulator> simulator, std::vector<Fault> faults) {
  auto stage = std::make_shared<Stage>();
  stage->simulator = simulator;
  stage->faults = Faults(std::move(faults), simulator->simulation().seed);
  const Rig& rig = simulator->rig();
  const Simulation& simulation = simulator->simulation();
  stage->photos_since_show.assign(rig.cameras.size(), 0);
  stage->caches.resize(rig.cameras.size());
  capture::Devices devices;
  for (std::size_t q = 0; q < rig.projectors.size(); ++q) {
    const ProjectorSpec& spec = rig.projectors[q];
    Stage::Screening screening;
    screening.photos.assign(rig.cameras.size(), 0);
    for (const SimulatedProjector& p : simulation.projectors)
      if (p.id == spec.id) screening.latency = p.latency_frames;
    const Picture black(spec.resolution[0], spec.resolution[1], 3);
    screening.former = screening.newest = {black, hash_picture(black)};
    stage->projectors.push_back(std::move(screening));
    devices.projectors.push_back(std::make_unique<SimulatedProjectorDevice>(stage, static_cast<int>(q), spec));
  }
  for (std::size_t c = 0; c < rig.cameras.size(); ++c)
    for (const SimulatedCamera& camera : simulation.cameras)
      if (camera.id == rig.cameras[c].id)
        devices.cameras.push_back(std::make_unique<SimulatedCameraDevice>(stage, static_cast<int>(c), camera.id,
                                                                          camera.reference_exposure_ms));
  return devices;
}

}  // namespace countershade::simdata

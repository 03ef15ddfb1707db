#include "capture/device/health.h"

#include <atomic>
#include <cfloat>

#include "calib/base/parallel.h"

namespace countershade::capture {

namespace {

constexpr int kFewPhotos = 10;      // of which nothing can be said
constexpr double kMostAgain = 0.2;  // share of all photos that may have to be taken again
constexpr double kMostBack = 0.1;   // share of them at which the clock may fall back

class Watched final : public Camera {
 public:
  explicit Watched(std::unique_ptr<Camera> camera) : camera_(std::move(camera)) {}
  const std::string& id() const override { return camera_->id(); }
  Health health() const override { return health_; }
  Result<void> arm(double exposure_ms) override {
    auto armed = camera_->arm(exposure_ms);
    health_.failure = armed ? "" : armed.error().message;
    return armed;
  }
  Result<Exposure> trigger() override {
    auto taken = camera_->trigger();
    if (taken)
      if (const auto possible = check(*taken); !possible) taken = possible.error();
    health_.failure = taken ? "" : taken.error().message;
    if (!taken) return taken;
    if (health_.photos > 0 && taken->timestamp_s < former_s_) ++health_.clock_back;
    former_s_ = taken->timestamp_s;
    ++health_.photos, health_.again += taken->lost;
    return taken;
  }

 private:
  Result<void> check(const Exposure& e) const {
    if (e.values.empty()) return error(ErrorCode::kDevice, "camera '{}' gave a photo without pixels", id());
    std::atomic<bool> possible = e.full_scale > 0;
    // Of files that hold fractions a highlight may be above 1, and noise below 0.
    const bool fractions = e.full_scale == 1;
    const float least = fractions ? -FLT_MAX : 0, full = fractions ? FLT_MAX : static_cast<float>(e.full_scale);
    const int values = e.values.width() * e.values.channels();
    parallel_for(e.values.height(), [&](int y) {
      const float* row = e.values.row(y);
      bool all = true;
      for (int i = 0; i < values; ++i) all &= row[i] >= least && row[i] <= full;  // false for what is no number
      if (!all) possible = false;
    });
    if (possible) return {};
    return error(ErrorCode::kDevice,
                 "camera '{}' gave a photo with values that are no numbers, or beyond 0 to {}; is it in another format "
                 "than it says?",
                 id(), e.full_scale);
  }

  std::unique_ptr<Camera> camera_;
  Health health_;
  double former_s_ = 0;
};

}  // namespace

std::string Health::unhealthy() const {
  if (!failure.empty()) return failure;
  if (photos + again < kFewPhotos) return "";
  if (again > kMostAgain * (photos + again))
    return fmt::format(
        "{} of {} photos did not arrive whole and were taken again: cable, network card, hub, or fewer "
        "programs on this computer",
        again, photos + again);
  if (clock_back > kMostBack * photos)
    return fmt::format(
        "the times of {} of {} photos fall back behind the photo before: photos come in another order "
        "than they were taken, or its clock is set while it runs",
        clock_back, photos);
  return "";
}

std::unique_ptr<Camera> watched(std::unique_ptr<Camera> camera) {
  return std::make_unique<Watched>(std::move(camera));
}

}  // namespace countershade::capture

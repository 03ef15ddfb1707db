#include "tools/job/photographs.h"

#include <algorithm>
#include <cmath>

#include "calib/base/parallel.h"
#include "capture/pattern/pattern.h"
#include "tools/job/devices.h"

namespace countershade::tools {

namespace {

// Width of a stripe: three pixels of margin at the better of two shifts, several times any projector's and camera's
// blur, and yet far finer than the scale on which indirect light changes.
constexpr int kStripePx = 12;
constexpr int kSteps = 4;

Picture masked(const Picture& picture, int step) {
  Picture out = picture;
  for (int y = 0; y < out.height(); ++y)
    for (int x = 0; x < out.width(); ++x) {
      const int phase = ((x - step * kStripePx / 2) % (2 * kStripePx) + 2 * kStripePx) % (2 * kStripePx);
      if (phase >= kStripePx)
        for (int c = 0; c < 3; ++c) out.at(x, y, c) = 0;
    }
  return out;
}

// Of the pairs (step, step + 2), the one whose stripes have their edges farther from column x, lit step first.
std::pair<int, int> best_pair(float x) {
  std::pair<int, int> best{0, 2};
  double margin = -1;
  for (int step = 0; step < 2; ++step) {
    const double phase = std::fmod(x + 0.5 - step * kStripePx / 2.0 + 4.0 * kStripePx, 2.0 * kStripePx);
    const double inside = std::fmod(phase, kStripePx);
    const double m = std::min(inside, kStripePx - inside);
    if (m <= margin) continue;
    margin = m;
    best = phase < kStripePx ? std::pair{step, step + 2} : std::pair{step + 2, step};
  }
  return best;
}

Result<void> show_all(const capture::Devices& devices, std::span<const Picture> pictures, int only = -1) {
  for (std::size_t q = 0; q < devices.projectors.size(); ++q) {
    capture::Projector& p = *devices.projectors[q];
    const bool lit = only < 0 || only == static_cast<int>(q);
    CS_TRY_VOID(p.show(lit && !pictures[q].empty() ? pictures[q] : Picture(p.width(), p.height(), 3)));
  }
  devices.wait(kSettledMs);
  return {};
}

double noise_of(const Image& average) {
  Photo photo{average, Mask(average.width(), average.height(), 1, 1), 0};
  const NoiseModel noise = estimate_noise(std::span(&photo, 1));
  return noise.sigma(0.4);
}

}  // namespace

Result<Image> average_exposure(capture::Camera& camera, const CameraSpec& spec, int count) {
  Image sum;
  for (int i = 0; i < count; ++i) {
    CS_TRY(const capture::Exposure exposure, camera.trigger());
    Photo photo = photo_of(exposure, spec);
    if (i == 0) {
      sum = std::move(photo.value);
      continue;
    }
    for (std::size_t k = 0; k < sum.data().size(); ++k) sum.data()[k] += photo.value.data()[k];
  }
  for (float& v : sum.data()) v /= static_cast<float>(count);
  return sum;
}

Result<Photographs> photograph(const capture::Devices& devices, const CameraSpec& spec,
                               const solver::PixelGeometry& pixels, std::span<const Picture> plain,
                               std::span<const Picture> compensated, double veil, int exposures, Progress& progress) {
  CS_CHECK(plain.size() == devices.projectors.size() && compensated.size() == plain.size(),
           "one picture per projector");
  capture::Camera* camera = nullptr;
  for (const auto& c : devices.cameras)
    if (c->id() == spec.id) camera = c.get();
  if (!camera)
    return error(ErrorCode::kDevice, "camera '{}' of the calibration is not among the open cameras", spec.id);
  CS_TRY_VOID(camera->arm(spec.exposures_ms.empty() ? 0 : spec.exposures_ms.front()));
  Photographs result;
  const int total = 3 + kSteps * static_cast<int>(plain.size());
  int done = 0;
  const auto take = [&]() -> Result<Image> {
    progress.step("photographs", done++, total);
    result.exposures += exposures;
    CS_TRY(Image photo, average_exposure(*camera, spec, exposures));
    take_out_veil(photo, veil);
    return photo;
  };
  CS_TRY_VOID(show_all(devices, plain));
  CS_TRY(result.uncompensated, take());
  CS_TRY_VOID(show_all(devices, compensated));
  CS_TRY(result.compensated, take());
  const std::vector<Picture> nothing(plain.size());
  CS_TRY_VOID(show_all(devices, nothing));
  CS_TRY(result.black, take());  // what no mask can take away
  result.target = result.black;
  for (std::size_t q = 0; q < plain.size(); ++q) {
    if (plain[q].empty()) continue;
    std::vector<Image> photos;
    for (int step = 0; step < kSteps; ++step) {
      std::vector<Picture> shown(plain.size());
      shown[q] = masked(plain[q], step);
      CS_TRY_VOID(show_all(devices, shown, static_cast<int>(q)));
      CS_TRY(Image photo, take());
      photos.push_back(std::move(photo));
    }
    const int channels = result.target.channels();
    parallel_for(result.target.height(), [&](int y) {
      for (int x = 0; x < result.target.width(); ++x) {
        const float column = pixels.beam[q][static_cast<std::size_t>(y) * pixels.width + x].x();
        if (std::isnan(column)) continue;
        const auto [lit, dark] = best_pair(column);
        for (int c = 0; c < channels; ++c)
          result.target.at(x, y, c) += photos[lit].at(x, y, c) - photos[dark].at(x, y, c);
      }
    });
  }
  progress.step("photographs", total, total);
  result.pixel_noise = noise_of(result.uncompensated);
  return result;
}

}  // namespace countershade::tools

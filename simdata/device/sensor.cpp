#include "simdata/device/sensor.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <numbers>
#include <vector>

#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "calib/photometry/response.h"

namespace countershade::simdata {

namespace {

constexpr int kNormals = 65536;

// Quantiles of the normal distribution at (i + 1/2) / 65536, mean zero by symmetry.
std::vector<float> normal_quantiles() {
  std::vector<float> table(kNormals);
  double x = 0;
  for (int i = kNormals / 2; i < kNormals; ++i) {
    const double p = (i + 0.5) / kNormals;
    for (int k = 0; k < 50; ++k) {  // Newton; rises to the root since the function is concave here
      const double step =
          (p - 0.5 * std::erfc(-x / std::numbers::sqrt2)) * std::sqrt(2 * std::numbers::pi) * std::exp(0.5 * x * x);
      x += step;
      if (std::abs(step) < 1e-12) break;
    }
    table[i] = static_cast<float>(x);
    table[kNormals - 1 - i] = -table[i];
  }
  return table;
}

const std::vector<float>& normals() {
  static const std::vector<float> table = normal_quantiles();
  return table;
}

}  // namespace

capture::Exposure expose(const Image& light, const SimulatedCamera& camera, const CameraSpec& spec, double exposure_ms,
                         std::uint64_t key) {
  const std::vector<float>& normal = normals();
  const Response response = Response::parse(spec.response).value();
  const bool linear = spec.response == "linear";
  capture::Exposure out;
  out.full_scale = std::ldexp(1.0, camera.bits) - 1;
  out.exposure_ms = exposure_ms;
  out.values = Image(light.width(), light.height(), light.channels());
  const float full = static_cast<float>(out.full_scale), pedestal = static_cast<float>(spec.pedestal);
  const float span = full - pedestal;
  const float gain = static_cast<float>(exposure_ms / camera.reference_exposure_ms);
  const float photon = static_cast<float>(1 / camera.full_well_e);
  const float read = static_cast<float>(std::pow(camera.read_noise_e / camera.full_well_e, 2));
  const int channels = light.channels();
  std::atomic<std::int64_t> saturated{0};
  parallel_for(light.height(), [&](int y) {
    const float* from = light.row(y);
    float* to = out.values.row(y);
    std::int64_t clipped = 0;
    const std::uint64_t row_key = mix(key ^ mix(static_cast<std::uint64_t>(y)));
    for (int x = 0; x < light.width(); ++x) {
      std::uint64_t bits = mix(row_key + static_cast<std::uint64_t>(x));
      bool at_full = false;
      for (int c = 0; c < channels; ++c, bits >>= 16) {
        const float mean = std::max(0.0f, *from++ * gain);
        float value = mean + std::sqrt(mean * photon + read) * normal[bits & (kNormals - 1)];
        if (!linear) value = static_cast<float>(response.encode(value));
        const float stored = std::clamp(std::floor(pedestal + span * value + 0.5f), 0.0f, full);
        at_full |= stored >= full;
        *to++ = stored;
      }
      clipped += at_full;
    }
    saturated += clipped;
  });
  out.saturated = static_cast<double>(saturated) / static_cast<double>(light.pixels());
  return out;
}

}  // namespace countershade::simdata

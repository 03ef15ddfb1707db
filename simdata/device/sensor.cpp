#include "simdata/device/sensor.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <numbers>
#include <vector>

#include "calib/base/parallel.h"
#include "calib/base/random.h"
#include "calib/image/demosaic.h"
#include "calib/photometry/response.h"
#include "simdata/device/blur.h"

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

// 0 red, 1 green, 2 blue.
int colour_at(const std::string& pattern, int x, int y) {
  return static_cast<int>(std::string_view("RGB").find(pattern[(y & 1) * 2 + (x & 1)]));
}

// Light as the sensor's pixels take it: one colour each under a Bayer filter, hot pixels with their own.
Image on_sensor(const Image& light, const SimulatedCamera& camera, std::uint64_t sensor) {
  Image taken = light;
  if (camera.bayer != "none") {
    taken = Image(light.width(), light.height(), 1);
    for (int y = 0; y < light.height(); ++y)
      for (int x = 0; x < light.width(); ++x) taken.at(x, y) = light.at(x, y, colour_at(camera.bayer, x, y));
  }
  Random random(sensor ^ hash_name("hot pixels"));
  for (int i = 0; i < camera.hot_pixels; ++i) {
    const int x = static_cast<int>(random.uniform() * light.width());
    const int y = static_cast<int>(random.uniform() * light.height());
    const float dark = static_cast<float>(random.uniform(0.05, 1));
    for (int c = 0; c < taken.channels(); ++c) taken.at(x, y, c) += dark;
  }
  return taken;
}

double share_at(const Image& values, float full) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < values.pixels(); ++i) {
    const float* v = values.data().data() + i * values.channels();
    count += std::any_of(v, v + values.channels(), [&](float one) { return one >= full; });
  }
  return static_cast<double>(count) / static_cast<double>(values.pixels());
}

capture::Exposure read_out(const Image& light, const SimulatedCamera& camera, const CameraSpec& spec,
                           double exposure_ms, std::uint64_t key) {
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

}  // namespace

void add_glare(Image& light, double share) {
  if (share == 0) return;
  const int channels = light.channels();
  std::vector<double> sum(channels);
  for (std::size_t i = 0; i < light.data().size(); ++i) sum[i % channels] += light.data()[i];
  for (std::size_t i = 0; i < light.data().size(); ++i)
    light.data()[i] += static_cast<float>(share * sum[i % channels] / static_cast<double>(light.pixels()));
}

Image through_lens(const Image& light, const SimulatedCamera& camera) {
  Image seen = blurred(light, camera.psf_sigma_px);
  add_glare(seen, camera.veiling_glare);
  return seen;
}

capture::Exposure expose(const Image& light, const SimulatedCamera& camera, const CameraSpec& spec, double exposure_ms,
                         std::uint64_t key, std::uint64_t sensor) {
  if (camera.bayer == "none" && camera.hot_pixels == 0) return read_out(light, camera, spec, exposure_ms, key);
  capture::Exposure exposure = read_out(on_sensor(light, camera, sensor), camera, spec, exposure_ms, key);
  if (camera.bayer == "none") return exposure;
  exposure.values = demosaiced(exposure.values, camera.bayer);
  exposure.saturated = share_at(exposure.values, static_cast<float>(exposure.full_scale));
  return exposure;
}

double adapted_exposure_ms(const Image& light, const SimulatedCamera& camera, double exposure_ms) {
  if (camera.auto_exposure == 0) return exposure_ms;
  double sum = 0;
  for (float v : light.data()) sum += v;
  const double mean = sum / static_cast<double>(light.data().size()) * exposure_ms / camera.reference_exposure_ms;
  return exposure_ms * std::pow(0.18 / std::max(mean, 1e-3), camera.auto_exposure);
}

}  // namespace countershade::simdata

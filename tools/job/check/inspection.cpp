#include "tools/job/check/inspection.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

#include "capture/session/latency.h"
#include "tools/job/devices.h"
#include "tools/report/picture.h"

namespace countershade::tools {

namespace {

constexpr int kSteps = 8;   // of latency, up and down
constexpr int kStill = 10;  // photos of a light that should not change
constexpr int kFine = 2,
              kCoarse = 8;  // widths of stripes [projector px]: the finest that help, the widest that must be seen

double mean_of(const Image& image) {
  return std::accumulate(image.data().begin(), image.data().end(), 0.0) / std::max<std::size_t>(1, image.data().size());
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto nth = values.begin() + static_cast<std::ptrdiff_t>(std::lround(share * (values.size() - 1)));
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

// Stripes of `cell` pixels, or their inverse.
Picture stripes(const capture::Projector& p, int cell, bool inverse) {
  Picture picture(p.width(), p.height(), 3);
  for (int y = 0; y < p.height(); ++y)
    for (int x = 0; x < p.width(); ++x) {
      const bool lit = (x / cell % 2 == 0) != inverse;
      for (int c = 0; c < 3; ++c) picture.at(x, y, c) = lit ? 65535 : 0;
    }
  return picture;
}

bool is_whole(double count) {
  return count > 0.98 && std::abs(count - std::round(count)) < 0.02 * count;
}

// What to do about light that swings in the dark: lamps pulse twice per period of the mains.
std::string mains_remedy(double exposure_ms, double refresh_hz) {
  std::string expose;
  for (const double pulses_hz : {100.0, 120.0})
    if (const auto ms = whole_pulses(exposure_ms, refresh_hz, pulses_hz);
        ms && !is_whole(exposure_ms * 1e-3 * pulses_hz))
      expose += fmt::format("{}{:.4g} ms on mains of {:.0f} Hz", expose.empty() ? "" : ", ", *ms, pulses_hz / 2);
  const bool whole_of_both = is_whole(exposure_ms * 1e-3 * 100) && is_whole(exposure_ms * 1e-3 * 120);
  if (expose.empty() && !whole_of_both)
    return "a lamp pulses: switch it off; no exposure of up to twelve refreshes is whole pulses of the mains";
  if (expose.empty())
    return "light comes and goes, and not with the mains (the exposure is whole pulses of both): dimmed LEDs, a "
           "screen, daylight through moving leaves; switch it off or close the blind";
  return fmt::format(
      "a lamp pulses: switch it off, or set exposures_ms to whole refreshes that are whole pulses too: {}", expose);
}

struct Taken {
  Image light;                    // grey: mean of the channels
  std::array<float, 3> channels;  // their means
  double saturated;               // share of pixels
  double from_ms;
};

// One camera, and all projectors that light what it sees.
class Look {
 public:
  Look(const capture::Devices& devices, capture::Camera& camera, const CameraSpec& spec)
      : devices_(devices), camera_(camera), spec_(spec), refresh_hz_(1e3 / devices.refresh_ms()) {}

  Result<void> all(Inspection& to);

 private:
  std::string about(const std::string& what) const { return fmt::format("camera {}: {}", spec_.id, what); }
  Result<void> show(const std::function<Picture(const capture::Projector&, int)>& picture, double wait_ms = kSettledMs);
  Result<void> show_flat(std::uint16_t value, double wait_ms = kSettledMs, int only = -1);
  Result<Taken> take();
  Result<void> latency(Inspection& to);
  Result<void> steadiness(Inspection& to);
  Result<void> exposures(Inspection& to);
  Result<void> coverage(Inspection& to);
  Result<void> sharpness(Inspection& to);
  Result<void> stillness(Inspection& to);

  const capture::Devices& devices_;
  capture::Camera& camera_;
  const CameraSpec& spec_;
  const double refresh_hz_;
  Image black_, white_;  // settled, all projectors
  double exposure_ms_ = 0;
  std::optional<std::uint64_t> counter_;
  int counter_gaps_ = 0;
};

Result<void> Look::show(const std::function<Picture(const capture::Projector&, int)>& picture, double wait_ms) {
  for (std::size_t q = 0; q < devices_.projectors.size(); ++q)
    CS_TRY_VOID(devices_.projectors[q]->show(picture(*devices_.projectors[q], static_cast<int>(q))));
  devices_.wait(wait_ms);
  return {};
}

Result<void> Look::show_flat(std::uint16_t value, double wait_ms, int only) {
  return show(
      [&](const capture::Projector& p, int q) {
        return Picture(p.width(), p.height(), 3, only < 0 || q == only ? value : std::uint16_t{0});
      },
      wait_ms);
}

Result<Taken> Look::take() {
  CS_TRY(const capture::Exposure e, camera_.trigger());
  const Photo photo = photo_of(e, spec_);
  const auto invalid = std::count(photo.valid.data().begin(), photo.valid.data().end(), 0);
  exposure_ms_ = e.exposure_ms;
  if (counter_ && e.counter > *counter_ + 1) counter_gaps_ += static_cast<int>(e.counter - *counter_ - 1);
  counter_ = e.counter;
  return Taken{luminance_mean(photo.value), channel_means(photo.value),
               static_cast<double>(invalid) / std::max<std::size_t>(1, photo.valid.pixels()), 1e3 * e.timestamp_s};
}

// Steps from black to white and back.
Result<void> Look::latency(Inspection& to) {
  std::vector<double> after_ms;
  const double dark = mean_of(black_), bright = mean_of(white_);
  for (int step = 0; step < kSteps; ++step) {
    const bool up = step % 2 == 0;
    CS_TRY_VOID(show_flat(up ? 65535 : 0, 0));
    std::vector<capture::StepPhoto> photos;
    while (photos.size() < 2 || (photos.size() < 16 && photos.back().share < capture::kWholeChange)) {
      CS_TRY(const Taken t, take());
      const double share = (mean_of(t.light) - dark) / std::max(1e-9, bright - dark);
      photos.push_back({t.from_ms, exposure_ms_, up ? share : 1 - share});
    }
    after_ms.push_back(capture::appearance(photos).latest_ms);
  }
  const double longest = percentile(after_ms, 1), spread = longest - percentile(after_ms, 0);
  Finding f{
      about("latency of steps"),
      fmt::format("median {:.0f} ms, longest {:.0f} ms, spread {:.0f} ms", percentile(after_ms, .5), longest, spread),
      "switch frame interpolation and picture improvement of projector and display off (game mode); the capture "
      "waits as long as it measures",
      longest < 200};
  f.caution = longest > 100 || spread > 1.5e3 / refresh_hz_;
  to.findings.push_back(std::move(f));
  return {};
}

// What changes though nothing should: lamps on mains, colour wheels and pulses that an exposure cuts.
Result<void> Look::steadiness(Inspection& to) {
  const double swing = std::max(1e-9, mean_of(white_) - mean_of(black_));
  for (const bool lit : {false, true}) {
    CS_TRY_VOID(show_flat(lit ? 65535 : 0));
    std::array<std::vector<double>, 3>
        means;  // of each colour: a wheel's turns add up to white in all of them together
    for (int i = 0; i < kStill; ++i) {
      CS_TRY(const Taken t, take());
      for (int c = 0; c < 3; ++c) means[c].push_back(t.channels[c]);
    }
    double range = 0;
    for (const auto& m : means) range = std::max(range, percentile(m, 1) - percentile(m, 0));
    Finding f{about(lit ? "light of white from photo to photo" : "light of black from photo to photo"),
              fmt::format("swings by {:.2f} % of white", 100 * range / swing),
              lit ? fmt::format(
                        "the exposure cuts a colour wheel's turn or a pulse: expose whole refreshes, such as {:.4g} ms",
                        whole_refreshes(exposure_ms_, refresh_hz_))
                  : mains_remedy(exposure_ms_, refresh_hz_),
              range < 0.02 * swing};
    f.caution = range > 0.004 * swing;
    to.findings.push_back(std::move(f));
  }
  return {};
}

Result<void> Look::exposures(Inspection& to) {
  CS_TRY_VOID(show_flat(65535));
  std::vector<float> sorted = white_.data();
  std::sort(sorted.begin(), sorted.end());
  const double bright = std::max(1e-4f, sorted[static_cast<std::size_t>(0.99 * (sorted.size() - 1))]);
  const double wanted = whole_refreshes(exposure_ms_ * 0.8 / bright, refresh_hz_);
  const double now = exposure_ms_ * refresh_hz_ / 1e3;
  Finding f{
      about("exposure"),
      fmt::format("{:.3g} ms is {:.2f} refreshes of {:.0f} Hz; {:.3f} ms would bring white to {:.0f} % of full scale",
                  exposure_ms_, now, refresh_hz_, wanted, 100 * bright * wanted / std::max(1e-9, exposure_ms_)),
      fmt::format("exposures_ms = [{:.3f}]; if white is then too bright, close the lens's aperture", wanted), true};
  f.caution = !is_whole(now) || std::abs(wanted / std::max(1e-9, exposure_ms_) - 1) > 0.6;
  to.findings.push_back(std::move(f));

  const std::vector<double> listed = spec_.exposures_ms.empty() ? std::vector<double>{0} : spec_.exposures_ms;
  for (double ms : listed) {
    CS_TRY_VOID(camera_.arm(ms));
    CS_TRY(const Taken a, take());
    CS_TRY(const Taken b, take());
    // Where white is bright: the middle half of what is lit.
    double sum = 0, square = 0;
    std::size_t count = 0;
    for (std::size_t i = 0; i < a.light.data().size(); ++i) {
      if (white_.data()[i] < 0.3 * bright) continue;
      const double d = static_cast<double>(a.light.data()[i]) - b.light.data()[i];
      sum += a.light.data()[i], square += d * d, ++count;
    }
    const double noise = std::sqrt(square / 2 / std::max<std::size_t>(1, count));
    const double ratio = sum / std::max<std::size_t>(1, count) / std::max(1e-9, noise);
    Finding s{about(fmt::format("signal to noise in white at {:.4g} ms", exposure_ms_)),
              fmt::format("{:.0f}, {:.2f} % of the photo saturated", ratio, 100 * a.saturated),
              "more light: longer exposure, wider aperture, less gain", ratio > 15};
    s.caution = ratio < 30;
    to.findings.push_back(std::move(s));
  }
  if (spec_.exposures_ms.empty()) return {};
  // Half the time, half the light.
  const double first = spec_.exposures_ms.front();
  const auto half_armed = camera_.arm(first / 2);
  if (half_armed) {
    CS_TRY(const Taken half, take());
    CS_TRY_VOID(camera_.arm(first));
    CS_TRY(const Taken full, take());
    const double share = mean_of(half.light) / std::max(1e-9, mean_of(full.light));
    Finding h{about("half the exposure"), fmt::format("brings {:.1f} % of the light", 100 * share),
              "the camera exposes something else than it says, or its response is not the one that the rig states",
              std::abs(share - 0.5) < 0.05};
    h.caution = std::abs(share - 0.5) > 0.015;
    to.findings.push_back(std::move(h));
  }
  CS_TRY_VOID(camera_.arm(first));
  return {};
}

Result<void> Look::coverage(Inspection& to) {
  static constexpr float kTint[3][3] = {{1.f, .45f, .25f}, {.25f, .6f, 1.f}, {.4f, .9f, .4f}};
  Image picture(white_.width(), white_.height(), 3);
  for (std::size_t q = 0; q < devices_.projectors.size(); ++q) {
    CS_TRY_VOID(show_flat(65535, kSettledMs, static_cast<int>(q)));
    CS_TRY(const Taken t, take());
    std::vector<double> gained;
    for (std::size_t i = 0; i < t.light.data().size(); ++i) gained.push_back(t.light.data()[i] - black_.data()[i]);
    const double bright = percentile(gained, 0.98);
    std::size_t lit = 0, edge = 0, edge_lit = 0;
    for (int y = 0; y < t.light.height(); ++y)
      for (int x = 0; x < t.light.width(); ++x) {
        const double v = gained[static_cast<std::size_t>(y) * t.light.width() + x];
        const bool on = v > 0.3 * bright;
        const bool border = x < 2 || y < 2 || x >= t.light.width() - 2 || y >= t.light.height() - 2;
        lit += on, edge += border, edge_lit += border && on;
        for (int c = 0; c < 3; ++c)
          picture.at(x, y, c) += static_cast<float>(255 * std::clamp(std::sqrt(std::max(0.0, v / bright)), 0.0, 1.0)) *
                                 kTint[q % 3][c] * (on ? 1.f : 0.45f);
      }
    const double share = static_cast<double>(lit) / t.light.pixels();
    Finding f{about("what projector " + devices_.projectors[q]->id() + " lights"),
              fmt::format("{:.1f} % of the photo, {:.1f} % of its border", 100 * share,
                          100.0 * edge_lit / std::max<std::size_t>(1, edge)),
              "what leaves the photo cannot be measured: step back, or use a wider lens", share > 0.01};
    f.caution = edge_lit > 0.02 * edge || share < 0.05;
    to.findings.push_back(std::move(f));
  }
  for (float& v : picture.data()) v = std::min(v, 255.f);
  to.pictures.push_back({about("what each projector lights"),
                         "a colour per projector; darker where it is less than a "
                         "third of its brightest, most of that scattered",
                         std::move(picture)});
  return {};
}

// Stripes and their inverse: how much of the difference between white and black is left in them.
Result<void> Look::sharpness(Inspection& to) {
  Image picture(white_.width(), white_.height(), 3);
  for (std::size_t q = 0; q < devices_.projectors.size(); ++q) {
    CS_TRY_VOID(show_flat(65535, kSettledMs, static_cast<int>(q)));
    CS_TRY(const Taken alone, take());
    double median[2] = {0, 0}, adds = 0;
    for (const int cell : {kCoarse, kFine}) {
      Image light[2];
      for (const bool inverse : {false, true}) {
        CS_TRY_VOID(show([&](const capture::Projector& p, int other) {
          return other == static_cast<int>(q) ? stripes(p, cell, inverse) : Picture(p.width(), p.height(), 3);
        }));
        CS_TRY(Taken t, take());
        light[inverse] = std::move(t.light);
      }
      // Over squares of some stripes: the mean difference of both, and whether they add up.
      const int side = std::max(8, white_.width() / 120);
      const double least = 0.25 * side * side * mean_of(white_);
      std::vector<double> left, sums;
      for (int y = 0; y + side <= white_.height(); y += side)
        for (int x = 0; x + side <= white_.width(); x += side) {
          double difference = 0, whole = 0, sum = 0;
          for (int j = y; j < y + side; ++j)
            for (int i = x; i < x + side; ++i) {
              difference += std::abs(light[0].at(i, j) - light[1].at(i, j));
              whole += alone.light.at(i, j) - black_.at(i, j);
              sum += light[0].at(i, j) + light[1].at(i, j) - 2 * black_.at(i, j);
            }
          if (whole < least) continue;
          const double m = std::min(1.0, difference / whole);
          left.push_back(m), sums.push_back(sum / whole);
          if (cell != kFine) continue;
          for (int j = y; j < y + side; ++j)
            for (int i = x; i < x + side; ++i) {
              const float value = static_cast<float>(255 * m);
              picture.at(i, j, 0) = std::max(picture.at(i, j, 0), 255 - value);
              picture.at(i, j, 1) = std::max(picture.at(i, j, 1), value);
              picture.at(i, j, 2) = 60;
            }
        }
      median[cell == kFine] = percentile(left, 0.5);
      if (cell == kFine) adds = percentile(sums, 0.5);  // blurred ones show what is between black and white
    }
    Finding f{about("sharpness of projector " + devices_.projectors[q]->id()),
              fmt::format("{:.0f} % of the contrast is left in stripes of {} px, {:.0f} % in those of {} px",
                          100 * median[0], kCoarse, 100 * median[1], kFine),
              "focus the projector by eye on its finest stripes, then the camera on them", median[0] > 0.35};
    f.caution = median[0] < 0.7 || median[1] < 0.15;
    to.findings.push_back(std::move(f));
    Finding r{about("light of projector " + devices_.projectors[q]->id() + " adds up"),
              fmt::format("a picture and its inverse are {:.1f} % of white", 100 * adds),
              "they should be 100 %: the rig states another response than the camera has (gamma on?), or the display "
              "changes pictures (dynamic contrast, limited range)",
              std::abs(adds - 1) < 0.06};
    r.caution = std::abs(adds - 1) > 0.02;
    to.findings.push_back(std::move(r));
  }
  to.pictures.push_back(
      {about("sharpness"),
       fmt::format("contrast that is left in stripes of {} projector pixels: green all, red none", kFine),
       std::move(picture)});
  return {};
}

// The same stripes again and again: how far they move.
Result<void> Look::stillness(Inspection& to) {
  CS_TRY_VOID(show([](const capture::Projector& p, int) {
    Picture picture(p.width(), p.height(), 3);
    for (int y = 0; y < p.height(); ++y)
      for (int x = 0; x < p.width(); ++x) {
        const unsigned cell = static_cast<unsigned>(x / kCoarse) * 7919u + static_cast<unsigned>(y / kCoarse) * 104729u;
        const bool lit = (cell * 2654435761u >> 13) & 1;
        for (int c = 0; c < 3; ++c) picture.at(x, y, c) = lit ? 65535 : 0;
      }
    return picture;
  }));
  std::vector<double> moved;
  cv::Mat first, window;
  for (int i = 0; i < kStill; ++i) {
    CS_TRY(Taken t, take());
    const cv::Mat photo = cv::Mat(t.light.height(), t.light.width(), CV_32F, t.light.data().data()).clone();
    if (i == 0) {
      first = photo;
      cv::createHanningWindow(window, photo.size(), CV_32F);
      continue;
    }
    const cv::Point2d shift = cv::phaseCorrelate(first, photo, window);
    moved.push_back(std::hypot(shift.x, shift.y));
  }
  const double most = percentile(moved, 1);
  Finding f{about("movement"), fmt::format("{:.2f} px at most in {} photos", most, kStill),
            "the camera or a projector shakes: a heavier stand, no draught, nobody on the floor beside it", most < 1};
  f.caution = most > 0.2;
  to.findings.push_back(std::move(f));
  return {};
}

Result<void> Look::all(Inspection& to) {
  CS_TRY_VOID(camera_.arm(spec_.exposures_ms.empty() ? 0 : spec_.exposures_ms.front()));
  CS_TRY_VOID(show_flat(0));
  CS_TRY(Taken black, take());
  black_ = std::move(black.light);
  CS_TRY_VOID(show_flat(65535));
  CS_TRY(Taken white, take());
  white_ = std::move(white.light);
  to.pictures.push_back({about("white on all projectors"), "as the camera sees it", as_seen(white_, 1)});
  CS_TRY_VOID(latency(to));
  CS_TRY_VOID(steadiness(to));
  CS_TRY_VOID(coverage(to));
  CS_TRY_VOID(sharpness(to));
  CS_TRY_VOID(stillness(to));
  CS_TRY_VOID(exposures(to));
  Finding health = health_of(camera_);
  if (counter_gaps_ > 0) {  // of a driver that does not own up to them
    health.measured += fmt::format(", {} lost by the count of the camera", counter_gaps_);
    health.caution = true;
  }
  to.findings.push_back(std::move(health));
  return show_flat(0, 0);
}

}  // namespace

double whole_refreshes(double wanted_ms, double refresh_hz) {
  const double period = 1e3 / refresh_hz;
  return period * std::max(1.0, std::floor(wanted_ms / period * (1 + 1e-6)));
}

std::optional<double> whole_pulses(double wanted_ms, double refresh_hz, double pulses_hz) {
  std::optional<double> nearest;
  for (int n = 1; n <= 12; ++n) {
    const double ms = 1e3 * n / refresh_hz, pulses = 1e-3 * ms * pulses_hz;
    if (std::abs(pulses - std::round(pulses)) > 0.01 * pulses) continue;
    if (!nearest || std::abs(std::log(ms / wanted_ms)) < std::abs(std::log(*nearest / wanted_ms))) nearest = ms;
  }
  return nearest;
}

Result<Inspection> inspect(const Rig& rig, const capture::Devices& devices, Progress& progress) {
  Inspection inspection;
  CS_TRY(inspection.findings, self_check(rig, devices, progress));
  for (const Finding& f : inspection.findings)
    if (!f.ok) return inspection;  // nothing beyond it could be believed
  for (std::size_t i = 0; i < devices.cameras.size(); ++i) {
    progress.step("inspect", i, devices.cameras.size());
    capture::Camera& camera = *devices.cameras[i];
    const auto looked = Look(devices, camera, *rig.camera(camera.id())).all(inspection);
    if (looked) continue;
    if (looked.error().code != ErrorCode::kDevice || camera.health().failure.empty()) return looked.error();
    inspection.findings.push_back(health_of(camera));
  }
  progress.step("inspect", devices.cameras.size(), devices.cameras.size());
  return inspection;
}

}  // namespace countershade::tools

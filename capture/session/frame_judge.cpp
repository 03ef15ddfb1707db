#include "capture/session/frame_judge.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace countershade::capture {

namespace {

// A fresh photo shows about all of the predicted change, a stale one none: the line between them.
constexpr double kShownChange = 0.03;
// Light adds; compression of fine stripes and a drifting lamp stay below this (noise comes on top), a wrong frame whose
// stripes the camera resolves above.
constexpr double kPairTolerance = 0.15;
// A change of the view that an unmoved camera does not make, beside four times its noise.
constexpr double kMoved = 0.01, kBrightened = 0.1;

}  // namespace

std::vector<Image> blocks_of(const std::vector<Picture>& pictures) {
  std::vector<Image> blocks;
  for (const Picture& picture : pictures) blocks.push_back(block_light(picture));
  return blocks;
}

FrameJudge::FrameJudge(const Rig& rig, const Sequence& sequence)
    : rig_(rig),
      sequence_(sequence),
      kept_(sequence.frames.size(), std::vector<std::optional<Bins>>(rig.cameras.size())),
      dark_(rig.cameras.size()),
      floor_(rig.cameras.size(), 0),
      pixel_floor_(rig.cameras.size(), 0) {}

std::string FrameJudge::name_of(int f) const {
  return fmt::format("frame {} ({})", sequence_.frames[f].index, sequence_.frames[f].role.name());
}

Bins FrameJudge::pixels_of(const Image& stored, std::size_t c) const {
  return stored.empty() ? Bins() : bin_photo(stored, 65535, rig_.cameras[c], 1);
}

void FrameJudge::learn_noise(std::size_t c, const Bins& one, const Bins& two, const Bins& one_pixels,
                             const Bins& two_pixels) {
  floor_[c] = std::max(floor_[c], mean_difference(one, two));
  pixel_floor_[c] = std::max(pixel_floor_[c], mean_difference(one_pixels, two_pixels));
}

// The measured one, or the photon noise of bins of 64 pixels that hold 2000 electrons each when full, a small sensor's.
double FrameJudge::noise(std::size_t c, const Bins& light) const {
  return std::max(floor_[c], 0.0025 * std::sqrt(std::max(0.0, mean_light(light))));
}

// The same of single pixels.
double FrameJudge::pixel_noise(std::size_t c, const Bins& light) const {
  return std::max(pixel_floor_[c], kCoarse * 0.0025 * std::sqrt(mean_light(light)));
}

// How much white of a projector changes the camera's bins against black; nothing where that is not photographed yet.
std::optional<double> FrameJudge::response(std::size_t c, const std::string& projector) const {
  const Bins* white = nullptr;
  const Bins* black = dark_[c].light.empty() ? nullptr : &dark_[c];
  for (int f = 0; f < frames(); ++f) {
    const Role& role = sequence_.frames[f].role;
    const bool lit = role.projector == projector || (role.projector.empty() && sequence_.projectors.size() == 1);
    if (role.kind == "white" && lit && kept_[f][c]) white = &*kept_[f][c];
    if (role.kind == "black" && kept_[f][c]) black = &*kept_[f][c];
  }
  if (white == nullptr || black == nullptr) return std::nullopt;
  return mean_difference(*white, *black);
}

bool FrameJudge::differ(const Views& one, const Views& two) const {
  for (std::size_t c = 0; c < cameras(); ++c)
    if (mean_difference(one[c], two[c]) > 4 * noise(c, one[c]) + 0.0005)  // of full scale: too little to decode
      return true;
  return false;
}

double FrameJudge::share_of_change(const Views& now, const Views& then) const {
  double way = 0, whole = 0;
  for (std::size_t c = 0; c < cameras(); ++c) {
    way += mean_difference(now[c], seen_.views[c]);
    whole += mean_difference(then[c], seen_.views[c]);
  }
  return whole > 0 ? way / whole : 1;
}

std::string FrameJudge::stale(const std::vector<Image>& blocks, const Views& now) const {
  double unknown = 0;  // change of projectors whose light no camera has been seen to answer yet
  std::vector<double> predicted(cameras()), whole(cameras());
  for (std::size_t p = 0; p < blocks.size(); ++p) {
    for (std::size_t c = 0; c < cameras(); ++c) {
      const double change = block_change(seen_.blocks[p], blocks[p], now[c].colour.channels());
      const auto answer = response(c, sequence_.projectors[p].first);
      if (!answer) unknown = std::max(unknown, change);
      predicted[c] += change * answer.value_or(0);
      whole[c] = std::max(whole[c], answer.value_or(0));
    }
  }
  for (std::size_t c = 0; c < cameras(); ++c) {
    const double change = mean_difference(now[c], seen_.views[c]), floor = noise(c, seen_.views[c]);
    if (unknown < kPredictable && predicted[c] > kPredictable * whole[c] && predicted[c] > 10 * floor &&
        predicted[c] > 0.001 && change < kShownChange * predicted[c] + 2 * floor)
      return fmt::format(
          "camera '{}' still shows the former frame (its light changed by {:.3f} % of full scale, expected "
          "about {:.2f} %)",
          rig_.cameras[c].id, 100 * change, 100 * predicted[c]);
  }
  if (unknown > 0.3 && !any_change(now)) return "no camera sees any change of the projected light";
  return "";
}

Result<std::string> FrameJudge::wrong_pair(int f, const Pixels& pixels, const StoredPixels& stored_pixels) const {
  const Companions with = companions(sequence_, f);
  if (with.white < 0 || with.black < 0 || with.inverse < 0) return std::string();
  for (std::size_t c = 0; c < cameras(); ++c) {
    CS_TRY(const Bins white, stored_pixels(with.white, c));
    CS_TRY(const Bins black, stored_pixels(with.black, c));
    CS_TRY(const Bins inverse, stored_pixels(with.inverse, c));
    const Bins& now = pixels(c);
    if (now.light.empty() || white.light.empty() || black.light.empty() || inverse.light.empty()) continue;
    const double swing = mean_difference(*kept_[with.white][c], *kept_[with.black][c]);
    if (swing < 10 * noise(c, *kept_[with.white][c]) || swing < 0.001) continue;  // it does not see that projector
    const PairLaw law = pair_law(white, black, inverse, now);
    // Four photos add up to 1.4 of the noise of one.
    const double tolerance = kPairTolerance + 2 * pixel_noise(c, white) / swing;
    if (law.error > tolerance)
      return fmt::format(
          "camera '{}': it and {} do not add up to white + black ({:.0f} % of the light is wrong, allowed "
          "{:.0f} %)",
          rig_.cameras[c].id, name_of(with.inverse), 100 * law.error, 100 * tolerance);
  }
  return std::string();
}

// The fringes of a sinusoid are too fine for blocks to tell it from the one before, but they move by a quarter of a
// period at least: single pixels change by about the swing of the direct light, a twentieth of white - black even where
// most light is indirect.
std::string FrameJudge::repeats(int f, const Pixels& pixels) const {
  if (sequence_.frames[f].role.kind != "phase" || seen_pixels_.empty()) return "";
  for (std::size_t c = 0; c < cameras(); ++c) {
    const auto swing = response(c, sequence_.frames[f].role.projector);
    if (!swing || seen_pixels_[c].light.empty()) continue;
    const Bins& now = pixels(c);
    if (now.light.empty()) continue;
    const double noise = pixel_noise(c, seen_.views[c]), change = mean_difference(now, seen_pixels_[c]);
    if (0.05 * *swing > 2 * noise && change < 0.05 * *swing + noise)
      return fmt::format(
          "camera '{}' still shows the former frame (its pixels changed by {:.3f} % of full scale, expected more than "
          "{:.2f} %)",
          rig_.cameras[c].id, 100 * change, 100 * (0.05 * *swing + noise));
  }
  return "";
}

std::string FrameJudge::moved(int f, const Views& now, double shake) const {
  for (std::size_t c = 0; c < cameras(); ++c) {
    const auto [difference, brightening] = change_of_view(now[c], *kept_[f][c]);
    const double noise = floor_[c] / std::max(1e-6, mean_light(now[c]));
    const double allowed = kMoved + 4 * noise + 2 * shake;
    if (difference > allowed || std::abs(brightening) > kBrightened)
      return fmt::format(
          "camera '{}' sees {} differently than when it was stored: {:.1f} % of its light changed place "
          "(allowed {:.1f} %) and its brightness changed by {:.1f} % (allowed {:.0f} %)",
          rig_.cameras[c].id, name_of(f), 100 * difference, 100 * allowed, 100 * brightening, 100 * kBrightened);
  }
  return "";
}

}  // namespace countershade::capture

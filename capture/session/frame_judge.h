// What the cameras have seen of a session so far, and whether new photos can be of the frame that was asked for.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/file/session.h"
#include "capture/session/frame_check.h"

namespace countershade::capture {

using Views = std::vector<Bins>;  // per camera, first exposure

std::vector<Image> blocks_of(const std::vector<Picture>& pictures);

class FrameJudge {
 public:
  // rig and sequence must outlive it.
  FrameJudge(const Rig& rig, const Sequence& sequence);

  // A photo in single pixels instead of bins; empty for an empty one.
  Bins pixels_of(const Image& stored, std::size_t camera) const;

  // ---- what is known ----

  // The photo of a frame (its position) as it is stored, the last one counts.
  void keep(int f, std::size_t camera, Bins photo) { kept_[f][camera] = std::move(photo); }
  const std::optional<Bins>& kept(int f, std::size_t camera) const { return kept_[f][camera]; }
  // What the cameras saw last, of pictures with these blocks (block_light).
  struct Seen {
    std::vector<Image> blocks;  // per projector
    Views views;
  };
  void saw(Seen seen) { seen_ = std::move(seen); }
  const Seen& seen() const { return seen_; }
  // The same in single pixels, where the next frame is a sinusoid; else nothing.
  void saw_pixels(Views pixels) { seen_pixels_ = std::move(pixels); }
  // Two photos of the same light, binned and in single pixels: what noise does.
  void learn_noise(std::size_t camera, const Bins& one, const Bins& two, const Bins& one_pixels,
                   const Bins& two_pixels);
  // Photo of no light, for as long as no frame of it is kept.
  void saw_dark(Views views) { dark_ = std::move(views); }

  // ---- what follows from it ----

  // Mean difference that noise makes between two photos of this light.
  double noise(std::size_t camera, const Bins& light) const;
  // Whether a camera sees other light than last.
  bool any_change(const Views& now) const { return differ(seen_.views, now); }
  // Whether a camera tells two photos apart, more than by noise.
  bool differ(const Views& one, const Views& two) const;
  // How far these photos are on the way from what was seen last to `then`, 0..1; mean of the cameras by their light.
  double share_of_change(const Views& now, const Views& then) const;
  // Share of the projector's swing that is looked for at least.
  static constexpr double kPredictable = 0.1;

  // Why the photos cannot be of the pictures with these blocks; empty when they can.
  std::string stale(const std::vector<Image>& blocks, const Views& now) const;
  // New photos in single pixels, by camera; empty where that is stored already.
  using Pixels = std::function<const Bins&(std::size_t camera)>;
  // Why the photos of a sinusoid cannot be new ones; empty when they can.
  std::string repeats(int f, const Pixels& pixels) const;
  // Why a frame and its inverse cannot both be right; empty when they can. stored_pixels: a kept photo in single
  // pixels; empty where it is not stored.
  using StoredPixels = std::function<Result<Bins>(int f, std::size_t camera)>;
  Result<std::string> wrong_pair(int f, const Pixels& pixels, const StoredPixels& stored_pixels) const;
  // Why the cameras cannot stand where they stood when frame f was kept; empty when they can. shake: share of a
  // camera's light that changes place from photo to photo though nothing moved.
  std::string moved(int f, const Views& now, double shake) const;
  // For messages: "frame 7 (gray x bit 2 of left)".
  std::string name_of(int f) const;

 private:
  double pixel_noise(std::size_t camera, const Bins& light) const;
  std::optional<double> response(std::size_t camera, const std::string& projector) const;
  std::size_t cameras() const { return rig_.cameras.size(); }
  int frames() const { return static_cast<int>(sequence_.frames.size()); }

  const Rig& rig_;
  const Sequence& sequence_;
  std::vector<std::vector<std::optional<Bins>>> kept_;  // [frame][camera]
  Seen seen_;
  Views seen_pixels_, dark_;
  std::vector<double> floor_, pixel_floor_;  // per camera: mean difference of two photos of the same light
};

}  // namespace countershade::capture

// How well photos fit a sequence, judged cheaply: in a few places of them, by the decoder itself.
#pragma once

#include <map>
#include <vector>

#include "capture/pattern/decode.h"

namespace countershade::capture {

inline constexpr int kPatch = 16;  // samples along a side of a place

// Share of the pixels of a place that were read and lie on the plane that most of them agree with, within `reach`
// [projector px], plus a quarter of its slope. q: projector px, NaN = not read; (x, y): first pixel, kPatch samples
// `stride` apart. counted (out): pixels of the place where `counts` is not 0; all of them where it is empty.
double share_on_plane(const Image& q, const Mask& counts, int x, int y, int stride, float reach, int& counted);

// Places all over the photos that a projector lights, put side by side as one small photo of each frame.
class Trial {
 public:
  // Looks for what a few frames of the code change. Error: that of a photo; kRefused where nothing changes.
  static Result<Trial> of(const Sequence& sequence, const PhotoSource& photos, const std::string& projector);

  // What the decoder reads from `edited` on one axis (0 x, 1 y); a share of 0 where it refuses. Frames of `edited` name
  // photos by their index, complement_of included. Each photo is read once, whatever number of sequences is tried.
  struct Fit {
    double share = 0;    // of the lit pixels: read, and on the plane of their neighbours (share_on_plane)
    double highest = 0;  // 99th percentile of what was read [projector px]
  };
  // `few`: judged by a fifth of the places. What was tried before is remembered.
  Fit fit(const Sequence& edited, int axis, bool few = false);

  // Whether two photos show the same, up to a twentieth of the light. False where one cannot be read.
  bool same(int index, int other);

  // The index of a frame that was not photographed: its photo is what all light less that of photo `index` would be.
  static int complement_of(int index) { return kComplement + index; }

 private:
  Trial(const PhotoSource& photos, std::string projector) : photos_(photos), projector_(std::move(projector)) {}
  Result<void> choose_places(const std::vector<Photo>& first);
  Photo gather(const Photo& photo) const;
  Result<Photo> photo(int index);
  Fit decode(const Sequence& one, int axis, std::size_t places);

  static constexpr int kComplement = 1 << 28;
  struct Known {
    Sequence one;
    int axis;
    std::size_t places;
    Fit fit;
  };
  const PhotoSource& photos_;
  std::string projector_;
  std::vector<std::pair<int, int>> places_;  // first pixels
  int stride_ = 1, columns_ = 1;             // samples' distance; places per row of the small photo
  Mask lit_;                                 // of the small photo
  Image all_light_;                          // brightest plus darkest, of the frames looked at first
  std::map<int, Photo> gathered_;
  std::vector<Known> known_;
};

}  // namespace countershade::capture

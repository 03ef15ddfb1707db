// The first half of decoding: bits, from rows of photos as they are stored.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "calib/base/lanes.h"
#include "capture/pattern/read/levels.h"
#include "capture/pattern/read/refine.h"

namespace countershade::capture {

// Bits of both axes while their photos arrive. A pass over the rows reads every pair of photos that can be judged by
// then, so that a pixel's state is touched once for many photos.
class BitReading {
 public:
  BitReading(const CodePlan& plan, const DecodeOptions& options) : plan_(plan), options_(options) {}

  // Whether a frame is one of those that are still to be read.
  bool wants(int frame) const;
  // Reads what can be read of `photos` and takes it out; a few pairs wait until it is worth a pass. All: nothing waits.
  void read(StoredPhotos& photos, bool all);
  bool done() const { return done_; }

  // Once done: Reason of pixels that no code is read from, and the axes that have bits, not yet refined.
  const Levels& levels() const { return *levels_; }
  Mask& judged() { return judged_; }
  AxisReading& axis(int a) { return axes_[a]; }
  Image& contrast() { return contrast_; }  // white - black, which the axes lack

 private:
  struct Pair {
    int axis = 0, bit = 0;
    bool fine = false;  // stripes too narrow to modulate light that comes by way of other surfaces
    std::shared_ptr<const StoredPhoto> plain, inverse;
  };
  struct Pass;
  template <class T>
  struct PairRows;
  bool is_fine(int axis, int bit) const;
  std::vector<Pair> ready(const StoredPhotos& photos) const;
  void begin(const LevelPhotos& photos);
  void judge_row(const LevelPhotos& photos, int y, float* white, float* black);
  template <class T>
  void read_band(const Pass& pass, int first_row, int last_row);
  template <class T>
  void read_row(const Pass& pass, const PairRows<T>& rows, int y);
  template <class Count>
  void pass_over(int y, int x, Count count);
  template <class Count>
  void finish(int y, int x, Count count, const std::array<LaneBits, 2>& code, const std::array<LaneBits, 2>& uncertain,
              Lanes fine, Lanes contrast);

  const CodePlan& plan_;
  const DecodeOptions& options_;
  std::optional<Levels> levels_;
  std::array<std::vector<bool>, 2> read_;  // bits of an axis
  int width_ = 0, height_ = 0;
  Mask judged_;
  Image contrast_;                               // white - black
  std::array<std::uint32_t, 2> combined_{0, 0};  // bits that were shown in exclusive or with another
  std::array<std::vector<float>, 2> fine_;       // largest difference that a fine bit and its inverse have shown so far
  std::array<AxisReading, 2> axes_;
  bool done_ = false;
};

}  // namespace countershade::capture

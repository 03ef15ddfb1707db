#include "capture/diagnose/trial.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "capture/pattern/plan.h"

namespace countershade::capture {

namespace {

constexpr int kGap = 3;                  // dark pixels between places: as far as the decoder looks at neighbours
constexpr int kAcross = 8, kDown = 6;    // places
constexpr int kCell = kPatch + kGap;     // in the small photo
constexpr std::size_t kFirstFrames = 6;  // that show where the light is

float median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Sample {
  float u, v, q;
};

// Median slope between samples `reach` apart, per sample.
float slope(const std::vector<float>& patch, bool along_v) {
  constexpr int kReach = 5;
  std::vector<float> slopes;
  for (int v = 0; v < kPatch - (along_v ? kReach : 0); ++v)
    for (int u = 0; u < kPatch - (along_v ? 0 : kReach); ++u) {
      const float low = patch[v * kPatch + u], high = patch[v * kPatch + u + kReach * (along_v ? kPatch : 1)];
      if (std::isfinite(low) && std::isfinite(high)) slopes.push_back((high - low) / kReach);
    }
  return slopes.empty() ? 0 : median(slopes);
}

template <class T>
Raster<T> top(const Raster<T>& image, int height) {
  Raster<T> part(image.width(), height, image.channels());
  std::copy_n(image.data().begin(), part.data().size(), part.data().begin());
  return part;
}

// Frames of a sequence that code one axis of a projector, with its white and black.
Sequence only_axis(const Sequence& sequence, const std::string& projector, int axis) {
  Sequence one;
  one.projectors = sequence.projectors;
  for (const Frame& frame : sequence.frames) {
    const Role& role = frame.role;
    if (!role.projector.empty() && role.projector != projector) continue;
    const bool level = role.kind == "white" || role.kind == "black";
    const bool code = role.kind == "gray" || role.kind == "xor" || role.kind == "phase";
    if (level || (code && role.axis == (axis ? "y" : "x"))) one.frames.push_back(frame);
  }
  return one;
}

// Indices of white, black and a few frames spread over the code.
std::vector<int> first_frames(const Sequence& sequence, const std::string& projector) {
  std::vector<int> levels, code;
  for (int axis = 0; axis < 2; ++axis)
    for (const Frame& frame : only_axis(sequence, projector, axis).frames) {
      const bool level = frame.role.kind == "white" || frame.role.kind == "black";
      std::vector<int>& list = level ? levels : code;
      if (std::find(list.begin(), list.end(), frame.index) == list.end()) list.push_back(frame.index);
    }
  std::vector<int> chosen(levels.begin(), levels.begin() + std::min<std::ptrdiff_t>(2, std::ssize(levels)));
  const std::size_t more = std::min(code.size(), kFirstFrames - chosen.size());
  for (std::size_t k = 0; k < more; ++k) chosen.push_back(code[k * code.size() / more]);
  return chosen;
}

}  // namespace

double share_on_plane(const Image& q, const Mask& counts, int x, int y, int stride, float reach, int& counted) {
  std::vector<float> patch(kPatch * kPatch, std::numeric_limits<float>::quiet_NaN());
  counted = 0;
  for (int v = 0; v < kPatch; ++v)
    for (int u = 0; u < kPatch; ++u) {
      const int px = x + u * stride, py = y + v * stride;
      if (!counts.empty() && !counts.at(px, py)) continue;
      ++counted;
      patch[v * kPatch + u] = q.at(px, py);
    }
  const float gu = slope(patch, false), gv = slope(patch, true);
  std::vector<float> level;
  for (int v = 0; v < kPatch; ++v)
    for (int u = 0; u < kPatch; ++u)
      if (const float value = patch[v * kPatch + u]; std::isfinite(value))
        level.push_back(value - gu * static_cast<float>(u) - gv * static_cast<float>(v));
  if (level.empty()) return 0;
  const float middle = median(level), bound = reach + 0.25f * (std::abs(gu) + std::abs(gv));
  const auto on = std::count_if(level.begin(), level.end(), [&](float l) { return std::abs(l - middle) <= bound; });
  return static_cast<double>(on) / counted;
}

Result<Trial> Trial::of(const Sequence& sequence, const PhotoSource& photos, const std::string& projector) {
  Trial trial(photos, projector);
  std::vector<Photo> first;
  for (const int index : first_frames(sequence, projector)) {
    CS_TRY(Photo photo, photos(index));
    photo.value = luminance_mean(photo.value);
    if (!first.empty() && !photo.value.same_size(first[0].value.width(), first[0].value.height()))
      return error(ErrorCode::kBadFile, "photo {:04} is of another size than the others", index);
    first.push_back(std::move(photo));
  }
  if (first.size() < 2) return error(ErrorCode::kRefused, "projector '{}' has fewer than two frames", projector);
  CS_TRY_VOID(trial.choose_places(first));
  return trial;
}

// In each part of the photos, the place that changes most.
Result<void> Trial::choose_places(const std::vector<Photo>& first) {
  const int width = first[0].value.width(), height = first[0].value.height();
  stride_ = std::clamp(std::min(width, height) / 400, 1, 3);
  const int extent = (kPatch - 1) * stride_ + 1;
  if (width < extent || height < extent) return error(ErrorCode::kRefused, "the photos are too small to be judged");
  Image low = first[0].value, high = low;
  std::vector<float> changes(low.data().size());
  for (std::size_t i = 0; i < changes.size(); ++i) {
    bool valid = true;
    for (const Photo& photo : first) {
      low.data()[i] = std::min(low.data()[i], photo.value.data()[i]);
      high.data()[i] = std::max(high.data()[i], photo.value.data()[i]);
      valid = valid && photo.valid.data()[i];
    }
    changes[i] = valid ? high.data()[i] - low.data()[i] : 0;
  }
  std::vector<float> sorted = changes;
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), nth, sorted.end());
  const float least = 0.1f * *nth;
  const auto changing = [&](int x0, int y0) {  // every fourth sample says enough
    int count = 0;
    for (int v = 0; v < kPatch; v += 4)
      for (int u = 0; u < kPatch; u += 4)
        count += changes[static_cast<std::size_t>(y0 + v * stride_) * width + x0 + u * stride_] > least;
    return count;
  };
  const int across = std::clamp(width / extent, 1, kAcross), down = std::clamp(height / extent, 1, kDown);
  for (int row = 0; row < down; ++row)
    for (int column = 0; column < across; ++column) {
      int best = 8;  // of 16
      std::pair<int, int> place;
      const int x1 = (column + 1) * width / across - extent, y1 = (row + 1) * height / down - extent;
      for (int y = row * height / down; y <= y1; y += std::max(1, extent / 4))
        for (int x = column * width / across; x <= x1; x += std::max(1, extent / 4))
          if (const int count = changing(x, y); count > best) best = count, place = {x, y};
      if (best > 8) places_.push_back(place);
    }
  if (places_.empty() || !(least > 0))
    return error(ErrorCode::kRefused, "no photo of projector '{}' differs from the others", projector_);
  columns_ = std::min<int>(3, static_cast<int>(places_.size()));
  // In an order in which every beginning is spread all over the photos.
  std::vector<std::pair<int, int>> spread;
  for (std::size_t step = 0; step < 5; ++step)
    for (std::size_t k = step; k < places_.size(); k += 5) spread.push_back(places_[k]);
  places_ = std::move(spread);
  Photo sum{low, Mask(width, height, 1, 1), 0};
  for (std::size_t i = 0; i < sum.value.data().size(); ++i) {
    sum.valid.data()[i] = changes[i] > least;
    sum.value.data()[i] += high.data()[i];
  }
  sum = gather(sum);
  all_light_ = std::move(sum.value);
  lit_ = std::move(sum.valid);
  return {};
}

Photo Trial::gather(const Photo& photo) const {
  const int rows = static_cast<int>((places_.size() + columns_ - 1) / columns_);
  Photo small{Image(columns_ * kCell, rows * kCell, 1), Mask(columns_ * kCell, rows * kCell, 1), 0};
  for (std::size_t k = 0; k < places_.size(); ++k)
    for (int v = 0; v < kPatch; ++v)
      for (int u = 0; u < kPatch; ++u) {
        const int x = places_[k].first + u * stride_, y = places_[k].second + v * stride_;
        const int to_x = static_cast<int>(k) % columns_ * kCell + u, to_y = static_cast<int>(k) / columns_ * kCell + v;
        small.value.at(to_x, to_y) = photo.value.at(x, y);
        small.valid.at(to_x, to_y) = photo.valid.at(x, y);
      }
  return small;
}

Result<Photo> Trial::photo(int index) {
  const auto known = gathered_.find(index);
  if (known != gathered_.end()) return known->second;
  Photo small;
  if (index >= kComplement) {
    CS_TRY(small, photo(index - kComplement));
    for (std::size_t i = 0; i < small.value.data().size(); ++i)
      small.value.data()[i] = all_light_.data()[i] - small.value.data()[i];
  } else {
    CS_TRY(Photo whole, photos_(index));
    whole.value = luminance_mean(whole.value);
    small = gather(whole);
  }
  // Between places all is dark, not saturated.
  for (int y = 0; y < small.valid.height(); ++y)
    for (int x = 0; x < small.valid.width(); ++x)
      if (x % kCell >= kPatch || y % kCell >= kPatch) small.valid.at(x, y) = 1;
  gathered_[index] = small;
  return small;
}

namespace {

bool same_frames(const Sequence& a, const Sequence& b) {
  const auto same = [](const Frame& f, const Frame& g) { return f.index == g.index && f.role == g.role; };
  return a.projectors == b.projectors &&
         std::equal(a.frames.begin(), a.frames.end(), b.frames.begin(), b.frames.end(), same);
}

}  // namespace

Trial::Fit Trial::fit(const Sequence& edited, int axis, bool few) {
  const Sequence one = only_axis(edited, projector_, axis);
  const bool waves =
      std::any_of(one.frames.begin(), one.frames.end(), [](const Frame& f) { return f.role.kind == "phase"; });
  // Sinusoids take ten times as long to decode as bits.
  const std::size_t places = std::min<std::size_t>(places_.size(), waves ? (few ? 3 : 12) : few ? 9 : places_.size());
  for (const Known& known : known_)
    if (known.axis == axis && known.places == places && same_frames(known.one, one)) return known.fit;
  known_.push_back({one, axis, places, decode(one, axis, places)});
  return known_.back().fit;
}

bool Trial::same(int index, int other) {
  const auto a = photo(index), b = photo(other);
  if (!a || !b) return false;
  double difference = 0, light = 0;
  for (std::size_t i = 0; i < lit_.data().size(); ++i) {
    if (!lit_.data()[i]) continue;
    difference += std::abs(a->value.data()[i] - b->value.data()[i]), light += all_light_.data()[i];
  }
  return difference < 0.05 * light;
}

Trial::Fit Trial::decode(const Sequence& one, int axis, std::size_t places) {
  const auto plan = plan_code(one, projector_);
  if (!plan) return {};
  for (const Frame& frame : one.frames)  // read by two threads afterwards
    if (!photo(frame.index)) return {};
  SilentProgress silent;
  const int height = static_cast<int>((places + columns_ - 1) / columns_) * kCell;
  const PhotoSource known = [&](int index) -> Result<Photo> {
    const Photo& photo = gathered_.at(index);
    return Photo{top(photo.value, height), top(photo.valid, height), 0};
  };
  const auto c = decode_frames(one, known, "", projector_, {}, silent);
  if (!c) return {};
  const Image& q = axis ? c->y : c->x;
  const AxisCode& code = plan->axis[axis];
  const float reach = code.waves.empty() ? 1.6f * static_cast<float>(code.cell_px) : 1.5f;
  double fits = 0, counted = 0;
  for (std::size_t k = 0; k < places; ++k) {
    const int x = static_cast<int>(k) % columns_ * kCell, y = static_cast<int>(k) / columns_ * kCell;
    int lit = 0;
    const double share = share_on_plane(q, lit_, x, y, 1, reach, lit);
    fits += share * lit, counted += lit;
  }
  std::vector<float> read;
  for (const float value : q.data())
    if (std::isfinite(value)) read.push_back(value);
  if (read.empty() || !(counted > 0)) return {};
  const auto nth = read.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(read.size() - 1));
  std::nth_element(read.begin(), nth, read.end());
  return {fits / counted, *nth};
}

}  // namespace countershade::capture

#include "capture/diagnose/held_out.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "capture/pattern/pattern.h"

namespace countershade::capture {

namespace {

constexpr int kMargin = 2;       // px: position may be off by as much, and blur reaches as far
constexpr float kClear = 0.25f;  // of the light of both: below, indirect light may have decided

constexpr float kDirect = 0.5f;   // ... and where indirect light could not have done it
constexpr float kBright = 0.05f;  // of the brightest: what is less is hardly lit

// Complementary frames of one colour, of all projectors together; the green ones where there are several.
const Frame* blocks_of(const Sequence& sequence, bool inverse) {
  const Frame* found = nullptr;
  for (const Frame& f : sequence.frames)
    if (f.role.kind == "blocks" && f.role.projector.empty() && f.role.inverse == inverse &&
        (!found || f.role.channel == "g" || f.role.channel == "rgb"))
      found = &f;
  return found;
}

// Brightness of the channel that a role lights, of one projector's picture; -1 within the margin of a border.
int lit_at(const Picture& picture, int channel, float x, float y) {
  const int px = static_cast<int>(std::lround(x)), py = static_cast<int>(std::lround(y));
  if (px < kMargin || py < kMargin || px + kMargin >= picture.width() || py + kMargin >= picture.height()) return -1;
  const std::uint16_t value = picture.at(px, py, channel);
  for (int dy : {-kMargin, kMargin})
    for (int dx : {-kMargin, kMargin})
      if (picture.at(px + dx, py + dy, channel) != value) return -1;
  return value > 0;
}

bool lights(const Correspondence& c, std::size_t pixel) {
  const auto why = static_cast<Reason>(c.reason.data()[pixel]);
  return why != Reason::kDark && why != Reason::kIndirect;
}

}  // namespace

Result<std::vector<CodeAudit>> audit_codes(const Sequence& sequence, const PhotoSource& photos,
                                           const std::vector<Correspondence>& decoded) {
  std::vector<CodeAudit> audits;
  const Frame *plain = blocks_of(sequence, false), *inverse = blocks_of(sequence, true);
  if (!plain || !inverse || plain->role.channel != inverse->role.channel || decoded.empty()) return audits;
  CS_TRY(const Photo one, photos(plain->index));
  CS_TRY(const Photo other, photos(inverse->index));
  const int channel = plain->role.channel == "r" ? 0 : plain->role.channel == "b" ? 2 : 1;
  const int seen = one.value.channels() == 1 ? 0 : channel;
  for (const Correspondence& c : decoded) {
    CodeAudit audit;
    CS_TRY(const Picture picture,
           render_role(plain->role, c.projector, c.projector_resolution[0], c.projector_resolution[1]));
    for (std::size_t i = 0; i < c.reason.data().size(); ++i) {
      if (c.reason.data()[i] || !one.valid.data()[i] || !other.valid.data()[i]) continue;
      if (!std::isfinite(c.x.data()[i]) || !std::isfinite(c.y.data()[i])) continue;
      bool alone = true;
      for (const Correspondence& d : decoded) alone = alone && (&d == &c || !lights(d, i));
      const int lit = alone ? lit_at(picture, channel, c.x.data()[i], c.y.data()[i]) : -1;
      if (lit < 0) continue;
      const float a = one.value.data()[i * one.value.channels() + seen],
                  b = other.value.data()[i * other.value.channels() + seen];
      if (std::abs(a - b) < kClear * (a + b)) continue;
      ++audit.judged;
      audit.contradicted += (a > b) != (lit == 1);
    }
    audits.push_back(audit);
  }
  return audits;
}

Result<Unread> unread_pixels(const Sequence& sequence, const PhotoSource& photos,
                             const std::vector<Correspondence>& decoded) {
  Unread found;
  const Frame *plain = blocks_of(sequence, false), *inverse = blocks_of(sequence, true);
  if (!plain || !inverse || plain->role.channel != inverse->role.channel || decoded.empty()) return found;
  CS_TRY(const Photo one, photos(plain->index));
  CS_TRY(const Photo other, photos(inverse->index));
  const int channel = plain->role.channel == "r" ? 0 : plain->role.channel == "b" ? 2 : 1;
  const int channels = one.value.channels(), seen = channels == 1 ? 0 : channel;
  std::vector<float> light;
  for (std::size_t i = 0; i < one.value.pixels(); ++i)
    light.push_back(one.value.data()[i * channels + seen] + other.value.data()[i * channels + seen]);
  std::vector<float> sorted = light;
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), nth, sorted.end());
  for (std::size_t i = 0; i < light.size(); ++i) {
    const float a = one.value.data()[i * channels + seen], b = other.value.data()[i * channels + seen];
    if (!one.valid.data()[i] || !other.valid.data()[i] || light[i] < kBright * *nth) continue;
    if (std::abs(a - b) < kDirect * light[i]) continue;
    ++found.clear;
    found.unread +=
        std::none_of(decoded.begin(), decoded.end(), [&](const Correspondence& c) { return c.reason.data()[i] == 0; });
  }
  return found;
}

namespace {

constexpr int kWide = 12;   // the same of what counts as smooth light
constexpr int kSmooth = 2;  // half width of the window, px

// Means over windows of that half width; one that leaves the image or touches what is no number has none.
Image smoothed(const Image& image, int half) {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  const float share = 1.0f / static_cast<float>(2 * half + 1);
  Image rows(image.width(), image.height(), 1, kNaN), all = rows;
  for (int y = 0; y < image.height(); ++y)
    for (int x = half; x + half < image.width(); ++x) {
      float sum = 0;
      for (int k = -half; k <= half; ++k) sum += image.at(x + k, y);
      rows.at(x, y) = sum * share;
    }
  for (int y = half; y + half < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x) {
      float sum = 0;
      for (int k = -half; k <= half; ++k) sum += rows.at(x, y + k);
      all.at(x, y) = sum * share;
    }
  return all;
}

// Edges without noise and without smooth light, which a lamp may have added.
Image edges_of(const Image& image) {
  Image edges = smoothed(image, kSmooth);
  const Image wide = smoothed(image, kWide);
  for (std::size_t i = 0; i < edges.data().size(); ++i) edges.data()[i] -= wide.data()[i];
  return edges;
}

// Adds `weight` times a photo's channel; what is saturated becomes no number.
Result<void> add_photo(const PhotoSource& photos, int index, int channel, float weight, Image& sum) {
  CS_TRY(const Photo photo, photos(index));
  const int channels = photo.value.channels(), c = channels == 1 ? 0 : channel;
  if (sum.empty()) sum = Image(photo.value.width(), photo.value.height(), 1);
  if (!sum.same_size(photo.value.width(), photo.value.height()))
    return error(ErrorCode::kBadFile, "photo {:04} is {} x {} pixels, the others are {} x {}", index,
                 photo.value.width(), photo.value.height(), sum.width(), sum.height());
  for (std::size_t i = 0; i < sum.data().size(); ++i)
    sum.data()[i] = photo.valid.data()[i] ? sum.data()[i] + weight * photo.value.data()[i * channels + c]
                                          : std::numeric_limits<float>::quiet_NaN();
  return {};
}

// Frames of white, one per projector, and one of black; empty where one is missing.
std::vector<int> levels_of(const Sequence& sequence) {
  std::vector<int> whites;
  int black = -1;
  for (const auto& [id, size] : sequence.projectors) {
    const auto white = std::find_if(sequence.frames.begin(), sequence.frames.end(), [&](const Frame& f) {
      return f.role.kind == "white" &&
             (f.role.projector == id || (f.role.projector.empty() && sequence.projectors.size() == 1));
    });
    if (white == sequence.frames.end()) return {};
    whites.push_back(white->index);
  }
  for (const Frame& f : sequence.frames)
    if (black < 0 && f.role.kind == "black") black = f.index;
  if (black < 0) return {};
  whites.push_back(black);
  return whites;
}

std::optional<ViewShift> fit_shift(const Image& reference, const Image& later) {
  Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
  Eigen::Vector4d g = Eigen::Vector4d::Zero();
  double squares = 0, count = 0;
  for (int y = 1; y + 1 < reference.height(); ++y)
    for (int x = 1; x + 1 < reference.width(); ++x) {
      const float r = reference.at(x, y), s = later.at(x, y);
      const Eigen::Vector4d j(r, 1, -(reference.at(x + 1, y) - reference.at(x - 1, y)) / 2,
                              -(reference.at(x, y + 1) - reference.at(x, y - 1)) / 2);
      if (!j.allFinite() || !std::isfinite(s)) continue;
      A += j * j.transpose(), g += s * j, squares += static_cast<double>(s) * s, count += 1;
    }
  const Eigen::FullPivLU<Eigen::Matrix4d> solver(A);
  if (count < 1000 || !solver.isInvertible()) return std::nullopt;
  const Eigen::Vector4d fitted = solver.solve(g);
  const Eigen::Matrix4d inverse = solver.inverse();
  const double scale = fitted[0];
  if (!(scale > 0)) return std::nullopt;
  // A smoothed pixel shares its noise with a window of others.
  const double variance = std::max(0.0, squares - fitted.dot(g)) / count * std::pow(2 * kSmooth + 1, 2);
  ViewShift shift{fitted[2] / scale, fitted[3] / scale, 0};
  shift.sigma = std::sqrt(std::max(inverse(2, 2), inverse(3, 3)) * variance) / scale;
  return shift;
}

}  // namespace

double ViewShift::length() const {
  return std::hypot(x, y);
}

bool ViewShift::moved() const {
  return length() > std::max(kMostViewShift, 5 * sigma);
}

Result<std::optional<ViewShift>> shift_of_view(const Sequence& sequence, const PhotoSource& photos) {
  const Frame *plain = blocks_of(sequence, false), *inverse = blocks_of(sequence, true);
  const std::vector<int> levels = levels_of(sequence);
  if (!plain || !inverse || plain->role.channel != inverse->role.channel || levels.empty())
    return std::optional<ViewShift>();
  const int channel = plain->role.channel == "r" ? 0 : plain->role.channel == "b" ? 2 : 1;
  Image reference, later;
  for (int white : std::span(levels).first(levels.size() - 1))
    CS_TRY_VOID(add_photo(photos, white, channel, 1, reference));
  CS_TRY_VOID(add_photo(photos, levels.back(), channel, -static_cast<float>(levels.size() - 1), reference));
  for (const Frame* blocks : {plain, inverse}) CS_TRY_VOID(add_photo(photos, blocks->index, channel, 1, later));
  CS_TRY_VOID(add_photo(photos, levels.back(), channel, -2, later));
  return fit_shift(edges_of(reference), edges_of(later));
}

}  // namespace countershade::capture

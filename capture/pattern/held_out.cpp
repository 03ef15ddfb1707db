#include "capture/pattern/held_out.h"

#include <cmath>

#include "capture/pattern/pattern.h"

namespace countershade::capture {

namespace {

constexpr int kMargin = 2;       // px: position may be off by as much, and blur reaches as far
constexpr float kClear = 0.25f;  // of the light of both: below, indirect light may have decided

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

}  // namespace countershade::capture

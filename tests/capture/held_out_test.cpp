#include "capture/diagnose/held_out.h"

#include <gtest/gtest.h>

#include <memory>

#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::rig_of;
using fake::View;

struct Decoded {
  Sequence sequence;
  PhotoSource photos;
  std::vector<Correspondence> all;
};

Decoded decoded(const View& view) {
  Decoded d;
  d.sequence = *sequence_with(rig_of(view), {"micro-phase"});
  d.photos = view.photos(d.sequence, "held out");
  SilentProgress silent;
  auto c = decode_frames(d.sequence, d.photos, "cam", "p", {}, silent);
  EXPECT_TRUE(c) << c.error().message;
  d.all.push_back(*std::move(c));
  return d;
}

TEST(AuditCodes, FindsAsManyWrongCodesAsWerePlanted) {
  View view;
  view.full_well = 10000, view.blur_px = 0.6;
  Decoded d = decoded(view);
  const auto right = audit_codes(d.sequence, d.photos, d.all);
  ASSERT_TRUE(right);
  ASSERT_EQ(right->size(), 1u);
  EXPECT_GT((*right)[0].judged, 0.5 * static_cast<double>(d.all[0].accepted));
  EXPECT_EQ((*right)[0].contradicted, 0u);
  // A twentieth of the pixels elsewhere on the picture: half of them land on a block that is lit alike.
  Random random(7);
  for (std::size_t i = 0; i < d.all[0].reason.data().size(); ++i)
    if (random.uniform() < 0.05) {
      d.all[0].x.data()[i] = static_cast<float>(random.uniform() * view.projector_width);
      d.all[0].y.data()[i] = static_cast<float>(random.uniform() * view.projector_height);
    }
  const auto wrong = audit_codes(d.sequence, d.photos, d.all);
  ASSERT_TRUE(wrong);
  EXPECT_NEAR((*wrong)[0].wrong(), 0.05, 0.01);
}

TEST(AuditCodes, LeavesOutWhatAnotherProjectorLights) {
  View view;
  view.full_well = 10000;
  Decoded d = decoded(view);
  Correspondence other = d.all[0];
  other.projector = "q";
  d.all.push_back(other);
  const auto audits = audit_codes(d.sequence, d.photos, d.all);
  ASSERT_TRUE(audits);
  ASSERT_EQ(audits->size(), 2u);
  EXPECT_EQ((*audits)[0].judged, 0u);
  EXPECT_EQ((*audits)[0].wrong(), 0);
}

TEST(AuditCodes, SaysNothingWithoutBlocks) {
  const View view;
  Decoded d = decoded(view);
  std::erase_if(d.sequence.frames, [](const Frame& f) { return f.role.kind == "blocks"; });
  const auto audits = audit_codes(d.sequence, d.photos, d.all);
  ASSERT_TRUE(audits);
  EXPECT_TRUE(audits->empty());
}

TEST(UnreadPixels, AreThoseThatBlocksShowAndNoCodeReads) {
  View view;
  view.full_well = 10000, view.blur_px = 0.6;
  Decoded d = decoded(view);
  const auto good = unread_pixels(d.sequence, d.photos, d.all);
  ASSERT_TRUE(good);
  EXPECT_GT(good->clear, 0.5 * static_cast<double>(d.all[0].accepted));
  EXPECT_LT(good->share(), 0.02);
  // The left third is taken for dark; one that another projector reads is read.
  Correspondence other = d.all[0];
  for (int v = 0; v < view.height; ++v)
    for (int u = 0; u < view.width / 3; ++u) {
      d.all[0].reason.at(u, v) = static_cast<std::uint8_t>(Reason::kDark);
      if (v < view.height / 2) other.reason.at(u, v) = static_cast<std::uint8_t>(Reason::kIndirect);
    }
  EXPECT_NEAR(unread_pixels(d.sequence, d.photos, d.all)->share(), 1.0 / 3, 0.05);  // blocks and borders are uneven
  d.all.push_back(other);
  EXPECT_NEAR(unread_pixels(d.sequence, d.photos, d.all)->share(), 1.0 / 6, 0.05);
  std::erase_if(d.sequence.frames, [](const Frame& f) { return f.role.kind == "blocks"; });
  EXPECT_EQ(unread_pixels(d.sequence, d.photos, d.all)->clear, 0u);
}

// A view whose photos of block patterns were taken (x, y) px beside where those of the code were.
PhotoSource moved_between(const Sequence& sequence, const View& view, double x, double y) {
  View later = view;
  later.map = [=](double u, double v) { return view.map(u - x, v - y); };
  later.albedo = [=](double u, double v) { return view.albedo(u - x, v - y); };
  const auto kept = std::make_shared<std::pair<View, View>>(view, later);
  const PhotoSource before = kept->first.photos(sequence, "before"), after = kept->second.photos(sequence, "after");
  return [=](int index) {
    (void)kept;
    for (const Frame& f : sequence.frames)
      if (f.index == index && f.role.kind == "blocks") return after(index);
    return before(index);
  };
}

// A picture whose borders are seen, with the contrast of a room.
View bordered() {
  View view;
  view.full_well = 10000, view.blur_px = 0.6;
  view.map = [](double u, double v) { return std::pair(-30 + 1.4 * u - 0.1 * v, -24 + 0.1 * u + 1.7 * v); };
  return view;
}

TEST(ViewShift, IsThatWhichWasPlantedAndItsSigmaKnows) {
  const Sequence sequence = *sequence_with(rig_of(bordered()), {"micro-phase"});
  for (const auto& [x, y] : {std::pair(0.0, 0.0), std::pair(0.3, -0.2), std::pair(-0.9, 0.4), std::pair(1.2, 1.6)}) {
    const auto shift = shift_of_view(sequence, moved_between(sequence, bordered(), x, y));
    ASSERT_TRUE(shift && *shift);
    // Noise, and what a straight line misses of edges: a tenth at two pixels.
    const double bent = 0.05 * std::hypot(x, y);
    EXPECT_NEAR((*shift)->x, x, 4 * (*shift)->sigma + bent) << x << " " << y;
    EXPECT_NEAR((*shift)->y, y, 4 * (*shift)->sigma + bent) << x << " " << y;
    EXPECT_LT((*shift)->sigma, 0.03);
    EXPECT_EQ((*shift)->moved(), x != 0) << x << " " << y;
  }
}

TEST(ViewShift, IsNoneWhenLampsChanged) {
  const Sequence sequence = *sequence_with(rig_of(bordered()), {"micro-phase"});
  const View view = bordered();
  View brighter = view;
  brighter.gain *= 0.9, brighter.ambient += 0.03;
  const PhotoSource before = view.photos(sequence, "before"), after = brighter.photos(sequence, "after");
  const auto shift = shift_of_view(sequence, [&](int index) -> Result<Photo> {
    for (const Frame& f : sequence.frames)
      if (f.index == index && f.role.kind == "blocks") {
        CS_TRY(Photo photo, after(index));
        for (int v = 0; v < view.height; ++v)  // a lamp at the right
          for (int u = 0; u < view.width; ++u)
            photo.value.at(u, v) += static_cast<float>(0.03 + 0.2 * u / view.width - 0.12 * v / view.height);
        return photo;
      }
    return before(index);
  });
  ASSERT_TRUE(shift && *shift);
  EXPECT_LT((*shift)->length(), 0.03);  // a fifth of the bound
}

TEST(ViewShift, NeedsBlocksAndLevels) {
  for (const char* kind : {"blocks", "white", "black"}) {
    Sequence sequence = *sequence_with(rig_of(bordered()), {"micro-phase"});
    std::erase_if(sequence.frames, [&](const Frame& f) { return f.role.kind == kind; });
    const View view = bordered();
    const auto shift = shift_of_view(sequence, view.photos(sequence, "none"));
    ASSERT_TRUE(shift) << kind;
    EXPECT_FALSE(*shift) << kind;
  }
}

}  // namespace
}  // namespace countershade::capture

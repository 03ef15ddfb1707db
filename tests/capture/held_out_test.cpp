#include "capture/pattern/held_out.h"

#include <gtest/gtest.h>

#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::View;

struct Decoded {
  Sequence sequence;
  PhotoSource photos;
  std::vector<Correspondence> all;
};

Decoded decoded(const View& view) {
  Rig rig;
  rig.projectors.resize(1);
  rig.projectors[0].id = "p", rig.projectors[0].resolution = {view.projector_width, view.projector_height};
  Decoded d;
  d.sequence = *sequence_with(rig, {"micro-phase"});
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

}  // namespace
}  // namespace countershade::capture

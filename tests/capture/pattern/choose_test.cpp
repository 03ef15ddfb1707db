#include "capture/pattern/choose.h"

#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::rig_of;
using fake::test_name;
using fake::View;
using testing::HasSubstr;

View view_with(double gain, double bounce) {
  View view;
  view.width = 200, view.height = 140, view.projector_width = 1920, view.projector_height = 280;
  view.map = [](double u, double v) { return std::pair(1180 + 1.33 * u - 0.11 * v, 69 + 0.07 * u + 1.21 * v); };
  view.full_well = 10000, view.blur_px = 0.6, view.gain = gain;
  view.bounce = [bounce](double, double) { return bounce; };
  return view;
}

Result<CodeChoice> chosen(const View& view) {
  const Sequence base = base_sequence(rig_of(view));
  return choose_code(base, view.photos(base, test_name()), "p", {});
}

TEST(ChooseCode, TakesTheCheapestThatWillDo) {
  const auto easy = chosen(view_with(0.7, 0.2));
  ASSERT_TRUE(easy) << easy.error().message;
  EXPECT_EQ(easy->code, "micro-phase");
  EXPECT_THAT(easy->reason, HasSubstr("the cheapest"));
  // Dim: 14 photos do not hold enough light to unwrap, 18 do.
  const auto dim = chosen(view_with(0.055, 0.6));
  ASSERT_TRUE(dim) << dim.error().message;
  EXPECT_EQ(dim->code, "micro-phase-9");
  EXPECT_GT(dim->noise, 3 * easy->noise);
  for (std::size_t i = 1; i < easy->forecasts.size(); ++i)
    EXPECT_GE(easy->forecasts[i].frames, easy->forecasts[i - 1].frames);
}

// The forecast against what the decoder then does.
TEST(ChooseCode, ForecastsWhatDecodingWillFind) {
  for (const auto& [gain, bounce] : {std::pair(0.6, 0.3), {0.25, 1.6}, {0.1, 0.1}}) {
    const View view = view_with(gain, bounce);
    const auto choice = chosen(view);
    ASSERT_TRUE(choice) << choice.error().message;
    // The direct share: what bounces is given by half the columns, half of them lit.
    EXPECT_NEAR(choice->direct, 0.95 / (1 + bounce), 0.06) << bounce;
    for (const CodeForecast& f : choice->forecasts) {
      // PHYSICS 8: .59 px at a period of 240 and .08 at 80, on the power law through both; as indirect to direct light.
      const double bias = 0.08 * std::pow(16.0 / 80, std::log(0.59 / 0.08) / std::log(3.0));
      EXPECT_NEAR(f.bias_px, bias * (1 / choice->direct - 1), 0.1 * f.bias_px);
      const auto sequence = sequence_with(rig_of(view), {f.code});
      ASSERT_TRUE(sequence);
      SilentProgress silent;
      const auto c = decode_frames(*sequence, view.photos(*sequence, test_name() + f.code), "cam", "p", {}, silent);
      const double lost = c ? 1 - fake::score(view, *c).coverage() : 1;
      EXPECT_NEAR(f.lost, lost, 0.2) << f.code << " gain " << gain << " bounce " << bounce;
      if (!c || lost > 0.1) continue;
      const double rms = fake::score(view, *c).rms;
      EXPECT_GT(f.sigma_px, 0.6 * rms) << f.code << " gain " << gain;
      EXPECT_LT(f.sigma_px, 1.4 * rms) << f.code << " gain " << gain;
    }
  }
}

TEST(ChooseCode, RefusesADarkViewAndNamesWhatIsMissing) {
  const auto dark = chosen(view_with(0.0001, 0));
  ASSERT_FALSE(dark);
  EXPECT_THAT(dark.error().message, HasSubstr("fine stripes are not visible"));
  const View view = view_with(0.6, 0.3);
  Sequence part = base_sequence(rig_of(view));
  part.frames.pop_back();
  const auto missing = choose_code(part, view.photos(part, test_name()), "p", {});
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, HasSubstr("lacks the white, black or sinusoid frames"));
}

TEST(ChooseCode, IsWrittenForPeopleAndPrograms) {
  const auto choice = chosen(view_with(0.6, 0.3));
  ASSERT_TRUE(choice);
  EXPECT_THAT(choice_text(*choice), HasSubstr("> micro-phase "));
  const auto json = nlohmann::json::parse(choices_json({*choice}));
  EXPECT_EQ(json["choices"][0]["code"], "micro-phase");
  EXPECT_EQ(json["choices"][0]["forecasts"].size(), 2u);
}

TEST(SequenceWith, BeginsWithTheBaseAndShowsNothingTwice) {
  Rig rig;
  rig.projectors.resize(2);
  for (int q = 0; q < 2; ++q)
    rig.projectors[q].id = q ? "right" : "left", rig.projectors[q].resolution = {640 + 32 * q, 400};
  const Sequence base = base_sequence(rig);
  const auto whole = sequence_with(rig, {"micro-phase", "gray"});
  ASSERT_TRUE(whole);
  ASSERT_EQ(base.frames.size(), 16u);
  for (std::size_t i = 0; i < base.frames.size(); ++i) EXPECT_EQ(whole->frames[i].role, base.frames[i].role);
  for (std::size_t i = 0; i < whole->frames.size(); ++i) {
    EXPECT_EQ(whole->frames[i].index, static_cast<int>(i));
    for (std::size_t k = 0; k < i; ++k) EXPECT_FALSE(whole->frames[i].role == whole->frames[k].role) << i << " " << k;
  }
  // 8 + 8 of the left code, 8 + 2 (10 + 9) of the right one, and 7 + 3 + 2 for the light.
  EXPECT_EQ(whole->frames.size(), 16u + 8u + 38u + 12u);
}

}  // namespace
}  // namespace countershade::capture

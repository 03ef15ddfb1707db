#include "capture/diagnose/diagnose.h"

#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>

#include "tests/capture/fake_room.h"
#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::View;
using testing::AllOf;
using testing::AnyOf;
using testing::HasSubstr;
using testing::StartsWith;
namespace fs = std::filesystem;

std::string test_name() {
  const auto* info = testing::UnitTest::GetInstance()->current_test_info();
  return std::string(info->test_suite_name()) + info->name();
}

View noisy() {
  View view;
  view.full_well = 10000, view.blur_px = 0.6;
  view.width = 180, view.height = 120;
  view.map = [](double u, double v) {
    return std::pair(14 + 1.43 * u - 0.11 * v + 0.0006 * u * v, 9 + 0.07 * u + 1.51 * v - 0.0004 * u * u);
  };
  return view;
}

// What decoding and diagnosis say of photos that follow `shown` but are said to follow `stated`.
std::vector<Finding> findings_of(const Sequence& stated, const PhotoSource& photos,
                                 const std::string& response = "linear") {
  SilentProgress silent;
  const auto c = decode_frames(stated, photos, "cam", "p", {}, silent);
  return diagnose(stated, photos, {"cam", "p", c ? &*c : nullptr, response});
}
// Photos of a view, each made once.
PhotoSource photos_of(const View& view, const Sequence& shown) {
  const PhotoSource live = view.photos(shown, test_name());
  auto kept = std::make_shared<std::map<int, Photo>>();
  for (const Frame& f : shown.frames) (*kept)[f.index] = *live(f.index);
  return [kept](int index) -> Result<Photo> {
    const auto photo = kept->find(index);
    if (photo == kept->end()) return error(ErrorCode::kBadFile, "no frame {}", index);
    return photo->second;
  };
}
std::vector<Finding> findings_of(const View& view, const Sequence& shown, const Sequence& stated) {
  return findings_of(stated, photos_of(view, shown));
}
std::string names(const std::vector<Finding>& findings) {
  std::string names;
  for (const Finding& f : findings) names += f.name + " ";
  return names;
}

Sequence edited(Sequence sequence, const std::function<void(Role&)>& edit) {
  for (Frame& frame : sequence.frames) edit(frame.role);
  return sequence;
}
bool is_bit(const Role& r) {
  return r.kind == "gray" || r.kind == "xor";
}
void swap_axes(Role& r) {
  if (is_bit(r) || r.kind == "phase") r.axis = r.axis == "x" ? "y" : "x";
}
void swap_inverse(Role& r) {
  if (is_bit(r)) r.inverse = !r.inverse;
}
// Bits are numbered from the coarsest one; `axes`: which do so.
std::function<void(Role&)> reverse_bits(const View& view, const std::string& axes = "xy") {
  return [&view, axes](Role& r) {
    const int top = gray_bits(r.axis == "x" ? view.projector_width : view.projector_height) - 1;
    if (!is_bit(r) || axes.find(r.axis) == std::string::npos) return;
    r.bit = top - r.bit;
    if (r.kind == "xor") r.base = top - r.base;
  };
}
void swap_levels(Role& r) {
  if (r.kind == "white" || r.kind == "black") r.kind = r.kind == "white" ? "black" : "white";
}
void reverse_steps(Role& r) {
  if (r.kind == "phase") r.shift_rad = -wave_shift(r);
}
// Photo of position i is that of position i + step from k on (the last is what comes last).
PhotoSource shifted(const PhotoSource& photos, const Sequence& sequence, int k, int step) {
  return [=](int index) -> Result<Photo> {
    const int count = static_cast<int>(sequence.frames.size());
    for (int i = 0; i < count; ++i)
      if (sequence.frames[i].index == index)
        return photos(sequence.frames[i < k ? i : std::clamp(i + step, 0, count - 1)].index);
    return error(ErrorCode::kBadFile, "no frame {}", index);
  };
}

std::string case_name(const testing::TestParamInfo<std::string>& info) {
  std::string name = info.param;
  std::erase(name, '-');
  return name;
}
class BitsStated : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Codes, BitsStated, testing::Values("gray", "xor-04"), case_name);
class CodeStated : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Codes, CodeStated, testing::Values("gray", "xor-04", "micro-phase", "phase"), case_name);

TEST_P(CodeStated, AsShownGivesNoFinding) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, GetParam());
  const PhotoSource photos = photos_of(view, shown);
  EXPECT_EQ(names(findings_of(shown, photos)), "");
  if (GetParam() == "phase") return;  // as micro phase, and slow
  EXPECT_EQ(names(diagnose(shown, photos, {"cam", "p"})), "") << "though every edit is tried";
}

TEST_P(CodeStated, WithAxesSwappedIsNamed) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, GetParam());
  const auto findings = findings_of(view, shown, edited(shown, swap_axes));
  ASSERT_EQ(names(findings), "axes-swapped ");
  EXPECT_THAT(findings[0].sentence, AllOf(HasSubstr("projector 'p'"), HasSubstr("`axis`")));
  EXPECT_GT(findings[0].if_so, 0.95);
}

// The camera sees a part of the projector whose rows and columns could be exchanged.
TEST(AxesSwapped, IsNamedByTheLengthOfTheCodesWhereBothOrdersFit) {
  View view = noisy();
  view.map = [](double u, double v) { return std::pair(14 + 1.03 * u - 0.11 * v, 9 + 0.07 * u + 1.21 * v); };
  const Sequence shown = fake::sequence_of(view, "gray");
  const auto findings = findings_of(view, shown, edited(shown, swap_axes));
  ASSERT_EQ(names(findings), "axes-swapped ");
  EXPECT_GT(findings[0].as_given, 0.95) << "no share tells";
  EXPECT_THAT(findings[0].sentence, HasSubstr("as long as the other axis needs"));
}

// Position 8 is the fourth bit of x of Gray and XOR codes, the last shift of the second period of sinusoids.
TEST_P(CodeStated, AFrameTooFewOrTooManyIsNamedAndFound) {
  if (GetParam() == "phase") GTEST_SKIP() << "as micro phase, and slow";
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, GetParam());
  const PhotoSource photos = photos_of(view, shown);
  constexpr int k = 8;
  const auto missing = findings_of(shown, shifted(photos, shown, k, 1));
  ASSERT_EQ(names(missing), "frame-missing ");
  EXPECT_THAT(missing[0].sentence, HasSubstr("frame 8 ("));
  if (GetParam() == "micro-phase") return;  // slow
  const auto doubled = findings_of(shown, shifted(photos, shown, k, -1));
  ASSERT_EQ(names(doubled), "frame-doubled ");
  EXPECT_THAT(doubled[0].sentence, AnyOf(HasSubstr("frame 7 ("), HasSubstr("frame 8 (")));  // both photos show 7
}

// With all bits behind it one too coarse, an axis reads as smoothly at half its scale.
TEST(FrameDoubled, IsNotTakenForAMissingOneThatWouldHalveTheScale) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, "gray");
  const PhotoSource photos = photos_of(view, shown);
  for (const int k : {22, 24})  // bits 7 and 6 of y begin at 20 and 22
    EXPECT_EQ(names(findings_of(shown, shifted(photos, shown, k, -1))), "frame-doubled ") << k;
}

TEST_P(BitsStated, WithInverseSwappedIsNamed) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, GetParam());
  EXPECT_EQ(names(findings_of(view, shown, edited(shown, swap_inverse))), "inverse-swapped ");
  const auto one = findings_of(view, shown, edited(shown, [](Role& r) {
                                 if (r.axis == "y") swap_inverse(r);
                               }));
  ASSERT_EQ(names(one), "inverse-swapped ");
  EXPECT_THAT(one[0].sentence, HasSubstr("on axis y"));
}

TEST_P(BitsStated, WithBitsReversedIsNamed) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, GetParam());
  EXPECT_EQ(names(findings_of(view, shown, edited(shown, reverse_bits(view)))), "bits-reversed ");
  const auto one = findings_of(view, shown, edited(shown, reverse_bits(view, "x")));
  ASSERT_EQ(names(one), "bits-reversed ");
  EXPECT_THAT(one[0].sentence, HasSubstr("on axis x"));
}

TEST(Xor, WithPhotosOfItsBitsInReverseOrderIsNamed) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, "xor-04");
  Sequence stated = shown;
  for (Frame& f : stated.frames)
    for (const Frame& g : shown.frames)
      if (is_bit(f.role) && is_bit(g.role) && f.role.axis == g.role.axis && f.role.inverse == g.role.inverse &&
          f.role.bit + g.role.bit == (f.role.axis == "x" ? 8 : 7))
        f.index = g.index;
  EXPECT_EQ(names(findings_of(view, shown, stated)), "bits-reversed ");
}

TEST_P(BitsStated, WithWhiteAndBlackSwappedIsNamed) {
  const View view = noisy();
  const Sequence shown = fake::sequence_of(view, GetParam());
  EXPECT_EQ(names(findings_of(view, shown, edited(shown, swap_levels))), "levels-swapped ");
}

TEST_P(CodeStated, SeenInAMirrorIsNamed) {
  View view = noisy();
  view.map = [map = view.map](double u, double v) { return map(179 - u, v); };
  const Sequence shown = fake::sequence_of(view, GetParam());
  const auto findings = findings_of(view, shown, shown);
  ASSERT_EQ(names(findings), "mirrored ");
  EXPECT_GT(findings[0].if_so, 0.98);
}

TEST(StepsOfSinusoids, ReversedAreNamed) {
  const View view = noisy();
  const Sequence micro = fake::sequence_of(view, "micro-phase");
  const auto one = findings_of(view, micro, edited(micro, [](Role& r) {
                                 if (r.axis == "x") reverse_steps(r);
                               }));
  ASSERT_EQ(names(one), "steps-reversed ");
  EXPECT_THAT(one[0].sentence, HasSubstr("on axis x"));
}

// They decode: the Gray code says which turn, and every turn reads backwards.
TEST(StepsOfSinusoids, ReversedAreNamedWhereTheyRefineAGrayCode) {
  const View view = noisy();
  Sequence shown = fake::code_of(view, {.cell_px = 8});
  Role r;
  r.kind = "phase", r.projector = "p", r.steps = 4, r.period_px = 32;
  for (const char* axis : {"x", "y"})
    for (r.step = 0; r.step < 4; ++r.step)
      r.axis = axis, shown.frames.push_back({static_cast<int>(shown.frames.size()) + 3, r});
  EXPECT_EQ(names(findings_of(view, shown, shown)), "");
  EXPECT_EQ(names(findings_of(view, shown, edited(shown, reverse_steps))), "steps-reversed ");
}

TEST(AnotherProjector, IsNamedWhereItsCodeGoesOnBeyondTheResolution) {
  View view = noisy();
  view.projector_width = 500;
  view.map = [](double u, double v) {
    return std::pair(14 + 2.5 * u - 0.11 * v + 0.0006 * u * v, 9 + 0.07 * u + 1.51 * v - 0.0004 * u * u);
  };
  const Sequence shown = fake::sequence_of(view, "gray");
  const PhotoSource photos = photos_of(view, shown);
  Sequence stated = shown;
  stated.projectors[0].second = {300, 220};
  const auto beyond = findings_of(stated, photos);
  ASSERT_EQ(names(beyond), "other-projector ");
  EXPECT_THAT(beyond[0].sentence, HasSubstr("300 x 220"));
  stated.projectors.emplace_back("q", std::array<int, 2>{500, 220});
  const auto known = findings_of(stated, photos);
  ASSERT_EQ(names(known), "projectors-exchanged ");
  EXPECT_THAT(known[0].sentence, HasSubstr("'q' has 500 x 220"));
}

// Two projectors of one resolution: no code tells them apart, a picture that differs between them does.
TEST(AnotherProjector, OfEqualResolutionIsNamedByAHeldOutPicture) {
  const View view = noisy();
  Sequence stated = fake::sequence_of(view, "gray");
  stated.projectors.emplace_back("q", stated.projectors[0].second);
  Role held_out;
  held_out.kind = "held-out", held_out.seed = 11;
  stated.frames.push_back({900, held_out});
  const PhotoSource photos = photos_of(view, stated);  // of "p"
  EXPECT_EQ(names(findings_of(stated, photos)), "");
  const Sequence exchanged = edited(stated, [](Role& r) {
    if (r.projector == "p") r.projector = "q";
  });
  SilentProgress silent;
  const auto c = decode_frames(exchanged, photos, "cam", "q", {}, silent);
  ASSERT_TRUE(c) << c.error().message;
  const auto findings = diagnose(exchanged, photos, {"cam", "q", &*c});
  ASSERT_EQ(names(findings), "projectors-exchanged ");
  EXPECT_GT(findings[0].if_so, 0.6);  // this camera sees green alone
  EXPECT_LT(findings[0].as_given, 0.4);
}

PhotoSource changed(const PhotoSource& photos, const std::function<void(Image&)>& change) {
  return [=](int index) -> Result<Photo> {
    auto photo = photos(index);
    if (photo) change(photo->value);
    return photo;
  };
}
void to_8_bits(Image& image) {
  for (float& v : image.data()) v = std::round(255 * std::clamp(v, 0.0f, 1.0f)) / 255;
}
void encode(Image& image, double gamma) {
  for (float& v : image.data()) v = std::pow(std::max(v, 0.0f), static_cast<float>(1 / gamma));
  to_8_bits(image);
}
void compress(Image& image, int quality) {
  cv::Mat bytes(image.height(), image.width(), CV_8UC1);
  for (int y = 0; y < bytes.rows; ++y)
    for (int x = 0; x < bytes.cols; ++x)
      bytes.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(255 * image.at(x, y));
  std::vector<std::uint8_t> file;
  cv::imencode(".jpg", bytes, file, {cv::IMWRITE_JPEG_QUALITY, quality});
  bytes = cv::imdecode(file, cv::IMREAD_GRAYSCALE);
  for (int y = 0; y < bytes.rows; ++y)
    for (int x = 0; x < bytes.cols; ++x) image.at(x, y) = bytes.at<std::uint8_t>(y, x) / 255.0f;
}

TEST(GammaEncodedPhotos, AreNamedWithTheirExponent) {
  const View view = noisy();
  const Sequence shown = fake::code_of(view, {.axes = "x"});
  const PhotoSource photos = photos_of(view, shown);
  EXPECT_EQ(names(findings_of(shown, changed(photos, to_8_bits))), "") << "8 bits alone are no fault";
  for (const double g : {1.25, 1.8, 2.2, 2.6}) {
    const auto findings = findings_of(shown, changed(photos, [g](Image& image) { encode(image, g); }));
    ASSERT_EQ(names(findings), "gamma-encoded ") << g;
    EXPECT_NEAR(findings[0].if_so, g, 0.03 * g);  // photon noise is not symmetric once it is bent
    EXPECT_THAT(findings[0].sentence, HasSubstr(fmt::format("response = \"gamma:{:.1f}\"", findings[0].if_so)));
  }
}

TEST(GammaEncodedPhotos, SaidToBeSoButLinearAreToldToBeLinear) {
  const View view = noisy();
  const Sequence shown = fake::code_of(view, {.axes = "x"});
  const PhotoSource photos = changed(photos_of(view, shown), [](Image& image) { encode(image, 1 / 2.2); });
  const auto findings = findings_of(shown, photos, "gamma:2.2");
  ASSERT_EQ(names(findings), "gamma-encoded ");
  EXPECT_THAT(findings[0].sentence, HasSubstr("response = \"linear\""));
}

TEST(JpegPhotos, AreNamed) {
  const View view = noisy();
  for (const bool levels : {true, false}) {
    const Sequence shown = fake::code_of(view, {.levels = levels, .axes = "y"});
    const PhotoSource photos = photos_of(view, shown);
    for (const int quality : {50, 80, 95}) {
      const auto findings = findings_of(shown, changed(photos, [=](Image& image) { compress(image, quality); }));
      EXPECT_THAT(names(findings), HasSubstr("jpeg ")) << quality;
    }
  }
}

struct Sound {
  std::string name;
  View view;
  fake::CodeOptions options;
};
std::vector<Sound> sound_views() {
  std::vector<Sound> all;
  const auto add = [&](const char* name, const std::function<void(View&)>& change, const fake::CodeOptions& o = {}) {
    all.push_back({name, noisy(), o});
    change(all.back().view);
  };
  add("one axis", [](View&) {}, {.axes = "y"});
  add("no white and black", [](View&) {}, {.levels = false});
  add("cells of 4 px", [](View&) {}, {.cell_px = 4});
  for (const double bounce : {0.8, 3.0})
    add("indirect light", [bounce](View& view) {
      view.gain = 0.9 / (1 + bounce);
      view.projector_width = 700;
      view.map = [](double u, double v) { return std::pair(220 + 1.43 * u - 0.11 * v, 9 + 0.07 * u + 1.51 * v); };
      view.bounce = [bounce](double u, double v) { return bounce * (1 + 0.1 * std::sin(u / 30 + v / 50)); };
    });
  add("steep", [](View& view) {
    view.projector_width = 800, view.projector_height = 600;
    view.map = [](double u, double v) { return std::pair(20 + 3.4 * u - 0.4 * v, 9 + 0.3 * u + 4.2 * v); };
  });
  add("many camera pixels each",
      [](View& view) { view.map = [](double u, double v) { return std::pair(20.3 + 0.2 * u, 41.2 + 0.17 * v); }; });
  add("dim", [](View& view) { view.gain = 0.03; });
  add("very dim", [](View& view) { view.gain = 0.015; });
  add("daylight", [](View& view) { view.gain = 0.15, view.ambient = 0.6; });
  add("occlusion edges", [](View& view) {
    view.map = [](double u, double v) {
      const double jump = static_cast<int>(u / 23 + v / 40) % 2 ? 43 : 0;
      return std::pair(12 + 1.2 * u + 0.05 * v + jump, 12 + 1.5 * v + 0.04 * u - 0.2 * jump);
    };
  });
  add("chessboard", [](View& view) {
    view.albedo = [](double u, double v) {
      return (static_cast<int>(u / 20) + static_cast<int>(v / 20)) % 2 ? 0.9 : 0.06;
    };
  });
  add("out of focus", [](View& view) { view.blur_px = 2; });
  add("saturated and dark", [](View& view) {
    view.albedo = [](double u, double) { return u < 50 ? 1.4 : u < 120 ? 0.5 : 0.0005; };
  });
  add("half lit by bounces alone", [](View& view) {
    view.map = [](double u, double v) {
      return u < 90 ? std::pair(14 + 1.1 * u, 9 + 1.2 * v) : std::pair(-1000.0, 0.0);
    };
    view.bounce = [](double u, double) { return u < 90 ? 0.05 : 0.4; };
  });
  return all;
}

TEST(SoundViews, GiveNoFindingEvenWhenEveryEditIsTried) {
  for (const Sound& s : sound_views()) {
    const Sequence shown = fake::code_of(s.view, s.options);
    const PhotoSource photos = photos_of(s.view, shown);
    EXPECT_EQ(names(findings_of(shown, photos)), "") << s.name;
    EXPECT_EQ(names(diagnose(shown, photos, {"cam", "p"})), "") << s.name;
  }
}

// ---- photographs somebody else took ----

// A quarter of a photo, for speed.
Photo middle_of(const Photo& photo) {
  const int width = photo.value.width() / 2, height = photo.value.height() / 2;
  Photo middle{Image(width, height, photo.value.channels()), Mask(width, height, 1), 0};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < photo.value.channels(); ++c)
        middle.value.at(x, y, c) = photo.value.at(x + width / 2, y + height / 2, c);
      middle.valid.at(x, y) = photo.valid.at(x + width / 2, y + height / 2);
    }
  return middle;
}

class RealBoardStated : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Poses, RealBoardStated, testing::Values(4));

TEST_P(RealBoardStated, NamesWhatIsPlantedAndNothingElse) {
  const fs::path data = fs::path(COUNTERSHADE_SOURCE_DIR).parent_path() / "shared" / "data" / "graycode-board";
  if (!fs::exists(data)) GTEST_SKIP() << "'" << data.string() << "' is not on this machine";
  const auto shown = read_sequence(data / "sequence.json");
  ASSERT_TRUE(shown);
  auto kept = std::make_shared<std::map<int, Photo>>();
  for (const Frame& f : shown->frames) {
    auto photo = read_photo(data / fmt::format("pose_{}/photos/{:04}.png", GetParam(), f.index), {});
    ASSERT_TRUE(photo) << photo.error().message;
    (*kept)[f.index] = middle_of(*photo);
  }
  const PhotoSource photos = [kept](int index) -> Result<Photo> { return kept->at(index); };
  const auto said = [&](const Sequence& stated, const PhotoSource& source) {
    SilentProgress silent;
    const auto c = decode_frames(stated, source, "camera", "projector", {}, silent);
    return names(diagnose(stated, source, {"camera", "projector", c ? &*c : nullptr}));
  };
  EXPECT_EQ(said(*shown, photos), "");
  EXPECT_THAT(said(edited(*shown, swap_axes), photos), StartsWith("axes-swapped "));
  EXPECT_THAT(said(edited(*shown, swap_inverse), photos), StartsWith("inverse-swapped "));
  EXPECT_THAT(said(*shown, shifted(photos, *shown, 14, 1)), StartsWith("frame-missing "));
  const Sequence reversed = edited(*shown, [](Role& r) {
    if (is_bit(r)) r.bit = 9 - r.bit;
  });
  EXPECT_THAT(said(reversed, photos), StartsWith("bits-reversed "));
}

}  // namespace
}  // namespace countershade::capture

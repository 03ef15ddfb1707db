// The GL runtime shows what the CPU reference shows.
#include "solver/runtime/runtime.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "solver/runtime/matrix.h"
#include "tests/support/test_model.h"

namespace countershade::solver {
namespace {

// A GL context for the whole test; skips the test where there is none.
class Gl : public ::testing::Test {
 protected:
  void SetUp() override {
    auto made = HeadlessContext::make();
    if (!made) GTEST_SKIP() << made.error().message;
    context_ = *std::move(made);
  }
  std::unique_ptr<HeadlessContext> context_;
};

using Runtimes = Gl;

// Share of equal values; every value must be within one 8-bit code.
double equal_share(const Picture& a, const Picture& b) {
  EXPECT_TRUE(a.same_size(b.width(), b.height()));
  std::size_t equal = 0;
  for (std::size_t i = 0; i < a.data().size(); ++i) {
    EXPECT_LE(std::abs(int{a.data()[i]} - int{b.data()[i]}), 257) << "value " << i;
    equal += a.data()[i] == b.data()[i];
  }
  return static_cast<double>(equal) / static_cast<double>(a.data().size());
}

// Renders and compares with the CPU: receivers, pictures, report.
void expect_same(const Model& model, std::span<const Picture> pictures, const CompensateOptions& options,
                 Precision precision) {
  const Compensator cpu(model);
  auto gl = Runtime::make(model, options, precision);
  ASSERT_TRUE(gl) << gl.error().message;
  ASSERT_TRUE((*gl)->render(pictures));
  FrameReport report;
  const Radiosity expected = cpu.receiver_indirect(cpu.patch_target(pictures), options, report);
  const Result<Radiosity> indirect = (*gl)->read_receiver_indirect();
  ASSERT_TRUE(indirect);
  // Float: sums in another order. Half: form factors have 11 bits, errors of either sign.
  const double tolerance = (precision == Precision::kFloat ? 1e-5 : 2e-3) * model.white;
  EXPECT_LE((*indirect - expected).cwiseAbs().maxCoeff(), tolerance);
  const Compensated wanted = cpu.frame(pictures, options);
  const Result<Compensated> shown = (*gl)->read();
  ASSERT_TRUE(shown);
  EXPECT_EQ(shown->report.used, wanted.report.used);
  EXPECT_NEAR(shown->report.largest_indirect, wanted.report.largest_indirect, tolerance);
  EXPECT_NEAR(shown->report.clipped_pixels, wanted.report.clipped_pixels, 2e-3);  // pixels on the brink
  if (precision == Precision::kFloat) {
    EXPECT_EQ(shown->report.gathers, wanted.report.gathers);
  }
  for (std::size_t q = 0; q < model.projectors.size(); ++q)
    // Values on the brink of rounding: the difference in codes; half adds what 2e-3 of white could.
    EXPECT_GE(equal_share(shown->pictures[q], wanted.pictures[q]), precision == Precision::kFloat ? .999 : .99);
}

TEST_F(Runtimes, ContextIsModernAndDescribesItself) {
  EXPECT_NE(context_->description().find("OpenGL 4."), std::string::npos);
}

TEST_F(Runtimes, FrameEqualsTheCpuForEverySolver) {
  const Model model = test::room();
  for (const SolverChoice solver :
       {SolverChoice::kAuto, SolverChoice::kCopy, SolverChoice::kClosedForm, SolverChoice::kClipped})
    for (const bool dark : {false, true})
      for (const Precision precision : {Precision::kFloat, Precision::kHalf}) {
        SCOPED_TRACE(fmt::format("solver {} dark {} precision {}", int(solver), dark, int(precision)));
        expect_same(model, test::pictures(model, 60, 240, dark), {.solver = solver}, precision);
      }
}

TEST_F(Runtimes, ChoosesTheClosedFormWhereNothingClips) {
  Model model = test::room({.k = .5});
  const std::vector<Picture> pictures = test::pictures(model, 235, 250);
  {
    // Patches in the dark always clip; here they reflect nothing that would have to be taken away.
    const PatchTarget target = Compensator(model).patch_target(pictures);
    for (Eigen::Index i = 0; i < model.k.rows(); ++i)
      if ((target.target - target.low).row(i).minCoeff() < .3f) model.k.row(i).setZero();
  }
  FrameReport report;
  const Compensator cpu(model);
  cpu.receiver_indirect(cpu.patch_target(pictures), {}, report);
  EXPECT_EQ(report.used, SolverChoice::kClosedForm);
  expect_same(model, pictures, {}, Precision::kFloat);
}

TEST_F(Runtimes, StopsGatheringWhereTheCpuDoes) {
  const Model model = test::room({.k = 1, .grid = {{14, 10}, {12, 8}}});
  const std::vector<Picture> pictures = test::pictures(model, 0, 250, true);
  EXPECT_GE(compensate_frame(model, pictures, {}).report.gathers, 3);
  expect_same(model, pictures, {}, Precision::kFloat);
  expect_same(model, pictures, {.max_gathers = 2}, Precision::kFloat);
}

TEST_F(Runtimes, CopiesWhereTheIndirectLightCannotBeSeen) {
  const Model model = test::room({.k = .001});
  const std::vector<Picture> pictures = test::pictures(model, 60, 240);
  auto gl = Runtime::make(model, {}, Precision::kFloat);
  ASSERT_TRUE(gl);
  ASSERT_TRUE((*gl)->render(pictures));
  const Compensated shown = *(*gl)->read();
  EXPECT_EQ(shown.report.used, SolverChoice::kCopy);
  EXPECT_GT(shown.report.largest_indirect, 0);
  for (int q = 0; q < 2; ++q) EXPECT_EQ(shown.pictures[q].data(), pictures[q].data());
}

TEST_F(Runtimes, FrameEqualsTheCpuWithoutReflection) {
  const Model model = test::room({.k = 0});
  expect_same(model, test::pictures(model, 60, 240), {}, Precision::kFloat);
}

TEST_F(Runtimes, SixteenBitsWithoutDitherEqualTheCpuToACode) {
  const Model model = test::room();
  const CompensateOptions options{.dither = false, .bits = 16};
  const std::vector<Picture> pictures = test::pictures(model, 60, 240, true);
  auto gl = Runtime::make(model, options, Precision::kFloat);
  ASSERT_TRUE(gl);
  ASSERT_TRUE((*gl)->render(pictures));
  const Compensated wanted = compensate_frame(model, pictures, options), shown = *(*gl)->read();
  int largest = 0;
  for (int q = 0; q < 2; ++q)
    for (std::size_t i = 0; i < wanted.pictures[q].data().size(); ++i)
      largest = std::max(largest, std::abs(int{wanted.pictures[q].data()[i]} - int{shown.pictures[q].data()[i]}));
  EXPECT_LE(largest, 16);  // 1e-5 of light near black, where a code is smallest, is about a dozen codes of 65535
}

TEST_F(Runtimes, TakesThreeProjectorsOddSizesAndEmptyPictures) {
  const Model model = test::room({.projectors = 3});
  std::vector<Picture> pictures = test::pictures(model, 60, 240, true);
  expect_same(model, pictures, {}, Precision::kFloat);
  pictures[1] = Picture();
  expect_same(model, pictures, {}, Precision::kFloat);
}

TEST_F(Runtimes, TakesTinyPicturesSinglePatchesAndGainsThatAreMissing) {
  Model model = test::room({.projectors = 3, .grid = {{1, 1}, {2, 1}}, .pictures = {{1, 1}, {2, 3}, {5, 1}}});
  auto& gain = model.projectors[1].gain[0].data();
  gain.assign(gain.size(), std::numeric_limits<float>::quiet_NaN());
  expect_same(model, test::pictures(model, 100, 240), {}, Precision::kFloat);
}

TEST_F(Runtimes, HalfFloatsKeepTinyFormFactors) {
  Model model = test::room();
  model.F *= 1e-6f, model.G *= 1e-6f;  // all denormal as half floats
  model.k *= 1e6f;
  expect_same(model, test::pictures(model, 60, 240, true), {}, Precision::kHalf);
}

TEST_F(Runtimes, FramesDoNotRememberEachOther) {
  const Model model = test::room();
  auto gl = Runtime::make(model, {}, Precision::kFloat);
  ASSERT_TRUE(gl);
  const std::vector<Picture> bright = test::pictures(model, 100, 240), dark = test::pictures(model, 0, 90, true);
  ASSERT_TRUE((*gl)->render(dark));
  const Compensated first = *(*gl)->read();
  ASSERT_TRUE((*gl)->render(bright));
  ASSERT_TRUE((*gl)->render(dark));
  const Compensated again = *(*gl)->read();
  EXPECT_EQ(first.report.clipped_pixels, again.report.clipped_pixels);
  for (int q = 0; q < 2; ++q) EXPECT_EQ(first.pictures[q].data(), again.pictures[q].data());
}

TEST_F(Runtimes, PatchSolvesEqualTheCpu) {
  const Model model = test::room();
  const std::vector<Picture> pictures = test::pictures(model, 60, 240);
  auto gl = Runtime::make(model, {}, Precision::kFloat);
  ASSERT_TRUE(gl);
  ASSERT_TRUE((*gl)->render(pictures));
  const Radiosity target = Compensator(model).patch_target(pictures).target;
  EXPECT_LT((*(*gl)->solve_patches(0, 1) - direct_for(model, target)).cwiseAbs().maxCoeff(), 1e-5);  // order of sums
  for (const int H : {1, 2, 5})
    for (const int passes : {1, 4})
      EXPECT_LT((*(*gl)->solve_patches(H, passes) - paper_direct_for(model, target, H, 0, passes).direct)
                    .cwiseAbs()
                    .maxCoeff(),
                1e-5)
          << "H " << H << " passes " << passes;
}

TEST_F(Runtimes, RefusesAPictureOfAnotherSizeByName) {
  const Model model = test::room();
  std::vector<Picture> pictures = test::pictures(model, 60, 240);
  pictures[1] = Picture(9, 9, 3);
  auto gl = Runtime::make(model, {}, Precision::kFloat);
  ASSERT_TRUE(gl);
  const Result<void> rendered = (*gl)->render(pictures);
  ASSERT_FALSE(rendered);
  EXPECT_EQ(rendered.error().code, ErrorCode::kBadValue);
  EXPECT_NE(rendered.error().message.find("right is 9 x 9"), std::string::npos);
}

using Matrices = Gl;

TEST_F(Matrices, MaySpanManyBuffers) {
  const Model model = test::room({.grid = {{23, 19}, {13, 9}}});
  const Radiosity x = test::random_radiosity(model.patches.size(), 0, 1, 1);
  CompensateOptions options;
  const std::vector<RowBand> bands = row_bands(model.F, model.patches, 1);
  const Radiosity expected = Gather::patches(model)(x);
  for (const Precision precision : {Precision::kFloat, Precision::kHalf}) {
    const std::vector<std::string> defines =
        precision == Precision::kHalf ? std::vector<std::string>{"HALF"} : std::vector<std::string>{};
    const Program gather = *Program::make(*shader_text("gather.comp", defines));
    const Buffer in = *Buffer::of("x", as_vec4(x)), out = *Buffer::of("y", as_vec4(x)),
                 other = *Buffer::of("z", as_vec4(x));
    for (const int binding : {4, 5, 7}) other.bind_storage(binding);
    // 128 rows of 437 columns take 224 kB as floats; 437 rows of 117 columns take 240 kB: two buffers.
    const std::size_t limit = precision == Precision::kFloat ? 230000 : 115000;
    const Result<GlMatrix> matrix = GlMatrix::make("F", model.F, model.k, bands, precision, limit);
    ASSERT_TRUE(matrix) << matrix.error().message;
    matrix->run(gather, {GatherMode::kStore, &in, &out});
    const Radiosity y = from_vec4(out.read_floats(4 * x.rows()));
    EXPECT_LT((y - expected).cwiseAbs().maxCoeff(), precision == Precision::kFloat ? 1e-6 : 5e-4);  // 11 bits of .5
    const Result<GlMatrix> refused = GlMatrix::make("F", model.F, model.k, bands, precision, 20000);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kDevice);
  }
}

using Shaders = Gl;

TEST_F(Shaders, RejectionNamesFileLineAndDriver) {
  const auto text = expand_shader(
      "broken.comp", "#include \"taps.glsl\"\nlayout(local_size_x = 1) in;\nvoid main() {\n  nonsense = 1;\n}\n", {});
  ASSERT_TRUE(text);
  const Result<Program> program = Program::make(*text);
  ASSERT_FALSE(program);
  const std::string& message = program.error().message;
  EXPECT_NE(message.find("broken.comp"), std::string::npos) << message;
  EXPECT_NE(message.find("0:4"), std::string::npos) << message;  // file 0, line 4: lines of includes do not count
  EXPECT_NE(message.find("1 = taps.glsl"), std::string::npos) << message;
  EXPECT_NE(message.find(context_->description()), std::string::npos) << message;
}

TEST(ShaderText, RefusesWhatIsNotEmbedded) {
  EXPECT_FALSE(shader_text("missing.comp"));
  const auto text = expand_shader("a.comp", "\n#include \"missing.glsl\"\n", {});
  ASSERT_FALSE(text);
  EXPECT_NE(text.error().message.find("a.comp:2"), std::string::npos) << text.error().message;
}

TEST(RuntimeLibrary, LinksNoCeres) {
  std::string needed;
  FILE* pipe = popen("readelf -d /proc/$PPID/exe", "r");
  ASSERT_NE(pipe, nullptr);
  std::array<char, 512> line;
  while (std::fgets(line.data(), static_cast<int>(line.size()), pipe) != nullptr) needed += line.data();
  if (pclose(pipe) != 0) GTEST_SKIP() << "no readelf here (binutils)";
  EXPECT_NE(needed.find("NEEDED"), std::string::npos);
  EXPECT_NE(needed.find("libepoxy"), std::string::npos);
  EXPECT_EQ(needed.find("ceres"), std::string::npos);
}

}  // namespace
}  // namespace countershade::solver

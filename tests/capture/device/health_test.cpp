// What a camera that is watched gives on, and what is said of it.
#include "capture/device/health.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace countershade::capture {
namespace {

using ::testing::HasSubstr;

// Gives what it is told to.
class Scripted final : public Camera {
 public:
  explicit Scripted(std::function<Result<Exposure>(int photo)> photo) : photo_(std::move(photo)) {}
  const std::string& id() const override { return id_; }
  Result<void> arm(double exposure_ms) override {
    if (exposure_ms > 100) return error(ErrorCode::kBadValue, "camera 'eye' cannot expose {} ms", exposure_ms);
    return {};
  }
  Result<Exposure> trigger() override { return photo_(photos_++); }

 private:
  std::string id_ = "eye";
  std::function<Result<Exposure>(int)> photo_;
  int photos_ = 0;
};

Exposure good(int photo) {
  Exposure e;
  e.values = Image(5, 4, 3, 100.f);
  e.full_scale = 255, e.timestamp_s = photo;
  return e;
}

Health after(int photos, const std::function<Result<Exposure>(int)>& photo) {
  const auto camera = watched(std::make_unique<Scripted>(photo));
  for (int i = 0; i < photos; ++i) static_cast<void>(camera->trigger());
  return camera->health();
}

TEST(Watched, HandsOnWhatIsGoodAndIsHealthy) {
  const auto camera = watched(std::make_unique<Scripted>([](int i) -> Result<Exposure> { return good(i); }));
  EXPECT_EQ(camera->id(), "eye");
  EXPECT_EQ(camera->trigger()->values.data(), good(0).values.data());
  EXPECT_EQ(camera->trigger()->timestamp_s, 1);
  EXPECT_EQ(camera->health().photos, 2);
  EXPECT_EQ(camera->health().unhealthy(), "");
}

TEST(Watched, RefusesWhatCannotBeAPhoto) {
  struct {
    const char* says;
    std::function<void(Exposure&)> change;
  } const kBad[] = {
      {"without pixels", [](Exposure& e) { e.values = Image(); }},
      {"beyond 0 to 255", [](Exposure& e) { e.values.at(4, 3, 2) = 256; }},
      {"beyond 0 to 255", [](Exposure& e) { e.values.at(0, 0, 0) = -1; }},
      {"no numbers", [](Exposure& e) { e.values.at(2, 1, 1) = std::nanf(""); }},
      {"no numbers", [](Exposure& e) { e.values.at(2, 1, 1) = INFINITY; }},
      {"no numbers", [](Exposure& e) { e.full_scale = 0; }},
  };
  for (const auto& bad : kBad) {
    const auto camera = watched(std::make_unique<Scripted>([&](int i) -> Result<Exposure> {
      Exposure e = good(i);
      if (i == 1) bad.change(e);
      return e;
    }));
    ASSERT_TRUE(camera->trigger());
    const auto refused = camera->trigger();
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kDevice);
    EXPECT_THAT(refused.error().message, ::testing::AllOf(HasSubstr("camera 'eye'"), HasSubstr(bad.says)));
    EXPECT_EQ(camera->health().unhealthy(), refused.error().message);
    ASSERT_TRUE(camera->trigger()) << "it is asked again";
    EXPECT_EQ(camera->health().unhealthy(), "") << "and has recovered";
  }
}

TEST(Watched, FractionsMayHaveHighlightsAndNoise) {
  const auto camera = watched(std::make_unique<Scripted>([](int i) -> Result<Exposure> {
    Exposure e = good(i);
    e.full_scale = 1;
    e.values.at(0, 0, 0) = 7, e.values.at(1, 0, 0) = -.01f;
    if (i == 1) e.values.at(2, 0, 0) = std::nanf("");
    return e;
  }));
  EXPECT_TRUE(camera->trigger());
  EXPECT_FALSE(camera->trigger());
}

TEST(Watched, AnExposureThatIsRefusedIsUnhealthyUntilOneIsTaken) {
  const auto camera = watched(std::make_unique<Scripted>([](int i) -> Result<Exposure> { return good(i); }));
  ASSERT_FALSE(camera->arm(200));
  EXPECT_THAT(camera->health().unhealthy(), HasSubstr("cannot expose 200 ms"));
  ASSERT_TRUE(camera->arm(20));
  EXPECT_EQ(camera->health().unhealthy(), "");
}

TEST(Watched, CountsPhotosThatHadToBeTakenAgain) {
  const auto losing = [](int every) {
    return [=](int i) -> Result<Exposure> {
      Exposure e = good(i);
      e.lost = i % every == 0;
      return e;
    };
  };
  EXPECT_THAT(after(20, losing(2)).unhealthy(), HasSubstr("10 of 30 photos did not arrive whole"));
  EXPECT_EQ(after(20, losing(10)).unhealthy(), "");
  EXPECT_EQ(after(20, losing(10)).again, 2);
  EXPECT_EQ(after(3, losing(1)).unhealthy(), "") << "too few to say";
}

TEST(Watched, CountsTimesThatFallBack) {
  const auto timed = [](std::function<double(int)> time) {
    return [=](int i) -> Result<Exposure> {
      Exposure e = good(i);
      e.timestamp_s = time(i);
      return e;
    };
  };
  EXPECT_THAT(after(20, timed([](int i) { return i % 2 ? 1.0 * i : i - 3.0; })).unhealthy(), HasSubstr("fall back"));
  EXPECT_EQ(after(20, timed([](int) { return 0.0; })).unhealthy(), "") << "a camera without a clock";
  EXPECT_EQ(after(20, timed([](int i) { return i > 10 ? i - 8.0 : i; })).unhealthy(), "") << "set once";
}

}  // namespace
}  // namespace countershade::capture

#include "tools/job/check/inspection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <functional>

#include "capture/device/health.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/support/edited_camera.h"

namespace countershade::tools {
namespace {

using ::testing::HasSubstr;

simdata::RigAndRoom small_room() {
  simdata::RigAndRoom room = simdata::small_two_wall(4, {320, 200}, 64);
  room.rig.cameras[0].exposures_ms = {1e3 / 60};
  room.simulation.cameras[0].reference_exposure_ms = 1e3 / 60;
  return room;
}

Inspection inspected(const simdata::RigAndRoom& room, const std::string& faults = "") {
  SilentProgress quiet;
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet);
  EXPECT_TRUE(simulator);
  std::vector<simdata::Fault> planted;
  if (!faults.empty()) planted = simdata::parse_faults(faults).value();
  const auto inspection = inspect(room.rig, simdata::simulated_devices(*simulator, planted), quiet);
  EXPECT_TRUE(inspection) << (inspection ? "" : inspection.error().message);
  return inspection ? *inspection : Inspection();
}

// The light of the findings whose name holds `what`: the worst of them; "none" where there is none.
std::string light(const Inspection& inspection, const std::string& what) {
  std::string worst = "none";
  for (const Finding& f : inspection.findings) {
    if (f.what.find(what) == std::string::npos) continue;
    const std::string one = light_of(f);
    if (worst == "none" || worst == "ok" || one == "WRONG") worst = one;
  }
  return worst;
}

std::string all_of(const Inspection& inspection) {
  std::string text;
  for (const Finding& f : inspection.findings) text += light_of(f) + " " + f.what + ": " + f.measured + "\n";
  return text;
}

double number_before(const Inspection& inspection, const std::string& what, const std::string& begin) {
  for (const Finding& f : inspection.findings)
    if (f.what.find(what) != std::string::npos) {
      const std::size_t at = f.measured.find(begin);
      double value = -1;
      if (at != std::string::npos) std::sscanf(f.measured.c_str() + at + begin.size(), "%lf", &value);
      return value;
    }
  return -1;
}

TEST(Inspection, OfAGoodRigHasNothingToSay) {
  const Inspection good = inspected(small_room());
  for (const Finding& f : good.findings) EXPECT_EQ(light_of(f), "ok") << f.what << ": " << f.measured;
  EXPECT_GE(good.findings.size(), 18u);
  ASSERT_EQ(good.pictures.size(), 3u);
  for (const CheckPicture& p : good.pictures) EXPECT_EQ(p.values.channels(), 3);
}

struct Trouble {
  const char* name;
  const char* faults;
  std::function<void(simdata::RigAndRoom&)> change;
  const char* finding;
};
const auto kNothing = [](simdata::RigAndRoom&) {};
const Trouble kTroubles[] = {
    {"ExposuresThatJitter", "exposure-jitter=0.05", kNothing, "light of white from photo to photo"},
    {"ColourWheelThatTheExposureCuts", "",
     [](simdata::RigAndRoom& room) {
       room.rig.cameras[0].exposures_ms = {40};
       room.simulation.cameras[0].reference_exposure_ms = 40;
       room.simulation.cameras[0].white_level = 0.4;  // a part of a turn is brighter than its mean
       for (SimulatedProjector& p : room.simulation.projectors) p.colour_wheel_hz = 60;
     },
     "light of white from photo to photo"},
    {"ExposureOfNoWholeRefresh", "", [](simdata::RigAndRoom& room) { room.rig.cameras[0].exposures_ms = {12}; },
     "camera: exposure"},
    {"Blur", "defocus=6", kNothing, "sharpness"},
    {"ProjectorOutOfFocus", "",
     [](simdata::RigAndRoom& room) {
       for (SimulatedProjector& p : room.simulation.projectors) p.defocus_sigma_px = 4;
     },
     "sharpness"},
    {"Shaking", "camera-shaken=0.05", kNothing, "movement"},
    {"DroppedPhotos", "dropped-frame=1@20", kNothing, "health"},
    {"AutomaticExposure", "auto-exposure=0.5", kNothing, "adds up"},
    {"JitterOfTheDisplay", "",
     [](simdata::RigAndRoom& room) {
       for (SimulatedProjector& p : room.simulation.projectors) p.latency_jitter_ms = 60;
     },
     "latency of steps"},
    {"AScreenThatLeavesThePhoto", "",
     [](simdata::RigAndRoom& room) {
       room.simulation.cameras[0].target = room.simulation.projectors[0].target;
       room.simulation.cameras[0].focal_px *= 2;
     },
     "lights"},
};

class Troubles : public ::testing::TestWithParam<Trouble> {};

TEST_P(Troubles, IsSeenWhereItIs) {
  simdata::RigAndRoom room = small_room();
  GetParam().change(room);
  const Inspection inspection = inspected(room, GetParam().faults);
  EXPECT_THAT(light(inspection, GetParam().finding), ::testing::AnyOf("LOOK", "WRONG")) << all_of(inspection);
}

INSTANTIATE_TEST_SUITE_P(All, Troubles, ::testing::ValuesIn(kTroubles),
                         [](const auto& info) { return std::string(info.param.name); });

TEST(Inspection, AResponseThatIsNotTheCamerasDoesNotAddUp) {
  simdata::RigAndRoom room = small_room();
  SilentProgress quiet;
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet).value();
  room.rig.cameras[0].response = "gamma:1.3";
  const auto inspection = inspect(room.rig, simdata::simulated_devices(simulator), quiet);
  ASSERT_TRUE(inspection) << inspection.error().message;
  EXPECT_EQ(light(*inspection, "adds up"), "WRONG") << all_of(*inspection);
}

TEST(Inspection, ALitRoomCouldBeDarkerAndIsWrongOnlyWhereItIsBrighterThanThePictures) {
  for (const auto& [ambient, says] : {std::pair(.01, "ok"), {.25, "LOOK"}, {3., "WRONG"}}) {
    simdata::RigAndRoom room = small_room();
    room.simulation.ambient = ambient;
    const Inspection inspection = inspected(room);
    EXPECT_EQ(light(inspection, "room in the dark"), says) << ambient << "\n" << all_of(inspection);
    if (ambient < 1) {
      EXPECT_NE(light(inspection, "movement"), "none") << "nothing else is wrong: the page goes on";
    }
  }
}

TEST(Inspection, LatencyIsThatOfTheDisplay) {
  for (const double latency : {0.0, 33.4, 80.0}) {
    simdata::RigAndRoom room = small_room();
    for (SimulatedProjector& p : room.simulation.projectors) p.latency_ms = latency;
    const Inspection inspection = inspected(room);
    // Shown at a refresh, seen at the first refresh after the latency; the computer goes on at the next one.
    const double median = number_before(inspection, "latency of steps", "median ");
    EXPECT_GE(median, latency - 17) << all_of(inspection);
    EXPECT_LE(median, latency + 17) << all_of(inspection);
  }
}

TEST(Inspection, StopsWhereNothingBeyondCouldBeBelieved) {
  simdata::RigAndRoom room = small_room();
  const Inspection inspection = inspected(room, "underexposed=0.005");
  EXPECT_EQ(light(inspection, "exposure of white"), "WRONG") << all_of(inspection);
  EXPECT_EQ(light(inspection, "movement"), "none");
}

// What the check says to do about lamps on the mains is what helps.
TEST(Inspection, AnExposureForLampsOnTheMainsIsNamedAndEndsTheirSwing) {
  simdata::RigAndRoom room = small_room();
  room.simulation.ambient = .06, room.simulation.ambient_swing = 1, room.simulation.ambient_hz = 99.9;
  const auto swings = [](const Inspection& inspection) {
    for (const Finding& f : inspection.findings)
      if (f.what.find("light of black") != std::string::npos) return f;
    return Finding{"none", "", "", true};
  };
  const Finding before = swings(inspected(room));
  EXPECT_NE(light_of(before), "ok") << before.measured;
  EXPECT_THAT(before.remedy, HasSubstr("50 ms on mains of 50 Hz"));
  EXPECT_THAT(before.remedy, ::testing::Not(HasSubstr("60 Hz"))) << "1/60 s is two pulses there";
  room.rig.cameras[0].exposures_ms = {50};
  room.simulation.cameras[0].reference_exposure_ms = 50;
  const Finding after = swings(inspected(room));
  EXPECT_EQ(light_of(after), "ok") << after.measured;
}

TEST(WholePulses, AreWholeRefreshesToo) {
  EXPECT_NEAR(whole_pulses(16.7, 60, 100).value(), 50, 1e-9);
  EXPECT_NEAR(whole_pulses(16.7, 60, 120).value(), 1e3 / 60, 1e-9);
  EXPECT_NEAR(whole_pulses(31, 50, 100).value(), 40, 1e-9);
  EXPECT_NEAR(whole_pulses(16.7, 59.94, 120).value(), 1e3 / 59.94, 1e-9);
  EXPECT_NEAR(whole_pulses(10, 73, 100).value(), 8e3 / 73, 1e-9);
  EXPECT_FALSE(whole_pulses(10, 97, 100));
}

// Hands out so many photos, then none any more.
std::unique_ptr<capture::Camera> failing(std::unique_ptr<capture::Camera> camera, int photos) {
  return capture::watched(std::make_unique<testing::EditedCamera>(
      std::move(camera), [photos](Result<capture::Exposure> taken, int n) -> Result<capture::Exposure> {
        if (n < photos) return taken;
        return error(ErrorCode::kDevice, "camera 'camera' was unplugged");
      }));
}

TEST(Inspection, ACameraThatFailsStandsOnThePageAsUnhealthy) {
  const simdata::RigAndRoom room = small_room();
  SilentProgress quiet;
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet).value();
  for (const int photos : {0, 3, 25}) {
    capture::Devices devices = simdata::simulated_devices(simulator);
    devices.cameras[0] = failing(std::move(devices.cameras[0]), photos);
    const auto inspection = inspect(room.rig, devices, quiet);
    ASSERT_TRUE(inspection) << inspection.error().message;
    const Finding& last = inspection->findings.back();
    EXPECT_EQ(inspection->findings.size() > 6, photos == 25) << "what was found before stands there";
    EXPECT_THAT(last.what, HasSubstr("health"));
    EXPECT_THAT(last.measured, HasSubstr("unhealthy: camera 'camera' was unplugged"));
    EXPECT_EQ(light_of(last), "WRONG");
  }
}

TEST(Inspection, ACameraThatFailsFromTheBeginningDoesNotHideTheNext) {
  simdata::RigAndRoom room = small_room();
  room.rig.cameras.push_back(room.rig.cameras[0]);
  room.simulation.cameras.push_back(room.simulation.cameras[0]);
  room.rig.cameras[1].id = room.simulation.cameras[1].id = "second";
  SilentProgress quiet;
  const auto simulator = simdata::Simulator::make(room.rig, room.simulation, quiet).value();
  capture::Devices devices = simdata::simulated_devices(simulator);
  devices.cameras[0] = failing(std::move(devices.cameras[0]), 0);
  const auto inspection = inspect(room.rig, devices, quiet);
  ASSERT_TRUE(inspection) << inspection.error().message;
  EXPECT_EQ(light(*inspection, "camera camera: health"), "WRONG") << all_of(*inspection);
  EXPECT_EQ(light(*inspection, "camera second: exposure of white"), "ok") << all_of(*inspection);
}

TEST(WholeRefreshes, AreTheLongestThatDoNotExceedWhatIsWanted) {
  EXPECT_NEAR(whole_refreshes(40, 60), 2e3 / 60, 1e-9);
  EXPECT_NEAR(whole_refreshes(1e3 / 60, 60), 1e3 / 60, 1e-9);
  EXPECT_NEAR(whole_refreshes(3, 60), 1e3 / 60, 1e-9) << "never less than one";
  EXPECT_NEAR(whole_refreshes(41, 50), 40, 1e-9);
}

TEST(CheckPage, SaysWhatIsWrongFirstAndHasItsPictures) {
  const std::vector<Finding> findings = {
      {"a <b>", "1", "look here", true, true}, {"c", "2", "mend this", false}, {"d", "3", "never said", true}};
  const auto page = check_html("rig.toml", findings, {{"photo", "as seen", Image(4, 3, 3, 128)}});
  ASSERT_TRUE(page);
  EXPECT_THAT(*page, HasSubstr(">WRONG</span>"));
  EXPECT_LT(page->find("mend this"), page->find("look here"));
  EXPECT_EQ(page->find("never said"), std::string::npos);
  EXPECT_EQ(page->find("a <b>"), std::string::npos) << "escaped";
  EXPECT_THAT(*page, HasSubstr("data:image/png;base64,"));
  EXPECT_THAT(*check_html("r", {{"d", "3", "", true}}, {}), HasSubstr("READY"));
}

}  // namespace
}  // namespace countershade::tools

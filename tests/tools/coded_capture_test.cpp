// Capture with the code that the room needs, decoded meanwhile, against what the session gives.
#include "tools/job/coded_capture.h"

#include <gtest/gtest.h>

#include "simdata/device/faults.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/support/cli.h"
#include "tests/support/same.h"

namespace countershade::tools {
namespace {

namespace fs = std::filesystem;
using testing::TemporaryFolder;

const simdata::RigAndRoom& room() {
  static const simdata::RigAndRoom made = [] {
    simdata::RigAndRoom small = simdata::small_two_wall(4, {320, 200}, 256);
    small.rig.cameras[0].model.clear();
    return small;
  }();
  return made;
}

std::shared_ptr<const simdata::Simulator> simulator() {
  SilentProgress quiet;
  static const auto made = simdata::Simulator::make(room().rig, room().simulation, quiet).value();
  return made;
}

void expect_as_decoded(const CodedCapture& captured, const fs::path& folder) {
  SilentProgress quiet;
  const auto session = Session::open(folder);
  ASSERT_TRUE(session) << session.error().message;
  ASSERT_EQ(captured.decoded.size(), 2u);
  EXPECT_TRUE(captured.undecoded.empty());
  for (const capture::Correspondence& live : captured.decoded) {
    const auto read = capture::decode(*session, "camera", live.projector, {}, quiet);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_GT(live.accepted, 1000u);
    testing::expect_same(live, *read);
  }
}

TEST(CodedCapture, DecodesWhatTheSessionHoldsAlsoWherePhotosAreRetaken) {
  const TemporaryFolder folder;
  SilentProgress quiet;
  const auto faults = simdata::parse_faults("stale-frame@22,duplicated-frame@40,dropped-frame@46").value();
  const auto captured = capture_with_code(room().rig, "", "auto", simdata::simulated_devices(simulator(), faults),
                                          folder / "session", quiet);
  ASSERT_TRUE(captured) << captured.error().message;
  expect_as_decoded(*captured, folder / "session");
}

// The code is chosen in the middle of a capture; whenever the camera is touched, no photo of before it remains.
TEST(CodedCapture, ACameraThatIsTouchedAtAnyMomentHasAllFramesTakenAgain) {
  const double degrees = 0.15;            // about 1 px
  for (const int photo : {38, 42, 58}) {  // 38: between its halves
    const TemporaryFolder folder;
    SilentProgress quiet;
    const auto faults = simdata::parse_faults(fmt::format("camera-turned={}@{}", degrees, photo)).value();
    const auto captured = capture_with_code(room().rig, "", "auto", simdata::simulated_devices(simulator(), faults),
                                            folder / "session", quiet);
    ASSERT_TRUE(captured) << photo << ": " << captured.error().message;
    EXPECT_TRUE(fs::exists(folder / "session/outdated")) << photo;
    expect_as_decoded(*captured, folder / "session");
  }
}

TEST(CodedCapture, DecodesWhatAFormerCaptureLeft) {
  const TemporaryFolder folder;
  SilentProgress quiet;
  const auto capture = [&] {
    return capture_with_code(room().rig, "", "auto", simdata::simulated_devices(simulator()), folder / "session",
                             quiet);
  };
  ASSERT_TRUE(capture());
  for (int frame : {1, 9, 14, 15}) {
    const Session session = Session::open_unfinished(folder / "session").value();
    ASSERT_TRUE(fs::remove(session.photo_path("camera", frame))) << frame;
  }
  const auto resumed = capture();
  ASSERT_TRUE(resumed) << resumed.error().message;
  expect_as_decoded(*resumed, folder / "session");
}

}  // namespace
}  // namespace countershade::tools

// A GigE Vision camera that is pulled out in the middle of a capture, and plugged in again.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "calib/file/file.h"
#include "capture/device/aravis/aravis.h"
#include "capture/pattern/pattern.h"
#include "capture/session/runner.h"
#include "capture/session/session_folder.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/device/aravis/gige_camera.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// Shows a picture to whoever looks at it.
class HeldPicture final : public capture::Projector {
 public:
  explicit HeldPicture(const ProjectorSpec& spec) : spec_(spec), shown_(width(), height(), 3) {}
  const std::string& id() const override { return spec_.id; }
  int width() const override { return spec_.resolution[0]; }
  int height() const override { return spec_.resolution[1]; }
  Result<void> show(const Picture& picture) override {
    shown_ = picture;
    return {};
  }
  const Picture& shown() const { return shown_; }

 private:
  ProjectorSpec spec_;
  Picture shown_;
};

std::map<std::string, std::string> files_of(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) files[fs::relative(entry.path(), folder).string()] = hash_file(entry.path()).value();
  return files;
}

class Unplugged : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!capture::has_aravis()) GTEST_SKIP() << "built without Aravis";
    room_.rig.cameras[0].full_scale.reset();
    room_.rig.cameras[0].pedestal = 0;
    room_.rig.cameras[0].model.clear();
    SilentProgress quiet;
    simulator_ = simdata::Simulator::make(room_.rig, room_.simulation, quiet).value();
    if (const std::string why = testing::enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }
  // Captures into a folder with a camera that is pulled out after so many photos (0: never).
  Result<void> capture_into(const fs::path& folder, int unplug_after) {
    std::vector<const HeldPicture*> held;
    testing::GigeOptions options;
    options.width = room_.simulation.cameras[0].resolution[0];
    options.height = room_.simulation.cameras[0].resolution[1];
    options.formats = {"Mono16"}, options.unplug_after = unplug_after;
    testing::GigeCamera plugged(options, [&](double exposure_ms) {
      std::vector<Picture> pictures;
      for (const HeldPicture* p : held) pictures.push_back(p->shown());
      const Image light = simulator_->optics(0, simulator_->total_light(0, pictures));
      const capture::Exposure e = simulator_->expose(0, light, exposure_ms, 0);  // equal light, equal noise
      std::vector<std::uint16_t> values;
      for (std::size_t i = 0; i < e.values.pixels(); ++i)
        values.push_back(
            static_cast<std::uint16_t>(std::lround(e.values.data()[i * e.values.channels()] / e.full_scale * 65535)));
      return values;
    });
    capture::Devices devices;  // closed before the camera is pulled out for good
    for (const ProjectorSpec& spec : room_.rig.projectors) {
      auto projector = std::make_unique<HeldPicture>(spec);
      held.push_back(projector.get());
      devices.projectors.push_back(std::move(projector));
    }
    CS_TRY(auto camera, capture::open_aravis_camera(room_.rig.cameras[0].id, "", {.timeout_s = 0.5}));
    devices.cameras.push_back(std::move(camera));
    devices.clock = [](double) {};  // nothing here takes time to appear
    SilentProgress quiet;
    const auto captured =
        capture::capture_session(room_.rig, "", capture::default_sequence(room_.rig), devices, folder, {}, quiet);
    photos_ = plugged.photos();
    return captured;
  }
  simdata::RigAndRoom room_ = simdata::small_two_wall(8, {160, 100}, 64);
  std::shared_ptr<const simdata::Simulator> simulator_;
  testing::TemporaryFolder folder_;
  int photos_ = 0;
};

TEST_F(Unplugged, InTheMiddleOfACaptureItIsNamedAndTheSameCommandEndsWithTheSameBytes) {
  const fs::path session = folder_ / "session";
  const auto undisturbed = capture_into(folder_ / "undisturbed", 0);
  ASSERT_TRUE(undisturbed) << undisturbed.error().message;
  const int needed = photos_;
  ASSERT_GT(needed, 40);
  const auto expected = files_of(folder_ / "undisturbed");
  std::size_t stood = 0;
  for (const int photos : {needed / 2, needed / 3}) {  // twice
    const auto torn = capture_into(session, photos);
    ASSERT_FALSE(torn);
    EXPECT_EQ(torn.error().code, ErrorCode::kDevice);
    EXPECT_THAT(torn.error().message, HasSubstr("camera '" + room_.rig.cameras[0].id + "' is gone"));
    const auto kept = files_of(session);
    for (const auto& [name, hash] : kept) EXPECT_EQ(expected.at(name), hash) << name;
    EXPECT_GT(kept.size(), stood);
    EXPECT_LT(kept.size(), expected.size());
    stood = kept.size();
  }
  const auto resumed = capture_into(session, 0);
  ASSERT_TRUE(resumed) << resumed.error().message;
  EXPECT_LT(photos_, needed) << "what was stored is kept";
  EXPECT_EQ(files_of(session), expected);
}

TEST_F(Unplugged, ASecondProcessOnTheSessionIsTurnedAwayAndDisturbsNothing) {
  const fs::path session = folder_ / "session";
  fs::create_directories(session);
  {
    const auto held = capture::FolderLock::take(session);
    ASSERT_TRUE(held);
    const auto before = files_of(session);
    const auto second = capture_into(session, 0);
    ASSERT_FALSE(second);
    EXPECT_EQ(second.error().code, ErrorCode::kRefused);
    EXPECT_THAT(second.error().message, HasSubstr("is being captured by another process"));
    EXPECT_EQ(files_of(session), before);
  }
  EXPECT_TRUE(capture_into(session, 0));
}

}  // namespace
}  // namespace countershade

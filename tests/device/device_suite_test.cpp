// What the rest of the program expects of every camera and projector, whatever stands behind them. A new backend adds
// one factory to kBackends and passes all of this.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <thread>

#include "calib/base/check.h"
#include "calib/image/image_file.h"
#include "capture/device/aravis/aravis.h"
#include "capture/device/command.h"
#include "capture/device/folder.h"
#include "capture/device/video/libcamera.h"
#include "capture/device/video/v4l2.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"
#include "tests/device/aravis/gige_camera.h"
#include "tests/device/aravis/u3v_camera.h"
#include "tests/device/video/uvc_camera.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// A rig that is plugged in: two projectors, one camera that sees what both show.
struct Bench {
  std::shared_ptr<testing::GigeCamera> gige;  // is unplugged last: who talks to it waits for answers
  std::shared_ptr<testing::UvcCamera> webcam;
  std::shared_ptr<testing::U3vCamera> usb3;
  std::function<void()> unplug;  // takes the camera away; none where it cannot go
  Rig rig;
  capture::Devices devices;
  std::function<void()> before_trigger = [] {};  // what a person does between the picture and the photo
  bool obeys_exposure = true;                    // exposure times change the photos
  std::shared_ptr<testing::TemporaryFolder> folder;
  std::string missing;  // why this machine cannot try it
};

simdata::RigAndRoom small_room() {
  simdata::RigAndRoom made = simdata::small_two_wall(8, {160, 100}, 64);
  made.simulation.block_px = 8;
  return made;
}

const std::shared_ptr<simdata::Simulator>& simulator() {
  static const auto one = [] {
    const simdata::RigAndRoom room = small_room();
    SilentProgress quiet;
    return *simdata::Simulator::make(room.rig, room.simulation, quiet);
  }();
  return one;
}

Bench simulated() {
  Bench bench;
  bench.rig = small_room().rig;
  bench.devices = simdata::simulated_devices(simulator());
  return bench;
}

// Projectors that write files for somebody's player, a camera that reads files of somebody's camera; somebody is the
// simulator.
Bench folders() {
  Bench bench;
  bench.rig = small_room().rig;
  bench.folder = std::make_shared<testing::TemporaryFolder>();
  const fs::path root = bench.folder->path();
  fs::create_directories(root / "photos");
  for (const ProjectorSpec& spec : bench.rig.projectors)
    bench.devices.projectors.push_back(
        *capture::open_folder_projector(spec.id, spec.resolution[0], spec.resolution[1], root / spec.id));
  bench.devices.cameras.push_back(
      *capture::open_folder_camera("camera", root / "photos", {.timeout_s = 2, .poll_s = 0.005}));
  bench.obeys_exposure = false;
  bench.before_trigger = [root, rig = bench.rig, photo = std::make_shared<int>(0)] {
    std::vector<Picture> newest;
    for (const ProjectorSpec& spec : rig.projectors) {
      fs::path last;
      for (const auto& file : fs::directory_iterator(root / spec.id)) last = std::max(last, file.path());
      newest.push_back(last.empty() ? Picture() : *read_picture(last));
    }
    const Image light = simulator()->optics(0, simulator()->total_light(0, newest));
    capture::Exposure e = simulator()->expose(0, light, 10, static_cast<std::uint64_t>(*photo));
    for (float& v : e.values.data()) v *= 16;  // 12 bits, left-aligned
    CS_CHECK(write_stored16(root / fmt::format("photos/{:04}.tif", (*photo)++), e.values).has_value(), "written");
  };
  bench.unplug = [root] { fs::remove_all(root / "photos"); };
  return bench;
}

// The same camera behind a command that takes a photo when it is told to.
Bench commanded() {
  Bench bench = folders();
  const fs::path root = bench.folder->path();
  bench.devices.cameras[0] =
      *capture::open_command_camera("camera", fmt::format("mv \"$(ls {0}/photos/*.tif)\" {{file}}.tif", root.string()));
  return bench;
}

using See = std::function<std::vector<std::uint16_t>(double exposure_ms)>;

// Simulated projectors, and what a camera in their room sees: 16 bits of a photo's first channel.
std::pair<Bench, See> projectors_and_light() {
  Bench bench;
  const auto optics = std::make_shared<capture::Devices>(simdata::simulated_devices(simulator()));
  bench.rig = small_room().rig;
  bench.devices.projectors = std::move(optics->projectors);
  bench.devices.clock = optics->clock;
  const See see = [optics](double exposure_ms) {
    CS_CHECK(optics->cameras[0]->arm(exposure_ms).has_value(), "armed");
    const capture::Exposure e = optics->cameras[0]->trigger().value();
    std::vector<std::uint16_t> values;
    for (std::size_t i = 0; i < e.values.pixels(); ++i)
      values.push_back(static_cast<std::uint16_t>(e.values.data()[i * e.values.channels()] / e.full_scale * 65535));
    return values;
  };
  return {std::move(bench), see};
}

// Options of a camera with as many pixels as the room's.
template <class Options>
Options sized() {
  Options options;
  const std::array<int, 2> size = small_room().simulation.cameras[0].resolution;
  options.width = size[0], options.height = size[1];
  return options;
}

// Plugs in a device of the USB; the camera appears when the kernel and whoever drives it have seen it.
void plug_in(Bench& bench, testing::UsbDevice& device,
             const std::function<Result<std::unique_ptr<capture::Camera>>()>& open) {
  if (bench.missing = device.plug_in(); !bench.missing.empty()) return;
  for (int i = 0; i < 100 && bench.devices.cameras.empty(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    auto camera = open();
    if (camera) bench.devices.cameras.push_back(std::move(*camera));
  }
  CS_CHECK(!bench.devices.cameras.empty(), "the camera appears");
  bench.unplug = [&device] { device.unplug(); };
}

// A GigE Vision camera on a network of this process: real packets through Aravis.
Bench gige_camera(bool runs_freely) {
  auto [bench, see] = projectors_and_light();  // first: it makes threads that stay in the common network
  if (!capture::has_aravis()) bench.missing = "built without Aravis";
  if (bench.missing.empty()) bench.missing = testing::enter_private_network();
  if (!bench.missing.empty()) return std::move(bench);
  auto options = sized<testing::GigeOptions>();
  options.formats = {"Mono16"}, options.runs_freely = runs_freely;
  bench.gige = std::make_shared<testing::GigeCamera>(options, see);
  auto camera = capture::open_aravis_camera("camera", "", {.timeout_s = 1});
  CS_CHECK(camera.has_value(), camera ? "" : camera.error().message);
  bench.devices.cameras.push_back(std::move(*camera));
  if (!runs_freely) bench.unplug = [gige = bench.gige] { gige->unplug(); };  // one way, and Aravis asks for 12 s
  return std::move(bench);
}

Bench gige() {
  return gige_camera(false);
}
Bench gige_that_runs_freely() {
  return gige_camera(true);
}

// A USB webcam that the kernel's own driver binds to.
Bench webcam() {
  auto [bench, see] = projectors_and_light();
  auto options = sized<testing::UvcOptions>();
  options.rate = 10;
  bench.webcam = std::make_shared<testing::UvcCamera>(options, see);
  plug_in(bench, *bench.webcam,
          [] { return capture::open_v4l2_camera("camera", "Room webcam: Room webcam", {.timeout_s = 2}); });
  return std::move(bench);
}

// The same webcam, behind libcamera, which knows only 8 of its bits.
Bench libcamera() {
  auto [bench, see] = projectors_and_light();
  if (!capture::has_libcamera()) {
    bench.missing = "built without libcamera";
    return std::move(bench);
  }
  auto options = sized<testing::UvcOptions>();
  options.rate = 10, options.formats = {"GREY"};
  bench.webcam = std::make_shared<testing::UvcCamera>(options, [see](double exposure_ms) {
    std::vector<std::uint16_t> values = see(exposure_ms);
    // Rounded, where the webcam cuts: half a grey level would be 2 % of dark photos.
    for (std::uint16_t& v : values) v = static_cast<std::uint16_t>(std::lround(v / 257.0) * 257);
    return values;
  });
  plug_in(bench, *bench.webcam, [] { return capture::open_libcamera_camera("camera", ""); });
  return std::move(bench);
}

// A USB3 Vision camera, through Aravis and libusb.
Bench usb3() {
  auto [bench, see] = projectors_and_light();
  if (!capture::has_aravis()) {
    bench.missing = "built without Aravis";
    return std::move(bench);
  }
  auto options = sized<testing::U3vOptions>();
  options.formats = {"Mono16"};
  bench.usb3 = std::make_shared<testing::U3vCamera>(options, see);
  plug_in(bench, *bench.usb3, [serial = options.serial] {
    return capture::open_aravis_camera("camera", serial, {.timeout_s = 15});  // an emulated room is slow
  });
  return std::move(bench);
}

struct Backend {
  const char* name;
  Bench (*plug_in)();
};
void PrintTo(const Backend& backend, std::ostream* to) {
  *to << backend.name;
}
const Backend kBackends[] = {{"Simulated", simulated},
                             {"Folder", folders},
                             {"Command", commanded},
                             {"Gige", gige},
                             {"GigeRunningFreely", gige_that_runs_freely},
                             {"Webcam", webcam},
                             {"Libcamera", libcamera},
                             {"Usb3", usb3}};

class DeviceSuite : public ::testing::TestWithParam<Backend> {
 protected:
  void SetUp() override {
    bench_ = GetParam().plug_in();
    if (!bench_.missing.empty()) GTEST_SKIP() << GetParam().name << ": " << bench_.missing;
  }
  capture::Camera& camera() { return *bench_.devices.cameras.at(0); }
  void show(int q, double value) {
    capture::Projector& p = *bench_.devices.projectors.at(q);
    ASSERT_TRUE(p.show(Picture(p.width(), p.height(), 3, static_cast<std::uint16_t>(65535 * value))));
    bench_.devices.wait(200);  // what any display takes
  }
  capture::Exposure photo() {
    bench_.before_trigger();
    auto taken = camera().trigger();
    EXPECT_TRUE(taken) << (taken ? "" : taken.error().message);
    return taken ? *taken : capture::Exposure();
  }
  static double mean(const capture::Exposure& e) {
    double sum = 0;
    for (float v : e.values.data()) sum += v;
    return sum / static_cast<double>(e.values.data().size()) / e.full_scale;
  }
  Bench bench_;
};

TEST_P(DeviceSuite, DevicesAreThoseOfTheRig) {
  ASSERT_EQ(bench_.devices.cameras.size(), 1u);
  EXPECT_EQ(camera().id(), "camera");
  ASSERT_EQ(bench_.devices.projectors.size(), bench_.rig.projectors.size());
  for (std::size_t q = 0; q < bench_.rig.projectors.size(); ++q) {
    const ProjectorSpec& spec = bench_.rig.projectors[q];
    capture::Projector* p = bench_.devices.projector(spec.id);
    ASSERT_NE(p, nullptr);
    EXPECT_EQ(p->id(), spec.id);
    EXPECT_EQ(p->width(), spec.resolution[0]);
    EXPECT_EQ(p->height(), spec.resolution[1]);
  }
  EXPECT_EQ(bench_.devices.projector("nobody"), nullptr);
}

TEST_P(DeviceSuite, PhotosAreStoredNumbersOfOneSize) {
  ASSERT_TRUE(camera().arm(10));
  show(0, .7), show(1, .4);
  const capture::Exposure a = photo(), b = photo();
  for (const capture::Exposure* e : {&a, &b}) {
    EXPECT_TRUE(e->values.channels() == 1 || e->values.channels() == 3);
    EXPECT_TRUE(e->values.same_size(a.values.width(), a.values.height()));
    EXPECT_GT(e->full_scale, 0);
    EXPECT_EQ(e->exposure_ms, 10);
    std::size_t full = 0;
    for (int y = 0; y < e->values.height(); ++y)
      for (int x = 0; x < e->values.width(); ++x) {
        bool any = false;
        for (int c = 0; c < e->values.channels(); ++c) {
          const float v = e->values.at(x, y, c);
          ASSERT_TRUE(v >= 0 && v <= e->full_scale && v == std::round(v)) << x << " " << y;
          any |= v >= e->full_scale;
        }
        full += any;
      }
    EXPECT_NEAR(e->saturated, static_cast<double>(full) / static_cast<double>(e->values.pixels()), 1e-9);
  }
  EXPECT_NEAR(mean(a), mean(b), .01) << "nothing changed between them";
}

TEST_P(DeviceSuite, EachPhotoIsCountedOnce) {
  ASSERT_TRUE(camera().arm(5));
  show(0, .5);
  capture::Exposure former = photo();
  for (int i = 0; i < 4; ++i) {
    const capture::Exposure e = photo();
    EXPECT_EQ(e.counter, former.counter + 1);
    if (e.timestamp_s != 0 || former.timestamp_s != 0) {  // 0 = the backend has no clock
      EXPECT_GE(e.timestamp_s, former.timestamp_s + (bench_.obeys_exposure ? 5e-3 : 1e-6));
    }
    former = e;
  }
}

TEST_P(DeviceSuite, PhotoShowsTheNewestPictureOfEachProjector) {
  ASSERT_TRUE(camera().arm(10));
  show(0, 0), show(1, 0);
  const double dark = mean(photo());
  show(0, 1);
  const double left = mean(photo());
  show(1, 1);
  const double both = mean(photo());
  show(0, 0);
  const double right = mean(photo());
  EXPECT_GT(left, dark + .01);
  EXPECT_GT(right, dark + .01);
  EXPECT_NEAR(both - dark, left - dark + right - dark, .02 * (both - dark)) << "light adds";
  show(1, 0);
  EXPECT_NEAR(mean(photo()), dark, .002) << "nothing stays";
}

TEST_P(DeviceSuite, TwiceTheTimeIsTwiceTheLight) {
  if (!bench_.obeys_exposure) GTEST_SKIP() << GetParam().name << ": somebody else sets the exposure";
  show(0, .6), show(1, .6);
  ASSERT_TRUE(camera().arm(4));
  const double once = mean(photo());
  ASSERT_TRUE(camera().arm(8));
  EXPECT_NEAR(mean(photo()) / once, 2, .02);
}

TEST_P(DeviceSuite, ImpossibleExposuresAreRefusedByName) {
  for (double ms : {-1., std::nan("")}) {
    const auto armed = camera().arm(ms);
    ASSERT_FALSE(armed) << ms;
    EXPECT_EQ(armed.error().code, ErrorCode::kBadValue);
    EXPECT_THAT(armed.error().message, HasSubstr("camera"));
  }
  EXPECT_TRUE(camera().arm(0)) << "0 is the device's default";
}

TEST_P(DeviceSuite, BrokenContractsAreBugs) {
  EXPECT_THROW((void)camera().trigger(), Bug) << "triggered before it is armed";
  capture::Projector& p = *bench_.devices.projectors.at(0);
  EXPECT_THROW((void)p.show(Picture(p.width() + 1, p.height(), 3)), Bug);
  EXPECT_THROW((void)p.show(Picture(p.width(), p.height(), 1)), Bug);
}

TEST_P(DeviceSuite, WorksFromAnotherThread) {
  show(0, .5);
  std::thread([&] {
    ASSERT_TRUE(camera().arm(10));
    EXPECT_GT(mean(photo()), 0);
  }).join();
}

TEST_P(DeviceSuite, ACameraThatGoesAwayIsAnErrorThatNamesIt) {
  if (!bench_.unplug) GTEST_SKIP() << GetParam().name << " cannot go away";
  ASSERT_TRUE(camera().arm(10));
  photo();
  bench_.unplug();
  const auto taken = camera().trigger();
  ASSERT_FALSE(taken);
  EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
  EXPECT_THAT(taken.error().message, HasSubstr("camera"));
}

INSTANTIATE_TEST_SUITE_P(All, DeviceSuite, ::testing::ValuesIn(kBackends),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace countershade

#include "tools/job/devices.h"

#include <gmock/gmock.h>

namespace countershade::tools {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

Rig rig_of(const std::vector<std::string>& backends, const std::string& output) {
  Rig rig;
  for (std::size_t i = 0; i < backends.size(); ++i) {
    rig.cameras.emplace_back();
    rig.cameras.back().id = "camera" + std::to_string(i), rig.cameras.back().backend = backends[i];
  }
  rig.projectors.resize(1);
  rig.projectors[0].id = "left", rig.projectors[0].resolution = {640, 400}, rig.projectors[0].output = output;
  return rig;
}

Error refusal(const Rig& rig) {
  SilentProgress quiet;
  const auto open = open_devices(rig, "no-such-file.toml", quiet);
  EXPECT_FALSE(open);
  return open ? Error{} : open.error();
}

TEST(OpenDevices, WhatCannotSeeEachOtherIsRefusedBeforeAnythingIsOpened) {
  const Error mixed = refusal(rig_of({"aravis", "simulated"}, "window"));
  EXPECT_EQ(mixed.code, ErrorCode::kBadValue);
  EXPECT_THAT(mixed.message, HasSubstr("camera 'camera1' is simulated, another one of the rig is not"));
  for (const char* output : {"simulated", "folder"}) {
    const Error unseen = refusal(rig_of({"aravis"}, output));
    EXPECT_EQ(unseen.code, ErrorCode::kBadValue);
    EXPECT_THAT(unseen.message, HasSubstr(std::string("output = \"") + output + "\" lights nothing that camera"));
  }
}

TEST(OpenDevices, APersonsCameraCannotBeTriggered) {
  const Error folder = refusal(rig_of({"folder"}, "window"));
  EXPECT_EQ(folder.code, ErrorCode::kDevice);
  EXPECT_THAT(folder.message, AllOf(HasSubstr("use `countershade import`"), HasSubstr("backend = \"command\"")));
  Rig rig = rig_of({"command"}, "window");
  rig.cameras[0].device = "gphoto2 --capture-image";
  EXPECT_THAT(refusal(rig).message, HasSubstr("{file} must stand in it")) << "opened as what it is";
  EXPECT_THAT(refusal(rig_of({"command"}, "folder")).message, HasSubstr("lights nothing that camera"));
}

}  // namespace
}  // namespace countershade::tools

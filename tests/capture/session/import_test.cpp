#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/image/image_file.h"
#include "capture/session/runner.h"
#include "capture/session/session_folder.h"
#include "tests/capture/fake_room.h"

namespace countershade::capture {
namespace {

using testing::AllOf;
using testing::HasSubstr;
namespace fs = std::filesystem;

// Photos of every frame, as 16-bit PNG in `folder`; `change` may spoil each before it is written.
using Change = std::function<void(int index, Image& values)>;
void photograph(const fs::path& folder, const Sequence& sequence, const Change& change = {}, double exposure_ms = 0,
                int cameras = 1) {
  const auto room = std::make_shared<fake::Room>();
  const Devices devices = fake::devices(room, fake::rig(cameras));
  fs::create_directories(folder);
  for (const Frame& frame : sequence.frames) {
    for (const auto& [id, size] : sequence.projectors)
      ASSERT_TRUE(devices.projector(id)->show(render_role(frame.role, id, size[0], size[1]).value()));
    for (const auto& camera : devices.cameras) {
      ASSERT_TRUE(camera->arm(exposure_ms));
      Image values = camera->trigger().value().values;
      if (change) change(frame.index, values);
      const fs::path where = cameras > 1 ? folder / camera->id() : folder;
      fs::create_directories(where);
      const std::string exposure = exposure_ms > 0 ? fmt::format("{}ms", exposure_ms) : "";
      ASSERT_TRUE(write_stored16(where / photo_name(frame.index, exposure, ".png"), values));
    }
  }
}

Result<void> import(const fs::path& photos, const fs::path& folder, const Rig& rig = fake::rig(),
                    const Sequence& sequence = fake::sequence()) {
  SilentProgress silent;
  return import_session(rig, sequence, photos, folder, silent);
}

void expect_refusal(const Result<void>& done, ErrorCode code, const testing::Matcher<std::string>& message,
                    const fs::path& folder) {
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, code);
  EXPECT_THAT(done.error().message, message);
  EXPECT_FALSE(fs::exists(folder));
  for (const auto& entry : fs::directory_iterator(folder.parent_path()))  // no hidden draft either
    EXPECT_EQ(entry.path().filename().string()[0] == '.', false) << entry.path();
}

TEST(ImportSession, CopiesEveryPhotoUnderItsCanonicalName) {
  fake::Scratch scratch("import");
  photograph(scratch / "photos", fake::sequence());
  ASSERT_TRUE(import(scratch / "photos", scratch / "s"));
  for (const Frame& frame : fake::sequence().frames) {
    const std::string name = photo_name(frame.index, "", ".png");
    EXPECT_EQ(fake::bytes_of(scratch / "s/photos/cam" / name), fake::bytes_of(scratch / "photos" / name));
  }
  const auto session = Session::open(scratch / "s");
  ASSERT_TRUE(session) << session.error().message;
  EXPECT_EQ(session->sequence().frames.size(), fake::sequence().frames.size());
}

TEST(ImportSession, SeveralCamerasAndExposuresAreKeptApart) {
  fake::Scratch scratch("several");
  photograph(scratch / "photos", fake::sequence(), {}, 8, 2);
  photograph(scratch / "photos", fake::sequence(), {}, 2.5, 2);
  const auto done = import(scratch / "photos", scratch / "s", fake::rig(2));
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_TRUE(fs::exists(scratch / "s/photos/cam/0007_8.0ms.png"));
  EXPECT_TRUE(fs::exists(scratch / "s/photos/side/0007_2.5ms.png"));
  fs::remove_all(scratch / "photos/side");
  expect_refusal(import(scratch / "photos", scratch / "t", fake::rig(2)), ErrorCode::kBadFile,
                 AllOf(HasSubstr("photos/side"), HasSubstr("camera 'side'")), scratch / "t");
}

TEST(ImportSession, MissingPhotosAreCountedAndTheFirstIsNamed) {
  fake::Scratch scratch("absent");
  photograph(scratch / "photos", fake::sequence());
  fs::remove(scratch / "photos/0005.png");
  fs::rename(scratch / "photos/0011.png", scratch / "photos/0011.jpg");
  expect_refusal(import(scratch / "photos", scratch / "s"), ErrorCode::kBadFile,
                 AllOf(HasSubstr("frame 5"), HasSubstr("0005.png"), HasSubstr("2 of 16"), HasSubstr("'.jpg'")),
                 scratch / "s");
  expect_refusal(import(scratch / "nowhere", scratch / "s"), ErrorCode::kBadFile, HasSubstr("nowhere"), scratch / "s");
}

TEST(ImportSession, PhotosWithOtherNamesAreMentionedAndSoIsAnEmptyFolder) {
  fake::Scratch scratch("names");
  photograph(scratch / "photos", fake::sequence());
  for (int i = 0; i < 3; ++i)
    fs::rename(scratch / "photos" / photo_name(i, "", ".png"), scratch / fmt::format("photos/IMG_{}.png", i));
  expect_refusal(import(scratch / "photos", scratch / "s"), ErrorCode::kBadFile,
                 AllOf(HasSubstr("3 of 16 photos are missing"), HasSubstr("3 others"), HasSubstr("sequence.json")),
                 scratch / "s");
  Sequence marked = fake::sequence();
  marked.identity = {{marked.projectors[0].first, 0, 0, 22}};
  fs::create_directories(scratch / "empty");
  std::ofstream(scratch / "empty/a.jpg") << "no photo";
  expect_refusal(import(scratch / "empty", scratch / "s", fake::rig(), marked), ErrorCode::kBadFile,
                 AllOf(HasSubstr("empty' holds no photos"), HasSubstr("'.jpg' files are not read")), scratch / "s");
}

TEST(ImportSession, TwoFilesOfOnePhotoAreAmbiguous) {
  fake::Scratch scratch("twice");
  photograph(scratch / "photos", fake::sequence());
  fs::copy_file(scratch / "photos/0005.png", scratch / "photos/0005.tif");
  expect_refusal(import(scratch / "photos", scratch / "s"), ErrorCode::kBadFile,
                 AllOf(HasSubstr("0005.png"), HasSubstr("0005.tif"), HasSubstr("both")), scratch / "s");
}

TEST(ImportSession, TruncatedPhotoIsNamed) {
  fake::Scratch scratch("truncated");
  photograph(scratch / "photos", fake::sequence());
  const fs::path victim = scratch / "photos/0009.png";
  fs::resize_file(victim, fs::file_size(victim) / 2);
  expect_refusal(import(scratch / "photos", scratch / "s"), ErrorCode::kBadFile, HasSubstr("0009.png"), scratch / "s");
}

TEST(ImportSession, PhotosOfTwoSizesAreBothNamed) {
  fake::Scratch scratch("sizes");
  photograph(scratch / "photos", fake::sequence(), [](int index, Image& values) {
    if (index == 4) values = Image(63, 48, 1, 1000.0f);
  });
  expect_refusal(import(scratch / "photos", scratch / "s"), ErrorCode::kBadFile,
                 AllOf(HasSubstr("0004.png"), HasSubstr("63x48"), HasSubstr("64x48"), HasSubstr("0000.png")),
                 scratch / "s");
}

TEST(ImportSession, BlackPhotosAreRefused) {
  fake::Scratch scratch("black");
  // 650 of 65535 is .99 % of full scale, just below the bound of 1 %.
  photograph(scratch / "all", fake::sequence(), [](int, Image& v) { v = Image(64, 48, 1, 650.0f); });
  expect_refusal(import(scratch / "all", scratch / "s"), ErrorCode::kRefused,
                 AllOf(HasSubstr("all photos of camera 'cam' are black"), HasSubstr("0.99 %")), scratch / "s");
  photograph(scratch / "one", fake::sequence(), [](int index, Image& v) {
    if (index == 8) v = Image(64, 48, 1, 650.0f);
  });
  expect_refusal(import(scratch / "one", scratch / "s"), ErrorCode::kRefused,
                 AllOf(HasSubstr("0008.png"), HasSubstr("white of right"), HasSubstr("black")), scratch / "s");
}

TEST(ImportSession, SaturatedWhiteIsRefused) {
  fake::Scratch scratch("saturated");
  photograph(scratch / "photos", fake::sequence(), [](int, Image& values) {
    for (float& v : values.data()) v = std::min(65535.0f, 3 * v);
  });
  expect_refusal(import(scratch / "photos", scratch / "s"), ErrorCode::kRefused,
                 AllOf(HasSubstr("0000.png"), HasSubstr("saturated"), HasSubstr("expose shorter")), scratch / "s");
}

// The sequence in which photo i shows frame order[i].
Sequence reordered(const std::vector<int>& order) {
  const Sequence plain = fake::sequence();
  Sequence sequence = plain;
  for (std::size_t i = 0; i < order.size(); ++i) sequence.frames[i].role = plain.frames[order[i]].role;
  return sequence;
}

TEST(ImportSession, PhotosInAnotherOrderAreRefused) {
  fake::Scratch scratch("order");
  photograph(scratch / "swapped", reordered({1, 0, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}));
  expect_refusal(import(scratch / "swapped", scratch / "s"), ErrorCode::kRefused,
                 AllOf(HasSubstr("0000.png"), HasSubstr("darker"), HasSubstr("0001.png"), HasSubstr("order")),
                 scratch / "s");
  photograph(scratch / "late", reordered({0, 1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14}));
  expect_refusal(import(scratch / "late", scratch / "s"), ErrorCode::kRefused, HasSubstr("order"), scratch / "s");
  photograph(scratch / "two", reordered({0, 1, 2, 5, 4, 3, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15}));
  expect_refusal(import(scratch / "two", scratch / "s"), ErrorCode::kRefused,
                 AllOf(HasSubstr("0002.png"), HasSubstr("0003.png"), HasSubstr("inverse")), scratch / "s");
}

TEST(ImportSession, CurvedCameraResponseIsNoWrongOrder) {
  fake::Scratch scratch("gamma");
  photograph(scratch / "photos", fake::sequence(), [](int, Image& values) {
    for (float& v : values.data()) v = 65535 * std::pow(v / 65535, 1 / 2.2f);
  });
  const auto done = import(scratch / "photos", scratch / "s");  // the rig says linear, as who does not know writes it
  EXPECT_TRUE(done) << done.error().message;
}

TEST(ImportSession, ExistingFolderIsLeftAlone) {
  fake::Scratch scratch("there");
  photograph(scratch / "photos", fake::sequence());
  fs::create_directories(scratch / "s");
  const auto done = import(scratch / "photos", scratch / "s");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, ErrorCode::kExists);
  EXPECT_TRUE(fs::is_empty(scratch / "s"));
}

TEST(ImportSession, SequenceOfAnotherRigIsRefused) {
  fake::Scratch scratch("otherrig");
  photograph(scratch / "photos", fake::sequence());
  Rig rig = fake::rig();
  rig.projectors[0].resolution = {1280, 800};
  expect_refusal(import(scratch / "photos", scratch / "s", rig), ErrorCode::kBadValue,
                 AllOf(HasSubstr("1280x800"), HasSubstr("32x20")), scratch / "s");
}

}  // namespace
}  // namespace countershade::capture

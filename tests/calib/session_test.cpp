#include "calib/file/session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "calib/file/file.h"
#include "calib/file/photo_probe.h"
#include "calib/image/image_file.h"
#include "calib/photometry/response.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using testing::TemporaryFolder;

// ---- sequence.json ----

Role role(const char* kind) {
  Role r;
  r.kind = kind;
  return r;
}

Result<Sequence> reading(const std::string& text) {
  TemporaryFolder folder;
  EXPECT_TRUE(write_atomically(folder / "sequence.json", text));
  return read_sequence(folder / "sequence.json");
}

std::string around(const std::string& frames) {
  return "{\"format_version\": 1, \"projectors\": {\"right\": {\"resolution\": [640, 400]}, \"left\": {\"resolution\": "
         "[320, 201]}},"
         " \"frames\": [" +
         frames + "]}";
}

std::string role_error(const std::string& role) {
  const auto read = reading(around("{\"index\": 3, \"role\": " + role + "}"));
  if (read) return "no complaint";
  EXPECT_EQ(read.error().code, ErrorCode::kBadFile);
  return read.error().message;
}

std::vector<Role> all_roles() {
  Role white = role("white"), gray = role("gray"), phase = role("phase"), blocks = role("blocks"),
       primary = role("primary"), held_out = role("held-out"), mask = role("mask");
  white.projector = "left";
  gray.axis = "y", gray.bit = 9, gray.inverse = true, gray.cell_px = 2, gray.projector = "right";
  phase.axis = "y", phase.period_px = 32.5, phase.step = 3, phase.steps = 4, phase.shift_rad = 0.1,
  phase.shown_exponent = 0.45;
  blocks.channel = "g", blocks.cell_px = 24, blocks.inverse = true, blocks.seed = 11;
  primary.channel = "b";
  held_out.seed = -5;
  mask.axis = "y", mask.cell_px = 6, mask.step = 2;
  return {white, role("black"), gray, phase, blocks, primary, held_out, mask};
}

TEST(Sequence, ReadsTheRolesOfTheContract) {
  const Sequence s =
      reading(
          around(
              "{\"index\": 7, \"role\": {\"kind\":\"white\"}}, {\"index\": 2, \"role\": {\"kind\":\"black\", "
              "\"projector\":\"left\"}},"
              "{\"index\": 3, \"role\": {\"kind\":\"gray\",\"axis\":\"x\",\"bit\":9,\"inverse\":false}},"
              "{\"index\": 4, \"role\": {\"kind\":\"phase\",\"axis\":\"x\",\"period_px\":32,\"step\":0,\"steps\":4}}"))
          .value();
  EXPECT_EQ(s.projectors[0].first, "right");  // the order of the file
  EXPECT_EQ(s.projectors[1].second, (std::array<int, 2>{320, 201}));
  ASSERT_EQ(s.frames.size(), 4);
  EXPECT_EQ(s.frames[0].index, 7);
  EXPECT_EQ(s.frames[1].role.projector, "left");
  EXPECT_EQ(s.frames[2].role.name(), "gray x bit 9");
  EXPECT_EQ(s.frames[3].role.period_px, 32);
  EXPECT_EQ(s.frames[3].role.shift_rad, std::nullopt);
}

TEST(Sequence, TextReadsBackEqualForEveryKind) {
  Sequence sequence;
  sequence.projectors = {{"right", {640, 400}}, {"left", {320, 201}}};
  for (const Role& role : all_roles()) sequence.frames.push_back({static_cast<int>(40 - sequence.frames.size()), role});
  const std::string text = sequence_text(sequence);
  const Sequence read = reading(text).value();
  EXPECT_EQ(read.projectors, sequence.projectors);
  ASSERT_EQ(read.frames.size(), sequence.frames.size());
  for (std::size_t i = 0; i < read.frames.size(); ++i) {
    EXPECT_EQ(read.frames[i].index, sequence.frames[i].index);
    EXPECT_EQ(read.frames[i].role, sequence.frames[i].role) << sequence.frames[i].role.name();
  }
  EXPECT_EQ(sequence_text(read), text);
}

TEST(Sequence, WritesOnlyWhatTheKindUses) {
  Role gray = role("gray");
  gray.axis = "x", gray.bit = 0, gray.projector = "left";
  gray.seed = 5, gray.steps = 7;  // of other kinds
  const std::string text = sequence_text({{{"left", {4, 3}}}, {{0, gray}, {1, role("white")}}, {}});
  EXPECT_THAT(text, HasSubstr("{\"index\":0,\"role\":{\"kind\":\"gray\",\"projector\":\"left\",\"axis\":\"x\",\"bit\":"
                              "0,\"inverse\":false}}"));
  EXPECT_THAT(text, HasSubstr("{\"index\":1,\"role\":{\"kind\":\"white\"}}"));
}

TEST(Sequence, KeepsKindsThatItDoesNotKnow) {
  const Sequence s =
      reading(
          around(
              "{\"index\": 3, \"role\": {\"kind\":\"hologram\",\"axis\":\"y\",\"bit\":[1,2],\"projector\":\"left\"}}"))
          .value();
  EXPECT_EQ(s.frames[0].role.kind, "hologram");
  EXPECT_EQ(s.frames[0].role.axis, "y");
  EXPECT_EQ(s.frames[0].role.projector, "left");
  EXPECT_EQ(reading(sequence_text(s))->frames[0].role, s.frames[0].role);
}

TEST(Sequence, XorRolesNeedAnotherBitAsTheirBase) {
  const Sequence s =
      reading(
          around("{\"index\": 3, \"role\": {\"kind\":\"xor\",\"axis\":\"y\",\"bit\":4,\"base\":1,\"inverse\":true}}"))
          .value();
  EXPECT_EQ(s.frames[0].role.base, 1);
  EXPECT_EQ(s.frames[0].role.name(), "xor y bit 4 inverse");
  EXPECT_EQ(reading(sequence_text(s))->frames[0].role, s.frames[0].role);
  EXPECT_THAT(role_error("{\"kind\":\"xor\",\"axis\":\"x\",\"bit\":1,\"base\":1}"), HasSubstr("base is 1"));
  EXPECT_THAT(role_error("{\"kind\":\"xor\",\"axis\":\"x\",\"bit\":1}"), HasSubstr("'base'"));
}

TEST(SequenceError, NamesTheFrameAndWhatIsWrong) {
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"z\",\"bit\":1}"),
              AllOf(HasSubstr("sequence.json'"), HasSubstr("frame 3: axis is 'z', must be x or y")));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"bit\":1}"), HasSubstr("frame 3: it has no 'axis'"));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"x\"}"), HasSubstr("it has no 'bit'"));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"x\",\"bit\":31}"), HasSubstr("bit is 31, must be 0 to 30"));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"x\",\"bit\":1.5}"),
              HasSubstr("'bit' is 1.5, must be a whole number"));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"x\",\"bit\":1,\"inverse\":1}"),
              HasSubstr("must be true or false"));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"x\",\"bit\":1,\"invers\":true}"),
              HasSubstr("unknown key 'invers'; nearest valid key is 'inverse'"));
  EXPECT_THAT(role_error("{\"kind\":\"gray\",\"axis\":\"x\",\"bit\":1,\"cell_px\":0}"), HasSubstr("cell_px is 0"));
  EXPECT_THAT(role_error("{\"kind\":\"phase\",\"axis\":\"x\",\"period_px\":0,\"step\":0,\"steps\":4}"),
              HasSubstr("period_px is 0"));
  EXPECT_THAT(role_error("{\"kind\":\"phase\",\"axis\":\"x\",\"period_px\":8}"), HasSubstr("steps is 0"));
  EXPECT_THAT(role_error("{\"kind\":\"primary\",\"channel\":\"red\"}"), HasSubstr("channel is 'red'"));
  EXPECT_THAT(role_error("{\"kind\":\"white\",\"projector\":\"middle\"}"),
              HasSubstr("projector 'middle' is none of those"));
  EXPECT_THAT(role_error("{}"), HasSubstr("no 'kind'"));
  EXPECT_EQ(role_error("{\"kind\":\"white\",\"remark\":\"door open\"}"), "no complaint");
}

TEST(SequenceError, NamesWhatTheWholeFileLacks) {
  const auto complaint = [](const std::string& text) {
    const auto read = reading(text);
    return read ? "no complaint" : read.error().message;
  };
  const std::string white = "\"role\": {\"kind\":\"white\"}";
  EXPECT_THAT(complaint(around("{\"index\": 1, " + white + "}, {\"index\": 1, " + white + "}")),
              HasSubstr("frame 1 stands twice"));
  EXPECT_THAT(complaint(around("{\"index\": 1, " + white + "}, {" + white + "}")),
              HasSubstr("entry 1 of 'frames' has no 'index'"));
  EXPECT_THAT(complaint(around("{\"index\": -1, " + white + "}")), HasSubstr("no 'index' that is 0 or more"));
  EXPECT_THAT(complaint(around("")), HasSubstr("it has no 'frames'"));
  EXPECT_THAT(complaint("{\"frames\": []}"), HasSubstr("it has no 'projectors'"));
  EXPECT_THAT(complaint("{\"projectors\": {\"a\": {\"resolution\": [0, 3]}}, \"frames\": []}"),
              HasSubstr("projector 'a': resolution is [0,3]"));
  EXPECT_THAT(complaint("{\"format_version\": 2}"), HasSubstr("format_version 2, newer than 1"));
  EXPECT_THAT(complaint("{\"frames\": ["), HasSubstr("is not JSON: "));
  EXPECT_THAT(complaint("[1]"), HasSubstr("not a JSON object"));
}

TEST(Sequence, MarksOfIdentityReadBackAndMustLieInTheirPicture) {
  Sequence sequence = reading(around("{\"index\": 1, \"role\": {\"kind\":\"white\"}}")).value();
  EXPECT_TRUE(sequence.identity.empty());
  sequence.identity = {{"left", 0, 161, 40}, {"right", 600, 0, 36}};
  EXPECT_EQ(reading(sequence_text(sequence))->identity, sequence.identity);
  const auto complaint = [&](const IdentityMark& mark) {
    Sequence with = sequence;
    with.identity = {mark};
    const auto read = reading(sequence_text(with));
    return read ? "no complaint" : read.error().message;
  };
  EXPECT_THAT(complaint({"middle", 0, 0, 40}), HasSubstr("entry 0 of 'identity': projector 'middle'"));
  for (const IdentityMark& outside : {IdentityMark{"left", 0, 162, 40}, IdentityMark{"left", 281, 0, 40},
                                      IdentityMark{"left", -1, 0, 40}, IdentityMark{"left", 0, 0, 0}})
    EXPECT_THAT(complaint(outside), HasSubstr("does not lie in the 320 x 201 pixels of 'left'"));
}

// ---- photos ----

CameraSpec twelve_bits() {
  CameraSpec camera;
  camera.id = "cam";
  camera.pedestal = 240;
  camera.full_scale = 4080;  // not the type's maximum
  return camera;
}

TEST(ReadPhoto, SubtractsThePedestalAndDividesByWhatIsLeftOfFullScale) {
  TemporaryFolder folder;
  Image stored(3, 2, 1, 240);
  stored.at(1, 0) = 240 + 960;  // a quarter of 4080 - 240
  stored.at(2, 0) = 200;        // noise goes below the pedestal, and stays
  stored.at(0, 1) = 4059;       // 99.49 % of full scale
  stored.at(1, 1) = 4060;       // 99.51 %
  ASSERT_TRUE(write_stored16(folder / "a.tif", stored));
  const Photo photo = read_photo(folder / "a.tif", twelve_bits()).value();
  EXPECT_FLOAT_EQ(photo.value.at(0, 0), 0);
  EXPECT_FLOAT_EQ(photo.value.at(1, 0), 0.25f);
  EXPECT_FLOAT_EQ(photo.value.at(2, 0), -40.f / 3840);
  EXPECT_EQ(photo.valid.at(2, 0), 1);
  EXPECT_EQ(photo.valid.at(0, 1), 1);
  EXPECT_EQ(photo.valid.at(1, 1), 0);
}

TEST(ReadPhoto, OneSaturatedChannelSpoilsThePixel) {
  TemporaryFolder folder;
  Image stored(4, 1, 3, 100);
  for (int c = 0; c < 3; ++c) stored.at(c, 0, c) = 65535;
  ASSERT_TRUE(write_stored16(folder / "a.png", stored));
  CameraSpec camera;
  const Photo photo = read_photo(folder / "a.png", camera).value();
  EXPECT_EQ(photo.valid.data(), (std::vector<std::uint8_t>{0, 0, 0, 1}));
  EXPECT_EQ(photo.value.at(1, 0, 1), 1);  // channels keep their places
}

TEST(ReadPhoto, UndoesTheResponseForEightBitsAndForFloats) {
  TemporaryFolder folder;
  CameraSpec camera;
  camera.response = "srgb";
  Image bytes(3, 1, 1);
  bytes.at(0, 0) = 60, bytes.at(1, 0) = 188, bytes.at(2, 0) = 0;
  ASSERT_TRUE(write_png8(folder / "a.png", bytes));
  Image floats = bytes;
  for (float& v : floats.data()) v /= 255;
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"Y", &floats}}));
  const Response srgb = Response::parse("srgb").value();
  for (const char* name : {"a.png", "a.exr"}) {
    const Photo photo = read_photo(folder / name, camera).value();
    for (int x = 0; x < 3; ++x)
      EXPECT_NEAR(photo.value.at(x, 0), srgb.decode(bytes.at(x, 0) / 255), 1e-7);  // rounding to float
  }
}

TEST(ReadPhoto, FloatsThatGoBeyondOneAreNotSaturatedThere) {
  TemporaryFolder folder;
  Image floats(3, 1, 1);
  floats.at(0, 0) = 1, floats.at(1, 0) = 3.5f, floats.at(2, 0) = std::numeric_limits<float>::quiet_NaN();
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"Y", &floats}}));
  CameraSpec camera;
  EXPECT_EQ(read_photo(folder / "a.exr", camera)->valid.data(), (std::vector<std::uint8_t>{1, 1, 0}));
  EXPECT_EQ(read_photo(folder / "a.exr", camera)->value.at(1, 0), 3.5f);
  camera.full_scale = 2;
  EXPECT_EQ(read_photo(folder / "a.exr", camera)->valid.data(), (std::vector<std::uint8_t>{1, 0, 0}));
  floats.at(1, 0) = 0.5f;  // clipped at 1
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"Y", &floats}}));
  camera.full_scale.reset();
  EXPECT_EQ(read_photo(folder / "a.exr", camera)->valid.data(), (std::vector<std::uint8_t>{0, 1, 0}));
}

TEST(ReadPhoto, RefusesAPedestalAboveFullScale) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_png8(folder / "a.png", Image(2, 2, 1, 9)));
  CameraSpec camera = twelve_bits();
  camera.full_scale.reset();
  camera.pedestal = 255;
  EXPECT_EQ(read_photo(folder / "a.png", camera).error().code, ErrorCode::kBadValue);
}

TEST(ProbePhoto, AgreesWithTheReaderAndSeesTruncation) {
  TemporaryFolder folder;
  for (const int channels : {1, 3}) {
    Image image(37, 23, channels);
    for (std::size_t i = 0; i < image.data().size(); ++i) image.data()[i] = static_cast<float>(i * 37 % 60000);
    const Image plane(37, 23, 1, 0.5f);
    ASSERT_TRUE(write_stored16(folder / "a.png", image));
    ASSERT_TRUE(write_stored16(folder / "a.tif", image));
    ASSERT_TRUE(channels == 1 ? write_exr(folder / "a.exr", {{"Y", &plane}})
                              : write_exr(folder / "a.exr", {{"R", &plane}, {"G", &plane}, {"B", &plane}}));
    for (const char* name : {"a.png", "a.tif", "a.exr"}) {
      const auto shape = probe_photo(folder / name);
      ASSERT_TRUE(shape) << shape.error().message;
      EXPECT_EQ(**shape, (PhotoShape{37, 23, channels})) << name;
      const std::string bytes = read_text(folder / name).value();
      for (const std::size_t kept :
           {bytes.size() - 5, bytes.size() / 2, std::size_t{30}, std::size_t{3}, std::size_t{0}}) {
        ASSERT_TRUE(write_atomically(folder / name, bytes.substr(0, kept)));
        const auto cut = probe_photo(folder / name);
        ASSERT_FALSE(cut) << name << " of " << kept << " bytes";
        EXPECT_THAT(cut.error().message, HasSubstr(name));
      }
    }
  }
}

// ---- sessions ----

// Two cameras of different size, three frames whose indices are neither dense nor in order.
struct Made {
  Rig rig;
  Sequence sequence;
};

Made made() {
  Made m;
  m.rig.cameras = {twelve_bits(), twelve_bits()};
  m.rig.cameras[1].id = "second";
  m.rig.projectors.resize(1);
  m.rig.projectors[0].id = "left";
  m.rig.projectors[0].resolution = {32, 21};
  m.sequence.projectors = {{"left", {32, 21}}};
  Role gray = role("gray");
  gray.bit = 4;
  m.sequence.frames = {{7, role("white")}, {2, role("black")}, {5, gray}};
  return m;
}

void write_photos(const fs::path& folder, const Made& m) {
  ASSERT_TRUE(write_session_header(folder, m.rig, "", m.sequence));
  for (std::size_t c = 0; c < m.rig.cameras.size(); ++c) {
    fs::create_directories(folder / "photos" / m.rig.cameras[c].id);
    for (const Frame& frame : m.sequence.frames)
      ASSERT_TRUE(write_stored16(folder / "photos" / m.rig.cameras[c].id / fmt::format("{:04}.tif", frame.index),
                                 Image(9 + 2 * c, 7, 1, 240 + 384 * (c + 1) + frame.index)));
  }
}

TEST(Session, WhatItCallsUnusedIsInvalidInEveryPhotoOfThatCamera) {
  TemporaryFolder folder;
  write_photos(folder.path(), made());
  ASSERT_TRUE(
      write_unused(folder.path(), {{"second", {{{2, 1}, {4, 1}, {4, 3}, {2, 3}}, {{9, 5}, {20, 5}, {20, 30}}}}}));
  const Session session = Session::open(folder.path()).value();
  for (const int frame : {7, 2, 5}) {
    const Photo photo = session.photo("second", frame).value();
    EXPECT_EQ(photo.valid.at(2, 1) + photo.valid.at(3, 2) + photo.valid.at(4, 3) + photo.valid.at(10, 5), 0);
    EXPECT_EQ(photo.valid.at(1, 1) + photo.valid.at(5, 3) + photo.valid.at(2, 4) + photo.valid.at(8, 5), 4);
    const Mask other = session.photo("cam", frame)->valid;
    EXPECT_EQ(std::count(other.data().begin(), other.data().end(), 0), 0) << "another camera";
  }
  for (const auto& [text, why] : {std::pair{"{\"cameras\": {\"third\": []}}", "no camera 'third'"},
                                  {"{\"cameras\": {\"cam\": [[[1, 2], [3, 4]]]}}", "2 corners"},
                                  {"{\"cameras\": {\"cam\": [[[1, 2], [3, 4], [1e9, 2]]]}}", "beyond every photo"},
                                  {"{\"cameras\": {\"cam\": [[[1], 2]]}}", "unused.json' is not"},
                                  {"[", "unused.json' is not"}}) {
    ASSERT_TRUE(write_atomically(folder / "unused.json", text));
    const auto opened = Session::open(folder.path());
    ASSERT_FALSE(opened) << text;
    EXPECT_EQ(opened.error().code, ErrorCode::kBadFile);
    EXPECT_THAT(opened.error().message, HasSubstr(why)) << text;
  }
}

TEST(Session, OpensWhatTheHeaderAndThePhotosSay) {
  TemporaryFolder folder;
  const Made m = made();
  write_photos(folder.path(), m);
  const Session session = Session::open(folder.path()).value();
  EXPECT_EQ(canonical_rig_text(session.rig()), canonical_rig_text(m.rig));
  EXPECT_EQ(sequence_text(session.sequence()), sequence_text(m.sequence));
  const Photo photo = session.photo("second", 5).value();
  EXPECT_TRUE(photo.value.same_size(11, 7));
  EXPECT_FLOAT_EQ(photo.value.at(3, 2), (2 * 384 + 5) / 3840.f);
  EXPECT_EQ(session.photo_path("cam", 7), folder.path() / "photos" / "cam" / "0007.tif");
  EXPECT_FALSE(fs::exists(folder / "simulation.toml"));
  EXPECT_THROW((void)session.photo("third", 5), Bug);
}

TEST(Session, OneCameraMayKeepItsPhotosWithoutAFolder) {
  TemporaryFolder folder;
  Made m = made();
  m.rig.cameras.pop_back();
  write_photos(folder.path(), m);
  fs::rename(folder / "photos", folder / "elsewhere");
  fs::rename(folder.path() / "elsewhere" / "cam", folder / "photos");
  const auto session = Session::open(folder.path());
  ASSERT_TRUE(session) << session.error().message;
  EXPECT_FLOAT_EQ(session->photo("cam", 7)->value.at(0, 0), (384 + 7) / 3840.f);
}

TEST(Session, NamesTheFirstMissingPhotoAndHowManyAreMissing) {
  TemporaryFolder folder;
  write_photos(folder.path(), made());
  fs::remove(folder.path() / "photos" / "second" / "0002.tif");
  fs::remove(folder.path() / "photos" / "second" / "0005.tif");
  const auto session = Session::open(folder.path());
  ASSERT_FALSE(session);
  EXPECT_EQ(session.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(session.error().message,
              AllOf(HasSubstr("camera 'second'"), HasSubstr("2 of 3 frames"), HasSubstr("0002 (black)")));
}

TEST(Session, RefusesATruncatedPhotoByName) {
  TemporaryFolder folder;
  write_photos(folder.path(), made());
  const fs::path photo = folder.path() / "photos" / "cam" / "0005.tif";
  const std::string bytes = read_text(photo).value();
  ASSERT_TRUE(write_atomically(photo, bytes.substr(0, bytes.size() / 2)));
  const auto session = Session::open(folder.path());
  ASSERT_FALSE(session);
  EXPECT_EQ(session.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(session.error().message, AllOf(HasSubstr("cam/0005.tif"), HasSubstr("truncated")));
}

TEST(Session, RefusesAPhotoOfAnotherSize) {
  TemporaryFolder folder;
  write_photos(folder.path(), made());
  ASSERT_TRUE(write_stored16(folder.path() / "photos" / "cam" / "0005.tif", Image(7, 9, 1, 500)));
  const auto session = Session::open(folder.path());
  ASSERT_FALSE(session);
  EXPECT_THAT(session.error().message, AllOf(HasSubstr("cam/0005.tif' has 7 x 9"), HasSubstr("cam/0007.tif' 9 x 7")));
  ASSERT_TRUE(write_stored16(folder.path() / "photos" / "cam" / "0005.tif", Image(9, 7, 3, 500)));
  EXPECT_THAT(Session::open(folder.path()).error().message, HasSubstr("of 3 channels"));
}

TEST(Session, RefusesTwoPhotosOfOneFrame) {
  TemporaryFolder folder;
  write_photos(folder.path(), made());
  ASSERT_TRUE(write_stored16(folder.path() / "photos" / "cam" / "0005.png", Image(9, 7, 1, 500)));
  EXPECT_THAT(Session::open(folder.path()).error().message,
              AllOf(HasSubstr("0005.png"), HasSubstr("0005.tif"), HasSubstr("remove one")));
}

TEST(Session, RefusesFilesThatContradictEachOtherOrComeFromTheFuture) {
  TemporaryFolder folder;
  Made m = made();
  write_photos(folder.path(), m);
  const auto rewrite = [&](const char* name, const std::string& text) {
    ASSERT_TRUE(write_atomically(folder / name, text));
  };
  m.sequence.projectors = {{"left", {32, 22}}};
  rewrite("sequence.json", sequence_text(m.sequence));
  EXPECT_THAT(Session::open(folder.path()).error().message, HasSubstr("32 x 21 pixels in rig.toml but 32 x 22"));
  m.sequence.projectors = {{"right", {32, 21}}};
  rewrite("sequence.json", sequence_text(m.sequence));
  EXPECT_THAT(Session::open(folder.path()).error().message,
              HasSubstr("projector 'right', which rig.toml does not name"));
  rewrite("session.json", "{\"format_version\": 2}");
  EXPECT_THAT(Session::open(folder.path()).error().message, HasSubstr("format_version 2, newer than 1"));
  EXPECT_THAT(Session::open(folder / "nowhere").error().message, HasSubstr("nowhere' is missing"));
}

// ---- several exposures ----

TEST(Session, SeveralExposuresGiveTheLightOfTheFirstListedOne) {
  TemporaryFolder folder;
  Made m = made();
  m.rig.cameras = {twelve_bits()};
  m.rig.cameras[0].exposures_ms = {8, 2, 32};  // the reference is the first, not the shortest
  m.sequence.frames = {{7, role("white")}};
  ASSERT_TRUE(write_session_header(folder.path(), m.rig, "", m.sequence));
  fs::create_directories(folder.path() / "photos" / "cam");
  // Four pixels, light per 8 ms as a fraction of full scale; the last saturates even at 2 ms.
  const double light[4] = {0.125, 0.5, 2.5, 5};
  for (const double exposure : {8.0, 2.0, 32.0}) {
    Image stored(4, 1, 1);
    for (int x = 0; x < 4; ++x)
      stored.at(x, 0) = static_cast<float>(std::min(4080.0, 240 + 3840 * light[x] * exposure / 8));
    ASSERT_TRUE(write_stored16(folder.path() / "photos" / "cam" / fmt::format("0007_{:.1f}ms.tif", exposure), stored));
  }
  const Session session = Session::open(folder.path()).value();
  const Photo photo = session.photo("cam", 7).value();
  EXPECT_EQ(photo.exposure_ms, 8);
  EXPECT_EQ(photo.valid.data(), (std::vector<std::uint8_t>{1, 1, 1, 0}));
  for (int x = 0; x < 3; ++x) EXPECT_NEAR(photo.value.at(x, 0), light[x], 1e-6);  // stored exactly; rounding to float
  EXPECT_NEAR(photo.value.at(3, 0), 4, 1e-6);  // full scale of the shortest exposure, 8 / 2
  EXPECT_THAT(session.photo_path("cam", 7).string(), EndsWith("0007_2.0ms.tif"));
  fs::remove(folder.path() / "photos" / "cam" / "0007_2.0ms.tif");
  EXPECT_TRUE(Session::open(folder.path()));  // the same for all frames
}

TEST(Session, LongerExposuresWeighMore) {
  TemporaryFolder folder;
  Made m = made();
  m.rig.cameras = {twelve_bits()};
  m.rig.cameras[0].exposures_ms = {10, 30};
  m.sequence.frames = {{7, role("white")}, {8, role("black")}};
  ASSERT_TRUE(write_session_header(folder.path(), m.rig, "", m.sequence));
  fs::create_directories(folder.path() / "photos" / "cam");
  for (const int index : {7, 8}) {
    ASSERT_TRUE(write_stored16(folder.path() / "photos" / "cam" / fmt::format("{:04}_10.0ms.tif", index),
                               Image(2, 1, 1, 240 + 384)));
    ASSERT_TRUE(write_stored16(folder.path() / "photos" / "cam" / fmt::format("{:04}_30.0ms.tif", index),
                               Image(2, 1, 1, 240 + 3 * 768)));
  }
  // 0.1 in 10 ms and 0.2 in 10 ms (three times that in 30): all light over all time = (.1 + .6) / 40 ms.
  EXPECT_NEAR(Session::open(folder.path())->photo("cam", 8)->value.at(1, 0), 0.175, 1e-6);  // rounding to float
  fs::remove(folder.path() / "photos" / "cam" / "0008_30.0ms.tif");
  EXPECT_THAT(Session::open(folder.path()).error().message,
              AllOf(HasSubstr("1 of 2 frames"), HasSubstr("0008 (black)")));
}

// ---- the header ----

TEST(SessionHeader, CopiesModelsAndRefersToThemRelatively) {
  TemporaryFolder folder;
  Made m = made();
  m.rig.projectors[0].id = "cam";  // a camera and a projector may share a name
  m.sequence.projectors[0].first = "cam";
  m.rig.cameras[0].model = folder / "lens.cameramodel";
  m.rig.projectors[0].model = folder / "projector.cameramodel";
  ASSERT_TRUE(write_atomically(m.rig.cameras[0].model, "camera's"));
  ASSERT_TRUE(write_atomically(m.rig.projectors[0].model, "projector's"));
  const fs::path session = folder / "session";
  fs::create_directories(session);
  ASSERT_TRUE(write_session_header(session, m.rig, "[simulation]\nroom = \"two-wall\"\n", m.sequence));
  EXPECT_THAT(read_text(session / "rig.toml").value(), HasSubstr("model = \"models/cam.cameramodel\""));
  const Rig read = read_rig(session / "rig.toml").value();
  EXPECT_EQ(read_text(read.cameras[0].model).value(), "camera's");
  EXPECT_EQ(read_text(read.projectors[0].model).value(), "projector's");
  EXPECT_EQ(read_simulation(session / "simulation.toml")->room, "two-wall");
  fs::remove(folder / "lens.cameramodel");
  const auto missing = write_session_header(session, m.rig, "", m.sequence);
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, AllOf(HasSubstr("camera 'cam'"), HasSubstr("lens.cameramodel' is missing")));
}

TEST(SessionHeader, EqualRigsGiveEqualBytesAtAnyPath) {
  TemporaryFolder folder;
  std::vector<std::string> texts;
  for (const char* name : {"here", "somewhere-else"}) {
    Made m = made();
    fs::create_directories(folder / name);
    m.rig.cameras[0].model = folder.path() / name / "lens.cameramodel";
    ASSERT_TRUE(write_atomically(m.rig.cameras[0].model, "lens"));
    ASSERT_TRUE(write_session_header(folder / name, m.rig, "", m.sequence));
    texts.push_back(read_text(folder.path() / name / "rig.toml").value() +
                    read_text(folder.path() / name / "sequence.json").value() +
                    read_text(folder.path() / name / "session.json").value());
  }
  EXPECT_EQ(texts[0], texts[1]);
}

}  // namespace
}  // namespace countershade

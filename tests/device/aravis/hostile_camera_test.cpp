// GigE Vision cameras that break the rules: whatever they send ends in a whole, right photo or in an error that names
// the camera, within bounded time.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>

#include "capture/device/aravis/aravis.h"
#include "tests/device/aravis/genicam.h"
#include "tests/device/aravis/gige_camera.h"

namespace countershade {
namespace {

using capture::Camera;
using capture::open_aravis_camera;
using testing::GigeCamera;
using testing::GigeFault;
using testing::GigeOptions;
using ::testing::HasSubstr;

constexpr int kWidth = 320, kHeight = 200, kTries = 3;
constexpr double kTimeoutS = 0.3;
// A photo at worst: every try in vain (0.3 s), after each the stream is begun anew (0.1 s that Aravis waits for a photo
// with holes; its threads; three questions to the camera), on a busy machine.
constexpr double kLongestS = 2 * kTries * (kTimeoutS + 0.4);

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}
// Of photo number `photo`, so that what is left of another one shows.
std::uint16_t value_of(std::size_t i, int photo) {
  return static_cast<std::uint16_t>((i + 77777u * static_cast<unsigned>(photo)) * 2654435761u >> 7);
}

class Hostile : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!capture::has_aravis()) GTEST_SKIP() << "built without Aravis";
    if (const std::string why = testing::enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }
  static GigeOptions with(GigeFault fault) {
    GigeOptions options;
    options.width = kWidth, options.height = kHeight, options.formats = {"Mono16"}, options.largest_packet = 1000;
    options.fault = fault;
    return options;
  }
  void plug_in(const GigeOptions& options) {
    taken_ = 0;
    camera_ = std::make_unique<GigeCamera>(options, [this, options](double) {
      const int photo = ++taken_;
      std::vector<std::uint16_t> values(static_cast<std::size_t>(options.width) * options.height);
      for (std::size_t i = 0; i < values.size(); ++i) values[i] = value_of(i, photo);
      return values;
    });
  }
  static Result<std::unique_ptr<Camera>> open() {
    const double begun = now_s();
    auto opened = open_aravis_camera("left eye", "", {.timeout_s = kTimeoutS, .tries = kTries});
    EXPECT_LT(now_s() - begun, 20) << "a second of discovery, and questions that Aravis asks five times";
    return opened;
  }
  // What becomes of a photo: the number that the camera gave it, if it is whole; 0 for an error that names the camera.
  int photo_of(Camera& camera) {
    const double begun = now_s();
    const int before = taken_;
    const auto taken = camera.trigger();
    EXPECT_LT(now_s() - begun, kLongestS);
    if (!taken) {
      EXPECT_EQ(taken.error().code, ErrorCode::kDevice);
      EXPECT_THAT(taken.error().message, HasSubstr("camera 'left eye'"));
      message_ = taken.error().message;
      return 0;
    }
    EXPECT_GE(taken->timestamp_s, begun) << "a camera's clock is not believed";
    EXPECT_LE(taken->timestamp_s, now_s());
    EXPECT_TRUE(taken->values.same_size(kWidth, kHeight));
    int photo = before + 1;  // none of before the question
    const auto is = [&](std::size_t i) { return taken->values.data()[i] == value_of(i, photo); };
    while (photo < taken_ && !(is(0) && is(1))) ++photo;
    std::size_t wrong = 0;
    for (std::size_t i = 0; i < taken->values.data().size(); ++i) wrong += !is(i);
    EXPECT_EQ(wrong, 0u) << "pixels of photo " << photo;
    return photo;
  }
  // Photos that come whole in spite of it.
  void expect_whole(GigeFault fault, int photos = 4) {
    plug_in(with(fault));
    const auto camera = open();
    ASSERT_TRUE(camera) << camera.error().message;
    ASSERT_TRUE((*camera)->arm(1));
    for (int i = 0; i < photos; ++i) EXPECT_GT(photo_of(**camera), 0) << "photo " << i << ": " << message_;
  }
  // Photos that never come, and why.
  void expect_refused(GigeFault fault, const std::string& why) {
    plug_in(with(fault));
    const auto camera = open();
    ASSERT_TRUE(camera) << camera.error().message;
    ASSERT_TRUE((*camera)->arm(1));
    for (int i = 0; i < 2; ++i) {
      EXPECT_EQ(photo_of(**camera), 0);
      EXPECT_THAT(message_, HasSubstr(why));
    }
  }
  std::atomic<int> taken_{0};
  std::string message_;
  std::unique_ptr<GigeCamera> camera_;
};

TEST_F(Hostile, PacketsInReverseOrderAreStillAPhoto) {
  expect_whole(GigeFault::kBackwards);
}
TEST_F(Hostile, TwoPhotosAtOnceAreNeverMixed) {
  expect_whole(GigeFault::kInterleaved);
}
TEST_F(Hostile, PacketsCutShortDoNotHurt) {
  expect_whole(GigeFault::kTinyPackets);
}
TEST_F(Hostile, PacketsBeyondThePhotoDoNotHurt) {
  expect_whole(GigeFault::kPacketBeyond);
}
TEST_F(Hostile, PacketsFarBeyondBehindAnAllInOneDoNotHurt) {
  expect_whole(GigeFault::kFarBeyond);
}
TEST_F(Hostile, PacketsThatAreTooLongDoNotReachIntoTheNext) {
  expect_whole(GigeFault::kLongPackets);
}
TEST_F(Hostile, NoiseAmongThePacketsIsNotTakenForAPhoto) {
  plug_in(with(GigeFault::kNoise));  // it may claim a photo's packets first: then the photo is lost, and no more
  const auto camera = open();
  ASSERT_TRUE(camera) << camera.error().message;
  ASSERT_TRUE((*camera)->arm(1));
  for (int i = 0; i < 4; ++i) photo_of(**camera);
}
TEST_F(Hostile, BlockNumbersThatJumpAheadAreFollowed) {
  expect_whole(GigeFault::kBlockJumps);
}
TEST_F(Hostile, BlockNumbersThatBeginAnewAreFollowed) {
  expect_whole(GigeFault::kBlockWraps, 6);
}
TEST_F(Hostile, BlockNumbersThatFallBackAreFollowed) {
  expect_whole(GigeFault::kBlockBack);
}
TEST_F(Hostile, AClockThatGoesBackTellsNothing) {
  expect_whole(GigeFault::kClockBack);
}
TEST_F(Hostile, AClockThatIsCenturiesAheadTellsNothing) {
  expect_whole(GigeFault::kClockAhead);
}

TEST_F(Hostile, ALeaderWithoutAPictureIsNoPhoto) {
  expect_refused(GigeFault::kShortLeader, "3 t");
}
TEST_F(Hostile, ALeaderOfAnotherKindIsNoPhoto) {
  expect_refused(GigeFault::kOtherPayload, "3 t");
}
TEST_F(Hostile, AHoleThatNoFlagTellsOfIsFound) {
  expect_refused(GigeFault::kHalfPacket, "do not fit it");
}
TEST_F(Hostile, APartThatLiesElsewhereIsAHole) {
  expect_refused(GigeFault::kMovedPart, "do not fit it");
}
TEST_F(Hostile, APhotoWithoutDataIsNone) {
  expect_refused(GigeFault::kNoData, "3 t");
}
TEST_F(Hostile, APhotoWithoutEndIsNone) {
  expect_refused(GigeFault::kNoTrailer, "do not fit it");
}
TEST_F(Hostile, AnEarlierPhotoThatComesLateIsNotGivenForALaterOne) {
  expect_whole(GigeFault::kHoldsBack, 6);
}

// ---- what it says about itself ----

class HostileDescription : public Hostile {
 protected:
  // The right description with one part replaced.
  static std::string with_part(const std::string& part, const std::string& by) {
    std::string text = testing::genicam_description({kWidth, kHeight, {"Mono16"}}, {"GEV", "BigEndian", 0});
    const std::size_t at = text.find(part);
    EXPECT_NE(at, std::string::npos) << part;
    return text.replace(at, part.size(), by);
  }
  // What opening and arming it says; "" where a photo comes.
  std::string complaint(const std::string& description, std::size_t claimed = 0, bool blanks = false) {
    GigeOptions options = with(GigeFault::kNone);
    options.blanks = blanks;
    options.description = description, options.claimed_description = claimed;
    plug_in(options);
    const auto said = [](const Error& e) {
      EXPECT_THAT(e.message, HasSubstr("camera 'left eye'"));
      EXPECT_THAT(e.message.size(), ::testing::Gt(40u)) << e.message;
      return e.message;
    };
    const auto camera = open();
    if (!camera) return said(camera.error());
    if (const auto armed = (*camera)->arm(1); !armed) return said(armed.error());
    return photo_of(**camera) > 0 ? "" : message_;
  }
  static constexpr const char* kExposure = "<pValue>ExposureReg</pValue>";
};

TEST_F(HostileDescription, TheRightOneIsTaken) {
  EXPECT_EQ(complaint(with_part(kExposure, kExposure)), "");
}

TEST_F(HostileDescription, CutAnywhereItIsAnError) {
  const std::string whole = with_part(kExposure, kExposure);
  for (const double share : {0.02, 0.3, 0.6, 0.95})
    EXPECT_NE(complaint(whole.substr(0, static_cast<std::size_t>(share * static_cast<double>(whole.size())))), "")
        << share;
  EXPECT_NE(complaint("this is no XML at all, but it is long enough to be read by somebody who believes that it is"),
            "");
  EXPECT_NE(complaint("<?xml version=\"1.0\"?><RegisterDescription/>"), "");
}

TEST_F(HostileDescription, OneOfFiftyMegabytesIsNotRead) {
  EXPECT_THAT(complaint("", 50 << 20), HasSubstr("longer than 8 MB"));
}

// A description in an archive, stored as it is: local header, file, directory of one entry, end.
struct Archive {
  std::string bytes;
  std::size_t directory = 0, end = 0;  // where they begin
  void number(std::size_t at, std::uint64_t value, int size = 4) {
    for (int i = 0; i < size; ++i) bytes[at + i] = static_cast<char>(value >> (8 * i));
  }
};
Archive zipped(const std::string& text) {
  const std::string name = "room.xml";
  Archive a;
  const auto header = [&](std::uint32_t magic, std::size_t length) {
    const std::size_t at = a.bytes.size();
    a.bytes.append(length, '\0');
    a.number(at, magic);
    return at;
  };
  const std::size_t local = header(0x04034b50, 30);
  a.number(local + 18, text.size()), a.number(local + 22, text.size()), a.number(local + 26, name.size(), 2);
  a.bytes += name + text;
  a.directory = header(0x02014b50, 46);
  a.number(a.directory + 20, text.size()), a.number(a.directory + 24, text.size());
  a.number(a.directory + 28, name.size(), 2);
  a.bytes += name;
  a.end = header(0x06054b50, 22);
  a.number(a.end + 8, 1, 2), a.number(a.end + 10, 1, 2);
  a.number(a.end + 12, a.end - a.directory), a.number(a.end + 16, a.directory);
  return a;
}

TEST_F(HostileDescription, AZippedOneIsTaken) {
  EXPECT_EQ(complaint(zipped(with_part(kExposure, kExposure)).bytes), "");
}

TEST_F(HostileDescription, BlanksInItsPlaceHideNothing) {
  Archive archive = zipped(with_part(kExposure, kExposure));
  EXPECT_EQ(complaint(archive.bytes, 0, true), "");
  archive.number(archive.directory + 24, 1u << 30);
  EXPECT_THAT(complaint(archive.bytes, 0, true), HasSubstr("1024 MB unpacked"));
  EXPECT_THAT(complaint("", 50 << 20, true), HasSubstr("longer than 8 MB"));
}

// Each of them ends Aravis 0.8.26, or has it ask for gigabytes.
TEST_F(HostileDescription, ArchivesThatLeadOutOfThemselvesAreErrors) {
  const Archive right = zipped(with_part(kExposure, kExposure));
  const auto with = [&](std::size_t at, std::uint64_t value, int size = 4) {
    Archive wrong = right;
    wrong.number(at, value, size);
    return complaint(wrong.bytes);
  };
  EXPECT_THAT(with(right.directory + 24, 1u << 30), HasSubstr("1024 MB unpacked"));
  EXPECT_THAT(with(right.directory + 20, 0x7fffffff), HasSubstr("not where its directory says"));
  EXPECT_THAT(with(right.directory + 42, 0x7fffffff), HasSubstr("not where its directory says"));
  EXPECT_THAT(with(26, 0xffff, 2), HasSubstr("not where its directory says"));
  EXPECT_THAT(with(right.directory + 28, 0xffff, 2), HasSubstr("cut short"));
  EXPECT_THAT(with(right.end + 16, 0xfffffff0), HasSubstr("not where it says"));
  EXPECT_THAT(with(right.end + 12, 0), HasSubstr("cut short"));
  EXPECT_THAT(with(right.end, 0), HasSubstr("no directory"));
  Archive many = right;
  many.number(many.end + 8, 0xffff, 2), many.number(many.end + 10, 0xffff, 2);
  EXPECT_THAT(complaint(many.bytes), HasSubstr("cut short"));
  EXPECT_THAT(complaint(right.bytes.substr(0, right.bytes.size() - 10)), HasSubstr("no directory"));
  EXPECT_THAT(complaint(right.bytes + right.bytes.substr(right.end, 10)), HasSubstr("cut short"));
}

TEST_F(HostileDescription, NodesThatReferToThemselvesAreNamed) {
  EXPECT_THAT(complaint(with_part("<Min>10</Min>", "<pMin>ExposureTime</pMin>")),
              HasSubstr("node 'ExposureTime' of its description refers to itself"));
  const std::string ring =
      "<Integer Name=\"A\"><pValue>B</pValue></Integer><Integer Name=\"B\"><pValue>A</pValue></Integer>";
  EXPECT_THAT(complaint(with_part("<Port", ring + "<Port")), HasSubstr("(A -> B -> A)"));
  EXPECT_THAT(complaint(with_part(kExposure, "<pValue>A</pValue>")
                            .replace(with_part(kExposure, "<pValue>A</pValue>").find("<Port"), 0, ring)),
              HasSubstr("refers to itself"));
}

TEST_F(HostileDescription, ChainsAndThicketsAreNamed) {
  std::string chain, thicket;
  for (int i = 0; i < 100000; ++i)
    chain += fmt::format("<Integer Name=\"C{}\"><pValue>C{}</pValue></Integer>", i, i + 1);
  EXPECT_THAT(complaint(with_part("<Port", chain + "<Port")), HasSubstr("chain of more than 200"));
  for (int i = 0; i < 60; ++i)
    thicket += fmt::format(
        "<Integer Name=\"T{}\"><pValue>T{}</pValue><pMin>S{}</pMin></Integer><Integer Name=\"S{}\">"
        "<pValue>T{}</pValue></Integer>",
        i, i + 1, i, i, i + 1);
  EXPECT_THAT(complaint(with_part("<Port", thicket + "<Port")), HasSubstr("ways through what it refers to"));
}

TEST_F(HostileDescription, DivisionByZeroIsAnError) {
  EXPECT_NE(complaint(with_part("W*H*((F&gt;&gt;16)&amp;0xFF)/8", "W*H/(F-F)")), "");
  EXPECT_NE(complaint(with_part("W*H*((F&gt;&gt;16)&amp;0xFF)/8", "W%(F-F)")), "");
}

TEST_F(HostileDescription, SizesThatCannotBeAreErrors) {
  for (const char* payload : {"0", "17", "4000000000", "-5", "1/0.", "W*"})
    EXPECT_NE(complaint(with_part("W*H*((F&gt;&gt;16)&amp;0xFF)/8", payload)), "") << payload;
}

TEST_F(HostileDescription, MissingNodesAreErrors) {
  for (const char* node : {"\"Width\"", "\"PixelFormat\"", "\"PayloadSize\"", "\"TriggerSoftware\"", "\"ExposureTime\"",
                           "\"AcquisitionStart\"", "\"ExposureReg\"", "Name=\"Device\""})
    EXPECT_NE(complaint(with_part(node, std::string(node).front() == 'N' ? "Name=\"X\"" : "\"X\"")), "") << node;
}

}  // namespace
}  // namespace countershade

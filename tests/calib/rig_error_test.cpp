// What is said of rig files that are wrong.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/file/rig.h"
#include "tests/calib/rig_reading.h"

namespace countershade {
namespace {

using test::complaint;
using test::kSmallest;
using test::reading;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;
using testing::TemporaryFolder;

TEST(RigError, UnknownKeyNamesFileLineTableAndTheNearest) {
  EXPECT_EQ(complaint("[[camera]]\nid = \"cam\"\n\n[[projector]]\nid = \"left\"\nresoltion = [1280, 800]\n"),
            "rig.toml:6: unknown key 'resoltion' in [[projector]]; nearest valid key is 'resolution'");
  EXPECT_EQ(complaint(kSmallest + "[scren]\nkind = \"measured\"\n"),
            "rig.toml:6: unknown key 'scren' at the top of the file; nearest valid key is 'screen'");
  EXPECT_EQ(complaint(kSmallest + "[screen]\nknown_length = { pixel_a = [1, 2], pixel_c = [3, 4], metres = 1 }\n"),
            "rig.toml:7: unknown key 'pixel_c' in known_length of [screen]; nearest valid key is 'pixel_a'");
  EXPECT_EQ(complaint(kSmallest + "[simulation]\n[[simulation.camera]]\nid = \"c\"\nfocal_pix = 3\n"),
            "rig.toml:9: unknown key 'focal_pix' in [[simulation.camera]]; nearest valid key is 'focal_px'");
}

TEST(RigError, TheFirstMistakeOfATableIsReported) {
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\nzzz = 1\naaa = 2\n"), StartsWith("rig.toml:3: unknown key 'zzz'"));
}

TEST(RigError, WhatIsMandatoryIsMissedByName) {
  EXPECT_THAT(complaint("[[camera]]\nbackend = \"folder\"\n"), StartsWith("rig.toml:1: [[camera]] has no 'id'"));
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\n[[projector]]\nresolution = [1, 1]\n"),
              StartsWith("rig.toml:3: [[projector]] has no 'id'"));
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\n[[projector]]\nid = \"p\"\n"),
              StartsWith("rig.toml:3: [[projector]] has no 'resolution'"));
  EXPECT_THAT(complaint("[[projector]]\nid = \"p\"\nresolution = [1, 1]\n"),
              HasSubstr("names no camera; add a table [[camera]]"));
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\n"), HasSubstr("names no projector; add a table [[projector]]"));
  EXPECT_THAT(complaint(kSmallest + "[board]\nsquare = 1\n"), StartsWith("rig.toml:6: [board] has no 'kind'"));
  EXPECT_THAT(complaint(""), HasSubstr("names no camera"));
}

TEST(RigError, IdsAreUniqueAndCanNameFiles) {
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\n[[camera]]\nid = \"c\"\n"),
              AllOf(StartsWith("rig.toml:3: id 'c' stands in two [[camera]] tables"), HasSubstr("first in line 1")));
  for (const std::string id : {"", "a/b", "..", "a=b", "a b", "C:"})
    EXPECT_THAT(complaint("[[camera]]\nid = \"" + id + "\"\n"),
                AllOf(StartsWith("rig.toml:2: id = \"" + id + "\" in [[camera]]"), HasSubstr("must be a name")));
  EXPECT_TRUE(reading(
      "[[camera]]\nid = \"left\"\n[[projector]]\nid = \"left\"\nresolution = [4, 3]\n"));  // a camera and a projector
}

struct Line {
  const char *line, *says;
};

TEST(RigError, WrongTypesSayWhatIsExpected) {
  for (const Line& l : std::vector<Line>{{"pedestal = \"x\"", "pedestal = \"x\" in [[camera]] must be a number"},
                                         {"id = 7", "must be text in quotes"},
                                         {"model = true", "must be a path in quotes"},
                                         {"exposures_ms = 8", "must be a list of numbers"},
                                         {"exposures_ms = [8, \"x\"]", "must be a number"}})
    EXPECT_THAT(complaint(std::string("[[camera]]\n") + l.line + "\n"),
                AllOf(StartsWith("rig.toml:2: "), HasSubstr(l.says)));
  for (const Line& l : std::vector<Line>{{"resolution = [1280.5, 800]", "must be a whole number"},
                                         {"resolution = [1280]", "must be 2 numbers in brackets"},
                                         {"resolution = 1280", "must be 2 numbers in brackets"},
                                         {"lens_shift = [0.0, 1.0, 2.0]", "must be 2 numbers in brackets"}})
    EXPECT_THAT(complaint(std::string("[[projector]]\n") + l.line + "\n"),
                AllOf(StartsWith("rig.toml:2: "), HasSubstr(l.says)));
  EXPECT_THAT(complaint("[camera]\nid = \"c\"\n"), HasSubstr("must be written [[camera]], in double brackets"));
  EXPECT_THAT(complaint(kSmallest + "[[screen]]\n"), HasSubstr("must be written [screen], in single brackets"));
  EXPECT_THAT(complaint(kSmallest + "[screen]\npatches = \"many\"\n"), HasSubstr("must be \"auto\" or [nu, nv]"));
}

TEST(RigError, ValuesOutOfRangeNameTheBound) {
  const std::string projector = "[[projector]]\nid = \"p\"\nresolution = [4, 3]\n";
  for (const Line& l :
       std::vector<Line>{{"black_level = 1.5", "black_level = 1.5 in [[projector]] must be at least 0 and at most 0.9"},
                         {"black_level = nan", "must be finite"},
                         {"throw_ratio = inf", "must be finite"},
                         {"throw_ratio = 0", "throw_ratio = 0 in [[projector]] must be more than 0"},
                         {"throw_ratio_sigma = -0.1", "must be more than 0"},
                         {"response = \"gamma:9\"", "from 0.2 to 5"},
                         {"response = \"sRGB\"", "use linear, srgb or gamma:G"}})
    EXPECT_THAT(complaint(projector + l.line + "\n"), AllOf(StartsWith("rig.toml:4: "), HasSubstr(l.says)));
  EXPECT_THAT(complaint("[[projector]]\nid = \"p\"\nresolution = [1280, 0]\n"),
              AllOf(StartsWith("rig.toml:3: resolution = [1280,0]"), HasSubstr("must be at least 1")));
  const std::string surface = kSmallest + "[simulation]\n[[simulation.surface]]\nid = \"s\"\n";
  EXPECT_THAT(complaint(surface + "shape = \"sphere\"\nradius = -2.0\n"),
              AllOf(StartsWith("rig.toml:10: radius"), HasSubstr("must be at least 0.001")));
  EXPECT_THAT(complaint(surface + "radius = 2.0\n"), HasSubstr("unknown key 'radius'"));  // of a rectangle
  EXPECT_THAT(complaint(surface + "shape = \"ball\"\n"), HasSubstr("the nearest is"));
  EXPECT_THAT(complaint(surface + "shape = \"mesh\"\n"), HasSubstr("has no 'mesh'"));
  EXPECT_THAT(complaint(surface + "shape = \"cone\"\nazimuth_deg = [20, 10]\n"), HasSubstr("must rise"));
  EXPECT_THAT(complaint(surface + "albedo = [0.5, 1.5, 0.5]\n"), HasSubstr("at most 1"));
  EXPECT_THAT(complaint(kSmallest + "[simulation]\n[[simulation.camera]]\nid = \"c\"\nchannels = 2\n"),
              HasSubstr("must be 1 or 3"));
  for (const Line& l : std::vector<Line>{{"bayer = \"RGBG\"", "is not known; use one of: none, RGGB"},
                                         {"veiling_glare = 1.5", "at least 0 and at most 1"},
                                         {"hot_pixels = -1", "at least 0"},
                                         {"hot_pixels = 1.5", "must be a whole number"},
                                         {"rolling_shutter_ms = -1", "at least 0"},
                                         {"auto_exposure = 2", "at most 1"},
                                         {"clock_drift_ppm = 1e6", "at most 100000"},
                                         {"eye = \"middle\"", "use one of: both, left, right"},
                                         {"glasses_leak = -0.1", "at least 0"}})
    EXPECT_THAT(complaint(kSmallest + "[simulation]\n[[simulation.camera]]\nid = \"c\"\n" + l.line + "\n"),
                AllOf(StartsWith("rig.toml:9: "), HasSubstr(l.says)));
  for (const Line& l : std::vector<Line>{{"distortion = [0.1]", "must be 5 numbers"},
                                         {"response_r = [0, 1.2]", "at most 1"},
                                         {"colour_mixing = [1, 0, 0]", "must be 9 numbers"},
                                         {"white_segment = -1", "at least 0"},
                                         {"flare = 1.1", "at most 1"},
                                         {"native_resolution = [-1, 3]", "at least 0"},
                                         {"warm_up = 1", "at most 0.99"},
                                         {"warm_up_s = 0", "at least 1e-06"},
                                         {"colour_wheel_hz = -1", "at least 0"},
                                         {"pwm_hz = -1", "at least 0"},
                                         {"refresh_hz = 0", "at least 1"},
                                         {"latency_ms = -1", "at least 0"},
                                         {"latency_jitter_ms = -1", "at least 0"},
                                         {"stereo = 1", "must be true or false"}})
    EXPECT_THAT(complaint(kSmallest + "[simulation]\n[[simulation.projector]]\nid = \"p\"\n" + l.line + "\n"),
                AllOf(StartsWith("rig.toml:9: "), HasSubstr(l.says)));
}

TEST(RigError, ValuesThatContradictEachOtherAreNamed) {
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\npedestal = 200\nfull_scale = 100\n"),
              AllOf(HasSubstr("[[camera]] 'c'"), HasSubstr("pedestal = 200 must be less than full_scale = 100")));
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\nexposures_ms = [8, 4, 8]\n"), HasSubstr("exposures_ms names 8 twice"));
  EXPECT_THAT(complaint(kSmallest + "[screen]\nknown_length = { pixel_a = [1, 2], pixel_b = [1, 2], metres = 1 }\n"),
              HasSubstr("same pixel"));
  EXPECT_THAT(complaint(kSmallest + "[simulation]\n[[simulation.projector]]\nid = \"p\"\nposition = [0, 0, 1]\n"),
              HasSubstr("position and target are the same"));
  const std::string projector = kSmallest + "[simulation]\n[[simulation.projector]]\nid = \"p\"\n";
  EXPECT_THAT(complaint(projector + "response_g = [0.5]\n"), HasSubstr("response_g = [0.5] is one value; give"));
  EXPECT_THAT(complaint(projector + "response_b = [0, 0.6, 0.5]\n"),
              HasSubstr("response_b falls from 0.6 to 0.5 at its value 3"));
  EXPECT_THAT(complaint(projector + "native_resolution = [0, 768]\n"), HasSubstr("has one side of 0"));
  EXPECT_THAT(
      complaint(kSmallest + "[simulation]\n[[simulation.camera]]\nid = \"c\"\nchannels = 1\nbayer = \"RGGB\"\n"),
      HasSubstr("bayer = \"RGGB\" needs channels = 3, not 1"));
}

TEST(RigError, WhatIsNotBuiltYetIsUnsupportedAndNamesWhatIsThere) {
  const auto unsupported = [](const std::string& text) { return complaint(text, ErrorCode::kUnsupported); };
  for (const std::string kind : {"cylinder", "dome", "mesh"})
    EXPECT_THAT(unsupported(kSmallest + "[screen]\nkind = \"" + kind + "\"\n"),
                HasSubstr("available: measured, planes"));
  EXPECT_THAT(unsupported(kSmallest + "[intent]\ntarget = \"uniform\"\n"), HasSubstr("available: direct"));
  EXPECT_THAT(unsupported("[[camera]]\nid = \"c\"\nresponse = \"measured\"\n"),
              HasSubstr("state linear, srgb or gamma:G"));
  EXPECT_THAT(unsupported("format_version = 2\n" + kSmallest),
              StartsWith("rig.toml:1: format_version = 2 is newer than 1"));
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\nbackend = \"fodler\"\n"), HasSubstr("the nearest is 'folder'"));
}

TEST(RigError, WhatIsNotTomlNamesTheLine) {
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\nresolution [1, 2]\n"), StartsWith("rig.toml:3: not TOML: "));
  EXPECT_THAT(complaint("[[camera]]\nid = \"c\"\nid = \"d\"\n"), HasSubstr("not TOML: "));
  EXPECT_THAT(complaint("id = \"c"), HasSubstr("not TOML: "));
  TemporaryFolder folder;
  const auto missing = read_rig(folder / "rig.toml");
  EXPECT_EQ(missing.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(missing.error().message, HasSubstr("rig.toml' is missing"));
}

TEST(RigError, MissingSimulationIsNamed) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "rig.toml", kSmallest));
  EXPECT_FALSE(has_simulation(folder / "rig.toml").value());
  const auto simulation = read_simulation(folder / "rig.toml");
  ASSERT_FALSE(simulation);
  EXPECT_THAT(simulation.error().message, HasSubstr("has no table [simulation]"));
}

}  // namespace
}  // namespace countershade

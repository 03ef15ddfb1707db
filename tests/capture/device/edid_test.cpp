#include "capture/device/edid.h"

#include <gtest/gtest.h>

#include <fstream>
#include <string>
#include <vector>

#include "tests/support/cli.h"

namespace countershade::capture {
namespace {

using Bytes = std::vector<std::uint8_t>;

void seal(Bytes& b) {
  unsigned sum = 0;
  for (int i = 0; i < 127; ++i) sum += b[i];
  b[127] = static_cast<std::uint8_t>(256 - sum % 256);
}

void describe(Bytes& b, int place, std::uint8_t kind, const std::string& text) {
  std::fill_n(b.begin() + 54 + 18 * place, 18, std::uint8_t{0});
  b[54 + 18 * place + 3] = kind;
  for (std::size_t i = 0; i < 13; ++i)
    b[54 + 18 * place + 5 + i] = i < text.size() ? text[i] : i == text.size() ? '\n' : ' ';
}

// EPS: E = 5, P = 16, S = 19.
Bytes projector() {
  Bytes b(128, 0);
  std::fill_n(b.begin() + 1, 6, std::uint8_t{0xff});
  const unsigned letters = 5 << 10 | 16 << 5 | 19;
  b[8] = letters >> 8, b[9] = letters & 255, b[10] = 0x34, b[11] = 0x12;
  b[54] = 1, b[55] = 0x1d;  // a mode
  describe(b, 1, 0xfc, "EB-L1755U");
  describe(b, 3, 0xff, "X4KJ930");
  seal(b);
  return b;
}

TEST(Edid, TellsMakerModelAndSerial) {
  EXPECT_EQ(parse_edid(projector())->name(), "EPS EB-L1755U X4KJ930");
  Bytes numbers = projector();
  describe(numbers, 1, 0x10, ""), describe(numbers, 3, 0x10, "");
  seal(numbers);
  EXPECT_EQ(parse_edid(numbers)->name(), "EPS 1234");
  numbers[12] = 1, numbers[13] = 2, numbers[15] = 0x80;
  seal(numbers);
  EXPECT_EQ(parse_edid(numbers)->serial, "2147484161");
  Bytes full = projector();  // 13 characters have no end, and an extension may follow
  describe(full, 1, 0xfc, " EB-L1755U-XYZ");
  seal(full);
  full.resize(256, 7);
  EXPECT_EQ(parse_edid(full)->model, "EB-L1755U-XY");
}

TEST(Edid, WhateverIsNoneIsNone) {
  const Bytes good = projector();
  EXPECT_FALSE(parse_edid({}));
  for (std::size_t size = 0; size < 128; ++size) EXPECT_FALSE(parse_edid(std::span(good).first(size))) << size;
  for (std::size_t i = 0; i < 128; ++i)
    for (const int change : {1, 128}) {
      Bytes bad = good;
      bad[i] = static_cast<std::uint8_t>(bad[i] + change);
      EXPECT_FALSE(parse_edid(bad)) << i;
    }
  Bytes noise = good;  // letters beyond Z, control characters in texts
  noise[8] = 0x7f, noise[9] = 0xff,
  describe(noise, 1, 0xfc,
           "A\x01"
           "B\x1b[2J");
  seal(noise);
  EXPECT_EQ(parse_edid(noise)->maker, "???");
  EXPECT_EQ(parse_edid(noise)->model, "AB[2J");
}

TEST(Edid, IsFoundByTheOutputsNameUnlessTwoCardsHaveIt) {
  const countershade::testing::TemporaryFolder drm;
  const auto plug = [&](const std::string& connector, const Bytes& edid) {
    std::filesystem::create_directories(drm / connector);
    std::ofstream(drm / (connector + "/edid"), std::ios::binary)
        .write(reinterpret_cast<const char*>(edid.data()), static_cast<std::streamsize>(edid.size()));
  };
  plug("card0-HDMI-A-1", projector()), plug("card0-DP-1", {}), plug("card0-eDP-1", Bytes(128, 3));
  std::filesystem::create_directories(drm / "card0-VGA-1");
  for (const char* output : {"HDMI-1", "HDMI-A-1"})
    EXPECT_EQ(name_on_output(output, drm.path()), "EPS EB-L1755U X4KJ930") << output;
  for (const char* output : {"DP-1", "eDP-1", "VGA-1", "HDMI-2", "A-1", "1", ""})
    EXPECT_EQ(name_on_output(output, drm.path()), "") << output;
  plug("card1-HDMI-A-1", projector());
  EXPECT_EQ(name_on_output("HDMI-1", drm.path()), "") << "which card?";
  EXPECT_EQ(name_on_output("HDMI-1", drm / "nowhere"), "");
}

}  // namespace
}  // namespace countershade::capture

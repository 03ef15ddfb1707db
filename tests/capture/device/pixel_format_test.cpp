#include "capture/device/pixel_format.h"

#include <gmock/gmock.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "calib/base/random.h"

namespace countershade::capture {
namespace {

using ::testing::HasSubstr;

PixelFormat named(const std::string& name) {
  return *best_format({name});
}

// Values of `bits` bits, as a sensor would give them.
std::vector<std::uint32_t> some_values(int bits, std::size_t count) {
  Random random(hash_name("pixel format") + bits);
  std::vector<std::uint32_t> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(static_cast<std::uint32_t>(random.uniform() * (1u << bits)));
  values[0] = 0, values[1] = (1u << bits) - 1;
  return values;
}

// Packs bit by bit, as the convention describes it in words.
std::vector<std::byte> packed(const PixelFormat& format, const std::vector<std::uint32_t>& values) {
  std::vector<unsigned> bytes;
  if (format.packing == Packing::kBits) {
    bytes.resize((values.size() * format.bits + 7) / 8);
    for (std::size_t i = 0; i < values.size(); ++i)
      for (int b = 0; b < format.bits; ++b)
        if (values[i] >> b & 1) bytes[(i * format.bits + b) / 8] |= 1u << (i * format.bits + b) % 8;
  } else if (format.packing == Packing::kOldPacked) {
    const int low = format.bits - 8;
    const unsigned mask = (1u << low) - 1;
    for (std::size_t i = 0; i < values.size(); i += 2) {
      const std::uint32_t a = values[i], b = i + 1 < values.size() ? values[i + 1] : 0;
      bytes.push_back(a >> low), bytes.push_back((a & mask) | (b & mask) << 4), bytes.push_back(b >> low);
    }
  } else {
    for (const std::uint32_t v : values) {
      bytes.push_back(v & 255);
      if (format.packing == Packing::kWords) bytes.push_back(v >> 8);
    }
  }
  std::vector<std::byte> result;
  for (const unsigned b : bytes) result.push_back(static_cast<std::byte>(b));
  return result;
}

TEST(PixelFormat, EveryGreyOneIsReadBack) {
  for (const PixelFormat& f : pixel_formats()) {
    if (!f.colours.empty()) continue;
    const auto values = some_values(f.bits, 7 * 5);  // an odd number: the last pair is half empty
    const auto bytes = packed(f, values);
    EXPECT_EQ(bytes.size(), f.bytes(7, 5)) << f.name;
    const auto image = unpack(f, bytes, 7, 5);
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(f.full_scale(), (1 << f.bits) - 1);
    for (std::size_t i = 0; i < values.size(); ++i) EXPECT_EQ(image->data()[i], values[i]) << f.name << " " << i;
  }
}

TEST(PixelFormat, AMosaicHasItsColoursWhereItsNameSays) {
  for (const char* name : {"BayerRG8", "BayerGR12", "BayerGB16", "BayerBG10"}) {
    const PixelFormat f = named(name);
    const auto full = static_cast<std::uint32_t>(f.full_scale());
    for (const char colour : {'R', 'G', 'B'}) {
      std::vector<std::uint32_t> values;  // light of one colour alone
      for (int y = 0; y < 6; ++y)
        for (int x = 0; x < 8; ++x) values.push_back(f.colours[(y % 2) * 2 + x % 2] == colour ? full : 0);
      const auto image = unpack(f, packed(f, values), 8, 6);
      ASSERT_TRUE(image) << image.error().message;
      ASSERT_EQ(image->channels(), 3);
      for (int c = 0; c < 3; ++c) EXPECT_EQ(image->at(3, 3, c), "RGB"[c] == colour ? full : 0) << name << colour << c;
    }
    EXPECT_EQ(f.name.substr(5, 2), f.colours.substr(0, 2));
  }
}

TEST(PixelFormat, ColourHasThreeBytesPerPixel) {
  const PixelFormat f = named("RGB8");
  const auto image = unpack(f, packed(f, {1, 2, 3, 4, 5, 6}), 2, 1);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->at(1, 0, 0), 4);
  EXPECT_EQ(image->at(1, 0, 2), 6);
}

TEST(PixelFormat, BlueMayComeFirst) {
  const PixelFormat f = named("BGR8");
  const auto image = unpack(f, packed(f, {1, 2, 3, 4, 5, 6}), 2, 1);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->at(0, 0, 0), 3);
  EXPECT_EQ(image->at(1, 0, 1), 5);
  EXPECT_EQ(image->at(1, 0, 2), 4);
}

// Against OpenCV's conversion, to a value; grey from 16 to 235 is black to white.
TEST(PixelFormat, WebcamsShareTheColourOfTwoPixels) {
  const PixelFormat f = named("YUYV");
  cv::Mat yuyv(4, 6, CV_8UC2);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 6; ++x)
      yuyv.at<cv::Vec2b>(y, x) = cv::Vec2b(static_cast<std::uint8_t>(16 + 40 * x + 3 * y),
                                           static_cast<std::uint8_t>(x % 2 ? 150 - 9 * y : 100 + 11 * x));
  const auto image = unpack(f, {reinterpret_cast<const std::byte*>(yuyv.data), 48}, 6, 4);
  ASSERT_TRUE(image) << image.error().message;
  cv::Mat rgb;
  cv::cvtColor(yuyv, rgb, cv::COLOR_YUV2RGB_YUYV);
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 6; ++x)
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(image->at(x, y, c), rgb.at<cv::Vec3b>(y, x)[c], 1.01) << x << y << c;
  const std::byte grey[] = {std::byte{16}, std::byte{128}, std::byte{235}, std::byte{128}};
  const auto two = unpack(f, grey, 2, 1);
  ASSERT_TRUE(two);
  EXPECT_EQ(two->at(0, 0, 1), 0);
  EXPECT_EQ(two->at(1, 0, 1), 255);
}

TEST(PixelFormat, AJpegFileIsReadOrSaysWhatItIs) {
  const PixelFormat f = named("JPEG");
  cv::Mat bgr(16, 24, CV_8UC3, cv::Scalar(20, 90, 200));
  std::vector<std::uint8_t> file;
  cv::imencode(".jpg", bgr, file, {cv::IMWRITE_JPEG_QUALITY, 100});
  const std::span bytes(reinterpret_cast<const std::byte*>(file.data()), file.size());
  const auto image = unpack(f, bytes, 24, 16);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_NEAR(image->at(5, 7, 0), 200, 3);
  EXPECT_NEAR(image->at(5, 7, 2), 20, 3);
  EXPECT_THAT(unpack(f, bytes, 16, 16).error().message, HasSubstr("one of 24 x 16"));
  EXPECT_THAT(unpack(f, bytes.first(9), 24, 16).error().message, HasSubstr("9 bytes came that are none"));
  EXPECT_FALSE(unpack(f, {}, 24, 16));
}

TEST(PixelFormat, TheBestForMeasuringIsTakenFirst) {
  EXPECT_EQ(best_format({"Mono8", "Mono12Packed", "Mono12", "BayerRG16"})->name, "Mono12");
  EXPECT_EQ(best_format({"RGB8", "BayerBG8", "BayerBG12"})->name, "BayerBG12");
  EXPECT_EQ(best_format({"JPEG", "YUYV"})->name, "YUYV");
  EXPECT_EQ(best_format({"JPEG", "YUYV", "BGR8", "BayerBG8", "Mono8"})->name, "Mono8");
  EXPECT_EQ(best_format({"YUV422Packed"}), std::nullopt);
  std::set<std::uint32_t> codes;
  std::size_t of_genicam = 0;
  for (const PixelFormat& f : pixel_formats()) {
    if (!f.faithful()) continue;
    ++of_genicam;
    codes.insert(f.code);
    EXPECT_EQ(pixel_format(f.code)->name, f.name);
    // Bits per pixel as it travels stand in the code.
    const int travelling = f.packing == Packing::kBytes   ? f.colours.size() == 3 ? 24 : 8
                           : f.packing == Packing::kWords ? 16
                           : f.packing == Packing::kBits  ? f.bits
                                                          : 12;
    EXPECT_EQ((f.code >> 16) & 0xff, static_cast<unsigned>(travelling)) << f.name;
  }
  EXPECT_EQ(codes.size(), of_genicam);
  EXPECT_EQ(pixel_format(0), std::nullopt) << "what webcams send has no code";
}

TEST(PixelFormat, RowsThatLieApartAreReadWithoutWhatIsBetween) {
  const std::vector<std::byte> bytes = {std::byte{1}, std::byte{2}, std::byte{99}, std::byte{3}, std::byte{4}};
  const auto image = unpack(named("Mono8"), bytes, 2, 2, 3);  // the last row needs no end
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_THAT(image->data(), ::testing::ElementsAre(1, 2, 3, 4));
  const auto short_one = unpack(named("Mono8"), std::span(bytes).first(4), 2, 2, 3);
  ASSERT_FALSE(short_one);
  EXPECT_THAT(short_one.error().message, HasSubstr("2 bytes, 3 apart, came with 4 bytes"));
}

TEST(PixelFormat, TooFewBytesAreNamed) {
  for (const PixelFormat& f : pixel_formats()) {
    if (f.packing == Packing::kJpeg) continue;
    const std::vector<std::byte> bytes(f.bytes(9, 4) - 1);
    const auto image = unpack(f, bytes, 9, 4);
    ASSERT_FALSE(image) << f.name;
    EXPECT_THAT(image.error().message, HasSubstr(fmt::format("has {} bytes, {} came", f.bytes(9, 4), bytes.size())));
  }
  EXPECT_FALSE(unpack(named("Mono8"), {}, 0, 4));
  EXPECT_FALSE(unpack(named("Mono8"), {}, -1, 4));
}

}  // namespace
}  // namespace countershade::capture

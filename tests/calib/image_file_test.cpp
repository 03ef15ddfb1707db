#include "calib/image/image_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/imgcodecs.hpp>

#include "calib/base/random.h"
#include "calib/file/file.h"
#include "tests/support/cli.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::TemporaryFolder;

// Whole numbers in 0..65535, all channels and pixels different.
Image numbers(int width, int height, int channels) {
  Image image(width, height, channels);
  for (std::size_t i = 0; i < image.data().size(); ++i) image.data()[i] = static_cast<float>((i * 40503 + 17) % 65536);
  return image;
}

Picture picture_of(const Image& image) {
  Picture picture(image.width(), image.height(), image.channels());
  for (std::size_t i = 0; i < image.data().size(); ++i) picture.data()[i] = static_cast<std::uint16_t>(image.data()[i]);
  return picture;
}

template <class T>
void expect_bad_file(const Result<T>& result, const std::string& name) {
  ASSERT_FALSE(result) << name;
  EXPECT_EQ(result.error().code, ErrorCode::kBadFile) << name;
  EXPECT_THAT(result.error().message, HasSubstr(name));
}

TEST(WriteStored16, ComesBackNumberByNumber) {
  TemporaryFolder folder;
  for (const char* name : {"a.png", "a.tif", "A.TIFF", "A.PNG"})
    for (int channels : {1, 3}) {
      const Image image = numbers(37, 23, channels);
      ASSERT_TRUE(write_stored16(folder / name, image));
      const auto back = read_image(folder / name);
      ASSERT_TRUE(back) << back.error().message;
      EXPECT_EQ(back->values.data(), image.data()) << name;
      EXPECT_EQ(back->values.channels(), channels);
      EXPECT_TRUE(back->values.same_size(37, 23));
      EXPECT_EQ(back->bits, 16);
      EXPECT_EQ(back->full_scale, 65535);
    }
}

TEST(WriteStored16, PutsRedWhereOthersLookForIt) {
  TemporaryFolder folder;
  Image image(2, 1, 3);
  image.data() = {1000, 2000, 3000, 4, 5, 6};
  for (const char* name : {"a.png", "a.tif"}) {
    ASSERT_TRUE(write_stored16(folder / name, image));
    const cv::Mat seen = cv::imread((folder / name).string(), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(seen.type(), CV_16UC3);
    EXPECT_EQ(seen.at<cv::Vec3w>(0, 0), cv::Vec3w(3000, 2000, 1000)) << "OpenCV has blue first";
  }
}

TEST(WriteStored16, RoundsAndClamps) {
  TemporaryFolder folder;
  Image image(7, 1, 1);
  image.data() = {-3, 0.4f, 0.6f, 65534.6f, 1e9f, std::nanf(""), 1234.4f};
  ASSERT_TRUE(write_stored16(folder / "a.tif", image));
  EXPECT_EQ(read_image(folder / "a.tif")->values.data(), (std::vector<float>{0, 0, 1, 65535, 65535, 0, 1234}));
}

TEST(WriteStored16, RefusesOtherFormatsAndFoldersThatAreNotThere) {
  TemporaryFolder folder;
  const auto jpeg = write_stored16(folder / "a.jpg", numbers(4, 4, 1));
  ASSERT_FALSE(jpeg);
  EXPECT_EQ(jpeg.error().code, ErrorCode::kBadValue);
  EXPECT_THAT(jpeg.error().message, AllOf(HasSubstr("a.jpg"), HasSubstr(".tif")));
  const auto nowhere = write_stored16(folder / "no" / "a.tif", numbers(4, 4, 1));
  ASSERT_FALSE(nowhere);
  EXPECT_EQ(nowhere.error().code, ErrorCode::kIo);
  EXPECT_THROW((void)write_stored16(folder / "a.tif", numbers(4, 4, 2)), Bug);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(WritePng8, RoundsAndClamps) {
  TemporaryFolder folder;
  Image image(2, 1, 3);
  image.data() = {-1, 0.6f, 254.4f, 300, 7, std::nanf("")};
  ASSERT_TRUE(write_png8(folder / "a.png", image));
  const auto back = read_image(folder / "a.png");
  ASSERT_TRUE(back);
  EXPECT_EQ(back->values.data(), (std::vector<float>{0, 1, 254, 255, 7, 0}));
  EXPECT_EQ(back->full_scale, 255);
  EXPECT_EQ(back->bits, 8);
}

TEST(Picture, With16BitsComesBackNumberByNumber) {
  TemporaryFolder folder;
  const Picture picture = picture_of(numbers(31, 17, 3));
  ASSERT_TRUE(write_picture(folder / "a.png", picture, 16));
  EXPECT_EQ(read_picture(folder / "a.png")->data(), picture.data());
}

TEST(Picture, With8BitsIsTheNearestOf256Levels) {
  TemporaryFolder folder;
  Picture picture(256, 256, 3);  // every value in every channel
  for (int i = 0; i < 65536; ++i)
    for (int c = 0; c < 3; ++c) picture.data()[3 * i + c] = static_cast<std::uint16_t>(i + c * 1000);
  ASSERT_TRUE(write_picture(folder / "a.png", picture, 8));
  const auto stored = read_image(folder / "a.png");
  ASSERT_TRUE(stored);
  ASSERT_EQ(stored->bits, 8);
  for (std::size_t i = 0; i < picture.data().size(); ++i)
    ASSERT_EQ(stored->values.data()[i], std::round(picture.data()[i] / 257.0)) << picture.data()[i];
  // Widened again it is the full range, and writing that again changes nothing.
  const auto back = read_picture(folder / "a.png");
  ASSERT_TRUE(back);
  for (std::size_t i = 0; i < picture.data().size(); ++i)
    ASSERT_EQ(back->data()[i], 257 * static_cast<int>(stored->values.data()[i]));
  ASSERT_TRUE(write_picture(folder / "b.png", *back, 8));
  EXPECT_EQ(read_picture(folder / "b.png")->data(), back->data());
}

TEST(Picture, GreyBecomesRgb) {
  TemporaryFolder folder;
  ASSERT_TRUE(cv::imwrite((folder / "a.png").string(), cv::Mat((cv::Mat_<std::uint8_t>(1, 2) << 3, 255))));
  const auto picture = read_picture(folder / "a.png");
  ASSERT_TRUE(picture);
  EXPECT_EQ(picture->data(), (std::vector<std::uint16_t>{771, 771, 771, 65535, 65535, 65535}));
}

TEST(Picture, TransparencyIsDropped) {
  TemporaryFolder folder;
  const cv::Mat bgra(1, 1, CV_8UC4, cv::Scalar(1, 2, 3, 100));
  ASSERT_TRUE(cv::imwrite((folder / "a.png").string(), bgra));
  EXPECT_EQ(read_image(folder / "a.png")->values.data(), (std::vector<float>{3, 2, 1}));
}

TEST(Picture, RefusesFloats) {
  TemporaryFolder folder;
  const Image grey(4, 3, 1, 0.5f);
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"Y", &grey}}));
  expect_bad_file(read_picture(folder / "a.exr"), "a.exr");
}

TEST(ReadImage, RefusesFilesCutAnywhere) {
  TemporaryFolder folder;
  const Image grey = numbers(50, 40, 1), rgb = numbers(50, 40, 3);
  ASSERT_TRUE(write_stored16(folder / "grey.png", grey));
  ASSERT_TRUE(write_stored16(folder / "rgb.png", rgb));
  ASSERT_TRUE(write_stored16(folder / "rgb.tif", rgb));
  ASSERT_TRUE(write_png8(folder / "eight.png", rgb));
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"B", &grey}, {"G", &grey}, {"R", &grey}}));
  ASSERT_TRUE(cv::imwrite((folder / "a.jpg").string(), cv::Mat(40, 50, CV_8UC3, cv::Scalar(9, 80, 200))));
  cv::Mat eight(40, 50, CV_8UC3, cv::Scalar(9, 80, 200));
  ASSERT_TRUE(cv::imwrite((folder / "eight.tif").string(), eight, {cv::IMWRITE_TIFF_COMPRESSION, 1}));
  for (const char* name : {"grey.png", "rgb.png", "rgb.tif", "eight.png", "eight.tif", "a.exr", "a.jpg"}) {
    ASSERT_TRUE(read_image(folder / name)) << name;
    const std::string bytes = read_text(folder / name).value(),
                      cut = fmt::format("cut{}", (folder / name).extension().string());
    for (const std::size_t length : {std::size_t{0}, std::size_t{1}, std::size_t{9}, bytes.size() / 9, bytes.size() / 2,
                                     bytes.size() * 8 / 9, bytes.size() - 1}) {
      ASSERT_TRUE(write_atomically(folder / cut, std::string_view(bytes).substr(0, length)));
      SCOPED_TRACE(std::string(name) + " cut to " + std::to_string(length) + " of " + std::to_string(bytes.size()));
      expect_bad_file(read_image(folder / cut), cut);
    }
  }
}

// An uncompressed 8-bit grey TIFF whose directory comes first, as some cameras' software writes it: 8 rows of 8 strips.
std::string tiff_with_directory_in_front() {
  std::string bytes("II*\0\x08\0\0\0", 8);
  const auto put = [&](std::uint32_t n, int count) {
    for (int i = 0; i < count; ++i) bytes.push_back(static_cast<char>(n >> 8 * i & 255));
  };
  const std::uint32_t strips = 8, data = 8 + 2 + 9 * 12 + 4, pixels = data + 2 * 4 * strips;
  put(9, 2);
  const std::uint32_t fields[9][4] = {{256, 3, 1, 100}, {257, 3, 1, 8}, {258, 3, 1, 8},
                                      {259, 3, 1, 1},   {262, 3, 1, 1}, {273, 4, strips, data},
                                      {277, 3, 1, 1},   {278, 3, 1, 1}, {279, 4, strips, data + 4 * strips}};
  for (const auto& f : fields) put(f[0], 2), put(f[1], 2), put(f[2], 4), put(f[3], 4);
  put(0, 4);
  for (std::uint32_t i = 0; i < strips; ++i) put(pixels + 100 * i, 4);
  for (std::uint32_t i = 0; i < strips; ++i) put(100, 4);
  for (int i = 0; i < 800; ++i) bytes.push_back(static_cast<char>(1 + i % 251));
  return bytes;
}

TEST(ReadImage, RefusesATiffThatEndsWithinItsPixels) {
  TemporaryFolder folder;
  const std::string bytes = tiff_with_directory_in_front();
  ASSERT_TRUE(write_atomically(folder / "whole.tif", bytes));
  const auto whole = read_image(folder / "whole.tif");
  ASSERT_TRUE(whole) << whole.error().message;
  EXPECT_EQ(whole->values.at(99, 7), 1 + 799 % 251);
  for (std::size_t missing : {1, 99, 101, 700}) {
    ASSERT_TRUE(write_atomically(folder / "cut.tif", std::string_view(bytes).substr(0, bytes.size() - missing)));
    SCOPED_TRACE(missing);
    expect_bad_file(read_image(folder / "cut.tif"), "cut.tif");
  }
}

TEST(ReadImage, RefusesWhatIsNoImage) {
  TemporaryFolder folder;
  for (const char* name : {"missing.png", "missing.tif", "missing.exr"})
    expect_bad_file(read_image(folder / name), name);
  fs::create_directory(folder / "folder.png");
  expect_bad_file(read_image(folder / "folder.png"), "folder.png");
  for (const char* name : {"text.png", "text.tif", "text.exr", "text.jpg", "text.bmp", "text"}) {
    ASSERT_TRUE(
        write_atomically(folder / name, "This is a sentence and not an image, whatever its name says. \xff\xd9"));
    expect_bad_file(read_image(folder / name), name);
  }
}

TEST(ReadImage, NoticesAChangedByteInAPng) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_stored16(folder / "a.png", numbers(50, 40, 3)));
  std::string bytes = read_text(folder / "a.png").value();
  bytes[bytes.size() / 2] ^= 0x20;
  ASSERT_TRUE(write_atomically(folder / "a.png", bytes));
  expect_bad_file(read_image(folder / "a.png"), "a.png");
}

TEST(Exr, ChannelsComeBackBitByBitInTheOrderAskedFor) {
  TemporaryFolder folder;
  Image a(13, 7, 1), b(13, 7, 1);
  for (std::size_t i = 0; i < a.data().size(); ++i)
    a.data()[i] = std::sin(0.1f + i) * 1e-6f, b.data()[i] = 1e7f / (1 + i);
  a.data()[5] = -0.0f;
  b.data()[6] = -std::numeric_limits<float>::infinity();
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"sigma", &a}, {"q.x", &b}}));
  const auto back = read_exr(folder / "a.exr", {"q.x", "sigma"});
  ASSERT_TRUE(back) << back.error().message;
  ASSERT_EQ(back->size(), 2);
  EXPECT_EQ((*back)[0].data(), b.data());
  EXPECT_EQ((*back)[1].data(), a.data());
  EXPECT_TRUE(std::signbit((*back)[1].data()[5]));
}

TEST(Exr, MissingChannelIsNamed) {
  TemporaryFolder folder;
  const Image a(3, 2, 1, 0.25f);
  ASSERT_TRUE(write_exr(folder / "a.exr", {{"x", &a}}));
  const auto result = read_exr(folder / "a.exr", {"x", "sigma"});
  expect_bad_file(result, "a.exr");
  EXPECT_THAT(result.error().message, HasSubstr("'sigma'"));
}

TEST(Exr, IsAnImageByRgbThenYThenItsOnlyChannel) {
  TemporaryFolder folder;
  const Image r(3, 2, 1, 1), g(3, 2, 1, 2), b(3, 2, 1, 3), y(3, 2, 1, 4);
  ASSERT_TRUE(write_exr(folder / "rgb.exr", {{"B", &b}, {"G", &g}, {"R", &r}, {"Y", &y}}));
  ASSERT_TRUE(write_exr(folder / "y.exr", {{"A", &g}, {"Y", &y}}));
  ASSERT_TRUE(write_exr(folder / "one.exr", {{"depth", &b}}));
  const auto rgb = read_image(folder / "rgb.exr"), grey = read_image(folder / "y.exr"),
             one = read_image(folder / "one.exr");
  ASSERT_TRUE(rgb && grey && one);
  ASSERT_EQ(rgb->values.channels(), 3);
  for (int c = 0; c < 3; ++c) EXPECT_EQ(rgb->values.at(2, 1, c), c + 1);
  EXPECT_EQ(grey->values.at(1, 1), 4);
  EXPECT_EQ(one->values.at(1, 1), 3);
  EXPECT_EQ(rgb->full_scale, 1);
  EXPECT_EQ(rgb->bits, 32);
}

TEST(Exr, ChannelsOfTwoSizesAreABug) {
  TemporaryFolder folder;
  const Image a(3, 2, 1), b(2, 3, 1);
  EXPECT_THROW((void)write_exr(folder / "a.exr", {{"a", &a}, {"b", &b}}), Bug);
  EXPECT_THROW((void)write_exr(folder / "a.exr", {}), Bug);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

}  // namespace
}  // namespace countershade

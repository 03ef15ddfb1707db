#include "capture/session/identify.h"

#include <gmock/gmock.h>

#include "calib/base/random.h"
#include "calib/image/image_file.h"
#include "capture/pattern/identity.h"
#include "capture/pattern/pattern.h"
#include "tests/support/cli.h"

namespace countershade::capture {
namespace {

namespace fs = std::filesystem;
using countershade::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(NaturalOrder, NumbersCountByTheirValue) {
  const std::vector<std::string> ordered = {"IMG_9.png",
                                            "IMG_10.png",
                                            "IMG_010b.png",
                                            "IMG_100.png",
                                            "IMG_100_2.png",
                                            "IMG_100_11.png",
                                            "a",
                                            "a1",
                                            "a1b",
                                            "b99999999999999999999998",
                                            "b99999999999999999999999"};
  for (std::size_t i = 0; i < ordered.size(); ++i)
    for (std::size_t j = 0; j < ordered.size(); ++j)
      EXPECT_EQ(natural_less(ordered[i], ordered[j]), i < j) << ordered[i] << ' ' << ordered[j];
  EXPECT_NE(natural_less("a01", "a1"), natural_less("a1", "a01")) << "an order, whichever";
}

// A camera that sees a projector's picture as it is, in half its size.
class Album {
 public:
  Album() {
    sequence_.projectors = {{"left", {480, 320}}};
    for (int i = 0; i < 6; ++i) {
      Role role;
      role.kind = "gray", role.axis = i % 2 ? "x" : "y", role.bit = 3 + i;
      sequence_.frames.push_back({i, role});
    }
    sequence_.identity = identity_marks(sequence_, {.inset = 0, .side_px = 72}).value();
    camera_.id = "cam";
  }

  // share of `other`'s light in the marks above `row`; all of them unless given.
  void add(int position, int other = 0, double share = 0, double share_below = -1, int covered = 0) {
    const Image a = light(position), b = light(other);
    Image photo = a;
    Random random(hash_name("album") + photos_.size());
    for (int y = 0; y < photo.height(); ++y)
      for (int x = 0; x < photo.width(); ++x) {
        const double s = y < photo.height() / 2 || share_below < 0 ? share : share_below;
        const bool dark = x < covered && y < covered;  // somebody stands there
        const double v = dark ? 0.02 : (1 - s) * a.at(x, y) + s * b.at(x, y);
        photo.at(x, y) = static_cast<float>(60000 * v + 200 * random.normal());
      }
    photos_.push_back(folder_ / fmt::format("IMG_{}.png", photos_.size()));
    ASSERT_TRUE(write_stored16(photos_.back(), photo));
  }
  Result<Identified> identified() const {
    SilentProgress silent;
    return identify_photos(sequence_, photos_, camera_, silent);
  }
  // Number of the photo that is taken for each frame; -1: none.
  std::vector<int> chosen() const {
    std::vector<int> numbers;
    const Identified found = identified().value();
    for (const fs::path& path : found.photos)
      numbers.push_back(
          path.empty() ? -1 : static_cast<int>(std::find(photos_.begin(), photos_.end(), path) - photos_.begin()));
    return numbers;
  }
  Sequence sequence_;

 private:
  Image light(int position) const {
    Picture picture = render_role(sequence_.frames[position].role, "left", 480, 320).value();
    draw_identity(sequence_, 0, position, picture);
    Image half(240, 160, 1);
    for (int y = 0; y < 160; ++y)
      for (int x = 0; x < 240; ++x)
        half.at(x, y) =
            static_cast<float>((picture.at(2 * x, 2 * y) / 65535. + picture.at(2 * x + 1, 2 * y + 1) / 65535.) / 2);
    return half;
  }
  TemporaryFolder folder_;
  CameraSpec camera_;
  std::vector<fs::path> photos_;
};

TEST(Identify, TakesTheMiddleOfTheLongestRunWhateverComesFirst) {
  Album album;
  for (const int position : {4, 4, 4, 5, 0, 0, 1, 2, 2, 2, 2, 2, 3, 4, 5, 5, 5, 0}) album.add(position);
  EXPECT_EQ(album.chosen(), (std::vector<int>{5, 6, 9, 12, 1, 15}));
}

TEST(Identify, APhotoOfTwoFramesIsOfNone) {
  Album album;
  album.add(0), album.add(0, 1, 0.3);  // the display has not settled
  album.add(1, 0, 0.25), album.add(1);
  album.add(2, 3, 0, 1), album.add(2);       // half of a rolling shutter
  album.add(3, 2, 0.2);                      // the only one
  album.add(4, 0, 0, -1, 60), album.add(4);  // a mark is covered
  album.add(5);
  EXPECT_EQ(album.chosen(), (std::vector<int>{0, 3, 5, -1, 8, 9}));
  const Identified found = album.identified().value();
  EXPECT_EQ(found.marks, 2);
  EXPECT_EQ(found.mixed, 4);
  EXPECT_EQ(found.unread, 0) << "one mark of a projector is enough";
}

TEST(Identify, TheLeastMixedIsTaken) {
  Album album;
  album.add(0), album.add(1, 0, 0.08), album.add(1, 0, 0.07), album.add(1, 0, 0.08), album.add(1), album.add(2);
  for (const int position : {3, 4, 5}) album.add(position);
  EXPECT_EQ(album.chosen(), (std::vector<int>{0, 4, 5, 6, 7, 8}));
}

TEST(Identify, NoMarkAtAllIsRefused) {
  Album album;
  album.add(2, 0, 0, -1, 1000);
  const auto found = album.identified();
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().code, ErrorCode::kRefused);
  EXPECT_THAT(found.error().message, AllOf(HasSubstr("none of 1 photos"), HasSubstr("'cam'"), HasSubstr("in focus")));
}

}  // namespace
}  // namespace countershade::capture

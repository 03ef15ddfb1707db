#include "capture/pattern/identity.h"

#include <gmock/gmock.h>

#include <opencv2/imgproc.hpp>

#include "calib/base/random.h"
#include "calib/image/image_file.h"
#include "capture/pattern/pattern.h"
#include "tests/support/cli.h"

namespace countershade::capture {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

Role role(const char* kind) {
  Role r;
  r.kind = kind;
  return r;
}

Sequence sequence_of(int frames) {
  Sequence sequence;
  sequence.projectors = {{"left", {640, 400}}};
  for (int i = 0; i < frames; ++i) sequence.frames.push_back({10 * i, role(i % 2 ? "black" : "white")});
  return sequence;
}

// Seen by a camera that looks from the side, with falloff, blur and noise; light.
Image photo_of(const Picture& picture, const cv::Matx33d& to_photo, double added = 0) {
  cv::Mat light(picture.height(), picture.width(), CV_32F);
  for (int y = 0; y < picture.height(); ++y)
    for (int x = 0; x < picture.width(); ++x)
      light.at<float>(y, x) =
          static_cast<float>(picture.at(x, y, 0) / 65535. * (1 - 0.5 * x / picture.width()) + added);
  cv::Mat seen;
  cv::warpPerspective(light, seen, to_photo, {500, 360}, cv::INTER_AREA);
  cv::GaussianBlur(seen, seen, {}, 0.7);
  Random random(hash_name("identity"));
  Image photo(seen.cols, seen.rows, 1);
  for (int y = 0; y < seen.rows; ++y)
    for (int x = 0; x < seen.cols; ++x)
      photo.at(x, y) = static_cast<float>(0.4 * seen.at<float>(y, x) + 0.004 * random.normal());
  return photo;
}
const cv::Matx33d kView(0.62, 0.05, 40, -0.02, 0.7, 35, -1e-4, 5e-5, 1);

Picture marked(const Sequence& sequence, int position, const Role& role) {
  Picture picture = render_role(role, "left", 640, 400).value();
  draw_identity(sequence, 0, position, picture);
  return picture;
}

TEST(Identity, EveryFrameIsReadInWhateverPictureAndLiesWhereItIs) {
  Sequence sequence = sequence_of(2115);
  sequence.identity = identity_marks(sequence, {.inset = 0.03, .side_px = 66}).value();
  std::vector<Role> roles{role("white"), role("black"), role("gray")};
  roles[2].bit = 5;
  for (int position = 0; position < 2115; position += 81) {
    const Image photo = photo_of(marked(sequence, position, roles[position % roles.size()]), kView);
    const auto marks = find_marks(photo, sequence);
    ASSERT_EQ(marks.size(), 2u) << position;
    for (const SeenMark& seen : marks) {
      EXPECT_EQ(seen.position, position);
      const IdentityMark& mark = sequence.identity[seen.centre.x() > 250];
      for (int k = 0; k < 4; ++k) {
        const double x = mark.x - 0.5 + (k == 1 || k == 2 ? mark.side_px : 0),
                     y = mark.y - 0.5 + (k > 1 ? mark.side_px : 0);
        const cv::Vec3d q = kView * cv::Vec3d(x, y, 1);
        EXPECT_LT((seen.outline[k] - Eigen::Vector2d(q[0] / q[2], q[1] / q[2])).norm(), 2.5) << position << ' ' << k;
      }
    }
  }
  EXPECT_TRUE(find_marks(photo_of(marked(sequence, 100, roles[0]), kView), sequence_of(100)).empty())
      << "no frame of so few";
}

// Whatever picture is around it.
TEST(Identity, IsReadFromTwoAndAHalfCameraPixelsAModule) {
  Sequence sequence = sequence_of(500);
  sequence.identity = identity_marks(sequence, {}).value();  // modules of 4 px
  std::vector<Role> roles{role("white"), role("black"), role("gray")};
  roles[2].bit = 4;
  const cv::Matx33d small(0.625, 0.01, 10, -0.01, 0.625, 20, 0, 0, 1);
  for (int position = 0; position < 500; position += 7) {
    const auto marks =
        find_marks(photo_of(marked(sequence, position, roles[position % roles.size()]), small), sequence);
    ASSERT_EQ(marks.size(), 2u) << position;
    EXPECT_TRUE(marks[0].position == position && marks[1].position == position) << position;
  }
}

// A photo across a change, or of a display that has not settled, holds two frames.
TEST(Identity, ShareOfAnotherFrameIsMeasured) {
  Sequence sequence = sequence_of(60);
  sequence.identity = identity_marks(sequence, {.corners = {"top-left"}, .inset = 0, .side_px = 48}).value();
  for (const int position : {0, 11, 42})
    for (const double share : {0., 0.1, 0.25}) {
      const Image own = photo_of(marked(sequence, position, role("white")), kView, 0.1),
                  other = photo_of(marked(sequence, position + 1, role("black")), kView, 0.1);
      Image photo = own;
      for (std::size_t i = 0; i < photo.data().size(); ++i)
        photo.data()[i] = static_cast<float>((1 - share) * own.data()[i] + share * other.data()[i]);
      const auto marks = find_marks(photo, sequence);
      ASSERT_EQ(marks.size(), 1u) << position << ' ' << share;
      EXPECT_EQ(marks[0].position, position);
      EXPECT_NEAR(share_of(position + 1, marks[0], photo, sequence), share, 0.04) << position;
      EXPECT_LT(share_of(position + 2, marks[0], photo, sequence), 0.08 + 0.4 * share)
          << position << ": it is not in it";
      EXPECT_EQ(share_of(position, marks[0], photo, sequence), 0);
    }
}

TEST(Identity, SaysWhichProjectorItIs) {
  Sequence sequence = sequence_of(9);
  sequence.projectors.push_back({"right", {640, 400}});
  sequence.identity = identity_marks(sequence, {}).value();
  ASSERT_EQ(sequence.identity.size(), 4u);
  for (int position = 0; position < 9; ++position)
    for (const int q : {0, 1}) {
      Picture picture(640, 400, 3, 0);
      draw_identity(sequence, q, position, picture);
      const auto marks = find_marks(photo_of(picture, kView), sequence);
      ASSERT_EQ(marks.size(), 2u);
      for (const SeenMark& mark : marks) EXPECT_EQ(std::pair(mark.projector, mark.position), std::pair(q, position));
    }
}

TEST(Identity, WhatCannotBeMarkedIsSaid) {
  const Sequence sequence = sequence_of(4);
  EXPECT_THAT(identity_marks(sequence, {.corners = {"topleft"}}).error().message,
              AllOf(HasSubstr("'topleft'"), HasSubstr("nearest is 'top-left'")));
  EXPECT_THAT(identity_marks(sequence, {.side_px = 20}).error().message,
              AllOf(HasSubstr("20 px"), HasSubstr("22 to 200 px")));
  EXPECT_THAT(identity_marks(sequence, {.side_px = 201}).error().message, HasSubstr("22 to 200 px"));
  EXPECT_THAT(identity_marks(sequence_of(2116), {}).error().message,
              AllOf(HasSubstr("2116 frames"), HasSubstr("2115")));
  EXPECT_THAT(identity_marks(sequence, {.inset = 0.41}).error().message, HasSubstr("inset = 0.41 must be 0 to 0.4"));
  EXPECT_EQ(identity_marks(sequence, {})->at(1), (IdentityMark{"left", 640 - 128 - 44, 400 - 80 - 44, 44}));
  EXPECT_EQ(identity_marks(sequence, {.corners = {"top-left", "top-left"}})->size(), 1u);
}

TEST(Identity, WrittenPicturesAreThePatternsWithTheirMarks) {
  Sequence sequence = sequence_of(3);
  sequence.identity = identity_marks(sequence, {.corners = {"top-right"}}).value();
  const countershade::testing::TemporaryFolder folder;
  ASSERT_TRUE(write_patterns(sequence, folder / "p"));
  const auto read = read_sequence(folder / "p/sequence.json");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->identity, sequence.identity);
  const Picture picture = read_picture(folder / "p/0010/left.png").value();
  EXPECT_EQ(picture.data(), marked(sequence, 1, role("black")).data());
}

}  // namespace
}  // namespace countershade::capture

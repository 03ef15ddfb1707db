// Decoding while photos arrive: neither their order nor how they are stored changes what is read.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "capture/pattern/decode.h"
#include "tests/capture/fake_view.h"

namespace countershade::capture {
namespace {

using fake::test_name;
using fake::View;
using testing::HasSubstr;

// A view that blur, noise, an edge and light by way of other surfaces make hard, and a width that no vector divides.
View hard_view() {
  View view;
  view.width = 133, view.height = 91, view.full_well = 4000, view.blur_px = 0.6;
  view.projector_width = 200, view.projector_height = 150;
  view.map = [](double u, double v) {
    const double jump = u + 0.2 * v > 90 ? 21 : 0;
    return std::pair(6 + 1.1 * u + 0.05 * v + jump, 8 + 1.2 * v + 0.04 * u);
  };
  view.bounce = [](double u, double) { return 0.2 + u / 300; };
  return view;
}

// Rounded to whole numbers of `full`, as floats.
std::map<int, Photo> whole_photos(const View& view, const Sequence& sequence, int full) {
  std::map<int, Photo> photos;
  const PhotoSource source = view.photos(sequence, test_name());
  for (const Frame& frame : sequence.frames) {
    Photo photo = *source(frame.index);
    for (std::size_t i = 0; i < photo.value.pixels(); ++i) {
      float& v = photo.value.data()[i];
      const float stored = std::round(std::clamp(v, 0.0f, 1.0f) * static_cast<float>(full));
      v = stored * static_cast<float>(1.0 / full);
      photo.valid.data()[i] = stored < 0.995 * full;
    }
    photos[frame.index] = std::move(photo);
  }
  return photos;
}

template <class T>
std::shared_ptr<const StoredPhoto> stored_as(const Photo& photo, int full) {
  Raster<T> values(photo.value.width(), photo.value.height(), 1);
  for (std::size_t i = 0; i < values.data().size(); ++i)
    values.data()[i] = static_cast<T>(std::lround(photo.value.data()[i] * static_cast<float>(full)));
  StoredScale scale;
  scale.full_scale = full, scale.saturated_from = 0.995 * full;
  return std::make_shared<const StoredPhoto>(std::move(values), scale);
}

std::shared_ptr<const StoredPhoto> as_light(const Photo& photo) {
  return std::make_shared<const StoredPhoto>(photo);
}

template <class Store>
Correspondence decoded(const Sequence& sequence, const std::map<int, Photo>& photos, const std::vector<int>& order,
                       Store&& store) {
  auto decoder = Decoder::make(sequence, "cam", "p", {});
  EXPECT_TRUE(decoder) << decoder.error().message;
  for (const int frame : order) EXPECT_TRUE(decoder->add(frame, store(photos.at(frame))));
  auto c = decoder->finish();
  EXPECT_TRUE(c) << c.error().message;
  return *std::move(c);
}

std::vector<int> shown_order(const Sequence& sequence) {
  std::vector<int> order;
  for (const Frame& frame : sequence.frames) order.push_back(frame.index);
  return order;
}

// Accepted and rejected pixels are the same, and positions to `tolerance`.
void expect_same(const Correspondence& a, const Correspondence& b, double tolerance) {
  EXPECT_EQ(a.reason.data(), b.reason.data());
  EXPECT_EQ(a.accepted, b.accepted);
  EXPECT_EQ(a.lit, b.lit);
  for (const auto& [p, q] : {std::pair(&a.x, &b.x), std::pair(&a.y, &b.y), std::pair(&a.sigma, &b.sigma)})
    for (std::size_t i = 0; i < p->data().size(); ++i) {
      ASSERT_EQ(std::isnan(p->data()[i]), std::isnan(q->data()[i])) << i;
      if (!std::isnan(p->data()[i])) {
        ASSERT_NEAR(p->data()[i], q->data()[i], tolerance) << i;
      }
    }
}

class ArrivingCode : public testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Decoder, ArrivingCode, testing::Values("gray", "xor-04", "micro-phase"), [](const auto& info) {
  std::string name = info.param;
  std::erase(name, '-');
  return name;
});

TEST_P(ArrivingCode, IsReadAlikeInWhateverOrderItsPhotosArrive) {
  const View view = hard_view();
  const Sequence sequence = fake::sequence_of(view, GetParam());
  const auto photos = whole_photos(view, sequence, 4095);
  const auto decoder = Decoder::make(sequence, "cam", "p", {});
  ASSERT_TRUE(decoder);
  const Correspondence best = decoded(sequence, photos, decoder->frames(), as_light);
  EXPECT_GT(best.accepted, best.lit / 2);
  std::vector<int> order = shown_order(sequence);
  expect_same(decoded(sequence, photos, order, as_light), best, 0);  // floats come in several passes
  std::reverse(order.begin(), order.end());
  expect_same(decoded(sequence, photos, order, as_light), best, 0);
  // Levels, then coarse bits of both axes, which fill a pass but have to wait for the fine ones.
  order = decoder->frames();
  std::reverse(order.begin() + 4, order.end());
  std::stable_partition(order.begin() + 4, order.end(), [&](int frame) {
    const Role& role = sequence.frames[frame].role;
    return role.kind == "gray" && role.bit >= 4;
  });
  expect_same(decoded(sequence, photos, order, as_light), best, 0);
}

TEST_P(ArrivingCode, IsReadAlikeFromBytesWordsAndFloats) {
  const View view = hard_view();
  const Sequence sequence = fake::sequence_of(view, GetParam());
  for (const int full : {255, 4095}) {
    const auto photos = whole_photos(view, sequence, full);
    const std::vector<int> order = shown_order(sequence);
    const Correspondence light = decoded(sequence, photos, order, as_light);
    const auto words = [&](const Photo& photo) { return stored_as<std::uint16_t>(photo, full); };
    expect_same(decoded(sequence, photos, order, words), light, 1e-4);  // of single precision
    const auto bytes = [&](const Photo& photo) { return stored_as<std::uint8_t>(photo, full); };
    if (full == 255) expect_same(decoded(sequence, photos, order, bytes), light, 1e-4);
  }
}

TEST(Decoder, TakesAPhotoAgainAsLongAsItsPairIsNotComplete) {
  const View view = hard_view();
  const Sequence sequence = fake::code_of(view);
  auto photos = whole_photos(view, sequence, 255);
  const auto bytes = [](const Photo& photo) { return stored_as<std::uint8_t>(photo, 255); };
  const Correspondence right = decoded(sequence, photos, shown_order(sequence), bytes);
  auto decoder = Decoder::make(sequence, "cam", "p", {});
  ASSERT_TRUE(decoder);
  for (const Frame& frame : sequence.frames) {
    const bool first_of_pair = frame.role.kind == "gray" && !frame.role.inverse;
    if (first_of_pair) {
      ASSERT_TRUE(decoder->add(frame.index, bytes(photos.at(sequence.frames[1].index))));  // black
    }
    ASSERT_TRUE(decoder->add(frame.index, bytes(photos.at(frame.index))));
  }
  ASSERT_TRUE(decoder->add(999, bytes(photos.begin()->second))) << "nobody's frame is passed over";
  const auto c = decoder->finish();
  ASSERT_TRUE(c);
  expect_same(*c, right, 0);
}

TEST(Decoder, NamesThePhotoThatIsMissing) {
  const View view = hard_view();
  const Sequence sequence = fake::code_of(view);
  const auto photos = whole_photos(view, sequence, 255);
  auto decoder = Decoder::make(sequence, "cam", "p", {});
  ASSERT_TRUE(decoder);
  for (const Frame& frame : sequence.frames)
    if (frame.index != 11) {
      ASSERT_TRUE(decoder->add(frame.index, as_light(photos.at(frame.index))));
    }
  const auto c = decoder->finish();
  ASSERT_FALSE(c);
  EXPECT_EQ(c.error().code, ErrorCode::kRefused);
  EXPECT_THAT(c.error().message, HasSubstr("0011"));
}

}  // namespace
}  // namespace countershade::capture

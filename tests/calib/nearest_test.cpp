#include "calib/file/nearest.h"

#include <gtest/gtest.h>

namespace countershade {
namespace {

TEST(EditDistance, CountsInsertionsRemovalsAndReplacements) {
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3);  // the textbook's pair
  EXPECT_EQ(edit_distance("", "abc"), 3);
  EXPECT_EQ(edit_distance("abc", ""), 3);
  EXPECT_EQ(edit_distance("resoltion", "resolution"), 1);
  EXPECT_EQ(nearest("gama", {"gain", "gamma", "seed"}), "gamma");
}

}  // namespace
}  // namespace countershade

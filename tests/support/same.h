// Decoding that must give the same, bit for bit, whoever asks.
#pragma once

#include <gtest/gtest.h>

#include <cstring>

#include "capture/pattern/decode.h"

namespace countershade::testing {

inline bool same(const Image& a, const Image& b) {  // NaN as NaN
  return a.same_size(b.width(), b.height()) &&
         std::memcmp(a.data().data(), b.data().data(), a.data().size() * sizeof(float)) == 0;
}

inline void expect_same(const capture::Correspondence& a, const capture::Correspondence& b) {
  EXPECT_TRUE(same(a.x, b.x) && same(a.y, b.y) && same(a.sigma, b.sigma));
  EXPECT_EQ(a.reason.data(), b.reason.data());
  EXPECT_EQ(a.accepted, b.accepted);
}

}  // namespace countershade::testing

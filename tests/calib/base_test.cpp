#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <atomic>
#include <cmath>
#include <set>
#include <stdexcept>
#include <vector>

#include "calib/base/parallel.h"
#include "calib/base/random.h"

namespace countershade {
namespace {

Random seeded() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  return Random(hash_name(fmt::format("{}.{}", info->test_suite_name(), info->name())));
}

constexpr int kCount = 400000;

// Tolerances of the moments: 4 standard deviations of a mean of kCount draws.
double four_sigma(double variance_of_one) {
  return 4 * std::sqrt(variance_of_one / kCount);
}

TEST(Random, UniformHasTheMomentsOfAUniform) {
  Random random = seeded();
  double m1 = 0, m2 = 0, lag = 0, before = random.uniform();
  for (int i = 0; i < kCount; ++i) {
    const double u = random.uniform();
    ASSERT_TRUE(u >= 0 && u < 1);
    m1 += u, m2 += u * u, lag += (u - 0.5) * (before - 0.5);
    before = u;
  }
  EXPECT_NEAR(m1 / kCount, 1.0 / 2, four_sigma(1.0 / 12));
  EXPECT_NEAR(m2 / kCount, 1.0 / 3, four_sigma(1.0 / 5 - 1.0 / 9));
  EXPECT_NEAR(lag / kCount, 0, four_sigma(1.0 / 144)) << "neighbours are correlated";
}

TEST(Random, UniformFillsItsInterval) {
  Random random = seeded();
  std::vector<int> bins(50);
  for (int i = 0; i < kCount; ++i) ++bins[static_cast<int>((random.uniform(-3, 2) + 3) * 10)];
  double chi2 = 0;
  for (int n : bins) chi2 += (n - kCount / 50.0) * (n - kCount / 50.0) / (kCount / 50.0);
  EXPECT_LT(chi2, 49 + 4 * std::sqrt(2 * 49.0));  // mean 49, 4 standard deviations
}

TEST(Random, NormalHasTheMomentsOfANormal) {
  Random random = seeded();
  double m1 = 0, m2 = 0, m3 = 0, m4 = 0;
  for (int i = 0; i < kCount; ++i) {
    const double n = random.normal();
    ASSERT_TRUE(std::isfinite(n));
    m1 += n, m2 += n * n, m3 += n * n * n, m4 += n * n * n * n;
  }
  EXPECT_NEAR(m1 / kCount, 0, four_sigma(1));
  EXPECT_NEAR(m2 / kCount, 1, four_sigma(2));
  EXPECT_NEAR(m3 / kCount, 0, four_sigma(15));
  EXPECT_NEAR(m4 / kCount, 3, four_sigma(96));
}

TEST(Random, DependsOnItsSeedAlone) {
  Random a(7), b(7), c(8);
  std::set<std::uint64_t> seen;
  for (int i = 0; i < 1000; ++i) {
    const std::uint64_t bits = a.bits();
    EXPECT_EQ(bits, b.bits());
    seen.insert(bits);
    seen.insert(c.bits());
  }
  EXPECT_EQ(seen.size(), 2000) << "two streams overlap";
}

TEST(Random, NamesGiveDifferentSeeds) {
  EXPECT_EQ(hash_name(""), 0xcbf29ce484222325ull);   // FNV-1a's offset
  EXPECT_EQ(hash_name("a"), 0xaf63dc4c8601ec8cull);  // from the published test vectors
  EXPECT_EQ(hash_name("foobar"), 0x85944171f73967e8ull);
}

TEST(ParallelFor, CallsEachIndexOnce) {
  std::vector<std::atomic<int>> calls(1237);
  parallel_for(static_cast<int>(calls.size()), [&](int i) { ++calls[i]; });
  for (const auto& n : calls) EXPECT_EQ(n, 1);
  parallel_for(0, [](int) { FAIL() << "nothing to do"; });
  parallel_for(-3, [](int) { FAIL() << "nothing to do"; });
}

TEST(ParallelFor, GivesTheSameAtAnyThreadCount) {
  const auto rows = [](int threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    std::vector<double> out(300);
    parallel_for(300, [&](int i) {
      Random random(mix(i));
      for (int k = 0; k < 100; ++k) out[i] += random.normal();
    });
    return out;
  };
  const std::vector<double> one = rows(1);
  EXPECT_EQ(one, rows(2));
  EXPECT_EQ(one, rows(5));
}

TEST(ParallelFor, PassesOnWhatABodyThrows) {
  EXPECT_THROW(parallel_for(100,
                            [](int i) {
                              if (i == 57) throw std::runtime_error("57");
                            }),
               std::runtime_error);
}

}  // namespace
}  // namespace countershade

// As gtest_main; and where COUNTERSHADE_SKIPPED_RETURNS is set, that is returned when all is well but something was
// skipped, so that whoever runs many tests in one process sees it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

int main(int argc, char** argv) {
  ::testing::InitGoogleMock(&argc, argv);
  const int failed = RUN_ALL_TESTS();
  const char* code = std::getenv("COUNTERSHADE_SKIPPED_RETURNS");
  const bool skipped = ::testing::UnitTest::GetInstance()->skipped_test_count() > 0;
  return failed == 0 && skipped && code != nullptr ? std::atoi(code) : failed;
}

// Rig files of a few lines, and what is said of them.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "calib/file/file.h"
#include "calib/file/rig.h"
#include "tests/support/cli.h"

namespace countershade::test {

inline const std::string kSmallest =
    "[[camera]]\nid = \"cam\"\n[[projector]]\nid = \"left\"\nresolution = [1280, 800]\n";

inline Result<Rig> reading(const std::string& text) {
  testing::TemporaryFolder folder;
  EXPECT_TRUE(write_atomically(folder / "rig.toml", text));
  return read_rig(folder / "rig.toml");
}

// The message without the folder of the test: "rig.toml:3: ...".
inline std::string complaint(const std::string& text, ErrorCode code = ErrorCode::kBadValue) {
  const auto rig = reading(text);
  if (rig) return "no complaint";
  EXPECT_EQ(static_cast<int>(rig.error().code), static_cast<int>(code)) << rig.error().message;
  const std::string& message = rig.error().message;
  const std::size_t at = message.find("rig.toml");
  return at == std::string::npos ? message : message.substr(at);
}

}  // namespace countershade::test

#include "calib/file/file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "calib/image/image_file.h"
#include "tests/support/cli.h"
#include "tests/support/small_disk.h"

namespace countershade {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::SmallDisk;
using testing::TemporaryFolder;

std::size_t entries(const fs::path& folder) {
  return std::distance(fs::directory_iterator(folder), fs::directory_iterator());
}

TEST(WriteAtomically, ReplacesAFileAndLeavesNothingElse) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "a.txt", "old and longer"));
  const std::string bytes("new\0\n\xff", 6);
  ASSERT_TRUE(write_atomically(folder / "a.txt", bytes));
  EXPECT_EQ(read_text(folder / "a.txt").value(), bytes);
  EXPECT_EQ(entries(folder.path()), 1);
}

TEST(WriteAtomically, KeepsTheOldFileWhenTheWriterFailsOrThrows) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "a.exr", "old"));
  const auto failed = write_atomically_with(folder / "a.exr", [](const fs::path& temporary) -> Result<void> {
    EXPECT_EQ(temporary.extension(), ".exr");
    std::ofstream(temporary) << "half";
    return error(ErrorCode::kIo, "the writer failed");
  });
  EXPECT_EQ(failed.error().message, "the writer failed");
  const auto throws = [&] {
    (void)write_atomically_with(folder / "a.exr", [](const fs::path& temporary) -> Result<void> {
      std::ofstream(temporary) << "half";
      throw std::runtime_error("a bug");
    });
  };
  EXPECT_THROW(throws(), std::runtime_error);
  EXPECT_EQ(read_text(folder / "a.exr").value(), "old");
  EXPECT_EQ(entries(folder.path()), 1);
}

TEST(WriteAtomically, RemovesWhatAKilledWriterOfTheSameFileLeft) {
  TemporaryFolder folder;
  const pid_t dead = fork();
  if (dead == 0) _exit(0);
  ASSERT_EQ(waitpid(dead, nullptr, 0), dead);
  const auto left = [&](pid_t writer, const std::string& name) {
    return folder / fmt::format(".writing-{}-{}", writer, name);
  };
  std::ofstream(left(dead, "a.txt")) << "half";
  std::ofstream(left(dead, "b.txt")) << "of another file";
  std::ofstream(left(getppid(), "a.txt")) << "of one that lives";
  fs::create_directories(left(dead, "out") / "below");
  ASSERT_TRUE(write_atomically(folder / "a.txt", "whole"));
  EXPECT_FALSE(fs::exists(left(dead, "a.txt")));
  EXPECT_TRUE(fs::exists(left(dead, "b.txt")));
  EXPECT_TRUE(fs::exists(left(getppid(), "a.txt")));
  EXPECT_TRUE(fs::exists(left(dead, "out")));
  ASSERT_TRUE(create_folder_atomically(folder / "out", [](const fs::path&) -> Result<void> { return {}; }));
  EXPECT_FALSE(fs::exists(left(dead, "out")));
}

TEST(WriteAtomically, NamesAFolderThatIsMissing) {
  TemporaryFolder folder;
  const auto result = write_atomically(folder / "nowhere" / "a.txt", "x");
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kIo);
  EXPECT_THAT(result.error().message, AllOf(HasSubstr("nowhere/a.txt"), HasSubstr("create the folder first")));
}

TEST(WriteAtomically, SaysThatTheDiskIsFullAndLeavesNothing) {
  TemporaryFolder folder;
  SmallDisk disk(folder / "disk");
  if (!disk.ready()) GTEST_SKIP() << "a full disk cannot be tried here: mounting a tmpfs failed: " << disk.why();
  ASSERT_TRUE(write_atomically(folder / "disk" / "a.bin", std::string(20000, 'a')));
  const auto result = write_atomically(folder / "disk" / "a.bin", std::string(70001, 'b'));
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kIo);
  EXPECT_THAT(result.error().message, AllOf(HasSubstr("disk/a.bin'"), HasSubstr("70001 bytes"),
                                            HasSubstr("No space left"), HasSubstr("free space")));
  EXPECT_EQ(read_text(folder / "disk" / "a.bin").value(), std::string(20000, 'a'));
  EXPECT_EQ(entries(folder / "disk"), 1);
}

TEST(WriteAtomically, SaysThatTheDiskIsFullForPhotosToo) {
  TemporaryFolder folder;
  SmallDisk disk(folder / "disk");
  if (!disk.ready()) GTEST_SKIP() << "a full disk cannot be tried here: mounting a tmpfs failed: " << disk.why();
  const Image photo(211, 173, 1, 12345);  // 73 KB in 16 bits, uncompressed
  const auto result = write_stored16(folder / "disk" / "0007.tif", photo);
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::kIo);
  EXPECT_THAT(result.error().message, HasSubstr("0007.tif"));
  EXPECT_EQ(entries(folder / "disk"), 0);
}

TEST(WriteAtomically, SaysThatAFolderIsReadOnly) {
  TemporaryFolder folder;
  SmallDisk disk(folder / "disk");
  if (!disk.ready() || !disk.make_read_only())
    GTEST_SKIP() << "a read-only folder cannot be tried here: mounting a tmpfs failed: " << std::strerror(errno);
  for (const auto& result :
       {write_atomically(folder / "disk" / "a.txt", "x"),
        create_folder_atomically(folder / "disk" / "a", [](const fs::path&) { return Result<void>(); })}) {
    ASSERT_FALSE(result);
    EXPECT_EQ(result.error().code, ErrorCode::kIo);
    EXPECT_THAT(result.error().message, AllOf(HasSubstr("disk/a"), HasSubstr("choose a folder that can be written")));
  }
}

TEST(CreateFolderAtomically, AppearsWholeOrNotAtAll) {
  TemporaryFolder folder;
  const auto build = [&](bool fail) {
    return create_folder_atomically(folder / "out/", [&](const fs::path& draft) -> Result<void> {
      EXPECT_FALSE(fs::exists(folder / "out"));
      CS_TRY_VOID(write_atomically(draft / "a.txt", "a"));
      if (fail) return error(ErrorCode::kIo, "half way");
      return {};
    });
  };
  EXPECT_EQ(build(true).error().message, "half way");
  EXPECT_EQ(entries(folder.path()), 0);
  ASSERT_TRUE(build(false));
  EXPECT_EQ(read_text(folder / "out" / "a.txt").value(), "a");
  EXPECT_EQ(entries(folder.path()), 1);
  EXPECT_EQ(build(false).error().code, ErrorCode::kExists);
}

TEST(CreateFolderAtomically, HasItsRecordWhenItAppears) {
  TemporaryFolder folder;
  const auto build = [](const fs::path& hidden) { return write_atomically(hidden / "a", "1"); };
  const auto made = create_folder_atomically(folder / "out", build, [&](const fs::path& hidden) {
    EXPECT_TRUE(fs::exists(hidden / "a")) << "the record is the last";
    EXPECT_FALSE(fs::exists(folder / "out"));
    return write_atomically(hidden / "record", "2");
  });
  ASSERT_TRUE(made);
  EXPECT_EQ(read_text(folder / "out" / "record").value(), "2");
  EXPECT_FALSE(create_folder_atomically(folder / "other", build,
                                        [](const fs::path&) -> Result<void> { return error(ErrorCode::kIo, "no"); }));
  EXPECT_FALSE(fs::exists(folder / "other"));
}

TEST(ReadText, SaysWhatIsMissingAndWhatIsAFolder) {
  TemporaryFolder folder;
  EXPECT_THAT(read_text(folder / "a.txt").error().message, AllOf(HasSubstr("a.txt"), HasSubstr("missing")));
  EXPECT_THAT(read_text(folder.path()).error().message, HasSubstr("is a folder"));
  ASSERT_TRUE(write_atomically(folder / "empty", ""));
  EXPECT_EQ(read_text(folder / "empty").value(), "");
}

TEST(Npy, ReadsBackWhatWasWrittenInEachTypeAndShape) {
  TemporaryFolder folder;
  const std::vector<std::vector<int>> shapes = {{}, {6}, {2, 3}, {1, 3, 2}, {0, 4}};
  for (const auto& shape : shapes)
    for (const ArrayType type : {ArrayType::kFloat32, ArrayType::kFloat64, ArrayType::kInt32}) {
      Array array{shape, {}};
      int count = 1;
      for (int n : shape) count *= n;
      for (int i = 0; i < count; ++i) array.data.push_back(type == ArrayType::kInt32 ? 3 - 70000 * i : 0.1f * (i + 1));
      ASSERT_TRUE(write_npy(folder / "a.npy", array, type));
      const Array read = read_npy(folder / "a.npy").value();
      EXPECT_EQ(read.shape, shape);
      EXPECT_EQ(read.data, array.data);  // bit by bit: the data are floats in all three types
    }
}

TEST(Npy, IsAlignedAndSaysItsTypeAsNumPyWould) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_npy(folder / "a.npy", {{2, 1}, {1, 2}}, ArrayType::kFloat64));
  const std::string bytes = read_text(folder / "a.npy").value();
  ASSERT_EQ(bytes.size(), 128 + 16);  // the format asks for data at a multiple of 64
  EXPECT_EQ(bytes.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
  EXPECT_THAT(bytes, HasSubstr("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 1), }"));
  EXPECT_EQ(bytes[127], '\n');
  double second = 0;
  std::memcpy(&second, bytes.data() + 136, 8);
  EXPECT_EQ(second, 2);
}

TEST(Npy, RefusesWhatItCannotRead) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_npy(folder / "a.npy", {{2, 3}, {1, 2, 3, 4, 5, 6}}));
  const std::string good = read_text(folder / "a.npy").value();
  const auto reading = [&](const std::string& bytes) {
    EXPECT_TRUE(write_atomically(folder / "b.npy", bytes));
    const auto result = read_npy(folder / "b.npy");
    return result ? "was read" : result.error().message;
  };
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string bytes = good;
    return bytes.replace(bytes.find(from), from.size(), to);
  };
  EXPECT_THAT(reading(good.substr(0, good.size() - 1)),
              AllOf(HasSubstr("b.npy"), HasSubstr("has 175 bytes"), HasSubstr("176")));
  EXPECT_THAT(reading(good + "x"), HasSubstr("has 177 bytes"));
  EXPECT_THAT(reading(good.substr(0, 50)), HasSubstr("truncated within its header"));
  EXPECT_THAT(reading("P5 1 1 255"), HasSubstr("does not begin as a .npy file"));
  EXPECT_THAT(reading(with("<f8", ">f8")), HasSubstr("its type is '>f8'"));
  EXPECT_THAT(reading(with("False", "True ")), HasSubstr("Fortran"));
  EXPECT_THAT(reading(with("(2, 3)", "(2,-3)")), HasSubstr("shape cannot be read"));
  EXPECT_THAT(reading(with("(2, 3), }", "(99999999999, 9), }")), HasSubstr("shape cannot be read"));
  EXPECT_THROW((void)write_npy(folder / "c.npy", {{2, 2}, {1, 2, 3}}), Bug);
  EXPECT_THROW((void)write_npy(folder / "c.npy", {{1}, {0.5}}, ArrayType::kInt32), Bug);
}

TEST(Hash, IsFnv1a) {
  // Test vectors of the authors (Fowler, Noll, Vo), 64 bits.
  EXPECT_EQ(hash_text(""), "cbf29ce484222325");
  EXPECT_EQ(hash_text("a"), "af63dc4c8601ec8c");
  EXPECT_EQ(hash_text("foobar"), "85944171f73967e8");
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "f", "foobar"));
  EXPECT_EQ(hash_file(folder / "f").value(), "85944171f73967e8");
}

TEST(Provenance, HoldsEveryOptionAndAnyPath) {
  TemporaryFolder folder;
  Provenance provenance;
  provenance.version = "1.2.3";
  provenance.command_line = "countershade compensate caf\xe9";  // Latin-1, no UTF-8
  provenance.options = {{"picture", "left=a.png"}, {"bits", "16"}, {"picture", "right=b.png"}, {"picture", "c.png"}};
  provenance.input_hashes = {{"rig.toml", "85944171f73967e8"}};
  provenance.seconds = 2.5;
  ASSERT_TRUE(write_provenance(folder.path(), provenance));
  const auto read = nlohmann::json::parse(read_text(folder / "provenance.json").value());
  EXPECT_EQ(read["version"], "1.2.3");
  EXPECT_EQ(read["options"]["picture"], nlohmann::json({"left=a.png", "right=b.png", "c.png"}));
  EXPECT_EQ(read["options"]["bits"], "16");
  EXPECT_EQ(read["inputs"]["rig.toml"], "85944171f73967e8");
  EXPECT_EQ(read["seconds"], 2.5);
  EXPECT_THAT(read["command_line"].get<std::string>(), HasSubstr("compensate caf"));
}

}  // namespace
}  // namespace countershade

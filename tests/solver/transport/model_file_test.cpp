#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>

#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "tests/support/cli.h"
#include "tests/support/test_model.h"

namespace countershade::solver {
namespace {

namespace fs = std::filesystem;
using countershade::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;

Model room() {
  Model model = test::room({.grid = {{4, 3}, {3, 2}}});
  model.screen.creases = {{0, 1, 1, 0, 1.7}};
  model.white = 1 / 3.0;
  return model;
}

void expect_same_projector(const ProjectorModel& a, const ProjectorModel& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.response.curve.text(), b.response.curve.text());
  EXPECT_EQ(a.response.black_level, b.response.black_level);
  EXPECT_EQ(a.device.lens.model(), b.device.lens.model());
  EXPECT_EQ(a.device.lens.intrinsics(), b.device.lens.intrinsics());
  EXPECT_EQ(a.device.lens.width(), b.device.lens.width());
  EXPECT_EQ(a.device.lens.height(), b.device.lens.height());
  EXPECT_EQ(a.device.device_from_world.rotation, b.device.device_from_world.rotation);
  EXPECT_EQ(a.device.device_from_world.translation, b.device.device_from_world.translation);
  EXPECT_EQ(a.map.surface, b.map.surface);
  EXPECT_EQ(a.map.u, b.map.u);
  EXPECT_EQ(a.map.v, b.map.v);
  ASSERT_EQ(a.gain.size(), b.gain.size());
  for (std::size_t s = 0; s < a.gain.size(); ++s) {
    EXPECT_TRUE(a.gain[s].same_size(b.gain[s].width(), b.gain[s].height()));
    EXPECT_EQ(a.gain[s].data(), b.gain[s].data());
  }
}

TEST(ModelFile, ReadsBackEveryBit) {
  TemporaryFolder folder;
  Model model = room();
  model.k(2, 1) = 1 / 3.0f;
  model.projectors[0].gain[1].at(3, 5, 2) = 0.1f;
  ASSERT_TRUE(write_model(folder.path(), model));
  const Result<Model> read = read_model(folder.path());
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->F, model.F);
  EXPECT_EQ(read->G, model.G);
  EXPECT_EQ(read->k, model.k);
  EXPECT_EQ(read->e, model.e);
  EXPECT_EQ(read->white, model.white);
  EXPECT_EQ(read->receiver_factor, model.receiver_factor);
  EXPECT_EQ(read->gain_factor, model.gain_factor);
  EXPECT_EQ(read->patches.grid(), model.patches.grid());
  ASSERT_EQ(read->planes.size(), model.planes.size());
  for (std::size_t s = 0; s < model.planes.size(); ++s) {
    EXPECT_EQ(read->screen.surfaces[s], read->planes[s]);
    EXPECT_EQ(read->planes[s]->origin(), model.planes[s]->origin());
    EXPECT_EQ(read->planes[s]->along_u(), model.planes[s]->along_u());
    EXPECT_EQ(read->planes[s]->along_v(), model.planes[s]->along_v());
  }
  ASSERT_EQ(read->screen.creases.size(), 1u);
  const Crease& a = read->screen.creases[0];
  const Crease& b = model.screen.creases[0];
  EXPECT_EQ(std::tie(a.surface_a, a.surface_b, a.u_a, a.u_b, a.angle),
            std::tie(b.surface_a, b.surface_b, b.u_a, b.u_b, b.angle));
  ASSERT_EQ(read->projectors.size(), 2u);
  for (int q = 0; q < 2; ++q) expect_same_projector(read->projectors[q], model.projectors[q]);
}

TEST(ModelFile, OfEqualModelsHasEqualBytes) {
  TemporaryFolder first, second;
  ASSERT_TRUE(write_model(first.path(), room()));
  ASSERT_TRUE(write_model(second.path(), *read_model(first.path())));
  int files = 0;
  for (const auto& entry : fs::directory_iterator(first.path())) {
    const std::string name = entry.path().filename().string();
    EXPECT_EQ(*read_text(first / name), *read_text(second / name)) << name;
    ++files;
  }
  EXPECT_EQ(files, 5 + 4);  // model.json, F, G, k, e; two projectors on two walls
}

TEST(ModelFile, NeedsItsFolder) {
  TemporaryFolder folder;
  const Result<void> written = write_model(folder / "missing", room());
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::kIo);
}

TEST(ModelFile, IncompleteModelsAreBugs) {
  TemporaryFolder folder;
  Model model = room();
  model.planes.pop_back();
  EXPECT_THROW((void)write_model(folder.path(), model), Bug);
  model = room();
  model.G.conservativeResize(model.G.rows() - 1, model.G.cols());
  EXPECT_THROW((void)write_model(folder.path(), model), Bug);
  model = room();
  model.projectors[1].gain.pop_back();
  EXPECT_THROW((void)write_model(folder.path(), model), Bug);
}

// Replaces the first `from` in the file's text.
void edit(const fs::path& path, const std::string& from, const std::string& to) {
  std::string text = *read_text(path);
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  ASSERT_TRUE(write_atomically(path, text));
}

struct Damage {
  const char *from, *to, *named;  // in model.json; what the message must name
};

class ModelFileDamage : public ::testing::TestWithParam<Damage> {};

TEST_P(ModelFileDamage, IsRefusedByName) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_model(folder.path(), room()));
  edit(folder / "model.json", GetParam().from, GetParam().to);
  const Result<Model> read = read_model(folder.path());
  ASSERT_FALSE(read) << GetParam().to;
  EXPECT_EQ(read.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(read.error().message, AllOf(HasSubstr("model.json"), HasSubstr(GetParam().named)));
}

INSTANTIATE_TEST_SUITE_P(
    ModelJson, ModelFileDamage,
    ::testing::Values(Damage{"\"format_version\": 1", "\"format_version\": 2", "newer countershade"},
                      Damage{"\"format_version\": 1", "\"format_version\": 0", "format_version 0"},
                      Damage{"\"format_version\"", "\"version\"", "format_version"}, Damage{"{", "", "not a model"},
                      Damage{"\"white\": 0.3", "\"white\": -0.3", "white is -0.3"},
                      Damage{"\"white\": 0.3", "\"white\": 1e999, \"w\": 0.3", "not a model"},
                      Damage{"\"receiver_factor\": 2", "\"receiver_factor\": 0", "receiver_factor is 0"},
                      Damage{"\"gain_factor\": 4", "\"gain_factor\": -4", "gain_factor is -4"},
                      Damage{"\"surface_b\": 1", "\"surface_b\": 7", "surface_b of a crease is 7"},
                      Damage{"\"patches\": [\n    4", "\"patches\": [\n    0", "patches[0] of a surface is 0"},
                      Damage{"\"patches\": [\n    4", "\"patches\": [\n    100000", "must be in [1, 4096]"},
                      Damage{"\"along_u\": [\n    1.8,\n    0.0,\n    -1.3", "\"along_u\": [\n 0,\n 3.2,\n 0",
                             "area of a surface is 0"},
                      Damage{"\"black_level\": 0.002", "\"black_level\": 1.5", "black_level of a projector is 1.5"},
                      Damage{"\"gamma:2.2\"", "\"gamma:77\"", "projector 'left'"},
                      Damage{"LENSMODEL_PINHOLE", "LENSMODEL_PINHOOLE", "projector 'left'"},
                      Damage{"\"rotation\": [\n    [\n", "\"rotation\": [\n    [9,\n", "rotation"}));

TEST(ModelFile, RefusesArraysOfAnotherShape) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_model(folder.path(), room()));
  ASSERT_TRUE(write_npy(folder / "k.npy", {{17, 3}, std::vector<double>(51, .5)}, ArrayType::kFloat32));
  const Result<Model> read = read_model(folder.path());
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(read.error().message, AllOf(HasSubstr("k.npy"), HasSubstr("(17, 3)"), HasSubstr("(18, 3)")));
}

TEST(ModelFile, RefusesNumbersThatAreNotFinite) {
  TemporaryFolder folder;
  const Model model = room();
  ASSERT_TRUE(write_model(folder.path(), model));
  std::vector<double> e(54, 0.);
  e[3 * 5 + 2] = std::numeric_limits<double>::quiet_NaN();
  ASSERT_TRUE(write_npy(folder / "e.npy", {{18, 3}, e}, ArrayType::kFloat32));
  const Result<Model> read = read_model(folder.path());
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(read.error().message, AllOf(HasSubstr("e.npy"), HasSubstr("(5, 2)")));
}

TEST(ModelFile, RefusesGainsOfAnotherSize) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_model(folder.path(), room()));
  fs::copy_file(folder / "gain_right_0.exr", folder / "gain_right_1.exr", fs::copy_options::overwrite_existing);
  const Result<Model> read = read_model(folder.path());
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, ErrorCode::kBadFile);
  EXPECT_THAT(read.error().message, AllOf(HasSubstr("gain_right_1.exr"), HasSubstr("16 x 12"), HasSubstr("12 x 8")));
}

TEST(ModelFile, NamesAMissingFile) {
  for (const char* name : {"model.json", "F.npy", "G.npy", "k.npy", "e.npy", "gain_left_1.exr"}) {
    TemporaryFolder folder;
    ASSERT_TRUE(write_model(folder.path(), room()));
    fs::remove(folder / name);
    const Result<Model> read = read_model(folder.path());
    ASSERT_FALSE(read) << name;
    EXPECT_EQ(read.error().code, ErrorCode::kBadFile) << read.error().message;
    EXPECT_THAT(read.error().message, HasSubstr(name));
  }
}

TEST(ModelFile, NamesATruncatedFile) {
  for (const char* name : {"model.json", "F.npy", "gain_left_1.exr"}) {
    TemporaryFolder folder;
    ASSERT_TRUE(write_model(folder.path(), room()));
    fs::resize_file(folder / name, fs::file_size(folder / name) / 2);
    const Result<Model> read = read_model(folder.path());
    ASSERT_FALSE(read) << name;
    EXPECT_EQ(read.error().code, ErrorCode::kBadFile) << read.error().message;
    EXPECT_THAT(read.error().message, HasSubstr(name));
  }
}

}  // namespace
}  // namespace countershade::solver

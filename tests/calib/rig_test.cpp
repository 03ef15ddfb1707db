#include "calib/file/rig.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "calib/file/file.h"
#include "calib/file/rig_fields.h"
#include "tests/calib/rig_reading.h"

namespace countershade {
namespace {

using test::kSmallest;
using test::reading;
namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::TemporaryFolder;

// Every field has another value than its default, no two numbers are alike.
Rig full_rig() {
  Rig rig;
  CameraSpec a{
      "cam-a", "simulated", "serial \"7\"\\\n\x01", "/models/a.cameramodel", "unknown", {8, 0.1, 1e-5}, "gamma:1.8",
      240.25,  65520.5};
  CameraSpec b;
  b.id = "B_2";
  rig.cameras = {a, b};
  ProjectorSpec left{
      "left", {1280, 801},       "window", "HDMI-1", "srgb", 1.0 / 3, 1.3, 0.031, std::array<double, 2>{-0.05, 0.55},
      0.07,   "/m/p.cameramodel"};
  ProjectorSpec right;
  right.id = "right";
  right.resolution = {1920, 1080};
  rig.projectors = {left, right};
  rig.screen = {"planes", 2, {40, 30}, ScreenSpec::KnownLength{{10.5, 20}, {1e3, 0.1}, 2.75}};
  rig.board = {"charuco", {10, 6}, 0.033};
  return rig;
}

Simulation full_simulation() {
  Simulation s{"my room", 0.013, 0.4, 120, 0xfedcba9876543210ull, 5000, 24, {}, {}, {}};
  for (const char* shape : {"rectangle", "cylinder", "cone", "sphere", "mesh"}) {
    SimulatedSurface surface{shape,
                             shape,
                             {0.1, 0.2, 0.3},
                             {1.1, 0.4, 0.5},
                             {0.6, 1.2, 0.7},
                             2.1,
                             1.3,
                             1.9,
                             {-31, 42},
                             {3, 64},
                             "outside",
                             "/m/a.ply",
                             0.01,
                             {0.5, 0.6, 0.55},
                             0.04,
                             0.05,
                             {5, 6},
                             0.07,
                             0.35,
                             1.5,
                             {8, -9},
                             0.9,
                             0.11,
                             {0.12, 0.13},
                             {0.34, 0.45}};
    s.surfaces.push_back(surface);
  }
  SimulatedCamera c{"cam-a",
                    {0.1, 1.7, 4.2},
                    {0.2, 1.1, 0.3},
                    -2.5,
                    {640, 401},
                    1,
                    512.5,
                    {321.25, 198.5},
                    {-0.1, 0.02, 1e-4, -2e-4, 0.003},
                    9000,
                    4,
                    10,
                    0.7,
                    12,
                    0.5,
                    0.2};
  SimulatedProjector p{"left", {-1, 2, 3},        {-1.2, 1, 0.4}, 1.5,  1.1, {0.02, -0.3},
                       0.9,    {2.2, 2.25, 2.15}, 0.0013,         0.21, 0.4, 2};
  c.lens = "/models/true.cameramodel";
  c.veiling_glare = 0.015, c.bayer = "GRBG", c.channels = 3, c.hot_pixels = 41, c.rolling_shutter_ms = 15.5;
  c.auto_exposure = 0.35, c.timestamp_offset_ms = -7.5, c.clock_drift_ppm = 33, c.eye = "right", c.glasses_leak = 0.006;
  p.distortion = {-0.05, 0.01, 3e-4, -4e-4, 0.002};
  p.response_r = {0, 0.25, 0.95}, p.response_g = {0.01, 0.98}, p.response_b = {0, 0.1, 0.4, 0.97};
  p.colour_mixing = {0.9, 0.06, 0.04, 0.02, 0.91, 0.07, 0.03, 0.05, 0.92};
  p.white_segment = 0.45, p.flare = 0.008, p.native_resolution = {1024, 768};
  p.warm_up = 0.12, p.warm_up_s = 700, p.colour_wheel_hz = 120, p.pwm_hz = 960, p.refresh_hz = 59.94;
  p.latency_jitter_ms = 3.5, p.stereo = true;
  s.cameras = {c};
  s.projectors = {p};
  return s;
}

// The fields of a table as text: compares each, whatever its type.
template <class T>
std::vector<std::string> texts(T value) {
  std::vector<std::string> all;
  for (const auto& f : fields::fields_of(value)) all.push_back(f.name + " = " + fields::value_text(f.slot));
  return all;
}
template <class T>
std::vector<std::vector<std::string>> texts(const std::vector<T>& values) {
  std::vector<std::vector<std::string>> all;
  for (const T& value : values) all.push_back(texts(value));
  return all;
}

void expect_equal(const Rig& a, const Rig& b) {
  EXPECT_EQ(texts(a.cameras), texts(b.cameras));
  EXPECT_EQ(texts(a.projectors), texts(b.projectors));
  EXPECT_EQ(texts(a.screen), texts(b.screen));
  EXPECT_EQ(texts(a.board), texts(b.board));
  EXPECT_EQ(a.target, b.target);
}

void expect_equal(const Simulation& a, const Simulation& b) {
  EXPECT_EQ(texts(a), texts(b));
  EXPECT_EQ(texts(a.surfaces), texts(b.surfaces));
  EXPECT_EQ(texts(a.cameras), texts(b.cameras));
  EXPECT_EQ(texts(a.projectors), texts(b.projectors));
}

// ---- what is accepted ----

TEST(Rig, NeedsOnlyIdsAndAResolution) {
  const Rig rig = reading(kSmallest).value();
  ASSERT_EQ(rig.cameras.size(), 1);
  EXPECT_EQ(rig.cameras[0].id, "cam");
  EXPECT_EQ(rig.projector("left")->resolution, (std::array<int, 2>{1280, 800}));
  EXPECT_EQ(rig.projector("right"), nullptr);
  CameraSpec camera;
  camera.id = "cam";
  EXPECT_EQ(texts(rig.cameras[0]), texts(camera));
  EXPECT_EQ(texts(rig.screen), texts(ScreenSpec{}));
}

// Values that are written out here and compared one by one, so that two fields of the list cannot have changed places.
TEST(Rig, PutsEachValueWhereItBelongs) {
  const Rig rig =
      reading(
          "format_version = 1\n"
          "[[camera]]\nid = \"c\"\nbackend = \"simulated\"\ndevice = \"d\"\nmodel = \"/m\"\npose = \"unknown\"\n"
          "exposures_ms = [8, 32.5]\nresponse = \"srgb\"\npedestal = 1\nfull_scale = 4000\n"
          "[[projector]]\nid = \"p\"\nresolution = [3, 2]\noutput = \"folder\"\nmonitor = \"m\"\nresponse = "
          "\"gamma:2\"\n"
          "black_level = 0.25\nthrow_ratio = 2\nthrow_ratio_sigma = 0.5\nlens_shift = [0, -1.5]\nlens_shift_sigma = "
          "0.75\n"
          "[screen]\nkind = \"planes\"\nplanes = 3\npatches = [5, 4]\n"
          "known_length = { pixel_a = [1, 2], pixel_b = [3.5, 4], metres = 6 }\n"
          "[board]\nkind = \"apriltag\"\ncorners = [8, 5]\nsquare = 0.125\n"
          "[intent]\ntarget = \"direct\"\n")
          .value();
  const CameraSpec& c = rig.cameras[0];
  EXPECT_EQ(c.backend + c.device + c.model.string() + c.pose + c.response, "simulatedd/munknownsrgb");
  EXPECT_EQ(c.exposures_ms, (std::vector<double>{8, 32.5}));
  EXPECT_EQ(c.pedestal, 1);
  EXPECT_EQ(c.full_scale, 4000);
  const ProjectorSpec& p = rig.projectors[0];
  EXPECT_EQ(p.output + p.monitor + p.response, "foldermgamma:2");
  EXPECT_EQ(p.resolution, (std::array<int, 2>{3, 2}));
  EXPECT_EQ(p.black_level, 0.25);
  EXPECT_EQ(p.throw_ratio, 2);
  EXPECT_EQ(p.throw_ratio_sigma, 0.5);
  EXPECT_EQ(p.lens_shift, (std::array<double, 2>{0, -1.5}));
  EXPECT_EQ(p.lens_shift_sigma, 0.75);
  EXPECT_EQ(rig.screen.planes, 3);
  EXPECT_EQ(rig.screen.patches, (std::array<int, 2>{5, 4}));
  EXPECT_EQ(rig.screen.known_length->pixel_b, (std::array<double, 2>{3.5, 4}));
  EXPECT_EQ(rig.screen.known_length->metres, 6);
  EXPECT_EQ(rig.board.kind, "apriltag");
  EXPECT_EQ(rig.board.corners, (std::array<int, 2>{8, 5}));
  EXPECT_EQ(rig.board.square, 0.125);
}

TEST(Rig, PutsEachValueOfTheSimulationWhereItBelongs) {
  TemporaryFolder folder;
  const std::string text =
      "[simulation]\nroom = \"mine\"\nambient = 0.8\nambient_swing = 0.7\nambient_hz = 120\nseed = 9\nsamples = "
      "100\nblock_px = 11\n"
      "[[simulation.surface]]\nid = \"r\"\norigin = [1, 2, 3]\nalong_u = [4, 5, 6]\nalong_v = [7, 8, 9]\n"
      "albedo = [0.1, 0.2, 0.3]\ntexture = 0.4\npatchwork = 0.5\npatchwork_cells = [6, 7]\ngloss = 0.8\n"
      "roughness = 0.9\ndirecting = 10\ndirecting_tilt_deg = [11, 12]\ntransmission = 13\ndaylight = 14\n"
      "daylight_from = [0.15, 0.16]\ndaylight_to = [0.17, 0.18]\n"
      "[[simulation.surface]]\nid = \"k\"\nshape = \"cone\"\norigin = [1, 2, 3]\nradius = 4\ntop_radius = 5\n"
      "height = 6\nazimuth_deg = [7, 8]\nlit = \"outside\"\n"
      "[[simulation.surface]]\nid = \"d\"\nshape = \"sphere\"\nelevation_deg = [-7, 8]\n"
      "[[simulation.surface]]\nid = \"m\"\nshape = \"mesh\"\nmesh = \"a.obj\"\nmesh_scale = 0.001\n"
      "[[simulation.camera]]\nid = \"c\"\nposition = [1, 2, 3]\ntarget = [4, 5, 6]\nroll_deg = 7\nresolution = [8, 9]\n"
      "channels = 1\nfocal_px = 10\nprincipal = [11, 12]\ndistortion = [0.1, 0.2, 0.3, 0.4, 0.5]\nfull_well_e = 13\n"
      "read_noise_e = 14\nbits = 15\nwhite_level = 16\nreference_exposure_ms = 17\npsf_sigma_px = 18\nvignetting = "
      "0.19\nlens = \"/l\"\nveiling_glare = 0.2\nbayer = \"none\"\nhot_pixels = 21\nrolling_shutter_ms = 22\n"
      "auto_exposure = 0.23\ntimestamp_offset_ms = 24\nclock_drift_ppm = 25\neye = \"left\"\nglasses_leak = 0.26\n"
      "[[simulation.projector]]\nid = \"p\"\nposition = [1, 2, 3]\ntarget = [4, 5, 6]\nroll_deg = 7\nthrow_ratio = 8\n"
      "lens_shift = [0.9, 1]\ngain = 11\ngamma = [1.2, 1.3, 1.4]\nblack_level = 0.15\nfalloff = 0.16\n"
      "defocus_sigma_px = 17\nlatency_ms = 18\n"
      "distortion = [0.1, 0.2, 0.3, 0.4, 0.5]\nresponse_r = [0.1, 0.2]\nresponse_g = [0.3, 0.4, 0.5]\n"
      "response_b = [0.6, 0.7]\ncolour_mixing = [1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9]\nwhite_segment = 0.19\n"
      "flare = 0.2\nnative_resolution = [21, 22]\nwarm_up = 0.23\nwarm_up_s = 24\ncolour_wheel_hz = 25\npwm_hz = 26\n"
      "refresh_hz = 27\nlatency_jitter_ms = 28\nstereo = true\n";
  ASSERT_TRUE(write_atomically(folder / "s.toml", text));
  const Simulation s = read_simulation(folder / "s.toml").value();
  using Two = std::array<double, 2>;
  using Three = std::array<double, 3>;
  EXPECT_EQ(s.room, "mine");
  EXPECT_EQ((Three{s.ambient, s.ambient_swing, s.ambient_hz}), (Three{0.8, 0.7, 120}));
  ASSERT_EQ(s.surfaces.size(), 4u);
  const SimulatedSurface &r = s.surfaces[0], &k = s.surfaces[1], &d = s.surfaces[2], &m = s.surfaces[3];
  EXPECT_EQ(r.shape, "rectangle");
  EXPECT_EQ(r.origin, (Three{1, 2, 3}));
  EXPECT_EQ(r.along_u, (Three{4, 5, 6}));
  EXPECT_EQ(r.along_v, (Three{7, 8, 9}));
  EXPECT_EQ(r.albedo, (Three{0.1, 0.2, 0.3}));
  EXPECT_EQ((Three{r.texture, r.patchwork, r.gloss}), (Three{0.4, 0.5, 0.8}));
  EXPECT_EQ(r.patchwork_cells, (std::array<int, 2>{6, 7}));
  EXPECT_EQ((Two{r.roughness, r.directing}), (Two{0.9, 10}));
  EXPECT_EQ(r.directing_tilt_deg, (Two{11, 12}));
  EXPECT_EQ((Two{r.transmission, r.daylight}), (Two{13, 14}));
  EXPECT_EQ(r.daylight_from, (Two{0.15, 0.16}));
  EXPECT_EQ(r.daylight_to, (Two{0.17, 0.18}));
  EXPECT_EQ(k.shape, "cone");
  EXPECT_EQ(k.origin, (Three{1, 2, 3}));
  EXPECT_EQ((Three{k.radius, k.top_radius, k.height}), (Three{4, 5, 6}));
  EXPECT_EQ(k.azimuth_deg, (Two{7, 8}));
  EXPECT_EQ(k.lit, "outside");
  EXPECT_EQ(d.elevation_deg, (Two{-7, 8}));
  EXPECT_EQ(m.mesh, folder / "a.obj") << "resolved against the file's folder";
  EXPECT_EQ(m.mesh_scale, 0.001);
  EXPECT_EQ(s.seed, 9);
  EXPECT_EQ((Two{1. * s.samples, 1. * s.block_px}), (Two{100, 11}));
  const SimulatedCamera& c = s.cameras.at(0);
  EXPECT_EQ(c.position, (Three{1, 2, 3}));
  EXPECT_EQ(c.target, (Three{4, 5, 6}));
  EXPECT_EQ(c.resolution, (std::array<int, 2>{8, 9}));
  EXPECT_EQ((Three{c.roll_deg, 1. * c.channels, c.focal_px}), (Three{7, 1, 10}));
  EXPECT_EQ(c.principal, (Two{11, 12}));
  EXPECT_EQ(c.distortion, (std::array<double, 5>{0.1, 0.2, 0.3, 0.4, 0.5}));
  EXPECT_EQ((Three{c.full_well_e, c.read_noise_e, 1. * c.bits}), (Three{13, 14, 15}));
  EXPECT_EQ((Two{c.white_level, c.reference_exposure_ms}), (Two{16, 17}));
  EXPECT_EQ((Two{c.psf_sigma_px, c.vignetting}), (Two{18, 0.19}));
  EXPECT_EQ(c.lens.string() + c.bayer + c.eye, "/lnoneleft");
  EXPECT_EQ((Three{c.veiling_glare, 1. * c.hot_pixels, c.rolling_shutter_ms}), (Three{0.2, 21, 22}));
  EXPECT_EQ((Two{c.auto_exposure, c.timestamp_offset_ms}), (Two{0.23, 24}));
  EXPECT_EQ((Two{c.clock_drift_ppm, c.glasses_leak}), (Two{25, 0.26}));
  const SimulatedProjector& p = s.projectors.at(0);
  EXPECT_EQ(p.position, (Three{1, 2, 3}));
  EXPECT_EQ(p.target, (Three{4, 5, 6}));
  EXPECT_EQ((Three{p.roll_deg, p.throw_ratio, p.gain}), (Three{7, 8, 11}));
  EXPECT_EQ(p.lens_shift, (Two{0.9, 1}));
  EXPECT_EQ(p.gamma, (Three{1.2, 1.3, 1.4}));
  EXPECT_EQ((Two{p.black_level, p.falloff}), (Two{0.15, 0.16}));
  EXPECT_EQ((Two{p.defocus_sigma_px, p.latency_ms}), (Two{17, 18}));
  EXPECT_EQ(p.distortion, (std::array<double, 5>{0.1, 0.2, 0.3, 0.4, 0.5}));
  EXPECT_EQ(p.response_r, (std::vector<double>{0.1, 0.2}));
  EXPECT_EQ(p.response_g, (std::vector<double>{0.3, 0.4, 0.5}));
  EXPECT_EQ(p.response_b, (std::vector<double>{0.6, 0.7}));
  EXPECT_EQ(p.colour_mixing, (std::array<double, 9>{1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9}));
  EXPECT_EQ(p.native_resolution, (std::array<int, 2>{21, 22}));
  EXPECT_EQ((Two{p.white_segment, p.flare}), (Two{0.19, 0.2}));
  EXPECT_EQ((Two{p.warm_up, p.warm_up_s}), (Two{0.23, 24}));
  EXPECT_EQ((Three{p.colour_wheel_hz, p.pwm_hz, p.refresh_hz}), (Three{25, 26, 27}));
  EXPECT_EQ(p.latency_jitter_ms, 28);
  EXPECT_TRUE(p.stereo);
}

TEST(Rig, ResolvesModelsAgainstItsOwnFolder) {
  TemporaryFolder folder;
  const std::string text =
      "[[camera]]\nid = \"cam\"\nmodel = \"lenses/../a.cameramodel\"\n"
      "[[projector]]\nid = \"left\"\nresolution = [1280, 800]\nmodel = \"/abs/p.cameramodel\"\n";
  ASSERT_TRUE(write_atomically(folder / "rig.toml", text));
  const Rig rig = read_rig(folder / "rig.toml").value();
  EXPECT_EQ(rig.cameras[0].model, folder / "a.cameramodel");
  EXPECT_EQ(rig.projectors[0].model, "/abs/p.cameramodel");
}

TEST(Rig, ResolvesTheTrueLensAgainstItsOwnFolder) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "s.toml",
                               "[simulation]\n[[simulation.camera]]\nid = \"c\"\nlens = \"l.cameramodel\"\n"));
  EXPECT_EQ(read_simulation(folder / "s.toml")->cameras[0].lens, folder / "l.cameramodel");
}

// A session of a plain room does not change its text when devices learn something new.
TEST(Rig, SeldomSettingsAreWrittenOnlyWhenTheyAreSet) {
  Simulation simulation;
  simulation.cameras.resize(1);
  simulation.projectors.resize(1);
  for (const char* name : {"bayer", "eye", "flare", "colour_mixing", "refresh_hz", "stereo", "lens =", "response_g"})
    EXPECT_THAT(simulation_text(simulation), Not(HasSubstr(name))) << name;
  EXPECT_THAT(rig_text({}, &simulation), AllOf(HasSubstr("# flare = 0.0 "), HasSubstr("default: 0.0")));
  simulation.projectors[0].flare = 0.01;
  EXPECT_THAT(simulation_text(simulation), HasSubstr("\nflare = 0.01\n"));
}

// ---- round trips ----

TEST(Rig, CanonicalTextReadsBackEqual) {
  const Rig rig = full_rig();
  const Rig read = reading(canonical_rig_text(rig)).value();
  expect_equal(read, rig);
  EXPECT_EQ(canonical_rig_text(read), canonical_rig_text(rig));
  Rig plain;
  plain.cameras.resize(1);
  plain.cameras[0].id = "c";
  plain.projectors.resize(1);
  plain.projectors[0].id = "p";
  plain.projectors[0].resolution = {7, 5};
  expect_equal(reading(canonical_rig_text(plain)).value(), plain);
}

TEST(Rig, CommentedTextReadsBackEqual) {
  const Simulation simulation = full_simulation();
  for (const Simulation* s : {&simulation, static_cast<const Simulation*>(nullptr)}) {
    TemporaryFolder folder;
    ASSERT_TRUE(write_atomically(folder / "rig.toml", rig_text(full_rig(), s)));
    expect_equal(read_rig(folder / "rig.toml").value(), full_rig());
    EXPECT_EQ(has_simulation(folder / "rig.toml").value(), s != nullptr);
    if (s != nullptr) expect_equal(read_simulation(folder / "rig.toml").value(), simulation);
  }
}

TEST(Rig, CommentedTextNamesEveryFieldAndEveryUnsetOneCanBeSet) {
  Rig rig;
  rig.cameras.resize(1);
  rig.cameras[0].id = "c";
  rig.projectors.resize(1);
  rig.projectors[0].id = "p";
  rig.projectors[0].resolution = {7, 5};
  std::string text = rig_text(rig, nullptr);
  std::vector<fields::Fields> tables = {fields::fields_of(rig.cameras[0]), fields::fields_of(rig.projectors[0]),
                                        fields::fields_of(rig.screen), fields::fields_of(rig.board),
                                        fields::intent_of(rig)};
  for (const auto& table : tables)
    for (const auto& f : table) EXPECT_THAT(text, HasSubstr(f.name + " = ")) << f.name;
  // Taking every "# " away before "name = value" leaves a file that is read.
  for (std::size_t at = 0; (at = text.find("\n# ", at)) != std::string::npos; ++at) {
    const std::string line = text.substr(at + 3, text.find('\n', at + 1) - at - 3);
    const std::size_t name = line.find_first_not_of("abcdefghijklmnopqrstuvwxyz_");
    if (line.substr(name, 3) == " = " || line[0] == '[') text.erase(at + 1, 2);
  }
  const auto read = reading(text);
  ASSERT_TRUE(read) << read.error().message << "\n" << text;
  EXPECT_TRUE(read->cameras[0].full_scale && read->projectors[0].throw_ratio && read->screen.known_length);
  EXPECT_EQ(read->board.kind, "chessboard");
  EXPECT_THAT(rig_text(rig, nullptr), HasSubstr("default: \"gamma:2.2\""));
}

TEST(Rig, SimulationReadsBackEqual) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "simulation.toml", simulation_text(full_simulation())));
  expect_equal(read_simulation(folder / "simulation.toml").value(), full_simulation());
  EXPECT_THAT(canonical_rig_text(full_rig()), Not(HasSubstr("simulation]")));
}

TEST(Rig, SimulatedLensIsCentredUnlessItSaysOtherwise) {
  TemporaryFolder folder;
  ASSERT_TRUE(write_atomically(folder / "s.toml",
                               "[simulation]\n[[simulation.camera]]\nid = \"c\"\nresolution = [640, 401]\n"));
  EXPECT_EQ(read_simulation(folder / "s.toml")->cameras[0].principal, (std::array<double, 2>{319.5, 200}));
}

// What a program puts together is held to the bounds of a file.
TEST(CheckValues, NamesTableSettingValueAndBound) {
  EXPECT_TRUE(check_values(full_simulation()));
  const auto complaint = [](auto change) {
    Simulation s = full_simulation();
    change(s);
    const auto checked = check_values(s);
    return checked ? std::string() : checked.error().message;
  };
  EXPECT_EQ(complaint([](Simulation& s) { s.cameras[0].veiling_glare = 1.5; }),
            "[[simulation.camera]] 'cam-a': veiling_glare = 1.5 must be at least 0 and at most 1 (share of the photo's "
            "mean light that lies over it)");
  EXPECT_THAT(complaint([](Simulation& s) { s.cameras[0].bayer = "XYZW"; }),
              AllOf(HasSubstr("bayer = \"XYZW\""), HasSubstr("use one of: none, RGGB")));
  EXPECT_THAT(complaint([](Simulation& s) { s.cameras[0].channels = 1, s.cameras[0].bayer = "RGGB"; }),
              HasSubstr("needs channels = 3, not 1"));
  EXPECT_THAT(complaint([](Simulation& s) {
                s.projectors[0].response_g = {0, .6, .5};
              }),
              AllOf(HasSubstr("'left'"), HasSubstr("response_g falls from 0.6 to 0.5 at its value 3")));
  EXPECT_THAT(complaint([](Simulation& s) { s.projectors[0].response_g = {.5}; }), HasSubstr("at least 2"));
  EXPECT_THAT(complaint([](Simulation& s) { s.projectors[0].response_g = std::vector<double>(5000, .5); }),
              HasSubstr("4096 are the most"));
  EXPECT_THAT(complaint([](Simulation& s) {
                s.projectors[0].native_resolution = {0, 300};
              }),
              HasSubstr("native_resolution = [0, 300]"));
  EXPECT_THAT(complaint([](Simulation& s) { s.projectors[0].refresh_hz = 0; }),
              HasSubstr("refresh_hz = 0.0 must be at least 1 and at most 1000"));
  EXPECT_THAT(complaint([](Simulation& s) { s.projectors[0].position[1] = std::nan(""); }),
              HasSubstr("must be finite"));
  EXPECT_THAT(complaint([](Simulation& s) {
                s.surfaces[3].elevation_deg = {0, 150};
              }),
              AllOf(HasSubstr("[[simulation.surface]] 'sphere'"), HasSubstr("at most 90")));
  EXPECT_THAT(complaint([](Simulation& s) { s.surfaces[0].albedo[2] = 1.2; }), HasSubstr("at most 1"));
  EXPECT_THAT(complaint([](Simulation& s) { s.samples = 0; }), HasSubstr("at least 16"));
}

}  // namespace
}  // namespace countershade

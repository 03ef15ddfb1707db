// rig.toml: what the operator writes (CONTRACT, `rig.toml`).
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"

namespace countershade {

struct CameraSpec {
  std::string id;
  // folder | simulated | aravis | v4l2 | libcamera | command
  std::string backend = "folder";
  // What the backend opens: a folder's path; of aravis serial number, address or name; of command what takes a photo.
  std::string device;
  std::filesystem::path model;       // .cameramodel, resolved against the rig's folder; empty = none
  std::string pose = "unknown";      // unknown | known (then the model's extrinsics count)
  std::vector<double> exposures_ms;  // empty = the backend's default
  std::string response = "linear";
  double pedestal = 0;               // stored value of no light
  std::optional<double> full_scale;  // stored value of saturation; default the file type's maximum
};

struct ProjectorSpec {
  std::string id;
  std::array<int, 2> resolution{0, 0};
  std::string output = "simulated";  // simulated | window | folder
  std::string monitor;
  std::string response = "gamma:2.2";
  double black_level = 0;
  std::optional<double> throw_ratio;  // distance / picture width
  double throw_ratio_sigma = 0.02;    // relative
  std::optional<std::array<double, 2>>
      lens_shift;  // offset of the picture's centre from the lens axis, in picture
                   // widths and heights, right and down positive; [0, 0] = axis through the centre
  double lens_shift_sigma = 0.02;
  std::filesystem::path model;  // .cameramodel of the projector; empty = estimated
};

struct ScreenSpec {
  std::string kind = "measured";     // measured | planes (others are refused by name until built)
  int planes = 0;                    // number of planes; 0 = found
  std::array<int, 2> patches{0, 0};  // {0, 0} = "auto"
  // Two camera pixels of the first camera and the distance of the screen points under them [m]; gives metres.
  struct KnownLength {
    std::array<double, 2> pixel_a, pixel_b;
    double metres;
  };
  std::optional<KnownLength> known_length;
};

struct BoardSpec {
  std::string kind;  // chessboard | apriltag | charuco; empty = no board
  std::array<int, 2> corners{9, 7};
  double square = 0.075;  // m
};

struct Rig {
  std::vector<CameraSpec> cameras;
  std::vector<ProjectorSpec> projectors;
  ScreenSpec screen;
  BoardSpec board;
  std::string target = "direct";  // [intent] direct (uniform is refused by name until built)

  const ProjectorSpec* projector(const std::string& id) const;
  const CameraSpec* camera(const std::string& id) const;
};

// ---- [simulation]: the truth of a room made of light that never was. Only the simulator reads it. ----

struct SimulatedCamera {
  std::string id;
  std::array<double, 3> position{0, 0, 0}, target{0, 0, 1};  // m, world: x right, y up, z to the audience
  double roll_deg = 0;
  std::array<int, 2> resolution{1920, 1200};
  int channels = 3;
  double focal_px = 1400;
  std::array<double, 2> principal{959.5, 599.5};
  std::array<double, 5> distortion{0, 0, 0, 0, 0};  // Brown-Conrady k1 k2 p1 p2 k3
  double full_well_e = 10000, read_noise_e = 5;
  int bits = 12;
  double white_level = 0.8;  // fraction of full scale that the brightest white reaches at reference_exposure_ms
  double reference_exposure_ms = 10;
  double psf_sigma_px = 0.6;
  double vignetting = 0;  // loss at the picture's corner, fraction
  // What a better camera does not do; off by default.
  std::filesystem::path lens{};    // .cameramodel whose lens replaces focal, principal and distortion; empty = these
  double veiling_glare = 0;        // share of the photo's mean light that lies over it
  std::string bayer = "none";      // none | RGGB | GRBG | GBRG | BGGR: colours of the first 2 x 2 pixels
  int hot_pixels = 0;              // pixels with a dark signal of their own, at fixed places
  double rolling_shutter_ms = 0;   // from the first row's start of exposure to the last row's
  double auto_exposure = 0;        // 0 = locked, 1 = always comes to a mean of 18 %, and says nothing
  double timestamp_offset_ms = 0;  // of the camera's clock
  double clock_drift_ppm = 0;      // how much faster the camera's clock runs
  std::string eye = "both";        // both | left | right: looks through that glass of shutter glasses
  double glasses_leak = 0;         // share of light that the glass lets through while it is closed
};

struct SimulatedProjector {
  std::string id;
  std::array<double, 3> position{0, 0, 0}, target{0, 0, 1};
  double roll_deg = 0;
  double throw_ratio = 1.2;
  std::array<double, 2> lens_shift{0, 0};
  double gain = 1;  // relative luminous power
  std::array<double, 3> gamma{2.2, 2.2, 2.2};
  double black_level = 0.001;  // 1 / contrast
  double falloff = 0.15;       // loss of illuminance at the picture's corner, fraction
  double defocus_sigma_px = 0.5;
  double latency_ms = 0;  // from show() to light, rounded up to the next refresh
  // What a better projector does not do; off by default.
  double aperture_mm = 0, focus_distance = 3;       // of a thin lens: blur beside the focal plane, m along the axis
  std::array<double, 5> distortion{0, 0, 0, 0, 0};  // Brown-Conrady k1 k2 p1 p2 k3
  std::vector<double> response_r{}, response_g{}, response_b{};    // light at equally spaced values; empty = gamma
  std::array<double, 9> colour_mixing{1, 0, 0, 0, 1, 0, 0, 0, 1};  // row by row: light <- light of the primaries
  double white_segment = 0;                                        // how much brighter grey is shown; white stays 1
  double flare = 0;                            // share of its light that lies evenly over the picture
  std::array<int, 2> native_resolution{0, 0};  // width, height [px]; {0, 0} = that of the pictures
  double warm_up = 0, warm_up_s = 600;         // share of light missing at first; time constant
  double colour_wheel_hz = 0;                  // turns; red, green, blue one after the other
  double pwm_hz = 0;                           // light pulses, on for the first half of each period
  double refresh_hz = 60;
  double latency_jitter_ms = 0;  // latency grows by up to that much, differently for each picture
  bool stereo = false;           // pictures for the left eye at even refreshes, for the right eye at odd ones
};

// One piece of a simulated room. World: x right, y up, z towards the audience; azimuth 0 looks along -z, 90 degrees
// along +x. The lit side of a rectangle is the one from which along_u leads right when along_v leads up.
struct SimulatedSurface {
  std::string id;
  std::string shape = "rectangle";  // rectangle | cylinder | cone | sphere | mesh
  // rectangle: corner u = v = 0; cylinder, cone: centre of the lower circle; sphere: centre; mesh: where its origin
  // lies
  std::array<double, 3> origin{0, 0, 0};
  std::array<double, 3> along_u{1, 0, 0}, along_v{0, 1, 0};  // rectangle: its sides [m]
  double radius = 2, top_radius = 1;                         // m; top_radius: cone
  double height = 2;                                         // m; cylinder, cone
  std::array<double, 2> azimuth_deg{-60, 60};                // part of the circle, from left to right seen from inside
  std::array<double, 2> elevation_deg{0, 90};                // sphere: part of the meridian
  std::string lit = "inside";                                // inside | outside: side of a round shape that is lit
  std::filesystem::path mesh;                                // OBJ or PLY, faces anticlockwise from the lit side
  double mesh_scale = 1;                                     // metres per unit of the file
  std::array<double, 3> albedo{0.8, 0.8, 0.8};
  double texture = 0;    // amplitude of a smooth albedo variation, fraction
  double patchwork = 0;  // amplitude of an albedo that differs from cell to cell, fraction
  std::array<int, 2> patchwork_cells{4, 3};
  double gloss = 0;                                // share of the reflected light in a GGX lobe
  double roughness = 0.4;                          // GGX alpha
  double directing = 0;                            // exponent of a light-directing screen; 0 = Lambertian
  std::array<double, 2> directing_tilt_deg{0, 0};  // of its axis from the normal, along u and v
  double transmission = 0;                         // rear projection: light that passes / light that is reflected
  double daylight = 0;                             // irradiance of a sunlit patch, 1 = reference irradiance
  std::array<double, 2> daylight_from{0.1, 0.1}, daylight_to{0.4, 0.5};  // its corners, (u, v)
};

struct Simulation {
  std::string room = "two-wall";  // what it is called in messages and reports; the surfaces say what it is
  double ambient = 0;             // radiance of the surround, fraction of reference white
  double ambient_swing = 0;       // share by which it swings: lamps on the mains
  double ambient_hz = 100;        // how often a second; twice the mains' frequency
  std::uint64_t seed = 1;
  int samples = 4096;  // strata, or rays, by which a receiving point looks at the room
  int block_px = 16;   // projector pixels per block of the indirect light
  std::vector<SimulatedSurface> surfaces;
  std::vector<SimulatedCamera> cameras;
  std::vector<SimulatedProjector> projectors;
};

// Reads and checks the whole file; unknown keys, wrong types, out-of-range values: kBadValue with file, line, value,
// bound, and the nearest valid key. Relative paths are resolved against the file's folder. format_version 1.
Result<Rig> read_rig(const std::filesystem::path& path);
// The [simulation] of the same file (or of a file that holds nothing else). kBadValue when there is none.
Result<Simulation> read_simulation(const std::filesystem::path& path);
// Whether every value is one that a file may hold, and no two contradict each other; the bounds of read_simulation.
// kBadValue names table, value, bound and meaning.
Result<void> check_values(const Simulation& simulation);
// Whether the file has a [simulation] table.
Result<bool> has_simulation(const std::filesystem::path& path);

// The commented rig file that `countershade new` writes: every field with unit and default; `simulation` may be null.
// Written values are read back equal (a round trip).
std::string rig_text(const Rig& rig, const Simulation* simulation);
// The same without comments or [simulation], canonical: what a session carries, equal rigs give equal bytes.
// Paths are written as they are given.
std::string canonical_rig_text(const Rig& rig);
std::string simulation_text(const Simulation& simulation);

}  // namespace countershade

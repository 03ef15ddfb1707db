// A session: what was shown, and the photos of it.
//
//   session/rig.toml          the operator's rig, canonical, without [simulation]; models copied into session/models/
//   session/simulation.toml   only for simulated sessions; read by the simulator alone
//   session/sequence.json     the frames in order (CONTRACT, `patterns/`)
//   session/photos/<camera>/0007.tif     stored values as the camera gave them
//   session/unused.json       where the photos show something else than the frames, e.g. marks of identity
//   session/unhealthy.json    which cameras failed or had to be asked again and again, while that is so
//   session/session.json      format_version
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "calib/base/result.h"
#include "calib/file/rig.h"
#include "calib/image/image.h"

namespace countershade {

// What a frame is. Only the fields of its kind are used:
//   white, black            every pixel at full / zero
//   gray                    axis x|y, bit (0 = least significant), inverse, cell_px (pixels per code cell, default 1)
//   xor                     a Gray bit in exclusive or with bit `base` of the same code: axis, bit, base, inverse,
//   cell_px phase                   axis, period_px, step, steps, shift_rad, shown_exponent blocks channel r|g|b|rgb,
//   cell_px, inverse, seed: pseudo-random blocks of cells, primary `channel` primary                 channel r|g|b|rgb
//   at full held-out                seed: a photo-like picture no fit has seen mask                    axis, cell_px,
//   step: stripes of cell_px pixels shifted by step * cell_px / 2, of verify
struct Role {
  std::string kind;
  std::string projector;  // lit projector; empty = all
  std::string axis = "x";
  int bit = 0, base = 0;
  bool inverse = false;
  int cell_px = 1;
  std::string channel = "rgb";
  int seed = 0;
  double period_px = 0;
  int step = 0, steps = 0;
  std::optional<double> shift_rad;
  double shown_exponent = 1;
  bool operator==(const Role&) const = default;
  std::string name() const;  // for messages: "gray x bit 9 inverse of left"
};

struct Frame {
  int index = 0;
  Role role;
};

// A square of every picture of a projector that holds a tag instead: it says which frame is shown (capture's
// identity.h).
struct IdentityMark {
  std::string projector;
  int x = 0, y = 0;  // first column and row
  int side_px = 0;
  bool operator==(const IdentityMark&) const = default;
};

struct Sequence {
  std::vector<std::pair<std::string, std::array<int, 2>>> projectors;  // id, resolution
  std::vector<Frame> frames;
  std::vector<IdentityMark> identity;  // empty: pictures are whole
};

// Per camera: polygons in its photos [px].
using UnusedParts = std::map<std::string, std::vector<std::vector<Eigen::Vector2d>>>;

// Errors: kBadFile with the frame's index for an unknown axis, a missing field, indices that repeat; marks of identity
// that leave the picture.
// Kinds of role that this program does not know are kept; who cannot use them skips them.
Result<Sequence> read_sequence(const std::filesystem::path& path);
std::string sequence_text(const Sequence& sequence);

// A session that has been opened. Photos are read when asked for.
class Session {
 public:
  // Checks that every frame of the sequence has a photo of every camera, of one size. Errors: kBadFile names the first
  // missing or unreadable photo and how many are missing.
  static Result<Session> open(const std::filesystem::path& folder);
  // One that is still being captured: photos may be missing.
  static Result<Session> open_unfinished(const std::filesystem::path& folder);
  const Rig& rig() const { return rig_; }
  const Sequence& sequence() const { return sequence_; }
  const std::filesystem::path& folder() const { return folder_; }
  // Linear photo of frame `index`: pedestal subtracted, response undone, 1 = full scale. Several exposures are merged,
  // in units of full scale at the camera's first listed exposure; valid where one of them is not saturated and the
  // session does not call it unused.
  Result<Photo> photo(const std::string& camera, int index) const;
  std::filesystem::path photo_path(const std::string& camera, int index) const;  // first exposure

 private:
  std::filesystem::path folder_;
  Rig rig_;
  Sequence sequence_;
  UnusedParts unused_;
};

// What a session folder begins with: rig.toml (lens models copied to models/<id>.cameramodel, a projector's to
// models/<id>.projector.cameramodel where a camera has the same id), simulation.toml where there is one, sequence.json,
// session.json, photos/. Errors: kBadFile (a model is missing), kIo.
Result<void> write_session_header(const std::filesystem::path& folder, const Rig& rig,
                                  const std::string& simulation_toml, const Sequence& sequence);

// Writes unused.json beside it. Errors: kIo.
Result<void> write_unused(const std::filesystem::path& folder, const UnusedParts& unused);

// The linear photo of one stored file of a camera. Invalid: a channel at 0.995 of full scale or more, or not finite. A
// float file has no full scale of its own: one that goes beyond 1 is saturated nowhere unless the camera states it.
Result<Photo> read_photo(const std::filesystem::path& path, const CameraSpec& camera);

}  // namespace countershade

// Which projector pixel is it: decoding of structured light (decode, beside encode in pattern.h).
#pragma once

#include <array>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/session.h"
#include "calib/image/image.h"
#include "calib/image/stored_photo.h"

namespace countershade::capture {

// Why a camera pixel has no projector pixel; written to reasons.json.
enum class Reason : std::uint8_t {
  kAccepted = 0,
  kDark = 1,  // white - black below what noise allows
  kSaturated = 2,
  kUncertainBit = 3,  // a bit and its inverse differ by less than noise allows
  kInconsistent = 4,  // the code leaves the projector, or disagrees with its neighbours
  kIsolated = 5,      // no accepted neighbour supports it
  kNoCode = 6,        // the sequence has no code of that axis for that projector
  kIndirect = 7,      // no fine stripe modulates it: this projector lights it only by way of other surfaces
  kPhase = 8,         // its sinusoids contradict each other: it sees two places at once, or something moved
  kEpipolar = 9,      // once it is known where the devices stand: its code is not on the line that its ray projects to
  kMixed = 10,        // it lies between two surfaces, and sees both
};
const std::map<int, std::string>& reason_names();

// Camera-sized maps. x, y [projector px], NaN where rejected or where the axis has no code; sigma [projector px];
// reason.
struct Correspondence {
  std::string camera, projector;
  std::array<int, 2> projector_resolution{0, 0};
  Image x, y, sigma;                  // (height, width, 1)
  Mask reason;                        // Reason, (height, width, 1)
  std::size_t lit = 0, accepted = 0;  // pixels that are neither dark nor lit indirectly only, and those decoded
  // Share of the lit pixels that each reason has rejected, where it has any; by name.
  std::map<std::string, double> rejected() const;
  // Share of the accepted pixels that are more than 1 px off, if their errors are normal with their sigma.
  double expected_wrong() const;
};

struct DecodeOptions {
  double min_snr = 3;             // a bit is certain when |bit - inverse| exceeds min_snr sigma of the difference
  double dark_fraction = 0.02;    // white - black below this fraction of its 99th percentile is dark
  double min_modulation = 0.04;   // ... and when it exceeds this fraction of white - black
  double fine_modulation = 0.15;  // direct light reaches at least this in one of the four finest stripes of an axis
};

// Decodes one camera's view of one projector while photos arrive, in any order: what a photo allows is done when it is
// added, and the photo is dropped. Photos may be bytes, 16-bit numbers or floats, and are read as they are.
// Results do not depend on the order, nor on who calls (decode_frames is this).
class Decoder {
 public:
  // Errors: kRefused when the sequence has no code for that projector, or lacks frames of it.
  static Result<Decoder> make(const Sequence& sequence, const std::string& camera, const std::string& projector,
                              const DecodeOptions& options);
  Decoder(Decoder&&) noexcept;
  Decoder& operator=(Decoder&&) noexcept;
  ~Decoder();
  // All frames that are read, in the order in which the fewest photos have to wait: levels, finest bits first.
  std::vector<int> frames() const;
  // Another photo of the same frame takes the place of one that has not been read yet; photos of other frames are
  // passed over. Error: kBadFile when photos differ in size.
  Result<void> add(int frame, std::shared_ptr<const StoredPhoto> photo);
  // Once, after all photos. Errors: kRefused as for decode, and when a photo is missing.
  Result<Correspondence> finish();

 private:
  struct State;
  explicit Decoder(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

// Gives the linear photo of a frame, by its index. Called from two threads at once.
using PhotoSource = std::function<Result<Photo>(int index)>;

// Decodes what the sequence has: Gray code with inverse, XOR codes (Gupta et al. 2011), sinusoids that share their
// band (micro phase shifting, Gupta & Nayar 2012) or climb down a ladder of periods, and a Gray code that sinusoids
// refine (read_phase).
//
// Gray code is read cell by cell; where exactly one bit is uncertain and both readings are neighbouring cells,
// the pixel lies on that edge. Coarse bits count only as far as light by way of other surfaces could not have made
// them. The position is then refined by a plane through the accepted neighbours that agree, so that quantisation
// averages out without bridging edges of the scene; pixels with more bits in doubt are completed where the plane and
// every certain bit agree. sigma includes what quantisation may hide from the plane, and the pull of brighter
// surroundings through lens blur. Memory: about 80 bytes per camera pixel, besides 64 bytes of photos that wait, or all
// sinusoids of an axis.
Result<Correspondence> decode_frames(const Sequence& sequence, const PhotoSource& photos, const std::string& camera,
                                     const std::string& projector, const DecodeOptions& options, Progress& progress);

// Decodes one camera's view of one projector. Errors: kRefused when the sequence has no code for that projector, or
// when not a single pixel is lit (names white and black levels seen, and what to check), or every white is saturated.
Result<Correspondence> decode(const Session& session, const std::string& camera, const std::string& projector,
                              const DecodeOptions& options, Progress& progress);

// <camera>-<projector>.exr (x, y, sigma, reason) and reasons.json.
Result<void> write_correspondence(const std::filesystem::path& folder, const Correspondence& correspondence);

// What was accepted (the code as a gradient, dimmed) and rejected (one colour per reason), as an 8-bit PNG.
Result<void> write_reason_picture(const std::filesystem::path& path, const Correspondence& correspondence);

}  // namespace countershade::capture

// Which projector pixel is it: decoding of structured light (decode, beside encode in pattern.h).
#pragma once

#include <functional>
#include <map>
#include <string>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "calib/file/session.h"
#include "calib/image/image.h"

namespace countershade::capture {

// Why a camera pixel has no projector pixel; written to reasons.json.
enum class Reason : std::uint8_t {
  kAccepted = 0,
  kDark = 1,           // white - black below what noise allows
  kSaturated = 2,
  kUncertainBit = 3,   // a bit and its inverse differ by less than noise allows
  kInconsistent = 4,   // the code leaves the projector, or disagrees with its neighbours
  kIsolated = 5,       // no accepted neighbour supports it
  kNoCode = 6,         // the sequence has no code of that axis for that projector
};
const std::map<int, std::string>& reason_names();

// Camera-sized maps. x, y [projector px], NaN where rejected or where the axis has no code; sigma [projector px]; reason.
struct Correspondence {
  std::string camera, projector;
  std::array<int, 2> projector_resolution{0, 0};
  Image x, y, sigma;  // (height, width, 1)
  Mask reason;        // Reason, (height, width, 1)
  std::size_t lit = 0, accepted = 0;  // pixels of the white-black mask, and those decoded
};

struct DecodeOptions {
  double min_snr = 4;         // a bit is certain when |bit - inverse| exceeds min_snr sigma of the difference
  double dark_fraction = 0.02;  // white - black below this fraction of its 99th percentile is dark
};

// Decodes one camera's view of one projector. Errors: kRefused when the sequence has no code for that projector, or
// when not a single pixel is lit (names white and black levels seen, and what to check), or every white is saturated.
Result<Correspondence> decode(const Session& session, const std::string& camera, const std::string& projector,
                              const DecodeOptions& options, Progress& progress);

Result<void> write_correspondence(const std::filesystem::path& folder, const Correspondence& correspondence);

}  // namespace countershade::capture

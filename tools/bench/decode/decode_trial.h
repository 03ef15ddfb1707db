// One code tried on one simulated rig: photos from the simulator, decoded, judged by the simulator's geometry.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "capture/pattern/decode.h"
#include "simdata/render/simulator.h"
#include "simdata/room/rooms.h"

namespace countershade::bench {

// A room whose projectors show codes to its first camera.
class DecodeRig {
 public:
  static Result<DecodeRig> make(const simdata::RigAndRoom& room, Progress& progress);
  const Rig& rig() const { return simulator_->rig(); }
  const simdata::TrueGeometry& truth() const { return truth_; }

  // Photos of `roles`, all of projector q, the others showing black; frame i is roles[i].
  struct Photos {
    Sequence sequence;
    std::vector<Photo> photos;
  };
  Result<Photos> photograph(int projector, const std::vector<Role>& roles) const;

 private:
  std::shared_ptr<simdata::Simulator> simulator_;
  simdata::TrueGeometry truth_;
};

// How good a decoded view is. Errors [projector px] are of single coordinates.
struct DecodeScore {
  double visible = 0, covered = 0;  // pixels whose centre the projector lights; those of them that were accepted
  double accepted = 0;              // all that were
  double wrong = 0;  // accepted and more than 1 px off in x or y, or not lit; what the picture's border lights in part
                     // is judged by its lit neighbours
  double rms = 0, bias = 0;  // over right ones; of the means of 16 x 16 pixels, their own noise taken off
  double random = 0;         // rms of what is left: rms^2 = bias^2 + random^2
  double z2 = 0;             // mean squared error over predicted variance
  double coverage() const { return covered / visible; }
  double wrong_share() const { return wrong / accepted; }
};
DecodeScore score_decode(const simdata::TrueGeometry& truth, int projector, const capture::Correspondence& c);

// White and black of a projector, then a code.
Result<std::vector<Role>> roles_of(const std::string& code, const ProjectorSpec& projector, bool levels);

// What fixed thresholds make of Gray code with inverse: |bit - inverse| > 5 and white - black > 40 of 255 (the defaults
// of OpenCV's structured_light), nothing else.
Result<capture::Correspondence> decode_by_fixed_thresholds(const DecodeRig::Photos& photos,
                                                           const ProjectorSpec& projector);

}  // namespace countershade::bench

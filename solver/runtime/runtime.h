// The GL compensation runtime: the frame of solver/compensate on OpenGL 4.3 compute, headless (EGL) or in a window.
#pragma once

#include <memory>
#include <span>

#include "solver/compensate/compensate.h"

namespace countershade::solver {

// A GL context without a window (EGL surfaceless, else the device platform). Current on the thread that made it.
class HeadlessContext {
 public:
  // Errors: kDevice with what EGL or GL said, and the version found when it is below 4.3.
  static Result<std::unique_ptr<HeadlessContext>> make();
  virtual ~HeadlessContext() = default;
  virtual std::string description() const = 0;  // renderer and version
};

enum class Precision { kHalf, kFloat };  // of the stored form factors

// Needs a current context (headless, or a window's) wherever it is made, used or destroyed; binds what it uses and
// leaves it bound. The solver decides on the GPU as the CPU reference does (copy, closed form, clipped), without a
// readback; gathers beyond what the model's contraction can need are not even queued.
class Runtime {
 public:
  // Uploads the model and keeps no reference to it. Errors: kDevice: shader errors with file, line and driver string;
  // limits exceeded; kUnsupported: more than 16 projectors or 32 surfaces.
  static Result<std::unique_ptr<Runtime>> make(const Model& model, const CompensateOptions& options,
                                               Precision precision);
  virtual ~Runtime() = default;
  // Sends pictures[q] to the GPU (empty = black), runs reduce, gather(s), pixel step. Does not wait. kBadValue: a size.
  virtual Result<void> render(std::span<const Picture> pictures) = 0;
  // The solver of later frames, in place of the options' one; kCopy shows the pictures as they are.
  virtual void choose(SolverChoice solver) = 0;
  // Texture (RGBA16) that holds the picture of projector q to show.
  virtual unsigned output_texture(int q) const = 0;
  // Reads the result back (waits).
  virtual Result<Compensated> read() = 0;
  // Patch-level results for tests: indirect light at the receivers of the last frame, (R, 3).
  virtual Result<Radiosity> read_receiver_indirect() = 0;
  // The paper's Algorithm 2 and the closed form as patch-level GL solves, for the speed study: runs `passes` passes of
  // H levels (H = 0: one closed-form gather) on the last frame's target, and returns the direct light (P, 3).
  virtual Result<Radiosity> solve_patches(int H, int passes) = 0;
};

}  // namespace countershade::solver

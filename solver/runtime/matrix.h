// Form factors in GL buffers, and the gather that reads them.
#pragma once

#include <vector>

#include "solver/compensate/gather.h"
#include "solver/runtime/gl_objects.h"
#include "solver/runtime/runtime.h"

namespace countershade::solver {

// Modes of gather.comp.
enum class GatherMode { kStore = 0, kAdd = 1, kSubtract = 2, kClip = 3 };

struct GatherCall {
  GatherMode mode = GatherMode::kStore;
  const Buffer* input = nullptr;
  const Buffer* output = nullptr;  // not the input
  const Buffer* base = nullptr;    // kAdd, kSubtract, kClip
  int iteration = 0;               // kClip
  float tolerance = 0, invisible = 0;
};

// F or G in as many buffers of at most block_bytes (the driver's limit) as it takes. low, high and state are bound by
// the caller.
class GlMatrix {
 public:
  static Result<GlMatrix> make(const std::string& what, const Eigen::MatrixXf& F, const Radiosity& k,
                               const std::vector<RowBand>& bands, Precision precision, std::size_t block_bytes);
  void run(const Program& gather, const GatherCall& call) const;

 private:
  struct Chunk {
    Buffer words;
    int row = 0, rows = 0, stride = 0, pairs = 0, skip = 0, skipped = 0;
  };
  int columns_ = 0;
  float unscale_ = 1;
  Buffer gain_;
  std::vector<Chunk> chunks_;
};

// (n, 3) -> n vec4.
std::vector<float> as_vec4(const Radiosity& values);
Radiosity from_vec4(const std::vector<float>& values);

}  // namespace countershade::solver

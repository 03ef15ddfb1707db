// Pictures in, pictures to show out: loading, compensating on GL (or on the CPU where there is no GL), writing.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/file/file.h"
#include "solver/compensate/compensate.h"

namespace countershade::tools {

// "file.png" or "left=file.png".
struct NamedPicture {
  std::string id;  // empty = none given
  std::filesystem::path file;
};
NamedPicture parse_named_picture(const std::string& text);

// Pictures per projector of the model, empty where none is named. Linear EXR (1 = the projector's white) is encoded by
// the projector's response. Errors: kBadValue for an unknown id, a picture without an id, a size that is not the
// projector's.
Result<std::vector<Picture>> load_pictures(const solver::Model& model, const std::vector<std::string>& named);

// The fixed test picture `name` on every projector, encoded by the projector's own response.
Result<std::vector<Picture>> test_pictures(const solver::Model& model, const std::string& name);

enum class Engine { kAuto, kGl, kCpu };
struct Show {
  std::vector<Picture> plain;  // what was asked for
  solver::Compensated compensated;
  std::string engine;  // "GL: <renderer>" or "CPU"
  double milliseconds = 0;
};
// kAuto: GL where a context of version 4.3 can be made, else the CPU (and a note that says so). kGl: kDevice without
// one.
Result<Show> compensate_show(const solver::Model& model, std::span<const Picture> pictures,
                             const solver::CompensateOptions& options, Engine engine, Progress& progress);

// Writes <id>.png for every projector; the folder appears whole.
Result<void> write_show(const solver::Model& model, const Show& show, int bits, const std::filesystem::path& folder,
                        const FillFolder& record = {});

}  // namespace countershade::tools

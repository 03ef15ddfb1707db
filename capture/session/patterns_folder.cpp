// write_patterns: the pictures of a sequence as files, for whoever shows and photographs them by hand.
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

Result<void> write_frame(const Sequence& sequence, const Frame& frame, const fs::path& folder) {
  std::error_code reason;
  fs::create_directories(folder, reason);
  if (reason)
    return error(ErrorCode::kIo, "folder '{}' cannot be created: {}; check the disk and its permissions",
                 folder.string(), reason.message());
  for (const auto& [id, size] : sequence.projectors) {
    CS_TRY(const Picture picture, render_role(frame.role, id, size[0], size[1]));
    CS_TRY_VOID(write_picture(folder / (id + ".png"), picture, 8));
  }
  return {};
}

}  // namespace

Result<void> write_patterns(const Sequence& sequence, const fs::path& folder, const FillFolder& record) {
  return create_folder_atomically(
      folder,
      [&](const fs::path& draft) -> Result<void> {
        for (const Frame& frame : sequence.frames)
          CS_TRY_VOID(write_frame(sequence, frame, draft / fmt::format("{:04}", frame.index)));
        return write_atomically(draft / "sequence.json", sequence_text(sequence));
      },
      record);
}

}  // namespace countershade::capture

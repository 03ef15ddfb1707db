// write_patterns: the pictures of a sequence as files, for whoever shows and photographs them by hand.
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/pattern/identity.h"
#include "capture/pattern/pattern.h"

namespace countershade::capture {

namespace fs = std::filesystem;

namespace {

Result<void> write_frame(const Sequence& sequence, int position, const fs::path& folder) {
  std::error_code reason;
  fs::create_directories(folder, reason);
  if (reason)
    return error(ErrorCode::kIo, "folder '{}' cannot be created: {}; check the disk and its permissions",
                 folder.string(), reason.message());
  for (int q = 0; q < static_cast<int>(sequence.projectors.size()); ++q) {
    const auto& [id, size] = sequence.projectors[q];
    CS_TRY(Picture picture, render_role(sequence.frames[position].role, id, size[0], size[1]));
    if (!sequence.identity.empty()) draw_identity(sequence, q, position, picture);
    CS_TRY_VOID(write_picture(folder / (id + ".png"), picture, 8));
  }
  return {};
}

}  // namespace

Result<void> write_patterns(const Sequence& sequence, const fs::path& folder, const FillFolder& record) {
  return create_folder_atomically(
      folder,
      [&](const fs::path& draft) -> Result<void> {
        for (int i = 0; i < static_cast<int>(sequence.frames.size()); ++i)
          CS_TRY_VOID(write_frame(sequence, i, draft / fmt::format("{:04}", sequence.frames[i].index)));
        return write_atomically(draft / "sequence.json", sequence_text(sequence));
      },
      record);
}

}  // namespace countershade::capture

// Photos of a calibration board: which files, what is in them.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "calib/base/progress.h"
#include "tools/report/lens_page.h"

namespace countershade::tools {

struct LensPhotos {
  Board board;
  bool recognised = false;        // nobody said which board it is
  std::vector<LensPhoto> photos;  // all files; those with a board have a view
  solver::BoardViews data;
  std::vector<std::string> notes;
};

// Picture files of folders (by extension, sorted by name; others are passed over) and single files, in that order.
// Errors: kBadFile for what is not there, for an empty folder, and for a single file that is no picture.
Result<std::vector<std::filesystem::path>> list_photos(const std::vector<std::filesystem::path>& inputs);

// Looks for the board in every photo. Without one given it is recognised in the photos. A file that repeats another
// byte for byte is left out: the same noise twice would pass for two measurements. Errors: kBadFile for photos of
// different sizes (which, how many of each); kRefused where no board is recognised.
Result<LensPhotos> find_boards(const std::vector<std::filesystem::path>& files, const std::optional<Board>& board,
                               Progress& progress);

}  // namespace countershade::tools

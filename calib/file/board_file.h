// Boards to print: true to scale, with a ruler beside them that shows whether the printer kept it.
#pragma once

#include <filesystem>
#include <string>

#include "calib/geometry/board.h"

namespace countershade {

// A sheet of paper, upright or lying, as it is printed on.
struct Sheet {
  std::string paper;  // "A4" to "A0"
  double width_mm = 0, height_mm = 0;
};

// The smallest sheet that holds the board with a margin and the ruler, or the named one. Errors: kBadValue for an
// unknown paper (and the nearest one), and for a board that is too large for it, with the largest square that fits.
Result<Sheet> sheet_for(const Board& board, const std::string& paper = "");

// .pdf (vectors, asks viewers not to scale) or .png (10 pixels per mm, 5 on paper larger than A3), by the extension;
// kBadValue for another. The same board gives the same bytes.
Result<Sheet> write_board(const std::filesystem::path& path, const Board& board, const std::string& paper = "");

}  // namespace countershade

#include "calib/file/board_file.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/file/file.h"
#include "calib/file/nearest.h"
#include "calib/image/image_file.h"

namespace countershade {

namespace {

constexpr double kMargin = 10;  // mm; the white around the print that detectors need, and printers leave
constexpr double kFoot = 12;    // mm at the lower edge for ruler and text
constexpr double kRuler = 100;  // mm
constexpr double kPointsPerMm = 72 / 25.4;

// Upright.
const std::vector<Sheet> kPapers = {
    {"A4", 210, 297}, {"A3", 297, 420}, {"A2", 420, 594}, {"A1", 594, 841}, {"A0", 841, 1189}};

// Black areas on the sheet in mm, from its upper left corner: x, y, width, height.
struct Bar {
  double x, y, width, height;
};

std::vector<Bar> bars_of(const Board& board, const Sheet& sheet) {
  const BoardPattern pattern(board);
  const Rectangle print = pattern.extent();
  const Eigen::Vector2d size = 1000 * (print.high - print.low);
  const Eigen::Vector2d origin((sheet.width_mm - size.x()) / 2, (sheet.height_mm - kFoot - size.y()) / 2);
  std::vector<Bar> bars;
  for (const Rectangle& r : pattern.dark_rectangles()) {
    const Eigen::Vector2d low = origin + 1000 * (r.low - print.low), edge = 1000 * (r.high - r.low);
    bars.push_back({low.x(), low.y(), edge.x(), edge.y()});
  }
  const double base = sheet.height_mm - 6;
  bars.push_back({kMargin, base, kRuler, 0.3});
  for (int i = 0; i <= 10; ++i)
    bars.push_back({kMargin + i * kRuler / 10 - 0.1, base - (i % 5 == 0 ? 3 : 2), 0.2, i % 5 == 0 ? 3.0 : 2.0});
  return bars;
}

std::string foot_of(const Board& board) {
  return fmt::format("{}   print at 100 %: the ruler must be {:g} mm long", board.name(), kRuler);
}

std::string pdf_of(const Board& board, const Sheet& sheet) {
  std::string drawing = fmt::format("{:.6f} 0 0 {:.6f} 0 0 cm 0 g\n", kPointsPerMm, kPointsPerMm);
  for (const Bar& b : bars_of(board, sheet))  // y goes up in a PDF
    drawing +=
        fmt::format("{:.4f} {:.4f} {:.4f} {:.4f} re\n", b.x, sheet.height_mm - b.y - b.height, b.width, b.height);
  drawing += fmt::format("f\nBT /F 3 Tf {:.4f} 5.2 Td ({}) Tj ET\n", kMargin + kRuler + 4, foot_of(board));
  const std::string objects[] = {
      "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
      "<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
      fmt::format(
          "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.4f} {:.4f}] /Contents 4 0 R /Resources << /Font << /F 5 "
          "0 R >> >> >>",
          sheet.width_mm * kPointsPerMm, sheet.height_mm * kPointsPerMm),
      fmt::format("<< /Length {} >>\nstream\n{}endstream", drawing.size(), drawing),
      "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>"};
  std::string pdf = "%PDF-1.7\n", places = "0000000000 65535 f \n";
  int number = 0;
  for (const std::string& object : objects) {
    places += fmt::format("{:010} 00000 n \n", pdf.size());
    pdf += fmt::format("{} 0 obj\n{}\nendobj\n", ++number, object);
  }
  return pdf + fmt::format("xref\n0 {0}\n{1}trailer\n<< /Size {0} /Root 1 0 R >>\nstartxref\n{2}\n%%EOF\n", number + 1,
                           places, pdf.size());
}

// Share of the pixel [at, at + 1) that [low, high) covers.
double covered(int at, double low, double high) {
  return std::max(0.0, std::min(at + 1.0, high) - std::max(static_cast<double>(at), low));
}

Image picture_of(const Board& board, const Sheet& sheet) {
  const double scale = sheet.width_mm * sheet.height_mm > 130'000 ? 5 : 10;  // pixels per mm
  Image page(static_cast<int>(std::lround(sheet.width_mm * scale)),
             static_cast<int>(std::lround(sheet.height_mm * scale)), 1, 255);
  for (const Bar& b : bars_of(board, sheet)) {
    const double x0 = b.x * scale, x1 = (b.x + b.width) * scale, y0 = b.y * scale, y1 = (b.y + b.height) * scale;
    for (int y = static_cast<int>(y0); y < std::min<double>(page.height(), y1); ++y)
      for (int x = static_cast<int>(x0); x < std::min<double>(page.width(), x1); ++x)
        page.at(x, y) -= static_cast<float>(255 * covered(x, x0, x1) * covered(y, y0, y1));
  }
  cv::Mat view(page.height(), page.width(), CV_32F, page.data().data());
  cv::putText(view, foot_of(board),
              {static_cast<int>((kMargin + kRuler + 4) * scale), page.height() - static_cast<int>(5.2 * scale)},
              cv::FONT_HERSHEY_SIMPLEX, 0.09 * scale, cv::Scalar(0), 2, cv::LINE_AA);
  return page;
}

}  // namespace

Result<Sheet> sheet_for(const Board& board, const std::string& paper) {
  std::vector<std::string> names;
  for (const Sheet& s : kPapers) names.push_back(s.paper);
  std::string wanted = paper;
  for (char& c : wanted) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  if (!wanted.empty() && std::find(names.begin(), names.end(), wanted) == names.end())
    return error(ErrorCode::kBadValue, "paper '{}' is not known, the nearest is {}; papers: {}", paper,
                 nearest(wanted, names), fmt::join(names, ", "));
  const Rectangle print = BoardPattern(board).extent();
  const Eigen::Vector2d size = 1000 * (print.high - print.low);
  double fits = 0;  // how much smaller it would have to be
  for (const Sheet& upright : kPapers) {
    if (!wanted.empty() && upright.paper != wanted) continue;
    for (const Sheet& s : {upright, Sheet{upright.paper, upright.height_mm, upright.width_mm}}) {
      fits = std::min((s.width_mm - 2 * kMargin) / size.x(), (s.height_mm - 2 * kMargin - kFoot) / size.y());
      if (fits >= 1 - 1e-9) return s;
    }
    const double other =
        std::min((upright.width_mm - 2 * kMargin) / size.x(), (upright.height_mm - 2 * kMargin - kFoot) / size.y());
    fits = std::max(fits, other);
  }
  return error(
      ErrorCode::kBadValue,
      "board {} is {:.0f} x {:.0f} mm and does not fit on {} with a margin of {:g} mm; take squares of at most "
      "{:.1f} mm, fewer squares, or {}",
      board.name(), size.x(), size.y(), wanted.empty() ? "A0" : wanted, kMargin,
      std::floor(10 * fits * 1000 * board.square) / 10, wanted.empty() ? "a print shop" : "larger paper");
}

Result<Sheet> write_board(const std::filesystem::path& path, const Board& board, const std::string& paper) {
  const std::string extension = path.extension().string();
  if (extension != ".pdf" && extension != ".png")
    return error(ErrorCode::kBadValue, "'{}': a board is written as .pdf or .png, not '{}'", path.string(), extension);
  CS_TRY(const Sheet sheet, sheet_for(board, paper));
  const bool vectors = extension == ".pdf";
  CS_TRY_VOID(vectors ? write_atomically(path, pdf_of(board, sheet)) : write_png8(path, picture_of(board, sheet)));
  return sheet;
}

}  // namespace countershade

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "calib/file/board_file.h"
#include "calib/file/file.h"
#include "tools/countershade/verbs.h"
#include "tools/job/lens/lens_calibration.h"
#include "tools/job/lens/lens_photos.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

struct Options {
  std::vector<fs::path> photos;
  fs::path out;
  std::string board, paper;
  CLI::Option* board_option = nullptr;
};

std::string padded(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::size_t> width;
  for (const auto& row : rows)
    for (std::size_t i = 0; i < row.size(); ++i) {
      width.resize(std::max(width.size(), row.size()));
      width[i] = std::max(width[i], row[i].size());
    }
  std::string text;
  for (const auto& row : rows) {
    std::string line;
    for (std::size_t i = 0; i < row.size(); ++i) line += fmt::format("{:<{}}  ", row[i], width[i]);
    text += line.substr(0, line.find_last_not_of(' ') + 1) + "\n";
  }
  return text;
}

std::string text_of(const LensReport& r, const LensFiles& files) {
  std::vector<std::vector<std::string>> table = ladder_rows(r.choice);
  table.insert(table.begin(), ladder_columns());
  std::string text = padded(table) + r.choice.reason + "\n\n";
  text += fmt::format(
      "views                {} of {} photos, {:.0f} % of the picture covered\nfocal length         {:.2f} {:.2f} px, "
      "one "
      "sigma {:.3f} %\nresidual             {:.4f} px rms, held-out {:.4f} px\nuncertainty          {:.3f} px in the "
      "middle, {:.3f} px in the worst corner, of directions; {:.3f} and {:.3f} px as far as the board\n",
      r.data.views.size(), r.photos.size(), 100 * r.views.covered, r.fit().lens.intrinsics()[0],
      r.fit().lens.intrinsics()[1], 100 * r.focal_sigma, r.fit().rms_px, r.choice.rung().held_out_px, r.far.centre,
      r.far.worst, r.near.centre, r.near.worst);
  if (r.halves)
    text += fmt::format("two halves           differ by {:.3f} px rms, noise alone predicts {:.3f}\n", r.halves->rms_px,
                        r.halves->predicted_rms_px);
  for (const std::string& note : r.notes) text += "note: " + note + "\n";
  for (const std::string& advice : r.views.advice) text += "better: " + advice + "\n";
  return text + fmt::format("wrote {} and {}\n", files.model.string(), (files.folder / "lens.html").string());
}

Result<Answer> print_board(const Options& options) {
  // `--board board.pdf` asks for the default board in that file.
  const bool names_file = options.board.ends_with(".pdf") || options.board.ends_with(".png");
  if (names_file && !options.out.empty())
    return error(ErrorCode::kBadValue, "--board {} and -o {} both name a file; which board is it to be?", options.board,
                 options.out.string());
  Board board;
  if (!options.board.empty() && !names_file) {
    CS_TRY(board, parse_board(options.board));
  }
  const fs::path out = names_file ? fs::path(options.board) : options.out.empty() ? "board.pdf" : options.out;
  if (fs::exists(out))
    return error(ErrorCode::kExists, "'{}' exists already; choose another name with -o or remove it", out.string());
  CS_TRY(const Sheet sheet, write_board(out, board, options.paper));
  const nlohmann::json document = {{"board", board.name()}, {"file", out.string()}, {"paper", sheet.paper}};
  return Answer{
      fmt::format("wrote {}: {} on {}\nprint at 100 %, measure the ruler, glue it on something flat and rigid\nnext: "
                  "take 15 to 30 photos, then countershade lens photos/ --board {} -o camera.cameramodel\n",
                  out.string(), board.name(), sheet.paper, board.name()),
      document.dump() + "\n"};
}

Result<Answer> run_lens(const Options& options, const Context& context) {
  if (options.photos.empty()) {
    if (options.board_option->count() == 0)
      return error(ErrorCode::kBadValue,
                   "no photos given; `countershade lens photos/ -o camera.cameramodel` calibrates, `countershade lens "
                   "--board` writes a board to print");
    return print_board(options);
  }
  if (!options.paper.empty())
    return error(ErrorCode::kBadValue, "--paper {} is for a board to print; leave it out, or the photos",
                 options.paper);
  LensOptions lens_options;
  if (!options.board.empty()) {
    CS_TRY(lens_options.board, parse_board(options.board));
  }
  const LensFiles files = lens_files(options.out.empty() ? "camera.cameramodel" : options.out);
  CS_TRY(const LensReport report, calibrate_lens(options.photos, files.model, lens_options, *context.progress));
  CS_TRY(const std::vector<fs::path> inputs, list_photos(options.photos));
  CS_TRY_VOID(context.record(files.folder, inputs));
  for (const std::string& warning : report.warnings) context.progress->warn(warning);
  return Answer{text_of(report, files), lens_json(report)};
}

}  // namespace

void add_lens(CLI::App& app, Action& action) {
  auto* verb = app.add_subcommand("lens", "a camera's lens from photos of a board; --board writes a board to print");
  auto options = std::make_shared<Options>();
  verb->add_option("photos", options->photos, "photos of the board, or folders of them; none: write a board to print");
  verb->add_option("-o,--output", options->out,
                   "camera model to write [camera.cameramodel], or board to print, .pdf or .png [board.pdf]");
  options->board_option =
      verb->add_option("--board", options->board,
                       "the board in the photos (not given: recognised), or to print (apriltag:10x7:25mm):\n"
                       "chessboard:COLUMNSxROWS:SQUARE, inner corners\n"
                       "apriltag:COLUMNSxROWS:SQUARE[:TAG], squares; AprilTags 36h11 in the white ones\n"
                       "charuco:COLUMNSxROWS:SQUARE[:MARKER[:4x4|5x5|6x6]], squares; lengths as 25mm, 2.5cm, .025m")
          ->expected(0, 1);
  verb->add_option("--paper", options->paper, "paper for a board to print, A4 to A0 [the smallest that holds it]");
  verb->callback([options, &action] { action = [options](const Context& c) { return run_lens(*options, c); }; });
}

}  // namespace countershade::tools

#include "tools/job/lens/lens_photos.h"

#include <algorithm>
#include <atomic>
#include <map>

#include "calib/base/parallel.h"
#include "calib/file/file.h"
#include "calib/image/image_file.h"
#include "capture/board/detect.h"
#include "tools/report/picture.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

constexpr int kThumbnail = 320;  // px
constexpr int kTriedForRecognition = 8;

bool is_picture(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const std::vector<std::string> known = {".png", ".jpg", ".jpeg", ".tif",  ".tiff", ".bmp",
                                          ".exr", ".pgm", ".ppm",  ".webp", ".jp2"};
  return std::find(known.begin(), known.end(), extension) != known.end();
}

Result<std::vector<fs::path>> pictures_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code code;
  for (const auto& entry : fs::directory_iterator(folder, code))
    if (is_picture(entry.path()) && entry.path().filename().string().front() != '.') files.push_back(entry.path());
  if (code) return error(ErrorCode::kIo, "cannot read folder '{}': {}", folder.string(), code.message());
  if (files.empty())
    return error(ErrorCode::kBadFile,
                 "folder '{}' holds no photos (png, jpg, tif, exr, ...); give the folder with photos of the board",
                 folder.string());
  std::sort(files.begin(), files.end());
  return files;
}

struct Seen {
  int width = 0, height = 0;
  std::string hash, thumbnail;
  capture::Detection detection;
};

std::string thumbnail_of(const StoredImage& image) {
  const Image small = reduced_to(image.values, kThumbnail);
  Image rgb(small.width(), small.height(), 3);
  for (int y = 0; y < rgb.height(); ++y)
    for (int x = 0; x < rgb.width(); ++x)
      for (int c = 0; c < 3; ++c)
        rgb.at(x, y, c) = static_cast<float>(255 / image.full_scale) * small.at(x, y, small.channels() == 3 ? c : 0);
  const Result<std::string> png = png_bytes(rgb);
  return png ? *png : "";
}

Seen look_at(const fs::path& file, const Board& board) {
  Seen seen;
  const Result<StoredImage> image = read_image(file);
  if (!image) {
    seen.detection.reason = "not a picture that can be read; remove or replace it";
    return seen;
  }
  seen.width = image->values.width(), seen.height = image->values.height();
  if (const Result<std::string> hash = hash_file(file)) seen.hash = *hash;
  seen.detection = capture::detect_board(image->values, board);
  if (!seen.detection.found) seen.thumbnail = thumbnail_of(*image);
  return seen;
}

// The board that most of the first photos show; of two equals the larger one.
Result<Board> recognise(const std::vector<fs::path>& files, Progress& progress) {
  std::map<std::string, std::pair<int, Board>> votes;
  const int tried = std::min<int>(kTriedForRecognition, static_cast<int>(files.size()));
  progress.step("recognise the board", 0, tried);
  int rows = 0;
  for (int i = 0; i < tried; ++i) {
    // Spread over the whole series: the first photos are often the worst.
    const Result<StoredImage> image = read_image(files[static_cast<std::size_t>(i) * files.size() / tried]);
    const std::optional<Board> found = image ? capture::recognise_board(image->values) : std::nullopt;
    if (found) {
      Board key = *found;
      if (key.kind != BoardKind::kChessboard) key.rows = 3;  // rows show only as far as tags are seen
      auto& [count, board] = votes.try_emplace(key.name(), 0, *found).first->second;
      ++count;
      if (found->points() > board.points()) board = *found;
      rows = std::max(rows, found->rows);
    }
    progress.step("recognise the board", i + 1, tried);
  }
  if (votes.empty())
    return error(
        ErrorCode::kRefused,
        "no chessboard and no AprilTag board was recognised in {} photos (of {}); say which board it is, such as "
        "--board chessboard:9x7:75mm, and see that it is sharp and lit",
        tried, files.size());
  return std::max_element(votes.begin(), votes.end(),
                          [](const auto& a, const auto& b) { return a.second.first < b.second.first; })
      ->second.second;
}

Result<void> check_sizes(const std::vector<fs::path>& files, const std::vector<Seen>& seen) {
  std::map<std::pair<int, int>, std::vector<std::string>> sizes;
  for (std::size_t i = 0; i < files.size(); ++i)
    if (seen[i].width > 0) sizes[{seen[i].width, seen[i].height}].push_back(files[i].filename().string());
  if (sizes.size() < 2) return {};
  std::vector<std::string> lines;
  for (const auto& [size, names] : sizes)
    lines.push_back(fmt::format("{} of {} x {} ('{}'{})", names.size(), size.first, size.second, names.front(),
                                names.size() > 1 ? ", ..." : ""));
  return error(ErrorCode::kBadFile,
               "the photos have different sizes: {}; all must come from one camera at one resolution, "
               "none turned or cut",
               fmt::join(lines, ", "));
}

// Names that tell the files apart: their paths below the folder that holds them all.
std::vector<std::string> names_of(const std::vector<fs::path>& files) {
  fs::path common = files.front().parent_path();
  for (const fs::path& file : files)
    while (!common.empty() && *file.lexically_relative(common).begin() == "..")
      common = common.has_parent_path() && common != common.parent_path() ? common.parent_path() : fs::path();
  std::vector<std::string> names;
  for (const fs::path& file : files)
    names.push_back(common.empty() ? file.string() : file.lexically_relative(common).string());
  return names;
}

}  // namespace

Result<std::vector<fs::path>> list_photos(const std::vector<fs::path>& inputs) {
  std::vector<fs::path> files;
  for (const fs::path& input : inputs) {
    if (fs::is_directory(input)) {
      CS_TRY(const std::vector<fs::path> found, pictures_in(input));
      files.insert(files.end(), found.begin(), found.end());
    } else if (!fs::exists(input)) {
      return error(ErrorCode::kBadFile, "'{}' does not exist; give photos or a folder of photos", input.string());
    } else if (!is_picture(input) || !read_image(input)) {
      return error(ErrorCode::kBadFile, "'{}' is not a picture that can be read; give photos (png, jpg, tif, exr, ...)",
                   input.string());
    } else {
      files.push_back(input);
    }
  }
  return files;
}

Result<LensPhotos> find_boards(const std::vector<fs::path>& files, const std::optional<Board>& board,
                               Progress& progress) {
  LensPhotos result;
  result.recognised = !board;
  if (board) {
    result.board = *board;
  } else {
    CS_TRY(result.board, recognise(files, progress));
  }
  std::vector<Seen> seen(files.size());
  std::atomic<int> done = 0;
  progress.step("find the board", 0, static_cast<double>(files.size()));
  parallel_for(static_cast<int>(files.size()), [&](int i) {
    seen[i] = look_at(files[i], result.board);
    progress.step("find the board", ++done, static_cast<double>(files.size()));
  });
  CS_TRY_VOID(check_sizes(files, seen));
  result.data.board = result.board;
  const std::vector<std::string> photo_names = names_of(files);
  std::map<std::string, std::string> names;  // by hash
  for (std::size_t i = 0; i < files.size(); ++i) {
    LensPhoto photo{photo_names[i],   seen[i].detection.found, seen[i].detection.reason, seen[i].detection.seen, 0, -1,
                    seen[i].thumbnail};
    if (seen[i].width > 0) result.data.width = seen[i].width, result.data.height = seen[i].height;
    if (photo.found) {
      const auto [first, fresh] = names.emplace(seen[i].hash, photo.name);
      if (fresh) {
        photo.view = static_cast<int>(result.data.views.size());
        result.data.views.push_back(seen[i].detection.q_px);
      } else {
        result.notes.push_back(
            fmt::format("'{}' is the same file as '{}' and was left out", photo.name, first->second));
      }
    }
    result.photos.push_back(std::move(photo));
  }
  return result;
}

}  // namespace countershade::tools

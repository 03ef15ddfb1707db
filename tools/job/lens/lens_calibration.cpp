#include "tools/job/lens/lens_calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "calib/file/file.h"
#include "solver/fit/lens/model_file.h"
#include "tools/job/lens/lens_photos.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using solver::BoardViews;
using solver::LensUncertainty;

constexpr int kMapColumns = 12, kMapRows = 9;
constexpr int kLeastForHalves = 2 * solver::kLeastViews;

// Middles of the cells of a map.
std::vector<Eigen::Vector2d> middles(int width, int height) {
  std::vector<Eigen::Vector2d> q;
  for (int j = 0; j < kMapRows; ++j)
    for (int i = 0; i < kMapColumns; ++i)
      q.emplace_back((i + 0.5) * width / kMapColumns - 0.5, (j + 0.5) * height / kMapRows - 0.5);
  return q;
}

SigmaMap sigma_map(const LensUncertainty& uncertainty, const BoardViews& data, double distance) {
  SigmaMap map{kMapColumns, kMapRows, {}, 0, 0};
  for (const Eigen::Vector2d& q : middles(data.width, data.height))
    map.value.push_back(solver::worst_sigma(uncertainty.covariance(q, distance)));
  const Eigen::Vector2d last(data.width - 1, data.height - 1);
  map.centre = solver::worst_sigma(uncertainty.covariance(last / 2, distance));
  for (const Eigen::Vector2d& q : solver::pixel_grid(data.width, data.height, 2, 2)) {
    const double sigma = solver::worst_sigma(uncertainty.covariance(q, distance));
    if (std::isfinite(sigma)) map.worst = std::max(map.worst, sigma);
  }
  return map;
}

// Cells of the map in which some view has a point.
std::vector<bool> cells_with_points(const BoardViews& data) {
  std::vector<bool> cells(kMapColumns * kMapRows);
  for (const auto& view : data.views)
    for (const Eigen::Vector2d& q : view) {
      const int i = static_cast<int>((q.x() + 0.5) / data.width * kMapColumns);
      const int j = static_cast<int>((q.y() + 0.5) / data.height * kMapRows);
      if (std::isfinite(q.x()) && i >= 0 && j >= 0 && i < kMapColumns && j < kMapRows)
        cells[j * kMapColumns + i] = true;
    }
  return cells;
}

// The chosen model fitted to either half of the views; views that are alike stay together.
std::optional<HalvesCheck> compare_halves(const LensReport& r, const std::vector<int>& group) {
  const std::set<int> distinct(group.begin(), group.end());
  if (distinct.size() < kLeastForHalves) return std::nullopt;
  std::vector<int> halves[2];
  for (std::size_t v = 0; v < group.size(); ++v)
    halves[std::distance(distinct.begin(), distinct.find(group[v])) % 2].push_back(static_cast<int>(v));
  std::vector<LensUncertainty> fits;
  for (const auto& half : halves) {
    const BoardViews data = solver::subset(r.data, half);
    const solver::LensFit start = solver::subset(r.fit(), half);
    const Result<solver::LensFit> fit = solver::fit_lens(data, {.model = r.choice.rung().model, .start = &start});
    if (!fit) return std::nullopt;
    fits.emplace_back(data, *fit);
  }
  HalvesCheck check{{kMapColumns, kMapRows, {}, 0, 0}, 0, 0};
  const std::vector<bool> cells = cells_with_points(r.data);
  const auto all = middles(r.data.width, r.data.height);
  std::vector<Eigen::Vector2d> compared;
  for (std::size_t i = 0; i < all.size(); ++i)
    if (cells[i] && fits[0].fit().lens.unproject(all[i]).allFinite() &&
        fits[1].fit().lens.unproject(all[i]).allFinite())
      compared.push_back(all[i]);
  const auto difference = solver::lens_difference(fits[0].fit().lens, fits[1].fit().lens, compared);
  double squares = 0;
  std::size_t at = 0;
  for (const Eigen::Vector2d& q : all) {
    const bool is_compared = at < compared.size() && q == compared[at];
    check.map.value.push_back(is_compared ? difference[at].norm() : std::nan(""));
    if (!is_compared) continue;
    squares += difference[at++].squaredNorm();
    check.map.worst = std::max(check.map.worst, check.map.value.back());
  }
  if (at == 0) return std::nullopt;
  check.rms_px = std::sqrt(squares / (2 * static_cast<double>(at)));
  check.predicted_rms_px = solver::predicted_difference_rms(fits[0], fits[1], compared);
  return check;
}

void add_quality(LensReport& r, const LensUncertainty& uncertainty, const std::vector<int>& group) {
  std::vector<double> distances = r.views.distance_m;
  std::nth_element(distances.begin(), distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2),
                   distances.end());
  r.distance_m = distances[distances.size() / 2];
  r.near = sigma_map(uncertainty, r.data, r.distance_m);
  r.far = sigma_map(uncertainty, r.data, LensUncertainty::kInfinity);
  r.halves = compare_halves(r, group);
  if (!r.halves)
    r.notes.push_back(
        fmt::format("two halves of the views are compared from {} views on that differ", kLeastForHalves));
  else if (r.halves->rms_px > 2 * r.halves->predicted_rms_px)
    r.warnings.push_back(
        fmt::format("two halves of the views differ by {:.3f} px rms where noise alone predicts {:.3f}: the stated "
                    "uncertainty is too "
                    "small by about {:.1f}x; is the board flat and rigid, and the focus fixed?",
                    r.halves->rms_px, r.halves->predicted_rms_px, r.halves->rms_px / r.halves->predicted_rms_px));
  const double left_out = 2.0 * r.fit().outliers / std::max(1, r.fit().observations);
  if (left_out > 0.03)
    r.warnings.push_back(
        fmt::format("{:.1f} % of the points do not fit the rest; are all photos sharp, by the same lens "
                    "at the same focus and zoom?",
                    100 * left_out));
}

// How certain the former calibration was of directions in its worst corner [px]; NaN where nothing says it.
double former_uncertainty(const fs::path& folder) {
  const Result<std::string> text = read_text(folder / "lens.json");
  if (!text) return std::nan("");
  const json numbers = json::parse(*text, nullptr, false);
  try {
    return numbers.at("uncertainty_px").at("far_worst").get<double>();
  } catch (const json::exception&) {
    return std::nan("");
  }
}

// The lens that was at this place before: what it leaves in these photos, and how certain it was. It may have been
// fitted to these very photos, which flatters it by a little.
void compare_with_former(const LensFiles& files, LensReport& r) {
  if (!fs::exists(files.model)) return;
  const Result<Device> former = read_cameramodel(files.model);
  if (!former || former->lens.width() != r.data.width || former->lens.height() != r.data.height) return;
  double sum = 0;
  int views = 0;
  for (std::size_t v = 0; v < r.data.views.size(); ++v) {
    const double square = solver::held_out_square(r.data, r.data.views[v], former->lens, r.fit().used[v]);
    if (std::isfinite(square)) sum += square, ++views;
  }
  if (views == 0) return;
  const double before = std::sqrt(sum / views), now = r.choice.rung().held_out_px;
  const double certain = former_uncertainty(files.folder);
  std::string text = fmt::format(
      "the former model leaves {:.4f} px in these photos, the new one {:.4f} px in those that "
      "its fits have not seen",
      before, now);
  if (std::isfinite(certain))
    text += fmt::format("; directions in the worst corner were certain to {:.3f} px and are now to {:.3f} px", certain,
                        r.far.worst);
  const bool fits_better = before < 0.9 * now, more_certain = before < 1.1 * now && 1.5 * certain < r.far.worst;
  if (fits_better || more_certain)
    r.warnings.push_back(text + "; the former one is kept beside it, and may be the better one");
  else
    r.notes.push_back(text);
}

fs::path with_suffix(const fs::path& model, const std::string& suffix) {
  fs::path path = model;
  return path.replace_filename(model.stem().string() + suffix);
}

// Names for what stands there already.
std::pair<fs::path, fs::path> former_names(const fs::path& model) {
  for (int i = 1;; ++i) {
    const std::string former = i == 1 ? ".former" : fmt::format(".former{}", i);
    const fs::path kept = with_suffix(model, former + model.extension().string());
    const fs::path folder = with_suffix(model, former + ".lens");
    if (!fs::exists(kept) && !fs::exists(folder)) return {kept, folder};
  }
}

Result<void> write_folder(const fs::path& path, const LensReport& r) {
  return create_folder_atomically(path, [&](const fs::path& folder) -> Result<void> {
    CS_TRY_VOID(write_atomically(folder / "lens.json", lens_json(r)));
    CS_TRY_VOID(write_atomically(folder / "coverage.svg", coverage_svg(r)));
    CS_TRY_VOID(write_atomically(folder / "residuals.svg", residuals_svg(r)));
    CS_TRY_VOID(write_atomically(folder / "uncertainty_near.svg", map_svg(r.near, r.data.width, r.data.height)));
    CS_TRY_VOID(write_atomically(folder / "uncertainty_far.svg", map_svg(r.far, r.data.width, r.data.height)));
    if (r.halves)
      CS_TRY_VOID(write_atomically(folder / "halves.svg", map_svg(r.halves->map, r.data.width, r.data.height)));
    return write_atomically(folder / "lens.html", lens_html(r));
  });
}

// Can the model be written there? Asked before the work.
Result<void> check_place(const fs::path& model) {
  if (model.extension() != ".cameramodel")
    return error(ErrorCode::kBadValue, "'{}' must end in .cameramodel", model.string());
  if (fs::is_directory(model))
    return error(ErrorCode::kBadValue, "'{}' is a folder; give the name of a file with -o", model.string());
  const fs::path folder = model.has_parent_path() ? model.parent_path() : fs::path(".");
  if (!fs::is_directory(folder))
    return error(ErrorCode::kBadValue, "folder '{}' does not exist; create it first or correct the name",
                 folder.string());
  return {};
}

// The new files are whole before the old ones move, and the old ones return where the last steps fail.
Result<void> write_all(const LensFiles& files, LensReport& r) {
  const auto [kept_model, kept_folder] = former_names(files.model);
  const bool model_there = fs::exists(files.model), folder_there = fs::exists(files.folder);
  if (model_there) r.notes.push_back(fmt::format("the former model is kept as '{}'", kept_model.filename().string()));
  const fs::path fresh_folder = with_suffix(files.model, ".new.lens"),
                 fresh_model = with_suffix(files.model, ".new" + files.model.extension().string());
  std::error_code failed, ignored;
  fs::remove_all(fresh_folder, ignored);  // of a run that was killed
  CS_TRY_VOID(solver::write_fitted_cameramodel(fresh_model, r.data, r.fit()));
  if (Result<void> written = write_folder(fresh_folder, r); !written) {
    fs::remove(fresh_model, ignored);
    return written;
  }
  if (model_there) fs::copy_file(files.model, kept_model, failed);
  if (!failed && folder_there) fs::rename(files.folder, kept_folder, failed);
  const bool folder_moved = !failed && folder_there;
  if (!failed) fs::rename(fresh_folder, files.folder, failed);
  const bool folder_placed = !failed;
  if (!failed) fs::rename(fresh_model, files.model, failed);
  if (!failed) {
    fs::remove(files.refused, ignored);
    return {};
  }
  if (folder_placed) fs::remove_all(files.folder, ignored);
  if (folder_moved) fs::rename(kept_folder, files.folder, ignored);
  fs::remove_all(fresh_folder, ignored);
  fs::remove(fresh_model, ignored);
  fs::remove(kept_model, ignored);
  return error(ErrorCode::kIo, "cannot replace '{}': {}; the former model stays; check permissions and space",
               files.model.string(), failed.message());
}

Result<LensReport> fit_all(LensPhotos& found, const LensOptions& options, Progress& progress) {
  LensReport r;
  r.board = found.board;
  r.board_recognised = found.recognised;
  r.data = found.data;
  r.notes = found.notes;
  const std::vector<int> group = solver::group_alike(r.data);
  CS_TRY_VOID(solver::check_enough(group));
  CS_TRY(r.choice, solver::choose_lens(r.data, group, options.ladder, progress));
  r.notes.insert(r.notes.end(), r.choice.notes.begin(), r.choice.notes.end());
  r.views = solver::summarise(r.data, r.fit());
  const LensUncertainty uncertainty(r.data, r.fit());
  // A spline's core does not move: the focal length is then judged with the largest model that has one.
  const solver::LensRung* judged = &r.choice.rung();
  for (const solver::LensRung& rung : r.choice.rungs)
    if (uncertainty.first_intrinsic() != 0 && rung.fitted && rung.parameters <= 12) judged = &rung;
  const LensUncertainty of_focal(r.data, judged->fit);
  r.focal_sigma = of_focal.focal_sigma();
  CS_TRY_VOID(solver::check_held(of_focal, r.views));
  if (r.board_recognised)
    r.notes.push_back(
        fmt::format("the board was recognised as {}; its square was not stated: distances suppose 25 "
                    "mm, the lens does not depend on it",
                    r.board.name()));
  add_quality(r, uncertainty, group);
  for (LensPhoto& photo : found.photos) {
    if (photo.view < 0) continue;
    double squares = 0;
    int used = 0;
    for (std::size_t i = 0; i < r.fit().used[photo.view].size(); ++i)
      if (r.fit().used[photo.view][i]) squares += r.fit().residual_px[photo.view][i].squaredNorm(), ++used;
    photo.rms_px = used ? std::sqrt(squares / (2 * used)) : 0;
  }
  r.photos = std::move(found.photos);
  return r;
}

// "no board found in 3 of 9 photos: REASON ('a.png', 'b.png'); REASON ('c.png')".
std::string photos_without(const std::vector<LensPhoto>& photos) {
  constexpr std::size_t kNamed = 3;  // photos a reason; the page names all
  std::map<std::string, std::vector<std::string>> names;
  std::size_t count = 0;
  for (const LensPhoto& p : photos)
    if (!p.found) {
      auto& same = names[p.reason];
      if (same.size() < kNamed)
        same.push_back("'" + p.name + "'");
      else if (same.size() == kNamed)
        same.emplace_back("...");
      ++count;
    }
  std::vector<std::string> lines;
  for (const auto& [reason, same] : names) lines.push_back(fmt::format("{} ({})", reason, fmt::join(same, ", ")));
  if (lines.empty()) return "";
  return fmt::format("no board found in {} of {} photos: {}", count, photos.size(), fmt::join(lines, "; "));
}

}  // namespace

LensFiles lens_files(const fs::path& model) {
  return {model, with_suffix(model, ".lens"), with_suffix(model, ".refused.html")};
}

Result<LensReport> calibrate_lens(const std::vector<fs::path>& inputs, const fs::path& model,
                                  const LensOptions& options, Progress& progress) {
  CS_TRY_VOID(check_place(model));
  CS_TRY(const std::vector<fs::path> files, list_photos(inputs));
  CS_TRY(LensPhotos found, find_boards(files, options.board, progress));
  const std::string without = photos_without(found.photos);
  std::vector<LensPhoto> photos = found.photos;
  Result<LensReport> report = fit_all(found, options, progress);
  const LensFiles out = lens_files(model);
  if (!report) {
    const std::string& reason = report.error().message;
    const std::string why = without.empty() ? reason : found.data.views.empty() ? without : reason + "; " + without;
    CS_TRY_VOID(write_atomically(out.refused, refused_html(photos, why)));
    return error(report.error().code, "{}; nothing was overwritten, '{}' shows the photos", why, out.refused.string());
  }
  if (!without.empty()) report->warnings.insert(report->warnings.begin(), without);
  compare_with_former(out, *report);
  CS_TRY_VOID(write_all(out, *report));
  return report;
}

std::string lens_json(const LensReport& r) {
  json photos = json::array(), ladder = json::array();
  for (const LensPhoto& p : r.photos) {
    json photo = {{"file", p.name}, {"found", p.found}, {"points", p.seen}};
    if (!p.reason.empty()) photo["reason"] = p.reason;
    if (p.view >= 0)
      photo.update(
          {{"rms_px", p.rms_px}, {"tilt_deg", r.views.tilt_deg[p.view]}, {"distance_m", r.views.distance_m[p.view]}});
    photos.push_back(photo);
  }
  for (const solver::LensRung& rung : r.choice.rungs) {
    json row = {{"model", rung.model}, {"fitted", rung.fitted}};
    if (rung.fitted)
      row.update({{"parameters", rung.parameters},
                  {"residual_px", rung.fit.rms_px},
                  {"held_out_px", rung.held_out_px},
                  {"excess_px2", rung.excess},
                  {"excess_sigma_px2", rung.excess_sigma},
                  {"bic", rung.bic},
                  {"f_test_p", rung.f_p}});
    else
      row["reason"] = rung.note;
    ladder.push_back(row);
  }
  const solver::LensFit& fit = r.fit();
  json document = {{"format_version", 1},
                   {"board", r.board.name()},
                   {"board_recognised", r.board_recognised},
                   {"picture_size", {r.data.width, r.data.height}},
                   {"photos", photos},
                   {"ladder", ladder},
                   {"model", fit.lens.model()},
                   {"reason", r.choice.reason},
                   {"intrinsics", fit.lens.intrinsics()},
                   {"residual_px", fit.rms_px},
                   {"noise_px", fit.sigma_px},
                   {"held_out_px", r.choice.rung().held_out_px},
                   {"outliers", fit.outliers},
                   {"focal_sigma", r.focal_sigma},
                   {"covered", r.views.covered},
                   {"uncertainty_px",
                    {{"near_distance_m", r.distance_m},
                     {"near_centre", r.near.centre},
                     {"near_worst", r.near.worst},
                     {"far_centre", r.far.centre},
                     {"far_worst", r.far.worst}}},
                   {"advice", r.views.advice},
                   {"notes", r.notes},
                   {"warnings", r.warnings}};
  if (r.halves) document["halves_px"] = {{"rms", r.halves->rms_px}, {"predicted_rms", r.halves->predicted_rms_px}};
  return document.dump(1) + "\n";
}

}  // namespace countershade::tools

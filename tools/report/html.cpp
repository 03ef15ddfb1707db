#include "tools/report/html.h"

#include <algorithm>
#include <cmath>

#include "calib/file/file.h"
#include "tools/report/picture.h"
#include "tools/report/plot.h"
#include "tools/report/style.h"

namespace countershade::tools {

namespace {

namespace fs = std::filesystem;

// Signed differences are shown over this range, in % of white, in every report: pictures of two reports compare.
constexpr double kReach = 10;
constexpr double kAmplified = 5;
constexpr int kEmbeddedWidth = 960;  // enough for half of a wide screen; the files beside the report are whole
constexpr int kProfileRows = 16;     // averaged: a single row would show noise

std::string times(double suppression) {
  if (std::isnan(suppression)) return "\u2013";
  if (std::isinf(suppression)) return "exact";
  return fmt::format("{:.1f}\u00d7", suppression);
}

// --- pictures ---------------------------------------------------------------------------------------------------

struct Light {
  const Image *u, *c, *t;
  const Mask* lit;
};

Image difference_picture(const Image& a, const Light& light, double white, double gain) {
  return signed_difference(a, *light.t, *light.lit, white, kReach / gain);
}

Result<void> write_pictures(const fs::path& folder, const Light& light, double white) {
  const std::pair<const char*, Image> files[] = {
      {"u.png", as_seen(*light.u, white)},
      {"c.png", as_seen(*light.c, white)},
      {"t.png", as_seen(*light.t, white)},
      {"difference_uncompensated.png", difference_picture(*light.u, light, white, 1)},
      {"difference_compensated.png", difference_picture(*light.c, light, white, 1)},
      {"difference_compensated_x5.png", difference_picture(*light.c, light, white, kAmplified)}};
  for (const auto& [name, picture] : files) {
    CS_TRY(const std::string png, png_bytes(picture));
    CS_TRY_VOID(write_atomically(folder / name, png));
  }
  return {};
}

std::string figure(const std::string& png, const std::string& title, const std::string& caption) {
  return fmt::format("<figure><img alt='{0}' src='{1}'><figcaption><b>{0}</b> {2}</figcaption></figure>\n",
                     escaped(title), data_uri(png), escaped(caption));
}

Result<std::string> photos_html(const Light& light, double white) {
  std::string out =
      "<h2>What the camera saw</h2><p class='lead'>Photographs on one scale: reference white is white on your display. "
      "The compensated show should look like the target.</p><div class='grid3'>";
  const std::tuple<const Image*, const char*, const char*> photos[] = {
      {light.u, "U", "the plain show, scattered light included"},
      {light.c, "C", "the compensated show"},
      {light.t, "T", "the target, photographed: direct light only"}};
  for (const auto& [image, name, caption] : photos) {
    CS_TRY(const std::string png, png_bytes(as_seen(*image, white)));
    out += figure(png, name, caption);
  }
  return out + "</div>";
}

Result<std::string> differences_html(const Light& light, double white) {
  std::string out =
      "<h2>How far from the target</h2><p class='lead'>Signed differences in % of reference white, of the channel that "
      "is farthest off: blue is too dark, red too bright, pale is right, dark grey is not lit.</p><div class='grid3'>";
  const auto add = [&](const Image& shown, double gain, const char* name, const char* caption) -> Result<void> {
    CS_TRY(const std::string png, png_bytes(difference_picture(shown, light, white, gain)));
    out += "<div>" + figure(png, name, caption) + difference_legend(kReach / gain) + "</div>";
    return {};
  };
  CS_TRY_VOID(add(*light.u, 1, "U \u2212 T", "the scattered light of the plain show"));
  CS_TRY_VOID(add(*light.c, 1, "C \u2212 T", "what is left of it, same scale"));
  CS_TRY_VOID(add(*light.c, kAmplified, "C \u2212 T, 5\u00d7 amplified", "the same on a scale five times finer"));
  return out + "</div>";
}

Result<std::string> exhibits_html(const std::vector<Exhibit>& exhibits) {
  if (exhibits.empty()) return std::string();
  std::string out =
      "<h2>Correspondences</h2><p class='lead'>Which camera pixels were decoded, and which were rejected and "
      "why.</p><div class='grid2'>";
  for (const Exhibit& e : exhibits) {
    CS_TRY(const std::string png, read_text(e.png));
    out += figure(png, e.caption, "");
  }
  return out + "</div>";
}

// --- plots ------------------------------------------------------------------------------------------------------

std::string histogram_svg(const VerifyNumbers& n) {
  Series u{"plain U \u2212 T", "var(--plain)", {}, {}, true, false};
  Series c{"compensated C \u2212 T", "var(--comp)", {}, {}, true, false};
  const double bins = static_cast<double>(n.histogram_u.size());
  for (std::size_t i = 0; i < n.histogram_u.size(); ++i) {
    const double x = n.histogram_reach * (2 * (static_cast<double>(i) + 0.5) / bins - 1);
    u.x.push_back(x), c.x.push_back(x);
    u.y.push_back(100 * n.histogram_u[i]), c.y.push_back(100 * n.histogram_c[i]);
  }
  PlotOptions options;
  options.x_title = "difference from the target, % of white";
  options.y_title = "% of blocks (logarithmic)";
  options.x_range = {-n.histogram_reach, n.histogram_reach};
  options.y_range = {0.01, 100};
  options.log_y = true;
  return plot_svg({u, c}, options);
}

// The row in the middle of those where the edge zone is lit, else the middle of the picture.
int profile_row(const Report& r) {
  const Mask& lit = *r.input.lit;
  if (r.profile_row >= 0) return std::min(r.profile_row, lit.height() - 1);
  std::vector<int> rows;
  for (int y = 0; r.input.edge && y < lit.height(); ++y)
    for (int x = 0; x < lit.width(); ++x)
      if (lit.at(x, y) && r.input.edge->at(x, y)) {
        rows.push_back(y);
        break;
      }
  return rows.empty() ? lit.height() / 2 : rows[rows.size() / 2];
}

struct Profile {
  std::vector<double> x, u, c, t;  // camera column, light in % of white
  std::vector<Band> bands;         // where it lies in the edge zone
  int row = 0, rows = 0;
};

// Mean over channels, rows and a few columns of lit, finite pixels.
void add_column(const VerifyInput& in, int first_row, int last_row, int first_column, int step, Profile& p) {
  double sum[3] = {0, 0, 0};
  int count = 0, edge = 0;
  for (int y = first_row; y < last_row; ++y)
    for (int x = first_column; x < first_column + step; ++x)
      for (int k = 0; k < in.uncompensated->channels() && in.lit->at(x, y); ++k) {
        const double u = in.uncompensated->at(x, y, k), c = in.compensated->at(x, y, k), t = in.target->at(x, y, k);
        if (!std::isfinite(u + c + t)) continue;
        sum[0] += u, sum[1] += c, sum[2] += t;
        ++count;
        edge += in.edge && in.edge->at(x, y);
      }
  const double scale = count ? 100 / (count * in.white) : NAN, x = first_column + (step - 1) / 2.0;
  p.x.push_back(x), p.u.push_back(sum[0] * scale), p.c.push_back(sum[1] * scale), p.t.push_back(sum[2] * scale);
  if (!count || 2 * edge < count) return;
  const double from = first_column - 0.5, to = from + step;
  if (!p.bands.empty() && std::abs(p.bands.back().to - from) < 1e-9)
    p.bands.back().to = to;
  else
    p.bands.push_back({from, to, ""});
}

Profile profile(const Report& r) {
  const int width = r.input.lit->width(), height = r.input.lit->height(), step = std::max(1, width / 480);
  Profile p;
  p.row = profile_row(r);
  const int first = std::max(0, p.row - kProfileRows / 2), last = std::min(height, p.row + kProfileRows / 2);
  p.rows = last - first;
  for (int x = 0; x + step <= width; x += step) add_column(r.input, first, last, x, step, p);
  if (p.bands.size() == 1) p.bands[0].name = "edge zone";
  return p;
}

std::string profile_html(const Report& r) {
  const Profile p = profile(r);
  PlotOptions light;
  light.x_title = fmt::format("camera column, mean of {} rows around row {}", p.rows, p.row);
  light.y_title = "light, % of white";
  light.bands = p.bands;
  const std::string upper = plot_svg({{"plain U", "var(--plain)", p.x, p.u},
                                      {"target T", "var(--target)", p.x, p.t, false, true},
                                      {"compensated C", "var(--comp)", p.x, p.c}},
                                     light);
  std::vector<double> du(p.x.size()), dc(p.x.size());
  for (std::size_t i = 0; i < p.x.size(); ++i) du[i] = p.u[i] - p.t[i], dc[i] = p.c[i] - p.t[i];
  PlotOptions difference = light;
  difference.y_title = "difference, % of white";
  const std::string lower = plot_svg(
      {{"plain U \u2212 T", "var(--plain)", p.x, du}, {"compensated C \u2212 T", "var(--comp)", p.x, dc}}, difference);
  return "<div class='panel'><h3>Profile across the edge</h3>" + upper +
         "</div><div class='panel'><h3>Difference along the same line</h3>" + lower + "</div>";
}

std::string bars_html(const VerifyNumbers& n) {
  std::vector<Bar> bars;
  const auto add = [&](const std::string& name, const ZoneNumbers& z) {
    if (z.uncompensated.blocks == 0) return;
    const auto text = [](double v) { return fmt::format("{:.3g}", v); };
    bars.push_back({name + ", plain", z.uncompensated.mean_grey, text(z.uncompensated.mean_grey), "var(--plain)"});
    bars.push_back({name + ", comp.", z.compensated.mean_grey, text(z.compensated.mean_grey), "var(--comp)"});
  };
  add("everything lit", n.all);
  add("unclipped", n.unclipped);
  add("edge zone", n.edge);
  return "<div class='panel'><h3>Mean distance from the target</h3>" + bars_svg(bars, "grey levels of 255") + "</div>";
}

std::string plots_html(const Report& r) {
  return "<h2>Residuals</h2><div class='grid2'><div class='panel'><h3>How often which difference occurs</h3>" +
         histogram_svg(r.numbers) +
         "<p class='small'>8 \u00d7 8 pixel blocks, each channel; the outermost bins collect what lies "
         "beyond.</p></div>" +
         bars_html(r.numbers) + profile_html(r) + "</div>";
}

// --- numbers ----------------------------------------------------------------------------------------------------

std::string deviations_row(const char* style, const char* name, const Deviations& d, const std::string& suppression) {
  return fmt::format(
      "<tr class='{}'><td>{}</td><td>{:.3f}</td><td>{:.3f}</td><td>{:.2f}</td><td>{:.2f}</td><td>{:.2f}</td>"
      "<td>{:.2f}</td><td>{}</td></tr>",
      style, name, d.mean_percent, d.p99_percent, d.mean_grey, d.p99_grey, d.mean_delta_e, d.p95_delta_e, suppression);
}

std::string zone_rows(const std::string& name, const char* unit, const ZoneNumbers& z) {
  std::string out =
      fmt::format("<tr class='zone'><td colspan='8'>{}: {} {}</td></tr>", escaped(name), z.uncompensated.blocks, unit);
  if (z.uncompensated.blocks == 0) return out;
  out += deviations_row("", "plain |U \u2212 T|", z.uncompensated, "");
  return out + deviations_row("shown", "compensated |C \u2212 T|", z.compensated, times(z.suppression));
}

std::string deviations_html(const VerifyNumbers& n) {
  const std::string edge = n.edge_text.empty() ? "Edge zone" : "Edge zone (" + n.edge_text + ")";
  return "<div class='panel scroll'><table class='numbers'><thead><tr><th></th><th>mean<br>% of white</th><th>99th "
         "percentile<br>% of white</th><th>mean<br>grey levels</th><th>99th percentile<br>grey levels</th>"
         "<th>mean<br>dE2000</th><th>95th percentile<br>dE2000</th><th>suppression</th></tr></thead><tbody>" +
         zone_rows("Everything lit", "blocks", n.all) +
         zone_rows("Needs no clipping (" + n.clipped_text + ")", "blocks", n.unclipped) +
         zone_rows(edge, "blocks", n.edge) + zone_rows("Everything lit, without averaging", "pixels", n.per_pixel) +
         "</tbody></table></div>";
}

std::string table_html(const Table& t) {
  std::string out = fmt::format("<div class='panel scroll'><h3>{}</h3><table>", escaped(t.title));
  if (!t.header.empty()) {
    out += "<thead><tr>";
    for (const auto& h : t.header) out += "<th>" + escaped(h) + "</th>";
    out += "</tr></thead>";
  }
  out += "<tbody>";
  for (const auto& row : t.rows) {
    out += "<tr>";
    for (const auto& cell : row) out += "<td>" + escaped(cell) + "</td>";
    out += "</tr>";
  }
  return out + "</tbody></table></div>\n";
}

// Predictions beside what was measured, and what it cost.
Table shares_table(const VerifyNumbers& n) {
  const auto percent = [](double share) { return fmt::format("{:.2f} %", 100 * share); };
  Table t{"Shares", {}, {}};
  t.rows = {{"blocks that need clipping", percent(n.clipped_share)},
            {"blocks worse than the plain show, beyond noise", percent(n.worse_share)},
            {"lit pixels that the model does not cover (they count)", percent(n.uncovered_share)},
            {"the edge zone brighter than white, where grey levels say nothing", percent(n.above_white_share)},
            {"lit pixels in no block (not finite, or at the rim of the light)", percent(n.unused_share)},
            {"mean(U \u2212 C) / mean(U), the measure of Bimber et al. 2006", percent(n.paper_measure)}};
  return t;
}

Table predictions_table(const VerifyNumbers& n) {
  const auto percent = [](double v) { return fmt::format("{:.3f} %", v); };
  Table t{"Predicted and measured, mean % of white", {}, {}};
  t.rows.push_back({"measured |C \u2212 T|", percent(n.all.compensated.mean_percent)});
  const Background& b = n.background;
  if (b.certificate_percent)
    t.rows.push_back({"certificate: error by the model itself", percent(*b.certificate_percent)});
  if (b.held_out_percent) t.rows.push_back({"error on held-out patterns", percent(*b.held_out_percent)});
  if (b.reachable_gap_percent)
    t.rows.push_back({"gap to the best that can be reached", percent(*b.reachable_gap_percent)});
  t.rows.push_back({"noise floor of the averaged photos", percent(n.noise_floor_percent)});
  t.rows.push_back({"noise floor of a single pixel", percent(n.pixel_noise_floor_percent)});
  if (b.frames) t.rows.push_back({"frames photographed", fmt::format("{}", *b.frames)});
  if (b.capture_seconds) t.rows.push_back({"seconds of capture", fmt::format("{:.1f}", *b.capture_seconds)});
  if (b.compute_seconds) t.rows.push_back({"seconds of computation", fmt::format("{:.1f}", *b.compute_seconds)});
  return t;
}

std::string numbers_html(const Report& r) {
  std::string out = "<h2>Numbers</h2>" + deviations_html(r.numbers) + "<div class='grid2'>" +
                    table_html(predictions_table(r.numbers)) + table_html(shares_table(r.numbers)) + "</div>";
  if (!r.tables.empty()) out += "<h2>How it was made</h2><div class='grid2'>";
  for (const Table& t : r.tables) out += table_html(t);
  return out + (r.tables.empty() ? "" : "</div>");
}

// --- page -------------------------------------------------------------------------------------------------------

std::string card(bool pass, const std::string& value, const std::string& what, const std::string& bound) {
  return fmt::format("<div class='card {}'><b>{}</b><div class='what'>{}</div><div class='bound'>{} {}</div></div>",
                     pass ? "pass" : "fail", value, what, pass ? "\u2713" : "\u2717", bound);
}

std::string list(const std::vector<std::string>& lines) {
  std::string out = "<ul>";
  for (const std::string& l : lines) out += "<li>" + escaped(l) + "</li>";
  return out + "</ul>";
}

std::string verdict_html(const Report& r) {
  const VerifyNumbers& n = r.numbers;
  const Thresholds& t = r.thresholds;
  std::string out = fmt::format(
      "<header><span class='badge {}'>{}</span><div><h1>{}</h1><p class='lead'>{}</p></div></header><div "
      "class='cards'>",
      r.verdict.pass ? "pass" : "fail", r.verdict.pass ? "PASS" : "FAIL", escaped(r.title), escaped(r.subtitle));
  out += card(n.unclipped.suppression >= t.suppression, times(n.unclipped.suppression),
              "less scattered light where nothing clips", fmt::format("at least {:g}\u00d7", t.suppression));
  out += card(n.edge.compensated.mean_grey <= t.edge_grey,
              fmt::format("{:.2f} \u2192 {:.2f}", n.edge.uncompensated.mean_grey, n.edge.compensated.mean_grey),
              "grey levels off beside the crease", fmt::format("at most {:g} left", t.edge_grey));
  out += card(n.worse_share <= t.worse_share, fmt::format("{:.2f} %", 100 * n.worse_share),
              "of the picture got worse, beyond noise", fmt::format("at most {:g} %", 100 * t.worse_share));
  out += card(n.uncovered_share <= t.uncovered_share, fmt::format("{:.2f} %", 100 * n.uncovered_share),
              "of the lit pixels are not in the model", fmt::format("at most {:g} %", 100 * t.uncovered_share));
  out += "</div>";
  if (!r.verdict.failures.empty())
    out += "<div class='box'><b>Why it fails, and what to try first</b>" + list(r.verdict.failures) + "</div>";
  if (!r.warnings.empty()) out += "<div class='box warn'><b>Warnings</b>" + list(r.warnings) + "</div>";
  return out;
}

std::string closing_html(const Report& r) {
  std::string out;
  if (!r.notes.empty()) out += "<h2>Notes</h2>" + list(r.notes);
  if (!r.options.empty()) {
    Table t{"Effective options", {}, {}};
    for (const auto& [name, value] : r.options) t.rows.push_back({name, value});
    out += table_html(t);
  }
  return out +
         "<footer>Reference white W: 99th percentile of the direct light of the strongest single projector at full "
         "white. Grey levels: 255 sRGB(value / W), clipped. Photos are averaged over exposures and 8 \u00d7 8 camera "
         "pixels before they are compared. Suppression: mean |U \u2212 T| / mean |C \u2212 T| in linear light. The "
         "target is photographed, never computed from the model under test. numbers.json beside this file holds all "
         "numbers for programs.</footer>";
}

Result<std::string> page(const Report& r) {
  const VerifyInput& in = r.input;
  const Image u = reduced_to(*in.uncompensated, kEmbeddedWidth), c = reduced_to(*in.compensated, kEmbeddedWidth);
  const Image t = reduced_to(*in.target, kEmbeddedWidth);
  const Mask lit = reduced_to(*in.lit, kEmbeddedWidth);
  const Light light{&u, &c, &t, &lit};
  std::string out =
      "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width,initial-scale=1'><title>" +
      escaped(r.title) + "</title><style>" + kReportStyle + "</style></head><body><main>\n" + verdict_html(r);
  CS_TRY(const std::string photos, photos_html(light, in.white));
  CS_TRY(const std::string differences, differences_html(light, in.white));
  CS_TRY(const std::string exhibits, exhibits_html(r.exhibits));
  return out + photos + differences + plots_html(r) + numbers_html(r) + exhibits + closing_html(r) +
         "</main></body></html>\n";
}

}  // namespace

Result<void> write_report(const fs::path& folder, const Report& r, const FillFolder& record) {
  return create_folder_atomically(
      folder,
      [&](const fs::path& hidden) -> Result<void> {
        const VerifyInput& in = r.input;
        CS_TRY_VOID(write_pictures(hidden, {in.uncompensated, in.compensated, in.target, in.lit}, in.white));
        CS_TRY_VOID(write_atomically(hidden / "numbers.json", numbers_json(r.numbers, r.verdict)));
        CS_TRY(const std::string html, page(r));
        return write_atomically(hidden / "report.html", html);
      },
      record);
}

}  // namespace countershade::tools

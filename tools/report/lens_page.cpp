#include "tools/report/lens_page.h"

#include <algorithm>
#include <cmath>

#include "tools/report/picture.h"
#include "tools/report/plot.h"
#include "tools/report/style.h"

namespace countershade::tools {

namespace {

using solver::LensRung;

std::string short_name(const std::string& model) {
  std::string name = model.substr(model.find('_') + 1);
  return name.starts_with("SPLINED") ? "SPLINED " + name.substr(name.find("order")) : name;
}

// Pictures are drawn in the photo's own pixels, so that all of them have one size.
std::string svg_of(int width, int height, const std::string& body) {
  return fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='-0.5 -0.5 {0} {1}'><rect x='-0.5' y='-0.5' width='{0}' "
      "height='{1}' fill='#8881' stroke='#888' stroke-width='{2:.2f}'/>{3}</svg>",
      width, height, width / 400.0, body);
}

std::string view_colour(int view, int views) {
  return fmt::format("hsl({:.0f} 65% 50%)", 360.0 * view / std::max(1, views));
}

// White to blue to dark blue, and the ink that can be read on it.
std::pair<std::string, const char*> cell_colour(double share) {
  const double t = std::clamp(share, 0.0, 1.0);
  const int r = static_cast<int>(240 - 215 * t), g = static_cast<int>(246 - 170 * t),
            b = static_cast<int>(251 - 100 * t);
  return {fmt::format("rgb({},{},{})", r, g, b), t > 0.5 ? "#fff" : "#123"};
}

std::string list(const std::vector<std::string>& lines) {
  std::string out = "<ul>";
  for (const std::string& l : lines) out += "<li>" + escaped(l) + "</li>";
  return out + "</ul>";
}

std::string table_html(const std::vector<std::string>& header, const std::vector<std::vector<std::string>>& rows) {
  std::string out = "<div class='panel scroll'><table class='numbers'><tr>";
  for (const auto& h : header) out += "<th>" + escaped(h) + "</th>";
  out += "</tr>";
  for (const auto& row : rows) {
    out += "<tr>";
    // A column without a name holds words.
    for (std::size_t i = 0; i < row.size(); ++i)
      out += (header[i].empty() ? "<td class='words'>" : "<td>") + escaped(row[i]) + "</td>";
    out += "</tr>";
  }
  return out + "</table></div>";
}

std::string figure(const std::string& svg, const std::string& title, const std::string& caption) {
  return "<figure>" + svg + "<figcaption><b>" + escaped(title) + "</b> " + escaped(caption) + "</figcaption></figure>";
}

std::string card(const std::string& value, const std::string& what) {
  return fmt::format("<div class='card'><b>{}</b><div class='what'>{}</div></div>", escaped(value), escaped(what));
}

std::string page(const std::string& title, const std::string& body) {
  return "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
         "content='width=device-width,initial-scale=1'><title>" +
         escaped(title) + "</title><style>" + kReportStyle + "</style></head><body><main>\n" + body +
         "</main></body></html>\n";
}

std::string not_found_html(const std::vector<LensPhoto>& photos) {
  const auto missing = std::count_if(photos.begin(), photos.end(), [](const LensPhoto& p) { return !p.found; });
  if (missing == 0) return "";
  std::string out =
      fmt::format("<h2>No board found in {} of {} photos</h2><div class='grid3'>", missing, photos.size());
  for (const LensPhoto& p : photos) {
    if (p.found) continue;
    const std::string picture =
        p.thumbnail.empty() ? "" : fmt::format("<img alt='{}' src='{}'>", escaped(p.name), data_uri(p.thumbnail));
    out += figure(picture, p.name, p.reason);
  }
  return out + "</div>";
}

std::string photos_html(const LensReport& r) {
  std::vector<std::vector<std::string>> rows;
  for (const LensPhoto& p : r.photos) {
    if (p.view < 0) continue;
    rows.push_back({p.name, fmt::format("{} of {}", p.seen, r.board.points()), fmt::format("{:.3f}", p.rms_px),
                    fmt::format("{:.0f}", r.views.tilt_deg[p.view]),
                    fmt::format("{:.3f}", r.views.distance_m[p.view])});
  }
  return "<h2>Views</h2>" + table_html({"photo", "points", "residual, px rms", "tilt, degrees",
                                        r.board_recognised ? "distance, m (of squares of 25 mm)" : "distance, m"},
                                       rows);
}

std::string pictures_html(const LensReport& r) {
  const std::string unit = r.board_recognised ? "" : fmt::format(" {:.2f} m away", r.distance_m);
  std::string out = "<h2>Where the lens is known</h2><div class='grid2'>";
  out += figure(coverage_svg(r), "Coverage", "every point of every view; a lens is known where points lie");
  out += figure(residuals_svg(r), "Residuals",
                "what the model leaves, amplified: directions should look random, without swirls or zones");
  out += figure(map_svg(r.near, r.data.width, r.data.height), "Uncertainty of near points",
                fmt::format("one sigma in the worst direction of a point as far as the boards{} [px]", unit));
  out += figure(map_svg(r.far, r.data.width, r.data.height), "Uncertainty of directions",
                "the same for points far away, where an error of the focal length is not made up for by distance [px]");
  if (r.halves)
    out += figure(map_svg(r.halves->map, r.data.width, r.data.height), "Two halves",
                  fmt::format("difference of lenses fitted to every second view [px]: {:.3f} px rms where noise alone "
                              "predicts {:.3f}",
                              r.halves->rms_px, r.halves->predicted_rms_px));
  return out + "</div>";
}

}  // namespace

std::vector<std::string> ladder_columns() {
  return {"model", "parameters", "residual px", "held-out px", "over best px2", "+-", "BIC", "F-test p", ""};
}

std::vector<std::vector<std::string>> ladder_rows(const solver::LensChoice& choice) {
  std::vector<std::vector<std::string>> rows;
  for (std::size_t i = 0; i < choice.rungs.size(); ++i) {
    const LensRung& r = choice.rungs[i];
    if (!r.fitted) {
      rows.push_back({short_name(r.model), "", "", "", "", "", "", "", "left out: " + r.note});
      continue;
    }
    const bool nested = i > 0 && r.model.starts_with("LENSMODEL_OPENCV");
    rows.push_back({short_name(r.model), fmt::format("{}", r.parameters), fmt::format("{:.4f}", r.fit.rms_px),
                    fmt::format("{:.4f}", r.held_out_px), fmt::format("{:.2e}", r.excess),
                    fmt::format("{:.1e}", r.excess_sigma), fmt::format("{:.1f}", r.bic),
                    nested ? fmt::format("{:.2g}", r.f_p) : "",
                    r.verdict + (static_cast<int>(i) == choice.chosen ? " - chosen" : "")});
  }
  return rows;
}

std::string coverage_svg(const LensReport& r) {
  std::string body;
  const int views = static_cast<int>(r.data.views.size());
  for (int v = 0; v < views; ++v) {
    body += fmt::format("<g fill='{}'>", view_colour(v, views));
    for (const Eigen::Vector2d& q : r.data.views[v])
      if (std::isfinite(q.x()))
        body += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='{:.1f}'/>", q.x(), q.y(), r.data.width / 220.0);
    body += "</g>";
  }
  return svg_of(r.data.width, r.data.height, body);
}

std::string residuals_svg(const LensReport& r) {
  // Three sigma become a thirtieth of the width.
  const double factor = r.data.width / 30.0 / std::max(1e-9, 3 * r.fit().rms_px);
  std::string body;
  const int views = static_cast<int>(r.data.views.size());
  for (int v = 0; v < views; ++v) {
    body += fmt::format("<g stroke='{}' stroke-width='{:.2f}'>", view_colour(v, views), r.data.width / 600.0);
    for (std::size_t i = 0; i < r.data.views[v].size(); ++i) {
      if (!r.fit().used[v][i]) continue;
      const Eigen::Vector2d& q = r.data.views[v][i];
      const Eigen::Vector2d end = q + factor * r.fit().residual_px[v][i];
      body += fmt::format("<line x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}'/>", q.x(), q.y(), end.x(), end.y());
    }
    body += "</g>";
  }
  body += fmt::format("<text x='{0}' y='{1}' font-size='{0}' fill='#888'>{2:.0f}x</text>", r.data.width / 40,
                      r.data.height - r.data.width / 40, factor);
  return svg_of(r.data.width, r.data.height, body);
}

std::string map_svg(const SigmaMap& map, int width, int height) {
  double most = 0;
  for (double v : map.value)
    if (std::isfinite(v)) most = std::max(most, v);
  const double w = static_cast<double>(width) / map.columns, h = static_cast<double>(height) / map.rows;
  std::string body;
  for (int j = 0; j < map.rows; ++j)
    for (int i = 0; i < map.columns; ++i) {
      const double value = map.value[j * map.columns + i];
      if (!std::isfinite(value)) continue;
      const auto [fill, ink] = cell_colour(most > 0 ? value / most : 0);
      body += fmt::format(
          "<rect x='{:.1f}' y='{:.1f}' width='{:.1f}' height='{:.1f}' fill='{}'/><text x='{:.1f}' y='{:.1f}' "
          "font-size='{:.1f}' fill='{}' text-anchor='middle'>{:.2g}</text>",
          i * w, j * h, w, h, fill, (i + 0.5) * w, (j + 0.6) * h, 0.3 * w, ink, value);
    }
  return svg_of(width, height, body);
}

std::string lens_html(const LensReport& r) {
  const LensRung& rung = r.choice.rung();
  std::string body = fmt::format(
      "<header><div><h1>{}</h1><p class='lead'>{}: {} views of {}, {} x {} pixels</p></div></header><div "
      "class='cards'>",
      escaped(short_name(rung.model)), "Lens calibration", r.data.views.size(), escaped(r.board.name()), r.data.width,
      r.data.height);
  body += card(fmt::format("{:.3f} px", rung.held_out_px),
               "error in views that the fit has not seen (rms of a coordinate)");
  body += card(fmt::format("{:.3f} px", rung.fit.rms_px), "residual of the fit");
  body += card(fmt::format("{:.3f} to {:.3f} px", r.far.centre, r.far.worst),
               "uncertainty of a direction, middle and worst corner (one sigma)");
  body += card(fmt::format("{:.0f} %", 100 * r.views.covered), "of the picture has points");
  body += "</div>";
  if (!r.warnings.empty()) body += "<div class='box warn'><b>Warnings</b>" + list(r.warnings) + "</div>";
  if (!r.views.advice.empty()) body += "<div class='box warn'><b>Views to add</b>" + list(r.views.advice) + "</div>";
  body += "<h2>Which model</h2><p class='lead'>" + escaped(r.choice.reason) + ".</p>" +
          table_html(ladder_columns(), ladder_rows(r.choice));
  body += pictures_html(r) + photos_html(r) + not_found_html(r.photos);
  if (!r.notes.empty()) body += "<h2>Notes</h2>" + list(r.notes);
  body +=
      "<footer>Residuals and errors are per coordinate. Held out: each view is predicted by a lens fitted without it, "
      "its "
      "pose taken from every second of its points, the error from the others. Uncertainty: the noise of the points "
      "carried through the fit (Kogan, mrcal), as if the model were right; two halves of the views show what it does "
      "not "
      "see. lens.json beside this file holds the numbers for programs.</footer>";
  return page("Lens calibration", body);
}

std::string refused_html(const std::vector<LensPhoto>& photos, const std::string& why) {
  return page("Lens calibration: refused", "<header><div><h1>No lens was fitted</h1></div></header><div class='box'>" +
                                               escaped(why) + "</div>" + not_found_html(photos));
}

}  // namespace countershade::tools

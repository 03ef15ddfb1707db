#include "tools/report/check_page.h"

#include <algorithm>

#include "tools/report/picture.h"
#include "tools/report/plot.h"
#include "tools/report/style.h"

namespace countershade::tools {

namespace {

constexpr int kWidest = 900;  // px of a picture on the page

constexpr const char* kStyle = R"css(
.dot{display:inline-block;width:14px;height:14px;border-radius:50%;vertical-align:-2px;margin-right:10px}
.dot.ok{background:#2f9e60}.dot.LOOK{background:#e0a21b}.dot.WRONG{background:#cf3f30}
.badge.look{background:#b07a08}
ol{padding-left:22px;margin:6px 0}li{margin:6px 0}
td.state{white-space:nowrap}
)css";

std::string row_html(const Finding& f) {
  const std::string light = light_of(f);
  return fmt::format("<tr><td class='state'><span class='dot {0}'></span>{0}</td><td>{1}</td><td>{2}</td></tr>", light,
                     escaped(f.what), escaped(f.measured));
}

std::string to_do_html(const std::vector<Finding>& findings) {
  std::string list;
  for (const bool wrong : {true, false})  // what is wrong comes first
    for (const Finding& f : findings)
      if (wrong ? !f.ok : f.ok && f.caution)
        list += fmt::format("<li><b>{}</b>: {}. {}</li>", escaped(f.what), escaped(f.measured), escaped(f.remedy));
  if (list.empty()) return "<p>Nothing: capture.</p>";
  return "<ol>" + list + "</ol>";
}

}  // namespace

std::string light_of(const Finding& f) {
  return !f.ok ? "WRONG" : f.caution ? "LOOK" : "ok";
}

Result<std::string> check_html(const std::string& rig, const std::vector<Finding>& findings,
                               const std::vector<CheckPicture>& pictures) {
  const bool wrong = std::any_of(findings.begin(), findings.end(), [](const Finding& f) { return !f.ok; });
  const bool look = std::any_of(findings.begin(), findings.end(), [](const Finding& f) { return f.caution; });
  std::string rows;
  for (const Finding& f : findings) rows += row_html(f);
  std::string html =
      "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width,initial-scale=1'><title>Check of " +
      escaped(rig) + "</title><style>" + kReportStyle + kStyle + "</style></head><body><main>\n";
  html += fmt::format(
      "<header><div><h1>Check before capture</h1><p class='lead'>{}</p></div><span class='badge {}'>{}</span></header>",
      escaped(rig),
      wrong  ? "fail"
      : look ? "look"
             : "pass",
      wrong  ? "WRONG"
      : look ? "LOOK"
             : "READY");
  html += "<h2>What to do next</h2><div class='panel'>" + to_do_html(findings) + "</div>";
  html +=
      "<h2>What was measured</h2><div class='panel scroll'><table><tr><th></th><th>what</th><th>measured</th></tr>" +
      rows + "</table></div>";
  if (!pictures.empty()) html += "<h2>Pictures</h2><div class='grid2'>";
  for (const CheckPicture& p : pictures) {
    CS_TRY(const std::string png, png_bytes(reduced_to(p.values, kWidest)));
    html +=
        fmt::format("<figure class='panel'><img alt='{0}' src='{1}'><figcaption><b>{0}</b> {2}</figcaption></figure>",
                    escaped(p.title), data_uri(png), escaped(p.caption));
  }
  if (!pictures.empty()) html += "</div>";
  return html + "</main></body></html>\n";
}

}  // namespace countershade::tools

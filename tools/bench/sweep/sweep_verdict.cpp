#include "tools/bench/sweep/sweep_verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace countershade::bench {

namespace {

std::string cell(double value, const char* format) {
  return std::isnan(value) ? "-" : fmt::format(fmt::runtime(format), value);
}

// The sentence that goes with said(), short enough for a table.
std::string sentence(const SweepPoint& p, Said loudest) {
  const std::string text = loudest == Said::kRefused     ? p.refusal
                           : loudest == Said::kFail      ? p.failure
                           : loudest == Said::kCalibrate ? p.calibrate
                           : loudest == Said::kCheck     ? p.check
                           : loudest == Said::kNoted     ? p.notes
                                                         : "";
  constexpr std::size_t kLongest = 120;
  return text.empty() ? "-" : text.size() > kLongest ? text.substr(0, kLongest) + ".." : text;
}

bool is_right(const SweepPoint& p, const SweepBounds& bounds) {
  if (const auto& d = p.decoding)
    return d->accepted_percent >= bounds.accepted_percent && d->wrong_percent <= bounds.wrong_percent &&
           d->z <= bounds.z;
  return !p.methods.empty() && p.methods.back().percent <= bounds.residual_percent;
}

// What a wrong point is wrong by.
double harm(const SweepPoint& p) {
  return p.decoding ? p.decoding->wrong_percent : p.methods.empty() ? kUnknown : p.methods.back().percent;
}

std::vector<std::string> outcome_columns(const std::vector<std::string>& methods, bool decoding) {
  if (decoding)
    return {"accepted %", "wrong %",    "bias px",   "random px",       "rms z",
            "code",       "forecast %", "printed %", "held-out wrong %"};
  std::vector<std::string> columns;
  for (const std::string& m : methods) columns.push_back(m + " % W"), columns.push_back(m + " x");
  for (const char* c : {"held-out % W", "chi2", "reprojection px", "verify x"}) columns.emplace_back(c);
  return columns;
}

std::vector<std::string> outcome_cells(const std::vector<std::string>& methods, const SweepPoint& p) {
  if (const auto& d = p.decoding)
    return {cell(d->accepted_percent, "{:.2f}"),
            cell(d->wrong_percent, "{:.3f}"),
            cell(d->bias_px, "{:.3f}"),
            cell(d->random_px, "{:.3f}"),
            cell(d->z, "{:.2f}"),
            d->codes.empty() ? "-" : d->codes,
            cell(d->forecast_percent, "{:.2f}"),
            cell(d->printed_percent, "{:.2f}"),
            cell(d->held_out_wrong_percent, "{:.3f}")};
  std::vector<std::string> cells;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    const Residual r = m < p.methods.size() ? p.methods[m] : Residual();
    cells.push_back(cell(r.percent, "{:.3f}")), cells.push_back(cell(r.suppression, "{:.1f}"));
  }
  for (const std::string& c : {cell(p.held_out_percent, "{:.3f}"), cell(p.chi2, "{:.2f}"),
                               cell(p.reprojection_px, "{:.3f}"), cell(p.verify_suppression, "{:.1f}")})
    cells.push_back(c);
  return cells;
}

}  // namespace

Said said(const SweepPoint& p, const SweepBounds& bounds) {
  if (!p.refusal.empty()) return Said::kRefused;
  if (p.pass && !*p.pass) return Said::kFail;
  if (!p.calibrate.empty()) return Said::kCalibrate;
  if (!p.check.empty()) return Said::kCheck;
  if (const auto& d = p.decoding; d && std::fmin(d->printed_percent, d->forecast_percent) < bounds.accepted_percent)
    return Said::kFew;
  if (p.held_out_percent > bounds.held_out_percent) return Said::kHeldOut;
  if (!p.notes.empty()) return Said::kNoted;
  return p.pass ? Said::kPass : Said::kNothing;
}

PointVerdict judge(const SweepPoint& p, const SweepBounds& bounds) {
  const Said loudest = said(p, bounds);
  if (loudest == Said::kRefused) return PointVerdict::kRefused;
  const bool complained = is_complaint(loudest);
  if (is_right(p, bounds)) return complained ? PointVerdict::kFalseAlarm : PointVerdict::kRight;
  return complained ? PointVerdict::kSaidSo : PointVerdict::kSilent;
}

SweepVerdict judge(const std::vector<SweepPoint>& points, const SweepBounds& bounds) {
  SweepVerdict v;
  v.points = static_cast<int>(points.size());
  for (const SweepPoint& p : points) {
    const PointVerdict one = judge(p, bounds);
    v.decoding |= p.decoding.has_value();
    v.right += one == PointVerdict::kRight;
    v.false_alarms += one == PointVerdict::kFalseAlarm;
    v.refused += one == PointVerdict::kRefused;
    v.said_so += one == PointVerdict::kSaidSo;
    v.silent += one == PointVerdict::kSilent;
    SweepPoint unverified = p;
    unverified.pass.reset();
    v.by_verify_alone += one == PointVerdict::kSaidSo && !is_complaint(said(unverified, bounds));
    if (one == PointVerdict::kSilent) v.worst_silent_percent = std::fmax(v.worst_silent_percent, harm(p));
  }
  return v;
}

std::string text_of(const SweepVerdict& v) {
  std::string text =
      fmt::format("{} points: {} right, {} false alarms, {} refused, {} wrong and said so{}, {} wrong in silence",
                  v.points, v.right, v.false_alarms, v.refused, v.said_so,
                  v.decoding ? "" : fmt::format(" ({} by verify alone)", v.by_verify_alone), v.silent);
  if (v.silent > 0)
    text += fmt::format(" (up to {:.2f} % {})", v.worst_silent_percent, v.decoding ? "wrong pixels" : "of white");
  return text;
}

const char* text_of(Said said) {
  constexpr const char* kTexts[] = {"nothing", "PASS",      "note", "held-out", "few",
                                    "check",   "calibrate", "FAIL", "refused"};
  return kTexts[static_cast<int>(said)];
}

const char* text_of(PointVerdict verdict) {
  constexpr const char* kTexts[] = {"right", "false alarm", "refused", "said so", "silent"};
  return kTexts[static_cast<int>(verdict)];
}

void fill_table(const std::vector<std::string>& methods, const std::vector<SweepPoint>& points,
                const SweepBounds& bounds, Study& study) {
  const bool decoding = !points.empty() && points[0].decoding.has_value();
  study.columns = {"series", "value", "predictor"};
  for (std::string& c : outcome_columns(methods, decoding)) study.columns.push_back(std::move(c));
  for (const char* c : {"said", "verdict", "in its words"}) study.columns.emplace_back(c);
  study.rows.clear();
  for (const SweepPoint& p : points) {
    std::vector<std::string> row{p.series, fmt::format("{:.4g}", p.value), cell(p.predictor, "{:.4g}")};
    for (std::string& c : outcome_cells(methods, p)) row.push_back(std::move(c));
    const Said loudest = said(p, bounds);
    for (const std::string& c :
         {std::string(text_of(loudest)), std::string(text_of(judge(p, bounds))), sentence(p, loudest)})
      row.push_back(c);
    study.rows.push_back(std::move(row));
  }
}

std::string csv_of(const Study& study) {
  std::string text;
  const auto line = [&](const std::vector<std::string>& cells) {
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (i) text += ",";
      if (cells[i].find_first_of(",\"\r\n") == std::string::npos) {
        text += cells[i];
        continue;
      }
      text += '"';
      for (char c : cells[i]) text += c == '"' ? std::string("\"\"") : std::string(1, c);
      text += '"';
    }
    text += "\n";
  };
  line(study.columns);
  for (const auto& row : study.rows) line(row);
  return text;
}

}  // namespace countershade::bench

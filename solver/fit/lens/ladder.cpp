#include "solver/fit/lens/ladder.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "solver/fit/lens/lens_parts.h"

namespace countershade::solver {

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kManyOutliers = 0.01;
constexpr double kSignificant = 0.01;

// Continued fraction of the incomplete beta function (Lentz's method; DLMF 8.17.22).
double beta_fraction(double a, double b, double x) {
  constexpr double kTiny = 1e-300;
  double c = 1, d = 1 - (a + b) * x / (a + 1);
  d = 1 / (std::abs(d) < kTiny ? kTiny : d);
  double value = d;
  for (int m = 1; m < 1000; ++m) {
    const double steps[] = {m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
                            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))};
    double change = 1;
    for (double step : steps) {
      d = 1 + step * d;
      c = 1 + step / c;
      d = 1 / (std::abs(d) < kTiny ? kTiny : d);
      if (std::abs(c) < kTiny) c = kTiny;
      change = c * d;
      value *= change;
    }
    if (std::abs(change - 1) < 1e-12) break;
  }
  return value;
}

// Regularised incomplete beta function I_x(a, b).
double incomplete_beta(double a, double b, double x) {
  if (x <= 0) return 0;
  if (x >= 1) return 1;
  const double front =
      std::exp(std::lgamma(a + b) - std::lgamma(a) - std::lgamma(b) + a * std::log(x) + b * std::log1p(-x));
  return x < (a + 1) / (a + b + 2) ? front * beta_fraction(a, b, x) / a : 1 - front * beta_fraction(b, a, 1 - x) / b;
}

const std::vector<std::string> kParametric = {"LENSMODEL_PINHOLE", "LENSMODEL_OPENCV4", "LENSMODEL_OPENCV5",
                                              "LENSMODEL_OPENCV8"};

// The pinhole camera from which all rungs climb, with the points that count.
Result<LensFit> foot_of(const BoardViews& data, const LadderOptions& options, LensChoice& choice) {
  LensFitOptions first;
  first.model = kParametric[0];
  CS_TRY(LensFit foot, fit_lens(data, first));
  LensFit richest = foot;
  for (std::size_t i = 1; i < kParametric.size(); ++i) {
    LensFitOptions next;
    next.model = kParametric[i];
    next.start = &richest;
    next.find_outliers = i + 1 == kParametric.size();
    Result<LensFit> fit = fit_lens(data, next);
    if (!fit) break;
    richest = *std::move(fit);
  }
  if (options.splined && 2 * richest.outliers > kManyOutliers * richest.observations) {
    // So many may be what the rational model cannot describe.
    LensFit all = richest;
    all.used = foot.used;
    LensFitOptions last;
    last.model = splined_model(richest.lens, options.spline_columns);
    last.start = &all;
    last.find_outliers = true;
    const Result<LensFit> fit = fit_lens(data, last);
    if (fit && fit->outliers < richest.outliers) richest = *fit;
  }
  if (richest.outliers > 0)
    choice.notes.push_back(fmt::format("{} of {} points do not fit the rest and were left out", richest.outliers,
                                       richest.outliers + richest.observations / 2));
  foot.used = richest.used;
  return foot;
}

void fit_rungs(const BoardViews& data, const LensFit& foot, const LadderOptions& options, LensChoice& choice) {
  LensFit before = foot;
  std::vector<std::string> models = kParametric;
  if (options.splined) models.emplace_back();  // named when the field of view is known
  for (std::string& model : models) {
    if (model.empty()) model = splined_model(before.lens, options.spline_columns);
    LensRung rung;
    rung.model = model;
    LensFitOptions fit_options;
    fit_options.model = model;
    fit_options.start = &before;
    Result<LensFit> fit = fit_lens(data, fit_options);
    rung.fitted = fit.has_value();
    if (fit) {
      before = *fit;
      rung.fit = *std::move(fit);
      rung.parameters = static_cast<int>(rung.fit.lens.intrinsics().size());
    } else {
      rung.note = fit.error().message;
    }
    choice.rungs.push_back(std::move(rung));
  }
}

void add_bic(LensRung& rung) {
  const double n = rung.fit.observations;
  rung.bic = n * std::log(rung.fit.squares / n) + (n - rung.fit.freedom) * std::log(n);
}

// Views by fold; groups are dealt out in turn.
std::vector<std::vector<int>> folds_of(const std::vector<int>& group, int most) {
  std::map<int, std::vector<int>> groups;
  for (std::size_t v = 0; v < group.size(); ++v) groups[group[v]].push_back(static_cast<int>(v));
  std::vector<std::vector<int>> folds(std::min<std::size_t>(most, groups.size()));
  std::size_t at = 0;
  for (const auto& [id, views] : groups) {
    auto& fold = folds[at++ % folds.size()];
    fold.insert(fold.end(), views.begin(), views.end());
  }
  return folds;
}

// Mean squared held-out error per view; NaN where a fold does not fit.
std::vector<double> cross_validate(const BoardViews& data, const LensRung& rung,
                                   const std::vector<std::vector<int>>& folds, const std::function<void()>& tick) {
  std::vector<double> squares(data.views.size(), kNaN);
  for (const auto& fold : folds) {
    std::vector<int> rest;
    for (int v = 0; v < static_cast<int>(data.views.size()); ++v)
      if (std::find(fold.begin(), fold.end(), v) == fold.end()) rest.push_back(v);
    const LensFit start = subset(rung.fit, rest);
    LensFitOptions options;
    options.model = rung.model;
    options.start = &start;
    const Result<LensFit> fit = fit_lens(subset(data, rest), options);
    for (int v : fold)
      if (fit) squares[v] = held_out_square(data, data.views[v], fit->lens, rung.fit.used[v]);
    tick();
  }
  return squares;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

// Views that no rung predicts say nothing about rungs; how many.
std::size_t leave_out_unjudged(std::vector<std::vector<double>>& squares) {
  std::size_t views = 0, left = 0;
  for (const auto& rung : squares) views = std::max(views, rung.size());
  for (std::size_t v = views; v-- > 0;) {
    const auto judged = [&](const auto& rung) { return v < rung.size() && std::isfinite(rung[v]); };
    if (std::any_of(squares.begin(), squares.end(), judged)) continue;
    for (auto& rung : squares)
      if (v < rung.size()) rung.erase(rung.begin() + static_cast<std::ptrdiff_t>(v));
    ++left;
  }
  return left;
}

struct Excess {
  double mean = 0, sigma = 0;
};

// Excess over another rung, view by view: what makes a view hard for both does not count.
Excess excess_over(const std::vector<double>& own, const std::vector<double>& other) {
  std::vector<double> more;
  for (std::size_t v = 0; v < own.size(); ++v) more.push_back(own[v] - other[v]);
  Excess excess{mean_of(more), 0};
  double squares = 0;
  for (double m : more) squares += (m - excess.mean) * (m - excess.mean);
  const double n = static_cast<double>(more.size());
  excess.sigma = std::sqrt(squares / (n - 1) / n);
  return excess;
}

// Does `next` say more than noise would, coming from `from`?
bool pays(const LensRung& from, LensRung& next, std::string& why) {
  if (!next.model.starts_with("LENSMODEL_OPENCV")) {
    why = fmt::format("BIC {:.1f} against {:.1f}", next.bic, from.bic);
    return next.bic < from.bic;
  }
  const int more = next.parameters - from.parameters;
  const double F = (from.fit.squares - next.fit.squares) / more / (next.fit.squares / next.fit.freedom);
  next.f_p = f_test_p(F, more, next.fit.freedom);
  why = fmt::format("F-test p = {:.2g}", next.f_p);
  return next.f_p < kSignificant;
}

// Climbs as far as both judges agree.
void climb(LensChoice& choice, const std::vector<std::vector<double>>& squares) {
  for (std::size_t i = 0; i < choice.rungs.size(); ++i) {
    LensRung& next = choice.rungs[i];
    if (!next.fitted) continue;
    if (choice.chosen < 0) {
      choice.chosen = static_cast<int>(i);
      next.verdict = "the foot";
      continue;
    }
    std::string why;
    const Excess gain = excess_over(squares[choice.chosen], squares[i]);
    const bool better = gain.mean > gain.sigma, significant = pays(choice.rung(), next, why);
    next.verdict = fmt::format("{}: held-out {} ({:.1f} standard errors), {} {}",
                               better && significant ? "climbed" : "left", better ? "agrees" : "no gain",
                               gain.sigma > 0 ? gain.mean / gain.sigma : 0.0, why, significant ? "agrees" : "no gain");
    if (better && significant) choice.chosen = static_cast<int>(i);
  }
}

std::string reason_of(const LensChoice& choice) {
  const bool last = choice.chosen + 1 == static_cast<int>(choice.rungs.size());
  return fmt::format("{}, held-out error {:.4f} px: {}", choice.rung().model, choice.rung().held_out_px,
                     last
                         ? "the richest model of the ladder; held-out views and the test both take it"
                         : "no richer model lowers the held-out error by more than one standard error and pays for its "
                           "parameters");
}

}  // namespace

double f_test_p(double F, double above, double below) {
  if (!(F > 0)) return 1;
  return incomplete_beta(below / 2, above / 2, below / (below + above * F));
}

double held_out_square(const BoardViews& data, const BoardView& view, const Lens& lens, const std::vector<bool>& used) {
  double squares = 0;
  int count = 0;
  for (int parity = 0; parity < 2; ++parity) {
    std::vector<bool> from(data.board.points());
    for (int i = 0; i < data.board.points(); ++i)
      from[i] = used[i] && (i % data.board.grid_columns() + i / data.board.grid_columns()) % 2 == parity;
    const std::optional<Pose> pose = fit_pose(data, view, lens, from);
    if (!pose) return kNaN;
    for (int i = 0; i < data.board.points(); ++i) {
      if (!used[i] || from[i]) continue;
      squares += (lens.project(*pose * data.board.point(i)) - view[i]).squaredNorm();
      count += 2;
    }
  }
  return count ? squares / count : kNaN;
}

Result<LensChoice> choose_lens(const BoardViews& data, const std::vector<int>& group, const LadderOptions& options,
                               Progress& progress) {
  CS_CHECK(group.size() == data.views.size(), "a group per view");
  LensChoice choice;
  CS_TRY(const LensFit foot, foot_of(data, options, choice));
  fit_rungs(data, foot, options, choice);
  const auto folds = folds_of(group, options.folds);
  const double steps = static_cast<double>(folds.size() * choice.rungs.size());
  double done = 0;
  progress.step("held-out views", 0, steps);
  std::vector<std::vector<double>> squares(choice.rungs.size());
  for (std::size_t i = 0; i < choice.rungs.size(); ++i)
    if (choice.rungs[i].fitted)
      squares[i] =
          cross_validate(data, choice.rungs[i], folds, [&] { progress.step("held-out views", ++done, steps); });
  const std::size_t left_out = leave_out_unjudged(squares);
  if (left_out > 0)
    choice.notes.push_back(
        fmt::format("{} views have too few points to be held out; they are fitted but judge nothing", left_out));
  int best = -1;
  for (std::size_t i = 0; i < choice.rungs.size(); ++i) {
    LensRung& rung = choice.rungs[i];
    if (!rung.fitted) continue;
    rung.held_out_px = std::sqrt(mean_of(squares[i]));
    if (!std::isfinite(rung.held_out_px)) {
      rung.fitted = false;
      rung.note = "some held-out views cannot be fitted at all";
    } else if (best < 0 || rung.held_out_px < choice.rungs[best].held_out_px) {
      best = static_cast<int>(i);
    }
  }
  progress.step("held-out views", steps, steps);
  if (best < 0)
    return error(ErrorCode::kRefused,
                 "no lens model fits these {} views when some are held out; take more views that differ",
                 data.views.size());
  for (std::size_t i = 0; i < choice.rungs.size(); ++i) {
    if (!choice.rungs[i].fitted) continue;
    const Excess excess = excess_over(squares[i], squares[best]);
    choice.rungs[i].excess = excess.mean, choice.rungs[i].excess_sigma = excess.sigma;
    add_bic(choice.rungs[i]);
  }
  climb(choice, squares);
  choice.reason = reason_of(choice);
  return choice;
}

}  // namespace countershade::solver

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

void add_tests(LensChoice& choice) {
  const LensRung* before = nullptr;
  for (LensRung& rung : choice.rungs) {
    if (!rung.fitted) continue;
    const double n = rung.fit.observations;
    rung.bic = n * std::log(rung.fit.squares / n) + (n - rung.fit.freedom) * std::log(n);
    if (before && rung.model.starts_with("LENSMODEL_OPENCV")) {
      const int more = rung.parameters - before->parameters;
      const double F = (before->fit.squares - rung.fit.squares) / more / (rung.fit.squares / rung.fit.freedom);
      rung.f_p = f_test_p(F, more, rung.fit.freedom);
    }
    before = &rung;
  }
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

// Excess over the best rung, view by view: what makes a view hard for all rungs does not count.
void compare(LensRung& rung, const std::vector<double>& own, const std::vector<double>& best) {
  std::vector<double> more;
  for (std::size_t v = 0; v < own.size(); ++v) more.push_back(own[v] - best[v]);
  rung.excess = mean_of(more);
  double squares = 0;
  for (double m : more) squares += (m - rung.excess) * (m - rung.excess);
  const double n = static_cast<double>(more.size());
  rung.excess_sigma = std::sqrt(squares / (n - 1) / n);
}

std::string reason_of(const LensChoice& choice, int best) {
  const LensRung &chosen = choice.rung(), &least = choice.rungs[best];
  std::string reason =
      choice.chosen == best
          ? fmt::format(
                "{} has the smallest held-out error, {:.4f} px, and no simpler model lies within one standard "
                "error of it",
                chosen.model, chosen.held_out_px)
          : fmt::format(
                "{} is the simplest model within one standard error of the smallest held-out error: {:.4f} px "
                "against {:.4f} px of {}",
                chosen.model, chosen.held_out_px, least.held_out_px, least.model);
  for (int i = choice.chosen + 1; i < static_cast<int>(choice.rungs.size()); ++i) {
    const LensRung& next = choice.rungs[i];
    if (!next.fitted || !next.model.starts_with("LENSMODEL_OPENCV")) continue;
    reason += next.f_p < 0.01 ? fmt::format("; the F-test would take {} (p = {:.2g}) but held-out views do not agree",
                                            next.model, next.f_p)
                              : fmt::format("; the F-test agrees ({} explains no more than noise, p = {:.2g})",
                                            next.model, next.f_p);
    break;
  }
  return reason;
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
  add_tests(choice);
  const auto folds = folds_of(group, options.folds);
  const double steps = static_cast<double>(folds.size() * choice.rungs.size());
  double done = 0;
  progress.step("held-out views", 0, steps);
  std::vector<std::vector<double>> squares(choice.rungs.size());
  int best = -1;
  for (std::size_t i = 0; i < choice.rungs.size(); ++i) {
    LensRung& rung = choice.rungs[i];
    if (!rung.fitted) continue;
    squares[i] = cross_validate(data, rung, folds, [&] { progress.step("held-out views", ++done, steps); });
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
  for (std::size_t i = 0; i < choice.rungs.size(); ++i)
    if (choice.rungs[i].fitted) compare(choice.rungs[i], squares[i], squares[best]);
  for (std::size_t i = 0; i < choice.rungs.size() && choice.chosen < 0; ++i)
    if (choice.rungs[i].fitted && choice.rungs[i].excess <= choice.rungs[i].excess_sigma)
      choice.chosen = static_cast<int>(i);
  choice.reason = reason_of(choice, best);
  return choice;
}

}  // namespace countershade::solver

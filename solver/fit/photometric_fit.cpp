#include "solver/fit/photometric_fit.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "calib/base/parallel.h"

namespace countershade::solver {

namespace {

// One equation of one patch and channel: m = sum_q a_q p_q + e + k s, all divided by sigma.
// Parameters: a_1 .. a_Q, e, k; those that nothing in the frames can tell are held.
class PatchEquation final : public ceres::CostFunction {
 public:
  PatchEquation(std::vector<double> coefficients, double measured)
      : coefficients_(std::move(coefficients)), measured_(measured) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->push_back(static_cast<int>(coefficients_.size()));
  }
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
    residuals[0] = -measured_;
    for (std::size_t i = 0; i < coefficients_.size(); ++i) residuals[0] += coefficients_[i] * parameters[0][i];
    if (jacobians && jacobians[0]) std::copy(coefficients_.begin(), coefficients_.end(), jacobians[0]);
    return true;
  }

 private:
  std::vector<double> coefficients_;
  double measured_;
};

// Prior knowledge of the indirect gain of a surface and channel.
struct GainPrior {
  double mean = 0.5, sigma = 1;
};

struct PatchSolution {
  std::vector<double> x;  // a_1 .. a_Q, e, k
  double k_sigma = 0;     // from the data alone (infinite where they say nothing)
  double chi2 = 0;
  int freedom = 0;                 // equations less the parameters they determine
  double excess = 0, spread2 = 0;  // sums of squared residuals over the noise, and of squared spreads
};

// What a patch gathers in one frame: F m, and how uncertain the senders' inner structure leaves it. A sender counts as
// one value, although its radiosity varies over it; if that makes each value wrong by a share eps, independently, the
// sum has the standard deviation eps sqrt(sum_j (F_ij m_j)^2): large beside a crease, where one sender dominates.
struct Shade {
  Radiosity sum, spread;
};

struct PatchProblem {
  std::vector<std::vector<double>> rows;  // coefficients over sigma
  std::vector<double> measured;           // over sigma
  std::vector<double> sigma, noise, spread;
  std::vector<double> mean;                // of the photo, over sigma
  std::vector<std::vector<double>> shown;  // per projector: mean of its picture, over sigma
  std::vector<bool> lit;                   // per projector
  double scale = 1;                        // largest m, the unit of weak priors
};

PatchProblem collect(const PhotometricData& data, const std::vector<Shade>& shade, int patch, int c, double share) {
  PatchProblem problem;
  const std::size_t projectors = data.frames.empty() ? 0 : data.frames[0].p.size();
  problem.lit.assign(projectors, false);
  for (std::size_t f = 0; f < data.frames.size(); ++f) {
    const PatchFrame& frame = data.frames[f];
    const double noise = frame.sigma(patch, c);
    if (!frame.channels[c] || !std::isfinite(noise) || noise <= 0) continue;
    const double spread = shade[f].spread(patch, c), sigma = std::hypot(noise, share * spread);
    problem.sigma.push_back(sigma);
    problem.noise.push_back(noise);
    problem.spread.push_back(spread);
    std::vector<double> row;
    for (std::size_t q = 0; q < projectors; ++q) {
      row.push_back(frame.p[q](patch, c) / sigma);
      problem.lit[q] = problem.lit[q] || frame.p[q](patch, c) > 0.05;
    }
    row.push_back(1 / sigma);
    row.push_back(shade[f].sum(patch, c) / sigma);
    problem.rows.push_back(std::move(row));
    problem.measured.push_back(frame.m(patch, c) / sigma);
    problem.mean.push_back(frame.mean[c] / sigma);
    problem.shown.emplace_back();
    for (const std::array<float, 3>& shown : frame.shown) problem.shown.back().push_back(shown[c] / sigma);
    problem.scale = std::max(f ? problem.scale : 0.0, static_cast<double>(frame.m(patch, c)));
  }
  return problem;
}

// Standard deviation of k when only the equations speak.
double k_sigma_of(const PatchProblem& problem, const std::vector<double>& weak) {
  const int n = static_cast<int>(weak.size());
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(n, n);
  for (const auto& row : problem.rows) {
    const Eigen::Map<const Eigen::VectorXd> r(row.data(), n);
    normal += r * r.transpose();
  }
  for (int i = 0; i + 1 < n; ++i) normal(i, i) += weak[i] * weak[i];
  // Schur complement of k: what is left of its information once the others are free.
  const Eigen::VectorXd others = normal.col(n - 1).head(n - 1);
  const double information = normal(n - 1, n - 1) - others.dot(normal.topLeftCorner(n - 1, n - 1).ldlt().solve(others));
  return information > 1e-12 * normal(n - 1, n - 1) && information > 0 ? 1 / std::sqrt(information) : HUGE_VAL;
}

constexpr double kMostVeil = 0.3;  // of a photo's mean; beyond it something else is wrong

// What one patch says of the shares of veil and flare: its part of the normal equations.
struct VeilSums {
  Eigen::Matrix2d normal = Eigen::Matrix2d::Zero();
  Eigen::Vector2d product = Eigen::Vector2d::Zero();
};

// Frisch & Waugh 1933: what is left of the photo's mean, and of the projectors' means times the patch's gains, once a,
// e and k have explained of them what they can, against what is left of the measurements. `gathered`: the patch's sum
// of form factors to patches that are seen: a veil over those counts as light that they send. The model may be wrong by
// a share of the indirect light, so frames count the less the more of it they have: most tells who is lit by nobody.
VeilSums veil_of(const PatchProblem& problem, const std::vector<double>& x, double gathered) {
  constexpr double kModelError = 0.03;
  const int n = static_cast<int>(problem.lit.size()) + 2, rows = static_cast<int>(problem.rows.size());
  Eigen::MatrixXd X(rows, n);
  Eigen::MatrixXd all(rows, 3);  // veil, flare, measurement
  for (int r = 0; r < rows; ++r) {
    const double weight = 1 / std::hypot(1.0, kModelError * problem.rows[r].back());
    X.row(r) = weight * Eigen::Map<const Eigen::RowVectorXd>(problem.rows[r].data(), n);
    double flare = 0;
    for (std::size_t q = 0; q < problem.shown[r].size(); ++q) flare += x[q] * problem.shown[r][q];
    all.row(r) << weight * problem.mean[r] * (1 - x.back() * gathered), weight * flare, weight * problem.measured[r];
  }
  const Eigen::MatrixXd left = all - X * X.completeOrthogonalDecomposition().solve(all);
  return {left.leftCols<2>().transpose() * left.leftCols<2>(), left.leftCols<2>().transpose() * left.col(2)};
}

// `start`: the solution of a former pass, from the data alone; then the prior is robust.
PatchSolution solve_patch(const PatchProblem& problem, const GainPrior& prior, double inflation, double robust_sigma,
                          const std::vector<double>* start) {
  const int n = static_cast<int>(problem.lit.size()) + 2;
  PatchSolution solution;
  solution.x.assign(n, 0.0);
  solution.x[n - 1] = prior.mean;
  if (start) solution.x = *start;
  // Directions that no equation holds are kept at zero by a prior far weaker than any measurement.
  std::vector<double> weak(n, 1e-3 / std::max(problem.scale, 1e-9));
  for (std::size_t q = 0; q < problem.lit.size(); ++q)
    if (!problem.lit[q]) weak[q] = 1e6 / std::max(problem.scale, 1e-9);
  weak[n - 1] = 1 / prior.sigma;
  ceres::Problem::Options problem_options;
  problem_options.disable_all_safety_checks = true;
  ceres::Problem ceres_problem(problem_options);
  double* x = solution.x.data();
  for (std::size_t r = 0; r < problem.rows.size(); ++r) {
    std::vector<double> row = problem.rows[r];
    for (double& v : row) v /= inflation;
    ceres_problem.AddResidualBlock(new PatchEquation(std::move(row), problem.measured[r] / inflation),
                                   new ceres::HuberLoss(robust_sigma), x);
  }
  for (int i = 0; i < n; ++i) {
    std::vector<double> row(n, 0.0);
    row[i] = weak[i];
    // A patch whose own equations contradict its surface's gain is believed: the prior's pull ends at a few spreads.
    ceres::LossFunction* loss = i == n - 1 && start ? new ceres::CauchyLoss(2.0) : nullptr;
    ceres_problem.AddResidualBlock(new PatchEquation(std::move(row), i == n - 1 ? prior.mean * weak[i] : 0.0), loss, x);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.max_num_iterations = 20;
  options.initial_trust_region_radius = 1e12;  // linear but for the loss: the first step is the answer
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &ceres_problem, &summary);
  solution.k_sigma = k_sigma_of(problem, weak) * inflation;
  int parameters = 2;
  for (bool lit : problem.lit) parameters += lit;
  solution.freedom = std::max(0, static_cast<int>(problem.rows.size()) - parameters);
  for (std::size_t r = 0; r < problem.rows.size(); ++r) {
    double residual = -problem.measured[r];
    for (int i = 0; i < n; ++i) residual += problem.rows[r][i] * x[i];
    solution.chi2 += residual * residual;
    const double correction = solution.freedom > 0 ? static_cast<double>(problem.rows.size()) / solution.freedom : 0;
    const double square = std::pow(residual * problem.sigma[r], 2) * correction;
    if (correction > 0)
      solution.excess += square - std::pow(problem.noise[r], 2), solution.spread2 += std::pow(problem.spread[r], 2);
  }
  return solution;
}

// Mean and spread of k over a surface: the spread is what is left of the scatter beyond the patches' own sigma
// (DerSimonian & Laird 1986), so noise does not pass for structure. Patches that hang over the wall's end gather less;
// they are exceptions, not the surface, so what lies beyond three spreads is left out, round by round from the median
// on.
GainPrior pool(std::vector<double> k, std::vector<double> sigma) {
  std::vector<double> sorted;
  for (std::size_t i = 0; i < k.size(); ++i)
    if (std::isfinite(sigma[i])) sorted.push_back(k[i]);
  if (sorted.empty()) return {0.5, 0.5};
  std::nth_element(sorted.begin(), sorted.begin() + sorted.size() / 2, sorted.end());
  GainPrior prior{sorted[sorted.size() / 2], 0.1};
  for (int round = 0; round < 6; ++round) {
    double weights = 0, weighted = 0, Q = 0, own = 0;
    int count = 0;
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < k.size(); ++i)
      if (std::isfinite(sigma[i]) && std::abs(k[i] - prior.mean) < 3 * std::hypot(sigma[i], prior.sigma))
        kept.push_back(i);
    for (std::size_t i : kept) {
      const double w = 1 / (sigma[i] * sigma[i] + prior.sigma * prior.sigma / 4);
      weights += w, weighted += w * k[i], own += w * sigma[i] * sigma[i], ++count;
    }
    if (count < 3) break;
    prior.mean = weighted / weights;
    for (std::size_t i : kept) {
      const double w = 1 / (sigma[i] * sigma[i] + prior.sigma * prior.sigma / 4);
      Q += w * ((k[i] - prior.mean) * (k[i] - prior.mean) - sigma[i] * sigma[i]);
    }
    // One standard error more than estimated: of few patches a spread of zero is not known to be zero.
    const double spread2 = std::max(0.0, Q / weights);
    prior.sigma = std::sqrt(spread2 + std::sqrt(2.0 / (count - 1)) * (spread2 + own / weights));
  }
  return prior;
}

// The share eps that explains the residuals beyond noise: ratio of sums over all patches but the worst hundredth.
double sender_share(const std::vector<std::vector<PatchSolution>>& solutions) {
  std::vector<const PatchSolution*> all;
  for (const auto& channel : solutions)
    for (const PatchSolution& s : channel)
      if (s.spread2 > 0) all.push_back(&s);
  if (all.empty()) return 0;
  const auto ratio = [](const PatchSolution* s) { return s->excess / s->spread2; };
  std::sort(all.begin(), all.end(), [&](const auto* a, const auto* b) { return ratio(a) < ratio(b); });
  double excess = 0, spread2 = 0;
  for (std::size_t i = 0; i < all.size() * 99 / 100; ++i) excess += all[i]->excess, spread2 += all[i]->spread2;
  return spread2 > 0 ? std::sqrt(std::max(0.0, excess / spread2)) : 0;
}

// Errors of predicted held-out frames at seen patches, as fractions of white.
std::vector<double> held_out_errors(const Eigen::MatrixXf& F, const PhotometricData& data, const PhotometricFit& fit) {
  std::vector<double> errors;
  for (const PatchFrame& frame : data.held_out) {
    Radiosity direct = fit.e;
    for (std::size_t q = 0; q < fit.a.size(); ++q) direct += fit.a[q].cwiseProduct(frame.p[q]);
    Radiosity B = direct;
    for (int i = 0; i < 200; ++i) {  // Jacobi; the spectral radius of K is below 1
      const Radiosity next = direct + fit.k.cwiseProduct(Radiosity(F * B));
      const float change = (next - B).cwiseAbs().maxCoeff();
      B = next;
      if (change < 1e-7f * data.white) break;
    }
    for (int i = 0; i < B.rows(); ++i)
      for (int c = 0; c < 3; ++c)
        if (std::isfinite(frame.sigma(i, c)) && data.seen[i] > 0)
          errors.push_back(std::abs((data.grey ? B.row(i).mean() : B(i, c)) - frame.m(i, c)) / data.white);
  }
  return errors;
}

// A fit of frames as they are, and the veil that its residuals show. Where the fit must be refused the veil may be why.
struct PlainFit {
  PhotometricFit fit;
  std::optional<Error> refusal;
  double veil = 0, veil_sigma = HUGE_VAL;
};

// The share that patches agree on, with the standard error that their disagreement gives it.
void pool_veil(const std::vector<VeilSums>& all, PlainFit& plain) {
  VeilSums sum;
  for (const VeilSums& v : all) sum.normal += v.normal, sum.product += v.product;
  if (!(sum.normal(0, 0) > 0)) return;
  // A trace of a prior: where nothing tells them apart flare is zero.
  sum.normal(1, 1) += 1e-9 * sum.normal.trace();
  const Eigen::Matrix2d inverse = sum.normal.inverse();
  const Eigen::Vector2d shares = inverse * sum.product;
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const VeilSums& v : all) {
    const Eigen::Vector2d off = v.product - v.normal * shares;
    scatter += off * off.transpose();
  }
  plain.veil = shares[0];
  plain.veil_sigma = std::sqrt((inverse * scatter * inverse)(0, 0));
  plain.fit.flare = shares[1];
}

Result<PlainFit> fit_frames(const Eigen::MatrixXf& F, const Patches& patches, const PhotometricData& data,
                            const PhotometricOptions& options, Progress& progress) {
  const int P = patches.size();
  const std::size_t projectors = data.frames[0].p.size();
  std::vector<Shade> shade;
  const Eigen::MatrixXf F2 = F.cwiseAbs2();
  for (const PatchFrame& frame : data.frames)
    shade.push_back({F * frame.m, Radiosity(F2 * frame.m.cwiseAbs2()).cwiseSqrt()});

  const Eigen::VectorXf gathered = F * (data.seen.array() > 0).cast<float>().matrix();
  PlainFit plain;
  PhotometricFit& fit = plain.fit;
  fit.a.assign(projectors, Radiosity::Zero(P, 3));
  fit.e = fit.k = fit.k_sigma = Radiosity::Zero(P, 3);
  std::vector<std::vector<PatchSolution>> solutions(3, std::vector<PatchSolution>(P));
  std::vector<std::vector<GainPrior>> priors(3, std::vector<GainPrior>(patches.surfaces()));
  double inflation = 1, share = 0;
  // Noise alone; then with what the residuals say of the senders' inner structure; then with each surface's gain as
  // prior.
  for (int pass = 0; pass < 3; ++pass) {
    progress.step("photometric fit", pass, 3);
    const auto before = solutions;
    parallel_for(P, [&](int i) {
      if (data.seen[i] <= 0) return;
      for (int c = 0; c < 3; ++c)
        solutions[c][i] = solve_patch(collect(data, shade, i, c, share), priors[c][patches.surface_of(i)], inflation,
                                      options.robust_sigma, pass > 1 ? &before[c][i].x : nullptr);
    });
    double chi2 = 0, freedom = 0;
    for (int c = 0; c < 3; ++c)
      for (int i = 0; i < P; ++i) chi2 += solutions[c][i].chi2, freedom += solutions[c][i].freedom;
    if (pass == 0 && !(freedom > 0))
      return error(
          ErrorCode::kRefused,
          "no patch has more photos than unknowns, so there is nothing to fit: {} photometric frames, of which "
          "none may be saturated or of unknown noise; capture the full sequence with a lower exposure",
          data.frames.size());
    if (pass == 0) fit.chi2 = freedom > 0 ? chi2 / freedom : 0;
    if (pass == 0) share = sender_share(solutions);
    if (pass == 1 && freedom > 0) inflation = std::sqrt(std::max(1.0, chi2 / freedom));
    if (pass == 1) {
      std::vector<VeilSums> veil(3 * P);
      parallel_for(P, [&](int i) {
        for (int c = 0; c < 3; ++c)
          if (solutions[c][i].freedom > 0)
            veil[3 * i + c] = veil_of(collect(data, shade, i, c, share), solutions[c][i].x, gathered[i]);
      });
      pool_veil(veil, plain);
    }
    for (int c = 0; c < 3 && pass == 1; ++c)
      for (int s = 0; s < patches.surfaces(); ++s) {
        std::vector<double> k, sigma;
        for (int i = patches.offset(s); i < patches.offset(s) + patches.count(s); ++i) {
          if (data.seen[i] <= 0 || solutions[c][i].x.empty()) continue;
          k.push_back(solutions[c][i].x.back());
          sigma.push_back(solutions[c][i].k_sigma * inflation);
        }
        priors[c][s] = pool(k, sigma);
        if (priors[c][s].mean > 1.02 && !plain.refusal)
          plain.refusal = error(
              ErrorCode::kRefused,
              "surface {} reflects {:.0f} % of the indirect light it receives (channel {}), more than all: likely "
              "causes are wrong geometry or lens model, veiling glare in the camera, a wrong projector response, or "
              "light from outside; check the geometry's residuals first",
              s, 100 * priors[c][s].mean, c);
      }
    if (plain.refusal) return plain;
  }
  for (int c = 0; c < 3; ++c)
    for (int i = 0; i < P; ++i) {
      const GainPrior& prior = priors[c][patches.surface_of(i)];
      const std::vector<double>& x = solutions[c][i].x;
      const double data_sigma = x.empty() ? HUGE_VAL : solutions[c][i].k_sigma;
      fit.k(i, c) = static_cast<float>(std::clamp(x.empty() ? prior.mean : x.back(), 0.0, 1.0));
      fit.k_sigma(i, c) = static_cast<float>(1 / std::hypot(1 / prior.sigma, 1 / data_sigma));
      if (x.empty()) continue;
      for (std::size_t q = 0; q < projectors; ++q) fit.a[q](i, c) = static_cast<float>(std::max(0.0, x[q]));
      fit.e(i, c) = static_cast<float>(std::max(0.0, x[projectors]));
    }
  fit.sender_share = share;
  std::vector<double> errors = held_out_errors(F, data, fit);
  if (!errors.empty()) {
    double sum = 0;
    for (double v : errors) sum += v;
    fit.held_out_error = sum / errors.size();
    const auto nth = errors.begin() + static_cast<std::ptrdiff_t>(0.99 * (errors.size() - 1));
    std::nth_element(errors.begin(), nth, errors.end());
    fit.held_out_p99 = *nth;
  } else {
    fit.notes.push_back("no held-out frame: the model's error on patterns it has not seen is unknown");
  }
  progress.step("photometric fit", 3, 3);
  return plain;
}

}  // namespace

PatchFrame one_primary(const PatchFrame& frame, const PatchFrame& black) {
  PatchFrame as = frame;
  for (int i = 0; i < as.m.rows(); ++i)
    for (int c = 0; c < 3; ++c) {
      as.m(i, c) = 3 * frame.m(i, c) - 2 * black.m(i, c);
      as.sigma(i, c) = std::hypot(3 * frame.sigma(i, c), 2 * black.sigma(i, c));
    }
  for (int c = 0; c < 3; ++c) as.mean[c] = 3 * frame.mean[c] - 2 * black.mean[c];
  return as;
}

std::vector<PatchFrame> without_veil(std::vector<PatchFrame> frames, double share) {
  if (share == 0) return frames;
  for (PatchFrame& frame : frames)
    for (int c = 0; c < 3; ++c) {
      for (int i = 0; i < frame.m.rows(); ++i)  // a patch without a valid pixel has no light to take it from
        if (frame.m(i, c) != 0 || std::isfinite(frame.sigma(i, c)))
          frame.m(i, c) -= static_cast<float>(share) * frame.mean[c];
      frame.mean[c] *= static_cast<float>(1 - share);
    }
  return frames;
}

Result<PhotometricFit> fit_photometry(const Eigen::MatrixXf& F, const Patches& patches, const PhotometricData& data,
                                      const PhotometricOptions& options, Progress& progress) {
  const int P = patches.size();
  CS_CHECK(F.rows() == P && F.cols() == P && data.seen.size() == P, "form factors, patches and data differ in size");
  if (data.frames.size() < 3)
    return error(
        ErrorCode::kRefused,
        "{} photometric frames, at least 3 per primary are needed (two complementary patterns and black); capture "
        "with the sequence that `countershade patterns` writes",
        data.frames.size());
  CS_TRY(PlainFit plain, fit_frames(F, patches, data, options, progress));
  PlainFit clear = plain;
  const bool veiled = !data.held_out.empty() && plain.veil > 5 * plain.veil_sigma;
  // A large veil spoils k, which the first estimate takes for granted: later rounds correct it.
  for (int round = 0; veiled && round < 4 && std::abs(clear.veil) > clear.veil_sigma; ++round) {
    const double veil = clear.fit.veil + clear.veil * (1 - clear.fit.veil);
    if (!(veil > 0 && veil < kMostVeil)) break;
    PhotometricData without = data;
    without.frames = without_veil(data.frames, veil), without.held_out = without_veil(data.held_out, veil);
    CS_TRY(clear, fit_frames(F, patches, without, options, progress));
    clear.fit.veil = veil;
  }
  constexpr double kRescued = 0.005;  // of white: what is left of a fit that had to be refused as it was
  const double bound = plain.refusal ? kRescued : plain.fit.held_out_error;
  if (veiled && !clear.refusal && clear.fit.held_out_error < bound) return std::move(clear.fit);
  if (plain.refusal) return *plain.refusal;
  return std::move(plain.fit);
}

}  // namespace countershade::solver

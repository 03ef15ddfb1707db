#include "solver/fit/geometry_fit.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "calib/base/parallel.h"
#include "solver/fit/geometry_parts.h"

namespace countershade::solver {

namespace {

using parts::Bundle;
using parts::Matches;

struct Problem {
  std::vector<Matches> matches;  // per projector, labelled with common planes
  std::vector<ProjectorSpec> specs;
  std::vector<std::vector<Eigen::Matrix3d>> maps;  // per projector, own planes
  std::vector<std::vector<int>> labels;            // per projector, own -> common
  int planes = 0;
};

Result<Problem> segment(const Device& camera, const std::vector<ProjectorObservation>& observations,
                        const GeometryOptions& options) {
  Problem problem;
  for (std::size_t q = 0; q < observations.size(); ++q) {
    problem.specs.push_back(observations[q].spec);
    Matches matches = parts::draw_matches(camera, observations[q], 4 * options.max_points, options.seed + q);
    if (matches.size() < 200)
      return error(
          ErrorCode::kRefused,
          "projector '{}': {} camera pixels carry both a column and a row, at least 200 are needed for geometry; "
          "look at the reasons picture of its correspondences, and check exposure and focus",
          observations[q].spec.id, matches.size());
    const int most = options.planes > 0 ? options.planes : 6;
    const auto maps = parts::segment_planes(matches, most, options.min_plane_share, options.seed + 77 * q);
    if (maps.empty())
      return error(
          ErrorCode::kRefused,
          "projector '{}': no plane explains {:.0f} % of its pixels; is the screen made of planes ([screen] kind)?",
          observations[q].spec.id, 100 * options.min_plane_share);
    problem.maps.emplace_back();
    problem.labels.emplace_back(maps.size());
    for (const auto& map : maps) problem.maps.back().push_back(map.H);
    problem.matches.push_back(std::move(matches));
  }
  problem.planes = parts::merge_planes(problem.matches, observations[0].x->width(), 8, problem.labels);
  for (std::size_t q = 0; q < problem.matches.size(); ++q)
    for (parts::Match& m : problem.matches[q])
      if (m.plane >= 0) m.plane = problem.labels[q][m.plane];
  return problem;
}

// Keeps at most `count` labelled matches, an equal share for each plane as far as it goes.
Matches thin(const Matches& all, int planes, int count) {
  std::vector<int> taken(planes);
  Matches kept;
  for (const parts::Match& m : all)
    if (m.plane >= 0 && taken[m.plane] < count / planes) ++taken[m.plane], kept.push_back(m);
  return kept;
}

struct Candidate {
  Bundle bundle;  // one projector, its own planes at their common labels (others zero)
  double cost = HUGE_VAL;
};

// One projector alone with the planes it lights, from every start; the cheapest wins.
Result<Candidate> fit_alone(const Problem& problem, int q) {
  // Alone, a projector drifts along its weak direction (PHYSICS 6); its column is held near the prior until the others
  // join.
  ProjectorSpec spec = problem.specs[q];
  spec.lens_shift_sigma *= 0.1;
  std::vector<int> own(problem.labels[q]);
  std::sort(own.begin(), own.end());
  own.erase(std::unique(own.begin(), own.end()), own.end());
  Matches matches = thin(problem.matches[q], problem.planes, 1200);
  std::vector<int> local(problem.planes, -1);
  for (std::size_t i = 0; i < own.size(); ++i) local[own[i]] = static_cast<int>(i);
  for (parts::Match& m : matches) m.plane = local[m.plane];
  if (own.size() == 1 && !(spec.throw_ratio && spec.lens_shift))
    return error(
        ErrorCode::kRefused,
        "projector '{}' lights one plane only: its lens and pose cannot be told from one plane. State {}{}{} for it "
        "in rig.toml, or let it spill at least 30 cm over the edge and capture again",
        spec.id, spec.throw_ratio ? "" : "throw_ratio", !spec.throw_ratio && !spec.lens_shift ? " and " : "",
        spec.lens_shift ? "" : "lens_shift");
  const std::vector<parts::Start> starts = own.size() == 1 ? parts::starts_from_plane(matches, spec, problem.maps[q][0])
                                                           : parts::starts_from_epipolar(matches, spec);
  Candidate best;
  for (const parts::Start& start : starts) {
    Bundle bundle;
    bundle.projectors = {{start.focal, start.cx, start.cy, start.projector_from_camera}};
    bundle.planes = parts::planes_from_start(start, matches, static_cast<int>(own.size()));
    if (std::any_of(bundle.planes.begin(), bundle.planes.end(), [](const auto& w) { return !(w.norm() > 1e-9); }))
      continue;
    const double cost = parts::adjust({matches}, {spec}, false, bundle).cost;
    if (cost < best.cost) best = {bundle, cost};
  }
  if (!std::isfinite(best.cost))
    return error(
        ErrorCode::kRefused,
        "projector '{}': no pose of it explains the correspondences; check that the rows and columns of the "
        "patterns are the projector's own pixels (no scaling, no keystone correction) and that the lens model fits",
        spec.id);
  std::vector<Eigen::Vector3d> common(problem.planes, Eigen::Vector3d::Zero());
  for (std::size_t i = 0; i < own.size(); ++i) common[own[i]] = best.bundle.planes[i];
  best.bundle.planes = common;
  return best;
}

// All projectors in one scale, that of `anchor`: the others are resected on the planes already placed, and bring the
// planes they light besides.
Result<Bundle> join(const Problem& problem, const std::vector<Candidate>& candidates, std::size_t anchor,
                    bool resected) {
  Bundle joint;
  joint.planes.assign(problem.planes, Eigen::Vector3d::Zero());
  joint.projectors.resize(candidates.size());
  std::vector<bool> placed(candidates.size());
  for (std::size_t round = 0; round < candidates.size(); ++round) {
    std::size_t next = candidates.size();
    std::vector<double> ratios;  // of scales, over the planes in common
    for (std::size_t q = 0; q < candidates.size() && next == candidates.size(); ++q) {
      if (placed[q] || (round == 0 && q != anchor)) continue;
      ratios.clear();
      for (int p = 0; p < problem.planes; ++p)
        if (joint.planes[p].norm() > 0 && candidates[q].bundle.planes[p].norm() > 0)
          ratios.push_back(candidates[q].bundle.planes[p].norm() / joint.planes[p].norm());
      if (round == 0 || !ratios.empty()) next = q;
    }
    if (next == candidates.size())
      return error(ErrorCode::kRefused,
                   "the projectors light no common plane, so their scales cannot be joined; let two of them overlap or "
                   "spill onto the same wall");
    placed[next] = true;
    double scale = 1;
    if (!ratios.empty()) {
      std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
      scale = ratios[ratios.size() / 2];
    }
    const Bundle& own = candidates[next].bundle;
    joint.projectors[next] = own.projectors[0];
    joint.projectors[next].projector_from_camera.translation *= scale;
    if (round > 0 && resected)
      if (const auto start = parts::resect(problem.matches[next], joint.planes))
        joint.projectors[next] = {start->focal, start->cx, start->cy, start->projector_from_camera};
    for (int p = 0; p < problem.planes; ++p)
      if (joint.planes[p].norm() == 0) joint.planes[p] = own.planes[p] / scale;
  }
  return joint;
}

// Gives every match to the plane that explains it best, or to none; then adjusts everything together.
// `reach`: projector pixels within which a match belongs to a plane. The result's cost is the mean per match, where one
// that no plane explains counts as kUnexplained: a fit must not win by explaining less.
constexpr double kUnexplained = 12;  // the robust cost of a match at the reach
parts::BundleResult adjust_all(Problem& problem, const GeometryOptions& options, double reach, bool covariance,
                               Bundle& bundle) {
  std::vector<Matches> chosen;
  std::size_t used = 0, explained = 0, all = 0;
  for (std::size_t q = 0; q < problem.matches.size(); ++q) {
    const Bundle::Projector& p = bundle.projectors[q];
    for (parts::Match& m : problem.matches[q]) {
      double best = reach;
      m.plane = -1;
      for (int label = 0; label < problem.planes; ++label) {
        const double inverse_depth = bundle.planes[label].dot(m.ray.homogeneous());
        if (inverse_depth <= 0) continue;
        const Eigen::Vector3d x = p.projector_from_camera * (m.ray.homogeneous() / inverse_depth);
        const double r = (p.focal * x.hnormalized() + Eigen::Vector2d(p.cx, p.cy) - m.q).norm();
        if (x.z() > 0 && r < best) best = r, m.plane = label;
      }
      explained += m.plane >= 0;
      ++all;
    }
    chosen.push_back(
        thin(problem.matches[q], problem.planes, options.max_points / static_cast<int>(problem.matches.size())));
  }
  for (const Matches& m : chosen) used += m.size();
  parts::BundleResult result = parts::adjust(chosen, problem.specs, covariance, bundle);
  result.cost = used ? result.cost / used + kUnexplained * (1 - static_cast<double>(explained) / all) : HUGE_VAL;
  return result;
}

void fill_charts(const Problem& problem, const Bundle& bundle, GeometryFit& fit) {
  std::vector<std::vector<Eigen::Vector3d>> points(problem.planes);
  for (const Matches& matches : problem.matches)
    for (const parts::Match& m : matches)
      if (m.plane >= 0)
        points[m.plane].push_back(m.ray.homogeneous() / bundle.planes[m.plane].dot(m.ray.homogeneous()));
  parts::Charts charts = parts::make_charts(bundle.planes, points);
  fit.screen = std::move(charts.screen);
  fit.planes = std::move(charts.planes);
}

// Sigma of the dihedral angles: the angle's gradient by central differences in the planes' parameters.
void fill_angle_sigma(const Bundle& bundle, const parts::BundleResult& result, GeometryFit& fit) {
  for (const Crease& crease : fit.screen.creases) {
    const auto angle = [&](Eigen::VectorXd w) {
      return std::acos(-w.head<3>().normalized().dot(w.tail<3>().normalized()));
    };
    Eigen::VectorXd w(6), gradient(6);
    w << bundle.planes[crease.surface_a], bundle.planes[crease.surface_b];
    for (int i = 0; i < 6; ++i) {
      Eigen::VectorXd step = Eigen::VectorXd::Zero(6);
      step[i] = 1e-5;
      gradient[i] = (angle(w + step) - angle(w - step)) / 2e-5;
    }
    double variance = 0;
    if (result.plane_covariance.size()) {
      const int at[2] = {3 * crease.surface_a, 3 * crease.surface_b};
      for (int a = 0; a < 2; ++a)
        for (int b = 0; b < 2; ++b)
          variance += gradient.segment<3>(3 * a).dot(result.plane_covariance.block<3, 3>(at[a], at[b]) *
                                                     gradient.segment<3>(3 * b));
    }
    fit.angle_sigma.push_back(std::sqrt(std::max(0.0, variance)));
  }
}

void scale_to_metres(const Device& camera, const ScreenSpec& spec, Bundle& bundle, const GeometryFit& fit,
                     double& known) {
  if (!spec.known_length) return;
  const auto point = [&](const std::array<double, 2>& pixel) {
    return fit.screen.intersect({Eigen::Vector3d::Zero(), camera.lens.unproject({pixel[0], pixel[1]})});
  };
  const ChartPoint a = point(spec.known_length->pixel_a), b = point(spec.known_length->pixel_b);
  if (a.surface < 0 || b.surface < 0) return;
  const double scale = spec.known_length->metres / (fit.screen.point(a) - fit.screen.point(b)).norm();
  for (Eigen::Vector3d& w : bundle.planes) w /= scale;
  for (auto& p : bundle.projectors) p.projector_from_camera.translation *= scale;
  known = 1;
}

}  // namespace

Result<GeometryFit> fit_geometry(const Device& camera, const std::vector<ProjectorObservation>& observations,
                                 const ScreenSpec& screen, const GeometryOptions& options, Progress& progress) {
  CS_CHECK(!observations.empty(), "no projector");
  const double steps = observations.size() + 3.0;
  progress.step("geometry", 0, steps);
  CS_TRY(Problem problem, segment(camera, observations, options));
  progress.step("geometry", 1, steps);
  std::vector<Candidate> candidates;
  for (std::size_t q = 0; q < observations.size(); ++q) {
    CS_TRY(Candidate candidate, fit_alone(problem, static_cast<int>(q)));
    candidates.push_back(std::move(candidate));
    progress.step("geometry", 2.0 + q, steps);
  }
  // Any projector alone may have drifted along its weak direction (PHYSICS 6); together they hold each other. So each
  // is tried as the one to begin with, and the adjustment of all decides.
  Bundle bundle;
  double least = HUGE_VAL;
  const std::vector<ProjectorSpec> stated = problem.specs;
  for (std::size_t anchor = 0; anchor < candidates.size(); ++anchor)
    for (int way = 0; way < 4; ++way) {
      CS_TRY(Bundle joint, join(problem, candidates, anchor, way % 2 == 1));
      // What a start explains counts only once it was adjusted; two ways first hold the columns near their prior.
      if (way < 2)
        for (ProjectorSpec& spec : problem.specs) spec.lens_shift_sigma *= 0.1;
      adjust_all(problem, options, 2.0, false, joint);
      if (way < 2) adjust_all(problem, options, 2.0, false, joint);
      problem.specs = stated;
      const double cost = adjust_all(problem, options, 1.5, false, joint).cost;
      if (cost < least) least = cost, bundle = joint;
    }
  if (!std::isfinite(least))
    return error(ErrorCode::kRefused,
                 "the projectors' views contradict each other: no common geometry explains all correspondences; did "
                 "anything move during the capture?");
  const parts::BundleResult result = adjust_all(problem, options, 1.0, true, bundle);
  GeometryFit fit;
  fill_charts(problem, bundle, fit);
  scale_to_metres(camera, screen, bundle, fit, fit.scale_known);
  if (fit.scale_known > 0) fill_charts(problem, bundle, fit);
  fill_angle_sigma(bundle, result, fit);
  if (screen.known_length && fit.scale_known == 0)
    fit.notes.push_back("[screen] known_length: one of its two pixels sees no fitted plane; the scale stays arbitrary");
  for (std::size_t q = 0; q < observations.size(); ++q) {
    const Bundle::Projector& p = bundle.projectors[q];
    const auto& resolution = observations[q].spec.resolution;
    ProjectorFit out{observations[q].spec.id,
                     {Lens::pinhole(p.focal, p.cx, p.cy, resolution[0], resolution[1]), p.projector_from_camera},
                     result.rms_px[q],
                     q < result.sigma.size() ? result.sigma[q] : Eigen::Vector4d::Zero()};
    fit.projectors.push_back(std::move(out));
    fit.rms_px = std::max(fit.rms_px, result.rms_px[q]);
    if (!observations[q].spec.lens_shift)
      fit.notes.push_back(
          fmt::format("projector '{}': lens_shift not stated; its principal column is taken as the centre +- {:.0f} px",
                      observations[q].spec.id, observations[q].spec.lens_shift_sigma * resolution[0]));
  }
  progress.step("geometry", steps, steps);
  return fit;
}

}  // namespace countershade::solver

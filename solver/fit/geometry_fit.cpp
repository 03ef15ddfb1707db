#include "solver/fit/geometry_fit.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "solver/fit/geometry_parts.h"

namespace countershade::solver {

namespace {

using parts::Bundle;
using parts::Matches;
using parts::Problem;

// A projector may only brush a plane, and be decoded on little of what it lights there, where the light of the others
// is stronger. Such a plane counts from this share of the projector's matches, if another projector lights it in full.
constexpr double kBrushedShare = 0.003;

// Takes out planes below `least` that no projector sees with more, and numbers the rest anew.
void drop_unconfirmed(const std::vector<std::vector<double>>& supports, double least, Problem& problem) {
  std::vector<double> largest(problem.planes);
  for (std::size_t q = 0; q < supports.size(); ++q)
    for (std::size_t own = 0; own < supports[q].size(); ++own)
      largest[problem.labels[q][own]] = std::max(largest[problem.labels[q][own]], supports[q][own]);
  std::vector<int> renumbered(problem.planes, -1);
  int count = 0;
  for (int p = 0; p < problem.planes; ++p)
    if (largest[p] >= least) renumbered[p] = count++;
  problem.planes = count;
  for (std::size_t q = 0; q < supports.size(); ++q) {
    for (parts::Match& m : problem.matches[q])
      if (m.plane >= 0) m.plane = renumbered[m.plane];
    std::vector<Eigen::Matrix3d> maps;
    std::vector<int> labels;
    for (std::size_t own = 0; own < supports[q].size(); ++own)
      if (const int label = renumbered[problem.labels[q][own]]; label >= 0)
        maps.push_back(problem.maps[q][own]), labels.push_back(label);
    problem.maps[q] = std::move(maps);
    problem.labels[q] = std::move(labels);
  }
}

Result<Problem> segment(const Device& camera, const std::vector<ProjectorObservation>& observations,
                        const GeometryOptions& options) {
  Problem problem;
  std::vector<std::vector<double>> supports;  // per projector and own plane: share of its matches
  for (std::size_t q = 0; q < observations.size(); ++q) {
    problem.specs.push_back(observations[q].spec);
    Matches matches = parts::draw_matches(camera, observations[q], 4 * options.max_points, options.seed + q);
    if (matches.size() < 200)
      return error(
          ErrorCode::kRefused,
          "projector '{}': {} camera pixels carry both a column and a row, at least 200 are needed for geometry; "
          "check exposure and focus",
          observations[q].spec.id, matches.size());
    const int most = options.planes > 0 ? options.planes : 6;
    const auto maps =
        parts::segment_planes(matches, most, std::min(kBrushedShare, options.min_plane_share), options.seed + 77 * q);
    if (maps.empty() || maps[0].support < options.min_plane_share * matches.size())
      return error(
          ErrorCode::kRefused,
          "projector '{}': no plane explains {:.0f} % of its pixels; is the screen made of planes ([screen] kind)?",
          observations[q].spec.id, 100 * options.min_plane_share);
    problem.maps.emplace_back();
    problem.labels.emplace_back(maps.size());
    for (const auto& map : maps) problem.maps.back().push_back(map.H);
    supports.emplace_back();
    for (const auto& map : maps) supports.back().push_back(static_cast<double>(map.support) / matches.size());
    problem.matches.push_back(std::move(matches));
  }
  problem.planes = parts::merge_planes(problem.matches, observations[0].x->width(),
                                       std::max(1, observations[0].x->width() / 240), problem.labels);
  for (std::size_t q = 0; q < problem.matches.size(); ++q)
    for (parts::Match& m : problem.matches[q])
      if (m.plane >= 0) m.plane = problem.labels[q][m.plane];
  drop_unconfirmed(supports, options.min_plane_share, problem);
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

// Gives every match to the plane that explains it best, or to none; then adjusts everything together.
// `reach`: projector pixels within which a match belongs to a plane. The result's cost is the mean per match, where one
// that no plane explains counts as kUnexplained: a fit must not win by explaining less.
constexpr double kUnexplained = 12;  // the robust cost of a match at the reach
constexpr int kFinalists = 3;        // starts that are adjusted on the matches themselves
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
  parts::BundleResult result = parts::adjust(chosen, problem.specs, {.covariance = covariance}, bundle);
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
  progress.step("geometry", 0, 3);
  CS_TRY(Problem problem, segment(camera, observations, options));
  progress.step("geometry", 1, 3);
  CS_TRY(std::vector<Bundle> starts, parts::starts_together(problem));
  progress.step("geometry", 2, 3);
  if (starts.size() > kFinalists) starts.resize(kFinalists);
  Bundle bundle;
  double least = HUGE_VAL;
  for (Bundle& start : starts) {
    adjust_all(problem, options, 2.0, false, start);
    const double cost = adjust_all(problem, options, 1.5, false, start).cost;
    if (cost < least) least = cost, bundle = start;
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
  progress.step("geometry", 3, 3);
  return fit;
}

}  // namespace countershade::solver

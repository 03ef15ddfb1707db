// Global part of the geometry fit: where all projectors may stand together.
//
// A projector alone determines everything but its principal column (PHYSICS 6): every column of a scan gives one or two
// exact solutions, a curve of planes. Two projectors that light the same planes agree where their curves meet. So the
// curves are sampled, matched by the planes they share, and the best meetings adjusted together. All of this runs on
// digests of the matches (means over cells), 50 times fewer than the matches themselves.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <optional>

#include "calib/base/parallel.h"
#include "solver/fit/geometry_parts.h"

namespace countershade::solver::parts {

namespace {

constexpr int kColumns = 13;          // samples of the principal column
constexpr double kReach = 3;          // within so many sigma of the prior
constexpr int kPerColumn = 3;         // solutions kept for one column
constexpr int kMeetings = 24;         // adjusted together, of either way
constexpr double kLeastSigma = 0.03;  // of a cell's mean: what lens models and decoding leave as common error [px]

// One projector alone, its planes at their common labels (zero where it lights none of it).
struct Solution {
  Bundle bundle;
  double cost = HUGE_VAL;
};

// Means of the matches over cells of the ray plane, up to 8 x 8 per plane, about the plane's map.
Matches digest(const Matches& matches, const std::vector<Eigen::Matrix3d>& maps, const std::vector<int>& labels) {
  struct Cell {
    Eigen::Vector2d ray{0, 0}, offset{0, 0};
    double weight = 0;
    int count = 0;
  };
  Matches result;
  for (std::size_t own = 0; own < maps.size(); ++own) {
    const auto predicted = [&](const Eigen::Vector2d& ray) -> Eigen::Vector2d {
      return (maps[own] * ray.homogeneous()).hnormalized();
    };
    Eigen::AlignedBox2d box;
    int count = 0;
    for (const Match& m : matches)
      if (m.plane == labels[own]) box.extend(m.ray), ++count;
    const double across = std::clamp(std::floor(std::sqrt(count / 10.0)), 2.0, 8.0);
    std::map<std::pair<int, int>, Cell> cells;
    for (const Match& m : matches) {
      if (m.plane != labels[own]) continue;
      // A plane may be seen along one line of pixels, where the box has no width.
      const Eigen::Vector2d at = (m.ray - box.min()).cwiseQuotient(box.sizes().cwiseMax(1e-12)) * (across - 1e-6);
      Cell& cell = cells[{static_cast<int>(at.x()), static_cast<int>(at.y())}];
      const double weight = 1 / (m.sigma * m.sigma);
      cell.ray += weight * m.ray;
      cell.offset += weight * (m.q - predicted(m.ray));
      cell.weight += weight;
      ++cell.count;
    }
    for (const auto& [where, cell] : cells) {
      if (cell.count < 4) continue;
      const Eigen::Vector2d ray = cell.ray / cell.weight;
      result.push_back({ray, predicted(ray) + cell.offset / cell.weight,
                        std::max(kLeastSigma, 1 / std::sqrt(cell.weight)), 0, labels[own]});
    }
  }
  return result;
}

// The planes of a projector's digest, adjusted from one start with its column held.
Solution solve_alone(const Matches& matches, const ProjectorSpec& spec, int planes, const Start& start) {
  Solution solution;
  solution.bundle.projectors = {{start.focal, start.cx, start.cy, start.projector_from_camera}};
  solution.bundle.planes = planes_from_start(start, matches, planes);
  for (const Match& m : matches)
    if (!(solution.bundle.planes[m.plane].norm() > 1e-9)) return {};
  solution.cost = adjust({matches}, {spec}, {.robust = false, .hold_columns = true}, solution.bundle).cost;
  return solution;
}

double prior_column(const ProjectorSpec& spec) {
  const double width = spec.resolution[0];
  return (width - 1) / 2 - spec.lens_shift.value_or(std::array<double, 2>{0, 0})[0] * width;
}

// The curve of a projector's solutions over its principal column.
std::vector<Solution> solutions_alone(const Matches& matches, const ProjectorSpec& spec, int planes) {
  const double width = spec.resolution[0];
  std::vector<std::vector<Solution>> found(kColumns);
  parallel_for(kColumns, [&](int i) {
    const double column = prior_column(spec) + kReach * spec.lens_shift_sigma * width * (2.0 * i / (kColumns - 1) - 1);
    for (const Start& start : starts_from_epipolar(matches, spec, column))
      if (Solution s = solve_alone(matches, spec, planes, start); std::isfinite(s.cost)) found[i].push_back(s);
    std::sort(found[i].begin(), found[i].end(), [](const auto& a, const auto& b) { return a.cost < b.cost; });
    // Several starts end in one solution.
    const auto same = [](const Solution& a, const Solution& b) {
      return std::abs(a.bundle.projectors[0].focal / b.bundle.projectors[0].focal - 1) < 1e-3;
    };
    found[i].erase(std::unique(found[i].begin(), found[i].end(), same), found[i].end());
    if (found[i].size() > kPerColumn) found[i].resize(kPerColumn);
  });
  std::vector<Solution> all;
  for (auto& some : found) all.insert(all.end(), some.begin(), some.end());
  return all;
}

// What a projector can be by itself; nothing where its planes do not tell (it only brushes all but one).
Result<std::vector<Solution>> solve_projector(const Problem& problem, int q, const Matches& matches) {
  const ProjectorSpec& spec = problem.specs[q];
  if (problem.maps[q].size() > 1) return solutions_alone(matches, spec, problem.planes);
  if (!(spec.throw_ratio && spec.lens_shift))
    return error(
        ErrorCode::kRefused,
        "projector '{}' lights one plane only: its lens and pose cannot be told from one plane. State {}{}{} for it "
        "in rig.toml, or let it spill at least 30 cm over the edge and capture again",
        spec.id, spec.throw_ratio ? "" : "throw_ratio", !spec.throw_ratio && !spec.lens_shift ? " and " : "",
        spec.lens_shift ? "" : "lens_shift");
  std::vector<Solution> solutions;
  for (const Start& start : starts_from_plane(matches, spec, problem.maps[q][0]))
    if (Solution s = solve_alone(matches, spec, problem.planes, start); std::isfinite(s.cost)) solutions.push_back(s);
  return solutions;
}

// How much larger the planes in common are in `own` than in `joint` (median), and how far they are from each other.
struct Meeting {
  double scale = 1, distance = HUGE_VAL;
};
Meeting meet(const std::vector<Eigen::Vector3d>& joint, const std::vector<Eigen::Vector3d>& own) {
  std::vector<double> ratios;
  for (std::size_t p = 0; p < joint.size(); ++p)
    if (joint[p].norm() > 0 && own[p].norm() > 0) ratios.push_back(own[p].norm() / joint[p].norm());
  if (ratios.empty()) return {};
  std::nth_element(ratios.begin(), ratios.begin() + ratios.size() / 2, ratios.end());
  Meeting meeting{ratios[ratios.size() / 2], 0};
  for (std::size_t p = 0; p < joint.size(); ++p)
    if (joint[p].norm() > 0 && own[p].norm() > 0)
      meeting.distance += (own[p] / meeting.scale - joint[p]).squaredNorm() / joint[p].squaredNorm();
  return meeting;
}

// All projectors in the scale of one solution of an anchor. `distance` ranks unions of one kind.
struct Union {
  Bundle bundle;
  double distance = 0;
  std::vector<bool> placed;
};

Union begin(std::size_t count, std::size_t anchor, const Solution& first) {
  Union result;
  result.bundle.planes = first.bundle.planes;
  result.bundle.projectors.resize(count);
  result.bundle.projectors[anchor] = first.bundle.projectors[0];
  result.placed.resize(count);
  result.placed[anchor] = true;
  return result;
}

// Puts projector q where `solution` has it, made smaller by `scale`, and the planes that only it brings.
void place(std::size_t q, const Solution& solution, double scale, Union& result) {
  result.placed[q] = true;
  result.bundle.projectors[q] = solution.bundle.projectors[0];
  result.bundle.projectors[q].projector_from_camera.translation *= scale;
  for (std::size_t p = 0; p < result.bundle.planes.size(); ++p)
    if (result.bundle.planes[p].norm() == 0) result.bundle.planes[p] = solution.bundle.planes[p] / scale;
}

// Projector q as resected on the planes placed so far. The distance is the mean square of its reprojection in sigma,
// and of its column in sigma of the prior: both are near 1 where the planes are right.
std::optional<std::pair<Solution, double>> resected(const Matches& matches, const ProjectorSpec& spec,
                                                    const std::vector<Eigen::Vector3d>& planes) {
  const std::optional<Start> start = resect(matches, planes);
  if (!start) return std::nullopt;
  Solution solution;
  solution.bundle.projectors = {{start->focal, start->cx, start->cy, start->projector_from_camera}};
  solution.bundle.planes = planes_from_start(*start, matches, static_cast<int>(planes.size()));
  double sum = 0;
  for (const Match& m : matches) {
    if (planes[m.plane].norm() == 0) continue;
    const Eigen::Vector3d x =
        start->projector_from_camera * (m.ray.homogeneous() / planes[m.plane].dot(m.ray.homogeneous()));
    const Eigen::Vector2d q = start->focal * x.hnormalized() + Eigen::Vector2d(start->cx, start->cy);
    sum += (q - m.q).squaredNorm() / (m.sigma * m.sigma) / static_cast<double>(matches.size());
  }
  const double column = (start->cx - prior_column(spec)) / (spec.lens_shift_sigma * spec.resolution[0]);
  return std::pair{solution, sum + column * column};
}

// Each next projector in its own solution that agrees best with the planes placed so far, or resected on them.
enum class Way { kOwnSolutions, kResected };
Union unite(const Problem& problem, const std::vector<Matches>& digests,
            const std::vector<std::vector<Solution>>& curves, std::size_t anchor, const Solution& first, Way way) {
  Union result = begin(curves.size(), anchor, first);
  for (bool progress = true; progress;) {
    progress = false;
    for (std::size_t q = 0; q < curves.size(); ++q) {
      if (result.placed[q]) continue;
      const auto at = way == Way::kResected || curves[q].empty()
                          ? resected(digests[q], problem.specs[q], result.bundle.planes)
                          : std::nullopt;
      if (at) {
        place(q, at->first, 1, result);
        result.distance += at->second;
        progress = true;
        continue;
      }
      Meeting best;
      const Solution* chosen = nullptr;
      for (const Solution& s : curves[q])
        if (const Meeting m = meet(result.bundle.planes, s.bundle.planes); m.distance < best.distance)
          best = m, chosen = &s;
      if (!chosen) continue;
      place(q, *chosen, best.scale, result);
      result.distance += best.distance;
      progress = true;
    }
  }
  return result;
}

bool complete(const Union& u) {
  return std::all_of(u.placed.begin(), u.placed.end(), [](bool placed) { return placed; });
}

}  // namespace

Result<std::vector<Bundle>> starts_together(const Problem& problem) {
  const std::size_t count = problem.matches.size();
  std::vector<Matches> digests;
  std::vector<std::vector<Solution>> curves;
  for (std::size_t q = 0; q < count; ++q) {
    digests.push_back(digest(problem.matches[q], problem.maps[q], problem.labels[q]));
    CS_TRY(std::vector<Solution> solutions, solve_projector(problem, static_cast<int>(q), digests[q]));
    curves.push_back(std::move(solutions));
  }
  if (std::all_of(curves.begin(), curves.end(), [](const auto& c) { return c.empty(); }))
    return error(
        ErrorCode::kRefused,
        "projector '{}': no pose of it (nor of any other) explains the correspondences; check that the rows and "
        "columns of the "
        "patterns are the projector's own pixels (no scaling, no keystone correction) and that the lens model fits",
        problem.specs[0].id);
  std::vector<Union> unions;
  std::string apart;
  for (Way way : {Way::kOwnSolutions, Way::kResected}) {
    std::vector<Union> found;
    for (std::size_t anchor = 0; anchor < count; ++anchor)
      for (const Solution& first : curves[anchor]) {
        Union u = unite(problem, digests, curves, anchor, first, way);
        if (complete(u))
          found.push_back(std::move(u));
        else
          apart = problem.specs[std::find(u.placed.begin(), u.placed.end(), false) - u.placed.begin()].id;
      }
    std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.distance < b.distance; });
    if (found.size() > kMeetings) found.resize(kMeetings);
    unions.insert(unions.end(), found.begin(), found.end());
  }
  if (unions.empty())
    return error(ErrorCode::kRefused,
                 "projector '{}' lights no plane in common with the others that would place it, so their scales cannot "
                 "be joined; let it overlap or spill onto a wall of theirs",
                 apart);
  std::vector<double> costs(unions.size());
  parallel_for(static_cast<int>(unions.size()),
               [&](int i) { costs[i] = adjust(digests, problem.specs, {.robust = false}, unions[i].bundle).cost; });
  std::vector<std::size_t> order(unions.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return costs[a] < costs[b]; });
  std::vector<Bundle> starts;
  for (std::size_t i : order)
    if (std::isfinite(costs[i])) starts.push_back(unions[i].bundle);
  return starts;
}

}  // namespace countershade::solver::parts

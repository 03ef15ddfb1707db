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

#include "calib/base/parallel.h"
#include "solver/fit/geometry_parts.h"

namespace countershade::solver::parts {

namespace {

constexpr int kColumns = 13;          // samples of the principal column
constexpr double kReach = 3;          // within so many sigma of the prior
constexpr int kPerColumn = 3;         // solutions kept for one column
constexpr int kMeetings = 24;         // adjusted together
constexpr double kLeastSigma = 0.03;  // of a cell's mean: what lens models and decoding leave as common error [px]

// One projector alone, its planes at their common labels (zero where it lights none of it).
struct Solution {
  Bundle bundle;
  double cost = HUGE_VAL;
};

// Means of the matches over cells of the ray plane, 8 x 8 per plane, about the plane's map.
Matches digest(const Matches& matches, const std::vector<Eigen::Matrix3d>& maps, const std::vector<int>& labels) {
  constexpr int kCells = 8;
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
    for (const Match& m : matches)
      if (m.plane == labels[own]) box.extend(m.ray);
    std::map<std::pair<int, int>, Cell> cells;
    for (const Match& m : matches) {
      if (m.plane != labels[own]) continue;
      const Eigen::Vector2d at = (m.ray - box.min()).cwiseQuotient(box.sizes()) * (kCells - 1e-6);
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

// The curve of a projector's solutions over its principal column.
std::vector<Solution> solutions_alone(const Matches& matches, const ProjectorSpec& spec, int planes) {
  const double width = spec.resolution[0];
  const double centre = (width - 1) / 2 - spec.lens_shift.value_or(std::array<double, 2>{0, 0})[0] * width;
  std::vector<std::vector<Solution>> found(kColumns);
  parallel_for(kColumns, [&](int i) {
    const double column = centre + kReach * spec.lens_shift_sigma * width * (2.0 * i / (kColumns - 1) - 1);
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

Result<std::vector<Solution>> solve_projector(const Problem& problem, int q, const Matches& matches) {
  const ProjectorSpec& spec = problem.specs[q];
  std::vector<Solution> solutions;
  if (problem.maps[q].size() == 1) {
    if (!(spec.throw_ratio && spec.lens_shift))
      return error(
          ErrorCode::kRefused,
          "projector '{}' lights one plane only: its lens and pose cannot be told from one plane. State {}{}{} for it "
          "in rig.toml, or let it spill at least 30 cm over the edge and capture again",
          spec.id, spec.throw_ratio ? "" : "throw_ratio", !spec.throw_ratio && !spec.lens_shift ? " and " : "",
          spec.lens_shift ? "" : "lens_shift");
    for (const Start& start : starts_from_plane(matches, spec, problem.maps[q][0]))
      if (Solution s = solve_alone(matches, spec, problem.planes, start); std::isfinite(s.cost)) solutions.push_back(s);
  } else {
    solutions = solutions_alone(matches, spec, problem.planes);
  }
  if (solutions.empty())
    return error(
        ErrorCode::kRefused,
        "projector '{}': no pose of it explains the correspondences; check that the rows and columns of the "
        "patterns are the projector's own pixels (no scaling, no keystone correction) and that the lens model fits",
        spec.id);
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

// All projectors in the scale of one solution of `anchor`; each next one in its solution that agrees best with the
// planes placed so far.
struct Union {
  Bundle bundle;
  double distance = 0;
  bool complete = true;  // false: some projector shares no plane with the others
};
Union unite(const std::vector<std::vector<Solution>>& curves, std::size_t anchor, const Solution& first) {
  Union result;
  result.bundle.planes = first.bundle.planes;
  result.bundle.projectors.resize(curves.size());
  result.bundle.projectors[anchor] = first.bundle.projectors[0];
  std::vector<bool> placed(curves.size());
  placed[anchor] = true;
  for (std::size_t round = 1; round < curves.size(); ++round) {
    Meeting best;
    const Solution* chosen = nullptr;
    std::size_t next = 0;
    for (std::size_t q = 0; q < curves.size() && !chosen; ++q) {
      if (placed[q]) continue;
      for (const Solution& s : curves[q])
        if (const Meeting m = meet(result.bundle.planes, s.bundle.planes); m.distance < best.distance)
          best = m, chosen = &s, next = q;
    }
    if (!chosen) return {{}, HUGE_VAL, false};
    placed[next] = true;
    result.distance += best.distance;
    result.bundle.projectors[next] = chosen->bundle.projectors[0];
    result.bundle.projectors[next].projector_from_camera.translation *= best.scale;
    for (std::size_t p = 0; p < result.bundle.planes.size(); ++p)
      if (result.bundle.planes[p].norm() == 0) result.bundle.planes[p] = chosen->bundle.planes[p] / best.scale;
  }
  return result;
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
  std::vector<Union> unions;
  for (std::size_t anchor = 0; anchor < count; ++anchor)
    for (const Solution& first : curves[anchor]) unions.push_back(unite(curves, anchor, first));
  if (!unions[0].complete)
    return error(ErrorCode::kRefused,
                 "the projectors light no common plane, so their scales cannot be joined; let two of them overlap or "
                 "spill onto the same wall");
  std::stable_sort(unions.begin(), unions.end(), [](const auto& a, const auto& b) { return a.distance < b.distance; });
  if (unions.size() > kMeetings) unions.resize(kMeetings);
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

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <opencv2/calib3d.hpp>

#include "calib/base/random.h"
#include "solver/fit/geometry_parts.h"

namespace countershade::solver::parts {

namespace {

// A match agrees with a plane map within this many projector pixels: decoded positions carry up to half a pixel of
// quantisation and the map of a real plane is smooth, so two pixels are generous for the right plane and far too few
// for a wrong one away from the crease.
constexpr double kInlierPx = 2.0;

// Decoded positions of neighbouring pixels share their rounding, so no match counts as better than this [px].
constexpr double kLeastSigma = 0.2;

double residual(const Eigen::Matrix3d& H, const Match& match) {
  const Eigen::Vector3d h = H * match.ray.homogeneous();
  return (h.hnormalized() - match.q).norm();
}

// Homography by least squares on the points' normalised coordinates.
bool fit_homography(const std::vector<const Match*>& points, Eigen::Matrix3d& H) {
  std::vector<cv::Point2d> from, to;
  for (const Match* m : points) {
    from.emplace_back(m->ray.x(), m->ray.y());
    to.emplace_back(m->q.x(), m->q.y());
  }
  const cv::Mat found = cv::findHomography(from, to, 0);
  if (found.empty()) return false;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) H(r, c) = found.at<double>(r, c);
  return H.allFinite();
}

// RANSAC with samples that lie near each other in the picture: a plane is a connected piece of it.
PlaneMap best_map(const std::vector<const Match*>& open, Random& random) {
  PlaneMap best;
  constexpr int kTries = 400;
  for (int attempt = 0; attempt < kTries; ++attempt) {
    const Match* centre = open[random.bits() % open.size()];
    std::vector<std::pair<double, const Match*>> pool;
    for (int i = 0; i < 40; ++i) {
      const Match* m = open[random.bits() % open.size()];
      pool.emplace_back((m->ray - centre->ray).squaredNorm(), m);
    }
    std::sort(pool.begin(), pool.end());
    std::vector<const Match*> sample;
    const std::size_t reach = 8 + random.bits() % 24;  // near for small planes, far for large ones
    for (int i = 0; i < 6; ++i) sample.push_back(pool[random.bits() % reach].second);
    Eigen::Matrix3d H;
    if (!fit_homography(sample, H)) continue;
    int support = 0;
    const std::size_t stride = std::max<std::size_t>(1, open.size() / 2000);
    for (std::size_t i = 0; i < open.size(); i += stride) support += residual(H, *open[i]) < 2 * kInlierPx;
    if (support > best.support) best = {H, support};
  }
  return best;
}

void refine(const std::vector<const Match*>& open, PlaneMap& map) {
  for (double reach : {3.0, 1.5, 1.0, 1.0}) {
    std::vector<const Match*> inliers;
    for (const Match* m : open)
      if (residual(map.H, *m) < reach * kInlierPx) inliers.push_back(m);
    if (inliers.size() < 8 || !fit_homography(inliers, map.H)) break;
    map.support = static_cast<int>(inliers.size());
  }
}

}  // namespace

Matches draw_matches(const Device& camera, const ProjectorObservation& observation, int count, std::uint64_t seed) {
  const Image& x = *observation.x;
  const Image& y = *observation.y;
  std::vector<int> decoded;
  for (int i = 0; i < static_cast<int>(x.data().size()); ++i)
    if (std::isfinite(x.data()[i]) && std::isfinite(y.data()[i])) decoded.push_back(i);
  Random random(seed);
  const int taken = std::min<int>(count, static_cast<int>(decoded.size()));
  for (int i = 0; i < taken; ++i) std::swap(decoded[i], decoded[i + random.bits() % (decoded.size() - i)]);
  Matches matches;
  for (int i = 0; i < taken; ++i) {
    const int pixel = decoded[i];
    const Eigen::Vector3d ray = camera.lens.unproject({pixel % x.width(), pixel / x.width()});
    if (ray.z() <= 0.05) continue;  // beyond 87 degrees off axis a plane's map is no homography worth the name
    const double sigma = observation.sigma ? observation.sigma->data()[pixel] : 0.3;
    matches.push_back({ray.hnormalized(), {x.data()[pixel], y.data()[pixel]}, std::max(kLeastSigma, sigma), pixel, -1});
  }
  return matches;
}

std::vector<PlaneMap> segment_planes(Matches& matches, int max_planes, double min_share, std::uint64_t seed) {
  std::vector<PlaneMap> maps;
  Random random(seed);
  for (Match& m : matches) m.plane = -1;
  while (static_cast<int>(maps.size()) < max_planes) {
    std::vector<const Match*> open;
    for (const Match& m : matches)
      if (m.plane < 0) open.push_back(&m);
    if (open.size() < std::max<std::size_t>(20, static_cast<std::size_t>(min_share * matches.size()))) break;
    PlaneMap map = best_map(open, random);
    if (map.support == 0) break;
    refine(open, map);
    if (map.support < min_share * matches.size()) break;
    for (Match& m : matches)
      if (m.plane < 0 && residual(map.H, m) < kInlierPx) m.plane = static_cast<int>(maps.size());
    maps.push_back(map);
  }
  // Pixels at a crease agree with both planes, and the first took them all: give each to the better one.
  for (Match& m : matches)
    for (int p = 0; p < static_cast<int>(maps.size()) && m.plane >= 0; ++p)
      if (residual(maps[p].H, m) < residual(maps[m.plane].H, m)) m.plane = p;
  return maps;
}

int merge_planes(const std::vector<Matches>& matches, int camera_width, double reach,
                 std::vector<std::vector<int>>& labels) {
  // Votes of neighbouring cells of the camera picture: which label of q sits where which label of r sits.
  const int cell = std::max(1, static_cast<int>(reach));
  std::vector<std::map<std::pair<int, int>, std::map<int, int>>> cells(matches.size());
  for (std::size_t q = 0; q < matches.size(); ++q)
    for (const Match& m : matches[q])
      if (m.plane >= 0) ++cells[q][{m.pixel % camera_width / cell, m.pixel / camera_width / cell}][m.plane];
  std::vector<std::pair<int, int>> nodes;  // (projector, own label)
  for (std::size_t q = 0; q < matches.size(); ++q)
    for (std::size_t own = 0; own < labels[q].size(); ++own) nodes.emplace_back(q, own);
  std::vector<int> parent(nodes.size());
  std::iota(parent.begin(), parent.end(), 0);
  auto find = [&](int i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
  };
  auto node = [&](std::size_t q, int own) {
    return static_cast<int>(std::find(nodes.begin(), nodes.end(), std::make_pair(static_cast<int>(q), own)) -
                            nodes.begin());
  };
  for (std::size_t q = 0; q < matches.size(); ++q) {
    for (std::size_t r = q + 1; r < matches.size(); ++r) {
      std::map<std::pair<int, int>, int> votes;
      for (const auto& [where, mine] : cells[q]) {
        const auto theirs = cells[r].find(where);
        if (theirs == cells[r].end()) continue;
        for (const auto& [a, na] : mine)
          for (const auto& [b, nb] : theirs->second) votes[{a, b}] += std::min(na, nb);
      }
      // Planes of two projectors are one where their pixels coincide, as a share of the smaller's: at a crease cells of
      // different planes coincide too, and a large plane has many of those. Each joins its best partner, if mutual.
      std::vector<std::size_t> size_a(labels[q].size()), size_b(labels[r].size());
      for (const Match& m : matches[q])
        if (m.plane >= 0) ++size_a[m.plane];
      for (const Match& m : matches[r])
        if (m.plane >= 0) ++size_b[m.plane];
      std::map<std::pair<int, int>, double> share;
      for (const auto& [pair, n] : votes)
        if (n > 3)  // three in common are chance, more are a wall
          share[pair] = static_cast<double>(n) / std::min(size_a[pair.first], size_b[pair.second]);
      for (const auto& [pair, mine] : share) {
        bool best = true;
        for (const auto& [other, theirs] : share)
          if (other != pair && (other.first == pair.first || other.second == pair.second) && theirs >= mine)
            best = false;
        if (best) parent[find(node(q, pair.first))] = find(node(r, pair.second));
      }
    }
  }
  std::map<int, int> common;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const int root = find(static_cast<int>(i));
    const int label = common.try_emplace(root, static_cast<int>(common.size())).first->second;
    labels[nodes[i].first][nodes[i].second] = label;
  }
  return static_cast<int>(common.size());
}

}  // namespace countershade::solver::parts

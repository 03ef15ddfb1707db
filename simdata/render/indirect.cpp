#include "simdata/render/indirect.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "calib/base/parallel.h"
#include "calib/base/random.h"

namespace countershade::simdata {

IndirectLight::IndirectLight(std::shared_ptr<const Scene> scene, const std::vector<Emitter>& emitters,
                             const Paint& paint, const Simulation& simulation, std::vector<Eigen::Vector3d> viewers,
                             Progress& progress)
    : scene_(std::move(scene)),
      emitters_(emitters),
      paint_(paint),
      viewers_(std::move(viewers)),
      strata_(std::max(
          4, static_cast<int>(std::lround(std::sqrt(simulation.samples / std::max(1.0, scene_->size() - 1.0)))))),
      seed_(simulation.seed),
      ambient_(static_cast<float>(simulation.ambient)) {
  const int surfaces = scene_->size();
  list_pairs();
  const double side = 1.0 / strata_;
  cells_.resize(surfaces);
  for (int s = 0; s < surfaces; ++s)
    for (int k = 0; k < strata_ * strata_ && scene_->shape(s).form() != Shape::Form::kMesh; ++k)
      cells_[s].push_back(cell_at(s, (k % strata_ + 0.5) * side, (k / strata_ + 0.5) * side, side, side));
  // Few samples mean a draft, for tests: no point in many receivers. More surfaces have fewer each, and so have rooms
  // whose numbers would not fit.
  const bool draft = simulation.samples < 1024;
  const double share = std::sqrt(2.0 / std::max(2, surfaces));
  const int coarse = static_cast<int>(share * (draft ? 140 : 768));
  double fine = share * (draft ? 560 : 4096), columns = 0;
  for (const auto& pairs : pairs_) columns += static_cast<double>(pairs.size()) + coarse;
  constexpr double kMostNumbers = 2e8;  // 800 MB
  fine = std::min(fine, std::max(200.0, kMostNumbers / (columns * surfaces)));
  for (int s = 0; s < surfaces; ++s) {
    fine_.at.emplace_back(*scene_, s, static_cast<int>(fine));
    coarse_.at.emplace_back(*scene_, s, coarse);
    any_by_rays_ |= by_rays(s);
  }
  gather(coarse_, 0, "indirect light, coarse", progress);
  gather(fine_, static_cast<int>(viewers_.size()), "indirect light", progress);
}

std::string IndirectLight::effort() const {
  int receivers = 0;
  std::size_t pairs = 0;
  for (const Receivers& r : fine_.at) receivers += r.size();
  for (const auto& p : pairs_) pairs += p.size();
  return fmt::format(
      "indirect light: {} receiving points, {} strata of each surface (2 samples each, more nearby), {} lit blocks; "
      "{:.0f} MB",
      receivers, strata_ * strata_, pairs, 4e-6 * static_cast<double>(entries_));
}

// Which blocks of which projector light which surface, with one block of margin.
void IndirectLight::list_pairs() {
  const int surfaces = scene_->size();
  column_.assign(surfaces, {});
  pairs_.assign(surfaces, {});
  for (std::size_t q = 0; q < emitters_.size(); ++q) {
    const Emitter& emitter = emitters_[q];
    const int nx = emitter.blocks_x(), ny = emitter.blocks() / nx;
    std::vector<std::vector<char>> lit(surfaces, std::vector<char>(emitter.blocks(), 0));
    const double width = emitter.device().lens.width(), height = emitter.device().lens.height();
    for (int y = 0; y <= 4 * ny; ++y)
      for (int x = 0; x <= 4 * nx; ++x) {
        const Eigen::Vector2d pixel(x * width / (4 * nx) - 0.5, y * height / (4 * ny) - 0.5);
        const int s = scene_->look(emitter.device().ray(pixel)).at.surface;
        if (s >= 0) lit[s][emitter.block_of(pixel)] = 1;
      }
    for (int s = 0; s < surfaces; ++s) {
      std::vector<int> columns(emitter.blocks(), -1);
      for (int b = 0; b < emitter.blocks(); ++b) {
        bool near = false;
        for (int dy = -1; dy <= 1; ++dy)
          for (int dx = -1; dx <= 1; ++dx) {
            const int bx = b % nx + dx, by = b / nx + dy;
            near |= bx >= 0 && by >= 0 && bx < nx && by < ny && lit[s][by * nx + bx];
          }
        if (!near) continue;
        columns[b] = static_cast<int>(pairs_[s].size());
        pairs_[s].emplace_back(static_cast<int>(q), b);
      }
      column_[s].push_back(std::move(columns));
    }
  }
  for (int s = 0; s < surfaces; ++s)
    if (paint_.has_daylight(s)) pairs_[s].emplace_back(-1, 0);
}

void IndirectLight::deposit(Standing& standing, const SurfacePoint& at, int row, const SurfacePoint& y,
                            double weight) const {
  const int t = y.surface;
  const Eigen::Vector3d to_y = (y.x - at.x).normalized(), to_x = -to_y;
  const double reflected = weight * paint_.texture(y);
  const double spread = paint_.evenly_lit(y, to_x);
  const auto add = [&](Wall& wall, double share) {
    for (std::size_t q = 0; q < emitters_.size(); ++q)
      if (const auto beam = emitters_[q].beam(*scene_, y)) {
        const int column = column_[t][q][emitters_[q].block_of(beam->pixel)];
        const double lobe = beam->from_behind ? spread : paint_.lobe(y, beam->to_projector, to_x);
        if (column >= 0) wall.from_blocks[t](row, column) += static_cast<float>(share * lobe * beam->irradiance);
      }
    if (paint_.has_daylight(t))
      wall.from_blocks[t](row, wall.from_blocks[t].cols() - 1) +=
          static_cast<float>(share * spread * paint_.daylight(y));
    const Receivers::Stencil stencil = coarse_.at[t].stencil(y);
    for (int i = 0; i < 4; ++i)
      wall.from_receivers[t](row, stencil.index[i]) += static_cast<float>(share * spread) * stencil.weight[i];
  };
  add(standing.walls[at.surface], reflected);
  if (!paint_.is_glossy(at.surface)) return;
  for (std::size_t k = 0; k < standing.mirrors.size(); ++k) {
    const double mirrored = paint_.glossy(at, to_y, (viewers_[k] - at.x).normalized());
    if (mirrored > 0) add(standing.mirrors[k][at.surface], reflected * mirrored);
  }
}

IndirectLight::Cell IndirectLight::cell_at(int surface, double u, double v, double du, double dv) const {
  const Shape& shape = scene_->shape(surface);
  return {surface, u, v, du, dv, shape.at(u, v).x, shape.diagonal(u, v, du, dv)};
}

void IndirectLight::gather_cell(Standing& standing, const SurfacePoint& at, int row, const Cell& cell, Random& random,
                                int depth) const {
  constexpr double kLargest = 0.25;  // a stratum's diagonal against its distance
  if (depth > 0 && cell.diagonal > kLargest * (cell.centre - at.x).norm()) {
    for (int k = 0; k < 4; ++k)
      gather_cell(standing, at, row,
                  cell_at(cell.surface, cell.u + (k % 2 - 0.5) * cell.du / 2, cell.v + (k / 2 - 0.5) * cell.dv / 2,
                          cell.du / 2, cell.dv / 2),
                  random, depth - 1);
    return;
  }
  const Shape& from = scene_->shape(cell.surface);
  const double du = (random.uniform() - 0.5) * cell.du, dv = (random.uniform() - 0.5) * cell.dv;
  for (double sign : {1.0, -1.0}) {
    const SurfacePoint y = scene_->point(cell.surface, cell.u + sign * du, cell.v + sign * dv);
    see(standing, at, row, y, from.area_element(y.u, y.v) * cell.du * cell.dv / 2);
  }
}

void IndirectLight::see(Standing& standing, const SurfacePoint& at, int row, const SurfacePoint& y, double area) const {
  const Eigen::Vector3d to_y = y.x - at.x;
  const double r2 = to_y.squaredNorm();
  const double cos_x = at.normal.dot(to_y), cos_y = -y.normal.dot(to_y);  // times r
  if (!(cos_x > 0) || !(r2 > 0) || !scene_->visible(at, y.x, y.surface)) return;
  const double weight = cos_x * std::abs(cos_y) * area / (std::numbers::pi * r2 * r2);
  standing.walls[at.surface].escape[row] -= static_cast<float>(weight);
  if (cos_y > 0) deposit(standing, at, row, y, weight);  // the back of a surface is black
}

void IndirectLight::gather_triangle(Standing& standing, const SurfacePoint& at, int row, const Triangle& part,
                                    Random& random, int depth) const {
  constexpr double kLargest = 0.35;
  const auto& mesh = static_cast<const MeshShape&>(scene_->shape(part.surface));
  const auto point = [&](const Eigen::Vector2d& b) {
    SurfacePoint p = mesh.at(part.face, b.x(), b.y());
    p.surface = part.surface;
    return p;
  };
  const auto& [a, b, c] = part.corners;
  const Eigen::Vector3d xa = point(a).x, xb = point(b).x, xc = point(c).x;
  const double size = std::sqrt(std::max({(xa - xb).squaredNorm(), (xb - xc).squaredNorm(), (xc - xa).squaredNorm()}));
  if (depth > 0 && size > kLargest * ((xa + xb + xc) / 3 - at.x).norm()) {
    const Eigen::Vector2d ab = (a + b) / 2, bc = (b + c) / 2, ca = (c + a) / 2;
    const std::array<Eigen::Vector2d, 3> parts[4] = {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}};
    for (const auto& corners : parts)
      gather_triangle(standing, at, row, {part.surface, part.face, corners}, random, depth - 1);
    return;
  }
  double s = random.uniform(), t = random.uniform();
  if (s + t > 1) s = 1 - s, t = 1 - t;
  const double area = (xb - xa).cross(xc - xa).norm() / 2;
  const double weights[3] = {1 - s - t, s, t};
  for (int k = 0; k < 3; ++k)  // turned twice: their mean is the centre
    see(standing, at, row, point(weights[k] * a + weights[(k + 1) % 3] * b + weights[(k + 2) % 3] * c), area / 3);
}

bool IndirectLight::by_rays(int surface) const {
  const auto* mesh = dynamic_cast<const MeshShape*>(&scene_->shape(surface));
  return mesh && static_cast<int>(mesh->triangles().faces.size()) > std::max(4 * strata_ * strata_, 3000);
}

// Cosine-weighted rays: what one meets has the weight 1 / rays.
void IndirectLight::gather_rays(Standing& standing, int surface, int index, Random& random) const {
  const SurfacePoint& at = standing.at[surface].point(index);
  const double weight = 1.0 / (strata_ * strata_);
  for (int k = 0; k < strata_ * strata_; ++k) {
    const double a = (k % strata_ + random.uniform()) / strata_, b = (k / strata_ + random.uniform()) / strata_;
    const SceneHit hit = scene_->hit(at, cosine_direction(at.normal, at.along_u, a, b));
    if (hit.at.surface < 0 || !by_rays(hit.at.surface)) continue;
    standing.walls[surface].escape[index] -= static_cast<float>(weight);
    if (hit.front) deposit(standing, at, index, hit.at, weight);
  }
}

void IndirectLight::gather_at(Standing& standing, int surface, int index) const {
  constexpr int kDepth = 14;
  const SurfacePoint& at = standing.at[surface].point(index);
  standing.walls[surface].escape[index] = 1;
  Random random(mix(seed_ ^ mix((standing.at[surface].size() * 16ull + surface) << 32 | index)));
  for (int t = 0; t < scene_->size(); ++t) {
    const Shape& from = scene_->shape(t);
    if (by_rays(t) || (t == surface && !from.sees_itself())) continue;
    if (const auto* mesh = dynamic_cast<const MeshShape*>(&from)) {
      for (int f = 0; f < static_cast<int>(mesh->triangles().faces.size()); ++f)
        if (t != surface || f != at.face)
          gather_triangle(standing, at, index, {t, f, {{{0, 0}, {1, 0}, {0, 1}}}}, random, kDepth);
      continue;
    }
    const int depth = t == surface ? 4 : kDepth;  // near itself a smooth surface exchanges evenly: 1 / (4 pi R^2)
    for (const Cell& cell : cells_[t]) gather_cell(standing, at, index, cell, random, depth);
  }
  if (any_by_rays_) gather_rays(standing, surface, index, random);
}

IndirectLight::Wall IndirectLight::empty_wall(int surface, int rows) const {
  Wall wall;
  for (int t = 0; t < scene_->size(); ++t) {
    const bool unseen = t == surface && !scene_->shape(t).sees_itself();
    wall.from_blocks.push_back(Weights::Zero(unseen ? 0 : rows, static_cast<int>(pairs_[t].size())));
    wall.from_receivers.push_back(Weights::Zero(unseen ? 0 : rows, coarse_.at[t].size()));
  }
  wall.escape = Eigen::VectorXf::Zero(rows);
  return wall;
}

void IndirectLight::gather(Standing& standing, int viewers, const char* stage, Progress& progress) {
  const int surfaces = scene_->size();
  standing.mirrors.resize(viewers);
  std::vector<std::pair<int, int>> all;  // (surface, receiver)
  const auto count = [&](const Wall& wall) {
    for (const Weights& w : wall.from_blocks) entries_ += w.size();
    for (const Weights& w : wall.from_receivers) entries_ += w.size();
  };
  for (int s = 0; s < surfaces; ++s) {
    const int rows = standing.at[s].size();
    standing.walls.push_back(empty_wall(s, rows));
    count(standing.walls.back());
    for (auto& mirrors : standing.mirrors) {
      mirrors.push_back(paint_.is_glossy(s) ? empty_wall(s, rows) : Wall{});
      count(mirrors.back());
    }
    for (int i = 0; i < rows; ++i) all.emplace_back(s, i);
  }
  constexpr int kSteps = 32;
  const std::size_t total = all.size();
  for (int step = 0; step < kSteps; ++step) {
    progress.step(stage, step, kSteps);
    const std::size_t begin = step * total / kSteps, end = (step + 1) * total / kSteps;
    parallel_for(static_cast<int>(end - begin),
                 [&](int i) { gather_at(standing, all[begin + i].first, all[begin + i].second); });
  }
  progress.step(stage, kSteps, kSteps);
}

Rgb IndirectLight::applied(const std::vector<Weights>& weights, int rows, const std::vector<Rgb>& sent) const {
  constexpr int kRows = 128;
  Rgb out = Rgb::Zero(rows, 4);
  parallel_for((rows + kRows - 1) / kRows, [&](int task) {
    const int first = task * kRows, count = std::min(kRows, rows - first);
    for (std::size_t t = 0; t < weights.size(); ++t)
      if (weights[t].rows() > 0)
        out.middleRows(first, count).noalias() += weights[t].middleRows(first, count) * sent[t];
  });
  return out;
}

std::vector<Rgb> IndirectLight::solve(std::span<const PictureLight> light, int viewer) const {
  const int surfaces = scene_->size();
  std::vector<Rgb> blocks, once, irradiance, bounced(surfaces);
  for (int t = 0; t < surfaces; ++t) {
    Rgb b(pairs_[t].size(), 4);
    for (std::size_t i = 0; i < pairs_[t].size(); ++i) {
      const auto [q, block] = pairs_[t][i];
      const Light4 sent = q < 0 ? Light4(1, 1, 1, 0) : light[q].block_mean[block];
      b.row(i) = (sent * paint_.base()[t]).matrix().transpose();
    }
    blocks.push_back(std::move(b));
  }
  for (int s = 0; s < surfaces; ++s)
    once.push_back(applied(coarse_.walls[s].from_blocks, coarse_.at[s].size(), blocks));
  irradiance = once;
  const auto reflect = [&](int t) {
    bounced[t] = ((irradiance[t].colwise() + coarse_.walls[t].escape * ambient_).array().rowwise() *
                  paint_.base()[t].transpose())
                     .matrix();
  };
  for (int t = 0; t < surfaces; ++t) reflect(t);
  for (int bounce = 0; bounce < 1000; ++bounce) {  // converges like (albedo times form factor) to the power of bounces
    float change = 0, largest = 0;
    for (int s = 0; s < surfaces; ++s) {
      Rgb next = once[s] + applied(coarse_.walls[s].from_receivers, coarse_.at[s].size(), bounced);
      change = std::max(change, (next - irradiance[s]).cwiseAbs().maxCoeff());
      largest = std::max(largest, next.cwiseAbs().maxCoeff());
      irradiance[s] = std::move(next);
      reflect(s);
    }
    if (change <= 1e-6f * largest) break;
  }
  const auto field = [&](const Wall& wall, int rows) {
    return Rgb(applied(wall.from_blocks, rows, blocks) + applied(wall.from_receivers, rows, bounced));
  };
  std::vector<Rgb> fields;
  for (int s = 0; s < surfaces; ++s) fields.push_back(field(fine_.walls[s], fine_.at[s].size()));
  for (int s = 0; s < surfaces; ++s)
    fields.push_back(paint_.is_glossy(s) ? field(fine_.mirrors[viewer][s], fine_.at[s].size()) : Rgb());
  return fields;
}

}  // namespace countershade::simdata

#include "simdata/render/indirect.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "calib/base/parallel.h"
#include "calib/base/random.h"

namespace countershade::simdata {

IndirectLight::IndirectLight(std::shared_ptr<const Scene> scene, const std::vector<Emitter>& emitters,
                             const Paint& paint, const Simulation& simulation, std::vector<Eigen::Vector3d> viewers)
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
  stand(simulation.samples < 1024);
}

Result<std::unique_ptr<IndirectLight>> IndirectLight::make(std::shared_ptr<const Scene> scene,
                                                           const std::vector<Emitter>& emitters, const Paint& paint,
                                                           const Simulation& simulation,
                                                           std::vector<Eigen::Vector3d> viewers, Progress& progress) {
  std::unique_ptr<IndirectLight> light(
      new IndirectLight(std::move(scene), emitters, paint, simulation, std::move(viewers)));
  const std::size_t cameras = light->viewers_.size();
  const bool mirrors = !light->mirrored_.at.empty();
  light->entries_ = light->numbers(light->coarse_.at, 0, false) + light->numbers(light->fine_.at, cameras, false);
  if (mirrors) light->entries_ += 3 * light->numbers(light->mirrored_.at, cameras, true);
  constexpr double kAtMost = 2e9;
  if (light->entries_ > kAtMost) {
    int largest = 0;
    for (int s = 0; s < light->scene_->size(); ++s)
      if (light->coarse_.at[s].size() > light->coarse_.at[largest].size()) largest = s;
    return error(ErrorCode::kBadValue,
                 "[simulation] the light between the surfaces would take {:.0f} MB, {:.0f} at most: simplify surface "
                 "'{}' (light is computed at {} corners of it; faces that meet at less than 30 degrees share theirs){}",
                 4e-6 * light->entries_, 4e-6 * kAtMost, simulation.surfaces[largest].id,
                 light->coarse_.at[largest].size(), mirrors ? ", or set gloss to 0" : "");
  }
  light->coarse_.walls = light->empty_walls(light->coarse_.at, 0, false);
  light->fine_.walls = light->empty_walls(light->fine_.at, cameras, false);
  light->gather(light->coarse_, "indirect light, coarse", progress);
  light->gather(light->fine_, "indirect light", progress);
  if (mirrors) {
    for (Walls& walls : light->mirrored_.channels) walls = light->empty_walls(light->mirrored_.at, cameras, true);
    light->gather_mirrored(progress);
  }
  return light;
}

// Few samples mean a draft, for tests: no point in many receivers. More surfaces have fewer each, and so have rooms
// whose numbers would not fit.
void IndirectLight::stand(bool draft) {
  const int surfaces = scene_->size();
  const double share = std::sqrt(2.0 / std::max(2, surfaces));
  const int coarse = static_cast<int>(share * (draft ? 140 : 768));
  double fine = share * (draft ? 560 : 4096), columns = 0;
  for (const auto& pairs : pairs_) columns += static_cast<double>(pairs.size()) + coarse;
  constexpr double kMostNumbers = 2e8;  // 800 MB
  fine = std::min(fine, std::max(200.0, kMostNumbers / (columns * surfaces)));
  double by_gloss = share * (draft ? 100 : 400);
  const double viewers = static_cast<double>(viewers_.size());
  by_gloss = std::min(by_gloss, std::max(64.0, kMostNumbers / 2 / (3 * (1 + viewers) * columns * surfaces)));
  bool any_gloss = false;
  for (int s = 0; s < surfaces; ++s) {
    fine_.at.emplace_back(*scene_, s, static_cast<int>(fine));
    coarse_.at.emplace_back(*scene_, s, coarse);
    any_by_rays_ |= by_rays(s);
    any_gloss |= paint_.is_glossy(s);
  }
  for (int s = 0; s < surfaces && any_gloss; ++s) mirrored_.at.emplace_back(*scene_, s, static_cast<int>(by_gloss));
}

std::string IndirectLight::effort() const {
  int receivers = 0;
  std::size_t pairs = 0;
  for (const Receivers& r : fine_.at) receivers += r.size();
  for (const auto& p : pairs_) pairs += p.size();
  return fmt::format(
      "indirect light: {} receiving points, {} strata of each surface (2 samples each, more nearby), {} lit blocks; "
      "{:.0f} MB",
      receivers, strata_ * strata_, pairs, 4e-6 * entries_);
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

void IndirectLight::Leaving::add_to(Wall& wall, int row, int t, double share) const {
  for (const auto& [column, weight] : blocks) wall.from_blocks[t](row, column) += static_cast<float>(share * weight);
  for (int i = 0; i < 4; ++i)
    wall.from_receivers[t](row, stencil.index[i]) += static_cast<float>(share * diffuse) * stencil.weight[i];
}

void IndirectLight::leave(const SurfacePoint& y, const Eigen::Vector3d& out, Leaving& light) const {
  const int t = y.surface;
  light.blocks.clear();
  light.stencil = coarse_.at[t].stencil(y), light.diffuse = paint_.directed(y, out);
  const double spread = paint_.evenly_lit(y, out);
  for (std::size_t q = 0; q < emitters_.size(); ++q)
    if (const auto beam = emitters_[q].beam(*scene_, y)) {
      const int column = column_[t][q][emitters_[q].block_of(beam->pixel)];
      const double lobe = beam->from_behind ? spread : paint_.lobe(y, beam->to_projector, out);
      if (column >= 0) light.blocks.emplace_back(column, lobe * beam->irradiance);
    }
  if (paint_.has_daylight(t))
    light.blocks.emplace_back(static_cast<int>(pairs_[t].size()) - 1, spread * paint_.daylight(y));
}

void IndirectLight::mirror(const SurfacePoint& x, const SurfacePoint& y, std::size_t count,
                           std::vector<double>& shares) const {
  shares.assign(1, 1);
  if (!paint_.is_glossy(x.surface)) return;
  for (std::size_t k = 0; k + 1 < count; ++k)
    shares.push_back(paint_.glossy(x, (y.x - x.x).normalized(), (viewers_[k] - x.x).normalized()));
}

void IndirectLight::deposit(Walls& walls, const SurfacePoint& x, int row, const SurfacePoint& y, double share,
                            const std::vector<double>& mirrored, Leaving& scratch) const {
  leave(y, (x.x - y.x).normalized(), scratch);
  const double reflected = share * paint_.texture(y);
  for (std::size_t k = 0; k < mirrored.size(); ++k)
    if (mirrored[k] > 0) scratch.add_to(walls[k][x.surface], row, y.surface, reflected * mirrored[k]);
}

void IndirectLight::deposit_mirrored(const SurfacePoint& x, int row, const SurfacePoint& first, double share,
                                     Random& random) {
  std::vector<double> shares;
  mirror(x, first, mirrored_.channels[0].size(), shares);
  const auto add = [&](const auto& to_wall, const Eigen::Array3d& light) {
    for (int c = 0; c < 3; ++c)
      for (std::size_t k = 0; k < shares.size(); ++k)
        if (shares[k] > 0) to_wall(mirrored_.channels[c][k][x.surface], light[c] * shares[k]);
  };
  SurfacePoint y = first;
  Eigen::Vector3d out = (x.x - y.x).normalized();
  Eigen::Array3d light = Eigen::Array3d::Constant(share);
  Leaving next;
  while (true) {
    const double a = random.uniform(), b = random.uniform();
    const Paint::Mirrored in = paint_.mirrored(y, out, a, b);
    if (!(in.weight > 0)) return;
    light *= in.weight * paint_.texture(y) * paint_.base()[y.surface].head<3>().cast<double>();
    const SceneHit hit = scene_->hit(y, in.direction);
    if (hit.at.surface < 0)
      add([&](Wall& wall, double value) { wall.escape[row] += static_cast<float>(value); }, light);
    if (!hit.front) return;
    y = hit.at, out = -in.direction;
    leave(y, out, next);
    const double texture = paint_.texture(y);
    add([&](Wall& wall, double value) { next.add_to(wall, row, y.surface, value * texture); }, light);
    // Gloss meets gloss: Russian roulette by its share, and by what is left.
    const double survives = std::min(paint_.gloss(y.surface), light.maxCoeff() / share);
    if (random.uniform() < survives)
      light /= survives;
    else
      return;
  }
}

IndirectLight::Cell IndirectLight::cell_at(int surface, double u, double v, double du, double dv) const {
  const Shape& shape = scene_->shape(surface);
  return {surface, u, v, du, dv, shape.at(u, v).x, shape.diagonal(u, v, du, dv)};
}

void IndirectLight::look_at_cell(const SurfacePoint& at, const Cell& cell, Random& random, int depth,
                                 const Visit& visit) const {
  constexpr double kLargest = 0.25;  // a stratum's diagonal against its distance
  if (depth > 0 && cell.diagonal > kLargest * (cell.centre - at.x).norm()) {
    for (int k = 0; k < 4; ++k)
      look_at_cell(at,
                   cell_at(cell.surface, cell.u + (k % 2 - 0.5) * cell.du / 2, cell.v + (k / 2 - 0.5) * cell.dv / 2,
                           cell.du / 2, cell.dv / 2),
                   random, depth - 1, visit);
    return;
  }
  const Shape& from = scene_->shape(cell.surface);
  const double du = (random.uniform() - 0.5) * cell.du, dv = (random.uniform() - 0.5) * cell.dv;
  for (double sign : {1.0, -1.0}) {
    const SurfacePoint y = scene_->point(cell.surface, cell.u + sign * du, cell.v + sign * dv);
    see(at, y, from.area_element(y.u, y.v) * cell.du * cell.dv / 2, random, visit);
  }
}

void IndirectLight::see(const SurfacePoint& at, const SurfacePoint& y, double area, Random& random,
                        const Visit& visit) const {
  const Eigen::Vector3d to_y = y.x - at.x;
  const double r2 = to_y.squaredNorm();
  const double cos_x = at.normal.dot(to_y), cos_y = -y.normal.dot(to_y);  // times r
  if (!(cos_x > 0) || !(r2 > 0) || !scene_->visible(at, y.x, y.surface)) return;
  visit(y, cos_x * std::abs(cos_y) * area / (std::numbers::pi * r2 * r2), cos_y > 0, random);
}

void IndirectLight::look_at_triangle(const SurfacePoint& at, const Triangle& part, Random& random, int depth,
                                     const Visit& visit) const {
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
      look_at_triangle(at, {part.surface, part.face, corners}, random, depth - 1, visit);
    return;
  }
  double s = random.uniform(), t = random.uniform();
  if (s + t > 1) s = 1 - s, t = 1 - t;
  const double area = (xb - xa).cross(xc - xa).norm() / 2;
  const double weights[3] = {1 - s - t, s, t};
  for (int k = 0; k < 3; ++k)  // turned twice: their mean is the centre
    see(at, point(weights[k] * a + weights[(k + 1) % 3] * b + weights[(k + 2) % 3] * c), area / 3, random, visit);
}

bool IndirectLight::by_rays(int surface) const {
  const auto* mesh = dynamic_cast<const MeshShape*>(&scene_->shape(surface));
  return mesh && static_cast<int>(mesh->triangles().faces.size()) > std::max(4 * strata_ * strata_, 3000);
}

// Cosine-weighted rays: what one meets has the share 1 / rays.
void IndirectLight::look_along_rays(const SurfacePoint& at, Random& random, const Visit& visit) const {
  const double share = 1.0 / (strata_ * strata_);
  for (int k = 0; k < strata_ * strata_; ++k) {
    const double a = (k % strata_ + random.uniform()) / strata_, b = (k / strata_ + random.uniform()) / strata_;
    const SceneHit hit = scene_->hit(at, cosine_direction(at.normal, at.along_u, a, b));
    if (hit.at.surface >= 0 && by_rays(hit.at.surface)) visit(hit.at, share, hit.front, random);
  }
}

void IndirectLight::look_around(const Receivers& receivers, int surface, int index, const Visit& visit) const {
  constexpr int kDepth = 14;
  const SurfacePoint& at = receivers.point(index);
  Random random(mix(seed_ ^ mix((receivers.size() * 16ull + surface) << 32 | index)));
  for (int t = 0; t < scene_->size(); ++t) {
    const Shape& from = scene_->shape(t);
    if (by_rays(t) || (t == surface && !from.sees_itself())) continue;
    if (const auto* mesh = dynamic_cast<const MeshShape*>(&from)) {
      for (int f = 0; f < static_cast<int>(mesh->triangles().faces.size()); ++f)
        if (t != surface || f != at.face)
          look_at_triangle(at, {t, f, {{{0, 0}, {1, 0}, {0, 1}}}}, random, kDepth, visit);
      continue;
    }
    const int depth = t == surface ? 4 : kDepth;  // near itself a smooth surface exchanges evenly: 1 / (4 pi R^2)
    for (const Cell& cell : cells_[t]) look_at_cell(at, cell, random, depth, visit);
  }
  if (any_by_rays_) look_along_rays(at, random, visit);
}

// by_gloss: light that comes by way of another surface, from any surface, its own too.
bool IndirectLight::sends(int from, int to, bool by_gloss) const {
  return from != to || scene_->shape(from).sees_itself() || by_gloss;
}

double IndirectLight::numbers(const std::vector<Receivers>& at, std::size_t viewers, bool by_gloss) const {
  double sum = 0;
  for (int s = 0; s < scene_->size(); ++s)
    for (int t = 0; t < scene_->size(); ++t)
      if (sends(t, s, by_gloss))
        sum += (1.0 + (paint_.is_glossy(s) ? static_cast<double>(viewers) : 0.0)) * at[s].size() *
               (static_cast<double>(pairs_[t].size()) + coarse_.at[t].size());
  return sum;
}

IndirectLight::Wall IndirectLight::empty_wall(int surface, int rows, bool by_gloss) const {
  Wall wall;
  for (int t = 0; t < scene_->size(); ++t) {
    const int sent = sends(t, surface, by_gloss) ? rows : 0;
    wall.from_blocks.push_back(Weights::Zero(sent, static_cast<int>(pairs_[t].size())));
    wall.from_receivers.push_back(Weights::Zero(sent, coarse_.at[t].size()));
  }
  wall.escape = Eigen::VectorXf::Zero(rows);
  return wall;
}

IndirectLight::Walls IndirectLight::empty_walls(const std::vector<Receivers>& at, std::size_t viewers,
                                                bool by_gloss) const {
  Walls walls(1 + viewers);
  for (std::size_t k = 0; k < walls.size(); ++k)
    for (int s = 0; s < scene_->size(); ++s)
      walls[k].push_back(k == 0 || paint_.is_glossy(s) ? empty_wall(s, at[s].size(), by_gloss) : Wall{});
  return walls;
}

template <class Each>
void IndirectLight::for_each_receiver(const std::vector<Receivers>& at, const char* stage, Progress& progress,
                                      Each each) const {
  std::vector<std::pair<int, int>> all;  // (surface, receiver)
  for (int s = 0; s < scene_->size(); ++s)
    for (int i = 0; i < at[s].size(); ++i) all.emplace_back(s, i);
  constexpr int kSteps = 32;
  const std::size_t total = all.size();
  for (int step = 0; step < kSteps; ++step) {
    progress.step(stage, step, kSteps);
    const std::size_t begin = step * total / kSteps, end = (step + 1) * total / kSteps;
    parallel_for(static_cast<int>(end - begin), [&](int i) { each(all[begin + i].first, all[begin + i].second); });
  }
  progress.step(stage, kSteps, kSteps);
}

void IndirectLight::gather(Standing& standing, const char* stage, Progress& progress) const {
  for_each_receiver(standing.at, stage, progress, [&](int s, int row) {
    const SurfacePoint& x = standing.at[s].point(row);
    const auto escape = [&](std::size_t k) -> float& { return standing.walls[k][s].escape[row]; };
    escape(0) = 1;
    for (std::size_t k = 1; k < standing.walls.size() && paint_.is_glossy(s); ++k) {
      const Eigen::Vector3d out = (viewers_[k - 1] - x.x).normalized();
      if (x.normal.dot(out) > 0) escape(k) = static_cast<float>(paint_.evenly_lit(x, out) - paint_.directed(x, out));
    }
    std::vector<double> mirrored;
    Leaving scratch;
    look_around(standing.at[s], s, row, [&](const SurfacePoint& y, double share, bool front, Random&) {
      mirror(x, y, standing.walls.size(), mirrored);
      for (std::size_t k = 0; k < mirrored.size(); ++k) escape(k) -= static_cast<float>(share * mirrored[k]);
      if (front) deposit(standing.walls, x, row, y, share, mirrored, scratch);  // the back of a surface is black
    });
  });
}

void IndirectLight::gather_mirrored(Progress& progress) {
  for_each_receiver(mirrored_.at, "indirect light, mirrored", progress, [&](int s, int row) {
    const SurfacePoint& x = mirrored_.at[s].point(row);
    look_around(mirrored_.at[s], s, row, [&](const SurfacePoint& y, double share, bool front, Random& random) {
      if (front && paint_.is_glossy(y.surface)) deposit_mirrored(x, row, y, share, random);
    });
  });
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
  for (int s = 0; s < surfaces; ++s) {
    once.push_back(applied(coarse_.walls[0][s].from_blocks, coarse_.at[s].size(), blocks));
    if (!mirrored_.at.empty()) once[s] += mirrored(0, s, Source::kBlocks, blocks, coarse_.at[s]);
  }
  irradiance = once;
  const auto reflect = [&](int t) {
    bounced[t] = ((irradiance[t].colwise() + coarse_.walls[0][t].escape * ambient_).array().rowwise() *
                  paint_.base()[t].transpose())
                     .matrix();
  };
  for (int t = 0; t < surfaces; ++t) reflect(t);
  for (int bounce = 0; bounce < 1000; ++bounce) {  // converges like (albedo times form factor) to the power of bounces
    float change = 0, largest = 0;
    for (int s = 0; s < surfaces; ++s) {
      Rgb next = once[s] + applied(coarse_.walls[0][s].from_receivers, coarse_.at[s].size(), bounced);
      if (!mirrored_.at.empty()) next += mirrored(0, s, Source::kReceivers, bounced, coarse_.at[s]);
      change = std::max(change, (next - irradiance[s]).cwiseAbs().maxCoeff());
      largest = std::max(largest, next.cwiseAbs().maxCoeff());
      irradiance[s] = std::move(next);
      reflect(s);
    }
    if (change <= 1e-6f * largest) break;
  }
  const auto field = [&](int k, int s) {
    const int rows = fine_.at[s].size();
    Rgb sum =
        applied(fine_.walls[k][s].from_blocks, rows, blocks) + applied(fine_.walls[k][s].from_receivers, rows, bounced);
    if (!mirrored_.at.empty())
      sum += mirrored(k, s, Source::kBlocks, blocks, fine_.at[s]) +
             mirrored(k, s, Source::kReceivers, bounced, fine_.at[s]);
    return sum;
  };
  std::vector<Rgb> fields;
  for (int s = 0; s < surfaces; ++s) fields.push_back(field(0, s));
  for (int s = 0; s < surfaces; ++s) fields.push_back(paint_.is_glossy(s) ? field(1 + viewer, s) : Rgb());
  return fields;
}

Rgb IndirectLight::mirrored(int towards, int surface, Source source, const std::vector<Rgb>& sent,
                            const Receivers& to) const {
  const Receivers& from = mirrored_.at[surface];
  Rgb at = Rgb::Zero(from.size(), 4);
  for (int c = 0; c < 3; ++c) {
    const Wall& wall = mirrored_.channels[c][towards][surface];
    if (source == Source::kBlocks) at.col(c) = wall.escape * ambient_;
    const std::vector<Weights>& weights = source == Source::kBlocks ? wall.from_blocks : wall.from_receivers;
    for (std::size_t t = 0; t < weights.size(); ++t) at.col(c).noalias() += weights[t] * sent[t].col(c);
  }
  Rgb out(to.size(), 4);
  for (int i = 0; i < to.size(); ++i) {
    const Receivers::Stencil stencil = from.stencil(to.point(i));
    out.row(i).setZero();
    for (int k = 0; k < 4; ++k) out.row(i) += stencil.weight[k] * at.row(stencil.index[k]);
  }
  return out;
}

}  // namespace countershade::simdata

#include "simdata/render/indirect.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "calib/base/parallel.h"
#include "calib/base/random.h"

namespace countershade::simdata {

namespace {

// The side of a chart that lies on the crease x = z = 0.
double crease_side(const Surface& surface) {
  const auto off_axis = [&](double u) {
    const Eigen::Vector3d x = surface.point(u, 0.5);
    return std::hypot(x.x(), x.z());
  };
  return off_axis(0) < off_axis(1) ? 0 : 1;
}

}  // namespace

IndirectLight::IndirectLight(std::shared_ptr<const Scene> scene, const std::vector<Emitter>& emitters,
                             const Paint& paint, const Simulation& simulation, Progress& progress)
    : scene_(std::move(scene)),
      emitters_(emitters),
      paint_(paint),
      strata_(std::max(2, static_cast<int>(std::lround(std::sqrt(simulation.samples))))),
      seed_(simulation.seed),
      ambient_(static_cast<float>(simulation.ambient)) {
  std::vector<double> sides;
  for (const auto& surface : scene_->screen().surfaces) sides.push_back(crease_side(*surface));
  const bool draft = simulation.samples < 1024;  // few samples, for tests: no point in many receivers
  fine_.grid = draft ? ReceiverGrid(28, 20, sides) : ReceiverGrid(64, 64, sides);
  coarse_.grid = draft ? ReceiverGrid(14, 10, sides) : ReceiverGrid(32, 24, sides);
  list_pairs(emitters);
  gather(coarse_, "indirect light, coarse", progress);
  gather(fine_, "indirect light", progress);
}

// Which blocks of which projector light which wall, with one block of margin.
void IndirectLight::list_pairs(const std::vector<Emitter>& emitters) {
  const int surfaces = scene_->screen().size();
  column_.assign(surfaces, {});
  pairs_.assign(surfaces, {});
  for (std::size_t q = 0; q < emitters.size(); ++q) {
    const Emitter& emitter = emitters[q];
    const int nx = emitter.blocks_x(), ny = emitter.blocks() / nx;
    std::vector<std::vector<char>> lit(surfaces, std::vector<char>(emitter.blocks(), 0));
    const double width = emitter.device().lens.width(), height = emitter.device().lens.height();
    for (int y = 0; y <= 4 * ny; ++y)
      for (int x = 0; x <= 4 * nx; ++x) {
        const Eigen::Vector2d pixel(x * width / (4 * nx) - 0.5, y * height / (4 * ny) - 0.5);
        const int s = scene_->screen().intersect(emitter.device().ray(pixel)).surface;
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
}

void IndirectLight::deposit(Wall& wall, int row, const ChartPoint& y, double weight) const {
  const int t = y.surface;
  const Eigen::Vector3d x = scene_->screen().point(y);
  const double reflected = weight * paint_.texture(t, y.u, y.v);
  for (std::size_t q = 0; q < emitters_.size(); ++q)
    if (const auto beam = emitters_[q].beam(*scene_, t, x)) {
      const int column = column_[t][q][emitters_[q].block_of(beam->pixel)];
      if (column >= 0) wall.from_blocks[t](row, column) += static_cast<float>(reflected * beam->irradiance);
    }
  const ReceiverGrid::Stencil stencil = coarse_.grid.stencil(t, y.u, y.v);
  for (int i = 0; i < 4; ++i)
    wall.from_receivers[t](row, stencil.index[i]) += static_cast<float>(reflected) * stencil.weight[i];
}

void IndirectLight::gather_cell(Wall& wall, const ChartPoint& at, int row, const Cell& cell, Random& random,
                                int depth) const {
  constexpr double kLargest = 0.25;  // a stratum's diagonal against its distance
  const PlaneSurface& from = scene_->plane(cell.surface);
  const Eigen::Vector3d x = scene_->screen().point(at), normal = scene_->screen().normal(at);
  const double diagonal = (cell.du * from.along_u() + cell.dv * from.along_v()).norm();
  if (depth > 0 && diagonal > kLargest * (from.point(cell.u, cell.v) - x).norm()) {
    for (int k = 0; k < 4; ++k)
      gather_cell(wall, at, row,
                  {cell.surface, cell.u + (k % 2 - 0.5) * cell.du / 2, cell.v + (k / 2 - 0.5) * cell.dv / 2,
                   cell.du / 2, cell.dv / 2},
                  random, depth - 1);
    return;
  }
  const double du = (random.uniform() - 0.5) * cell.du, dv = (random.uniform() - 0.5) * cell.dv;
  for (double sign : {1.0, -1.0}) {
    const ChartPoint y{cell.surface, cell.u + sign * du, cell.v + sign * dv};
    const Eigen::Vector3d to_y = from.point(y.u, y.v) - x;
    const double r2 = to_y.squaredNorm();
    const double cos_x = normal.dot(to_y), cos_y = -from.normal(0, 0).dot(to_y);  // times r
    if (!(cos_x > 0) || !scene_->visible(at.surface, x, x + to_y, cell.surface)) continue;
    const double area = from.area_element(y.u, y.v) * cell.du * cell.dv / 2;
    const double weight = cos_x * std::abs(cos_y) * area / (std::numbers::pi * r2 * r2);
    wall.escape[row] -= static_cast<float>(weight);
    if (cos_y > 0) deposit(wall, row, y, weight);  // the back of a wall is black
  }
}

void IndirectLight::gather_at(Receivers& receivers, int surface, int index) const {
  constexpr int kDepth = 14;
  const ChartPoint at = receivers.grid.point(surface, index);
  Wall& wall = receivers.walls[surface];
  wall.escape[index] = 1;
  Random random(mix(seed_ ^ mix((receivers.grid.per_surface() * 16ull + surface) << 32 | index)));
  const double side = 1.0 / strata_;
  for (int t = 0; t < scene_->screen().size(); ++t)
    for (int k = 0; t != surface && k < strata_ * strata_; ++k)  // a plane does not see itself
      gather_cell(wall, at, index, {t, (k % strata_ + 0.5) * side, (k / strata_ + 0.5) * side, side, side}, random,
                  kDepth);
}

void IndirectLight::gather(Receivers& receivers, const char* stage, Progress& progress) const {
  const int surfaces = scene_->screen().size(), rows = receivers.grid.per_surface();
  for (int s = 0; s < surfaces; ++s) {
    Wall wall;
    for (int t = 0; t < surfaces; ++t) {
      wall.from_blocks.push_back(Weights::Zero(t == s ? 0 : rows, static_cast<int>(pairs_[t].size())));
      wall.from_receivers.push_back(Weights::Zero(t == s ? 0 : rows, coarse_.grid.per_surface()));
    }
    wall.escape = Eigen::VectorXf::Zero(rows);
    receivers.walls.push_back(std::move(wall));
  }
  constexpr int kSteps = 32;
  const int total = surfaces * rows;
  for (int step = 0; step < kSteps; ++step) {
    progress.step(stage, step, kSteps);
    const int begin = step * total / kSteps, end = (step + 1) * total / kSteps;
    parallel_for(end - begin, [&](int i) { gather_at(receivers, (begin + i) / rows, (begin + i) % rows); });
  }
  progress.step(stage, kSteps, kSteps);
}

std::vector<Rgb> IndirectLight::apply(const Receivers& receivers, const std::vector<Rgb>& blocks,
                                      const std::vector<Rgb>& bounced) const {
  constexpr int kRows = 128;
  const int surfaces = scene_->screen().size(), rows = receivers.grid.per_surface();
  const int chunks = (rows + kRows - 1) / kRows;
  std::vector<Rgb> out(surfaces, Rgb::Zero(rows, 4));
  parallel_for(surfaces * chunks, [&](int task) {
    const int s = task / chunks, first = task % chunks * kRows, count = std::min(kRows, rows - first);
    for (int t = 0; t < surfaces; ++t) {
      if (t == s) continue;
      const Wall& wall = receivers.walls[s];
      out[s].middleRows(first, count).noalias() += wall.from_blocks[t].middleRows(first, count) * blocks[t];
      out[s].middleRows(first, count).noalias() += wall.from_receivers[t].middleRows(first, count) * bounced[t];
    }
  });
  return out;
}

std::vector<Rgb> IndirectLight::solve(std::span<const PictureLight> light) const {
  const int surfaces = scene_->screen().size(), coarse = coarse_.grid.per_surface();
  std::vector<Rgb> blocks, bounced;
  for (int t = 0; t < surfaces; ++t) {
    Rgb b(pairs_[t].size(), 4);
    for (std::size_t i = 0; i < pairs_[t].size(); ++i) {
      const auto [q, block] = pairs_[t][i];
      b.row(i) = (light[q].block_mean[block] * paint_.base[t]).matrix().transpose();
    }
    blocks.push_back(std::move(b));
    bounced.push_back(Rgb::Zero(coarse, 4));
  }
  std::vector<Rgb> irradiance(surfaces, Rgb::Zero(coarse, 4));
  for (int bounce = 0; bounce < 200; ++bounce) {  // converges like (albedo times form factor) to the power of bounces
    for (int t = 0; t < surfaces; ++t)
      bounced[t] = ((irradiance[t].colwise() + coarse_.walls[t].escape * ambient_).array().rowwise() *
                    paint_.base[t].transpose())
                       .matrix();
    std::vector<Rgb> next = apply(coarse_, blocks, bounced);
    float change = 0, largest = 0;
    for (int t = 0; t < surfaces; ++t) {
      change = std::max(change, (next[t] - irradiance[t]).cwiseAbs().maxCoeff());
      largest = std::max(largest, next[t].cwiseAbs().maxCoeff());
    }
    irradiance = std::move(next);
    if (change <= 1e-6f * largest) break;
  }
  return apply(fine_, blocks, bounced);
}

}  // namespace countershade::simdata

#include "solver/compensate/gather.h"

#include "calib/base/check.h"
#include "calib/base/parallel.h"

namespace countershade::solver {
namespace {

constexpr int kPanelRows = 32;  // 3 channels of them fit the vector registers of AVX2 and AVX-512
using Lane = Eigen::Array<float, kPanelRows, 1>;

struct Sums {
  Lane r = Lane::Zero(), g = Lane::Zero(), b = Lane::Zero();
};

// Adds columns [0, count) of a panel, weighted by x (3 values per column).
void add_columns(const float* panel, const float* x, int count, Sums& sums) {
  Lane r = sums.r, g = sums.g, b = sums.b;
  for (int j = 0; j < count; ++j, panel += kPanelRows, x += 3) {
    const Eigen::Map<const Lane> column(panel);
    r += column * x[0];
    g += column * x[1];
    b += column * x[2];
  }
  sums = {r, g, b};
}

}  // namespace

std::vector<RowBand> row_bands(const Eigen::MatrixXf& F, const Patches& patches, int rows_per_patch) {
  std::vector<RowBand> bands;
  for (int s = 0; s < patches.surfaces(); ++s) {
    RowBand band{patches.offset(s) * rows_per_patch, patches.count(s) * rows_per_patch, patches.offset(s),
                 patches.count(s)};
    CS_CHECK(band.row + band.rows <= F.rows() && band.skip + band.skipped <= F.cols(), "F does not fit the patches");
    if (!F.block(band.row, band.skip, band.rows, band.skipped).isZero(0)) band.skipped = 0;
    bands.push_back(band);
  }
  return bands;
}

Gather::Gather(const Eigen::MatrixXf& F, const Radiosity& k, const std::vector<RowBand>& bands)
    : columns_(static_cast<int>(F.cols())), k_(k) {
  CS_CHECK(k.rows() == F.rows(), "k and F differ in rows");
  CS_CHECK(F.allFinite() && k.allFinite(), "F and k must be finite");
  std::size_t size = 0;
  int row = 0;
  for (const RowBand& band : bands) {
    CS_CHECK(band.row == row, "bands must follow each other");
    for (; row < band.row + band.rows; row += panels_.back().rows) {
      panels_.push_back({row, std::min(kPanelRows, band.row + band.rows - row), band.skip, band.skipped, size});
      size += static_cast<std::size_t>(columns_ - band.skipped) * kPanelRows;
    }
  }
  CS_CHECK(row == F.rows(), "bands must cover all rows of F");
  packed_.assign(size, 0.f);
  parallel_for(static_cast<int>(panels_.size()), [&](int n) {
    const Panel& p = panels_[n];
    float* out = packed_.data() + p.start;
    for (int j = 0; j < columns_; ++j) {
      if (j >= p.skip && j < p.skip + p.skipped) continue;
      Eigen::Map<Eigen::VectorXf>(out, p.rows) = F.col(j).segment(p.row, p.rows);
      out += kPanelRows;
    }
  });
  if (F.rows() > 0) kappa_ = (k.array().colwise() * F.rowwise().sum().array()).maxCoeff();
}

Gather Gather::patches(const Model& model) {
  return Gather(model.F, model.k, row_bands(model.F, model.patches, 1));
}

Gather Gather::receivers(const Model& model) {
  const int per_patch = model.receiver_factor * model.receiver_factor;
  return Gather(model.G, receiver_gain(model), row_bands(model.G, model.patches, per_patch));
}

Radiosity Gather::operator()(const Radiosity& x) const {
  CS_CHECK(x.rows() == columns_, "one radiosity per column expected");
  const Eigen::Matrix<float, Eigen::Dynamic, 3, Eigen::RowMajor> interleaved = x;
  Radiosity y(rows(), 3);
  parallel_for(static_cast<int>(panels_.size()), [&](int n) {
    const Panel& p = panels_[n];
    const int before = p.skip, after = columns_ - p.skip - p.skipped;
    Sums sums;
    const float* panel = packed_.data() + p.start;
    add_columns(panel, interleaved.data(), before, sums);
    add_columns(panel + static_cast<std::size_t>(before) * kPanelRows,
                interleaved.data() + 3 * static_cast<std::size_t>(p.skip + p.skipped), after, sums);
    const auto rows = Eigen::seqN(p.row, p.rows);
    y(rows, 0) = (sums.r.head(p.rows) * k_(rows, 0).array()).matrix();
    y(rows, 1) = (sums.g.head(p.rows) * k_(rows, 1).array()).matrix();
    y(rows, 2) = (sums.b.head(p.rows) * k_(rows, 2).array()).matrix();
  });
  return y;
}

}  // namespace countershade::solver

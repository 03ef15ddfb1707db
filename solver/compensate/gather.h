// The gather: one bounce of light, K x = diag(k) F x, in the layout that makes it cheap.
#pragma once

#include <Eigen/Dense>
#include <vector>

#include "solver/transport/model.h"

namespace countershade::solver {

// Rows of one surface, and the columns of the same surface when that whole block is zero (a plane does not see itself).
struct RowBand {
  int row = 0, rows = 0;
  int skip = 0, skipped = 0;  // columns [skip, skip + skipped) hold nothing
};

// Bands of F (patches) or G (receivers; rows_per_patch = receiver_factor^2), surface by surface.
std::vector<RowBand> row_bands(const Eigen::MatrixXf& F, const Patches& patches, int rows_per_patch);

// x (columns, 3) -> diag(k) F x (rows, 3), with the zero blocks left out, on all cores.
class Gather {
 public:
  // k: (rows, 3). bands must cover the rows of F in order (a Bug otherwise).
  Gather(const Eigen::MatrixXf& F, const Radiosity& k, const std::vector<RowBand>& bands);
  // K of a model's patches; the same at its receivers, with receiver_gain(model).
  static Gather patches(const Model& model);
  static Gather receivers(const Model& model);

  Radiosity operator()(const Radiosity& x) const;
  int rows() const { return static_cast<int>(k_.rows()); }
  int columns() const { return columns_; }
  // Largest row sum of K over rows and channels: every gather shrinks a difference at least by this factor.
  float kappa() const { return kappa_; }

 private:
  struct Panel {
    int row = 0, rows = 0;      // at most kPanelRows
    int skip = 0, skipped = 0;  // as in RowBand
    std::size_t start = 0;      // of its columns in packed_, kPanelRows values each
  };
  int columns_ = 0;
  float kappa_ = 0;
  Radiosity k_;
  std::vector<Panel> panels_;
  std::vector<float> packed_;
};

}  // namespace countershade::solver

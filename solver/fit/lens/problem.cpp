#include "solver/fit/lens/problem.h"

extern "C" {
#include <mrcal/mrcal.h>
}
#include <suitesparse/cholmod.h>

#include <cmath>

#include "calib/base/check.h"

namespace countershade::solver::lens_parts {

namespace {

mrcal_lensmodel_t model_of(const std::string& name) {
  mrcal_lensmodel_t model;
  CS_CHECK(mrcal_lensmodel_from_name(&model, name.c_str()), "lens model " + name);
  return model;
}

mrcal_problem_selections_t selections_of(const Problem& p, const mrcal_lensmodel_t& model) {
  mrcal_problem_selections_t s = {};
  s.do_optimize_intrinsics_core = p.lens_moves && p.core_moves;
  s.do_optimize_intrinsics_distortions = p.lens_moves && mrcal_lensmodel_num_params(&model) > 4;
  s.do_optimize_frames = true;
  s.do_apply_regularization = p.lens_moves && p.regularised;
  return s;
}

// The same data in mrcal's types.
struct Arrays {
  mrcal_lensmodel_t model;
  mrcal_problem_selections_t selections;
  std::vector<double> intrinsics;
  std::vector<mrcal_pose_t> frames;
  std::vector<mrcal_observation_board_t> boards;
  std::vector<mrcal_point3_t> pool;
  int imager[2];
  mrcal_problem_constants_t constants{.point_min_range = 1e-6, .point_max_range = 1e6};
  int measurements = 0, states = 0;
};

Arrays arrays_of(const Problem& p) {
  Arrays a;
  a.model = model_of(p.model);
  a.selections = selections_of(p, a.model);
  a.intrinsics = p.intrinsics;
  for (int i = 0; i < p.views(); ++i) {
    const auto& e = p.poses[i];
    mrcal_pose_t pose;
    for (int k = 0; k < 3; ++k) pose.r.xyz[k] = e[k], pose.t.xyz[k] = e[3 + k];
    a.frames.push_back(pose);
    a.boards.push_back({{0, -1}, i});
  }
  for (const auto& o : p.observations) {
    mrcal_point3_t point;
    for (int k = 0; k < 3; ++k) point.xyz[k] = o[k];
    a.pool.push_back(point);
  }
  a.imager[0] = p.width, a.imager[1] = p.height;
  a.measurements =
      mrcal_num_measurements(p.views(), 0, p.columns, p.rows, 1, 0, p.views(), 0, 0, a.selections, &a.model);
  a.states = mrcal_num_states(1, 0, p.views(), 0, 0, p.views(), a.selections, &a.model);
  return a;
}

void accumulate(const std::vector<int>& begin, const std::vector<int>& state, const std::vector<double>& value, int row,
                Eigen::MatrixXd& N) {
  for (int a = begin[row]; a < begin[row + 1]; ++a)
    for (int b = begin[row]; b < begin[row + 1]; ++b) N(state[a], state[b]) += value[a] * value[b];
}

}  // namespace

bool optimise(Problem& p) {
  Arrays a = arrays_of(p);
  std::vector<double> b(a.states), x(a.measurements);
  const mrcal_stats_t stats =
      mrcal_optimize(b.data(), static_cast<int>(b.size() * sizeof(double)), x.data(),
                     static_cast<int>(x.size() * sizeof(double)), a.intrinsics.data(), nullptr, a.frames.data(),
                     nullptr, nullptr, 1, 0, p.views(), 0, 0, a.boards.data(), nullptr, p.views(), 0, a.pool.data(),
                     &a.model, a.imager, a.selections, &a.constants, p.spacing, p.columns, p.rows, false, false);
  if (!(stats.rms_reproj_error__pixels >= 0)) return false;
  bool finite = true;
  for (double v : a.intrinsics) finite = finite && std::isfinite(v);
  for (int i = 0; i < p.views(); ++i)
    for (int k = 0; k < 3; ++k) {
      p.poses[i][k] = a.frames[i].r.xyz[k], p.poses[i][3 + k] = a.frames[i].t.xyz[k];
      finite = finite && std::isfinite(p.poses[i][k]) && std::isfinite(p.poses[i][3 + k]);
    }
  p.intrinsics = a.intrinsics;
  return finite;
}

Linearisation linearise(const Problem& p) {
  const Arrays a = arrays_of(p);
  Linearisation l;
  const int entries = _mrcal_num_j_nonzero(p.views(), 0, p.columns, p.rows, 1, 0, p.views(), 0, 0, a.boards.data(),
                                           nullptr, a.selections, &a.model);
  std::vector<int> begin(a.measurements + 1), state(entries);
  std::vector<double> value(entries), packed(a.states);
  l.x.resize(a.measurements);
  cholmod_sparse Jt = {};
  Jt.nrow = a.states, Jt.ncol = a.measurements, Jt.nzmax = entries;
  Jt.p = begin.data(), Jt.i = state.data(), Jt.x = value.data();
  Jt.itype = CHOLMOD_INT, Jt.xtype = CHOLMOD_REAL, Jt.dtype = CHOLMOD_DOUBLE;
  Jt.sorted = 1, Jt.packed = 1;
  const bool ok = mrcal_optimizer_callback(packed.data(), static_cast<int>(packed.size() * sizeof(double)), l.x.data(),
                                           static_cast<int>(l.x.size() * sizeof(double)), &Jt, a.intrinsics.data(),
                                           nullptr, a.frames.data(), nullptr, nullptr, 1, 0, p.views(), 0, 0,
                                           a.boards.data(), nullptr, p.views(), 0, a.pool.data(), &a.model, a.imager,
                                           a.selections, &a.constants, p.spacing, p.columns, p.rows, false);
  CS_CHECK(ok, "mrcal cannot evaluate the problem that it has solved");
  l.states = a.states;
  l.board_measurements = mrcal_num_measurements_boards(p.views(), p.columns, p.rows);
  for (const auto& o : p.observations) l.used += o[2] >= 0 ? 2 : 0;
  l.N_board = Eigen::MatrixXd::Zero(a.states, a.states);
  for (int row = 0; row < l.board_measurements; ++row) accumulate(begin, state, value, row, l.N_board);
  l.N = l.N_board;
  for (int row = l.board_measurements; row < a.measurements; ++row) accumulate(begin, state, value, row, l.N);
  l.scale = Eigen::VectorXd::Ones(a.states);
  mrcal_unpack_solver_state_vector(l.scale.data(), 1, 0, p.views(), 0, 0, a.selections, &a.model);
  l.lens_at = mrcal_state_index_intrinsics(0, 1, 0, p.views(), 0, 0, p.views(), a.selections, &a.model);
  l.lens_states = mrcal_num_intrinsics_optimization_params(a.selections, &a.model);
  l.first_intrinsic = a.selections.do_optimize_intrinsics_core ? 0 : 4;
  l.poses_at = mrcal_state_index_frames(0, 1, 0, p.views(), 0, 0, p.views(), a.selections, &a.model);
  return l;
}

int parameters(const std::string& name) {
  const mrcal_lensmodel_t model = model_of(name);
  return mrcal_lensmodel_num_params(&model);
}

Projection project(const std::string& model_name, const std::vector<double>& intrinsics, const Eigen::Vector3d& x) {
  const mrcal_lensmodel_t model = model_of(model_name);
  Projection result;
  const mrcal_point3_t point{.x = x.x(), .y = x.y(), .z = x.z()};
  mrcal_point2_t q;
  mrcal_point3_t by_point[2];
  Eigen::Matrix<double, 2, Eigen::Dynamic, Eigen::RowMajor> by_intrinsics(2, intrinsics.size());
  const bool ok = mrcal_project(&q, by_point, by_intrinsics.data(), &point, 1, &model, intrinsics.data());
  CS_CHECK(ok, "mrcal cannot project with " + model_name);
  result.q = {q.x, q.y};
  for (int i = 0; i < 2; ++i) result.by_point.row(i) << by_point[i].x, by_point[i].y, by_point[i].z;
  result.by_intrinsics = by_intrinsics;
  return result;
}

Eigen::Matrix<double, 3, 6> transform_derivative(const std::array<double, 6>& pose, const Eigen::Vector3d& x) {
  Eigen::Matrix<double, 3, 6, Eigen::RowMajor> J;
  Eigen::Vector3d moved;
  mrcal_transform_point_rt(moved.data(), J.data(), nullptr, pose.data(), x.data());
  return J;
}

}  // namespace countershade::solver::lens_parts

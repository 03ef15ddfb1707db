#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "solver/fit/geometry_parts.h"

namespace countershade::solver::parts {

namespace {

Eigen::Matrix3d intrinsic_matrix(double f, double cx, double cy) {
  Eigen::Matrix3d K;
  K << f, 0, cx, 0, f, cy, 0, 0, 1;
  return K;
}

// Principal point where the rig says it is: the picture's centre, moved by the stated lens shift.
Eigen::Vector2d prior_principal(const ProjectorSpec& spec) {
  const std::array<double, 2> shift = spec.lens_shift.value_or(std::array<double, 2>{0, 0});
  return {(spec.resolution[0] - 1) / 2.0 - shift[0] * spec.resolution[0],
          (spec.resolution[1] - 1) / 2.0 - shift[1] * spec.resolution[1]};
}

// Of sizes that are fixed, 9 and 12, these take a minute to compile.
using SymmetricSolver = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>;

// Similarity that moves points to mean 0 and mean distance sqrt 2 (Hartley 1997).
Eigen::Matrix3d normaliser(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& p : points) mean += p / points.size();
  double spread = 0;
  for (const auto& p : points) spread += (p - mean).norm() / points.size();
  const double s = std::sqrt(2.0) / std::max(spread, 1e-12);
  Eigen::Matrix3d T;
  T << s, 0, -s * mean.x(), 0, s, -s * mean.y(), 0, 0, 1;
  return T;
}

// q^T F ray = 0, eight-point algorithm with equal total weight for each plane.
Eigen::Matrix3d fundamental(const Matches& matches) {
  std::vector<Eigen::Vector2d> rays, pixels;
  std::vector<int> counts;
  for (const Match& m : matches) {
    if (m.plane < 0) continue;
    rays.push_back(m.ray);
    pixels.push_back(m.q);
    counts.resize(std::max<std::size_t>(counts.size(), m.plane + 1));
    ++counts[m.plane];
  }
  const Eigen::Matrix3d T = normaliser(rays), U = normaliser(pixels);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(9, 9);
  for (const Match& m : matches) {
    if (m.plane < 0) continue;
    const Eigen::Vector3d r = T * m.ray.homogeneous(), q = U * m.q.homogeneous();
    Eigen::VectorXd row(9);
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) row[3 * i + j] = q[i] * r[j];
    normal += row * row.transpose() / counts[m.plane];
  }
  const SymmetricSolver eigen(normal);
  const Eigen::VectorXd f = eigen.eigenvectors().col(0);
  Eigen::Matrix3d F;
  F << f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8];
  Eigen::JacobiSVD<Eigen::Matrix3d> svd(F, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d s = svd.singularValues();
  s[2] = 0;
  return U.transpose() * (svd.matrixU() * s.asDiagonal() * svd.matrixV().transpose()) * T;
}

// Depths along a camera ray (z = 1) and a projector ray whose lines come closest to each other.
Eigen::Vector2d depths(const Pose& pose, const Eigen::Vector3d& ray, const Eigen::Vector3d& beam) {
  Eigen::Matrix<double, 3, 2> A;
  A.col(0) = pose.rotation * ray;
  A.col(1) = -beam;
  return A.colPivHouseholderQr().solve(-pose.translation);
}

double share_in_front(const Pose& pose, const Eigen::Matrix3d& K, const Matches& matches) {
  const Eigen::Matrix3d K_inverse = K.inverse();
  int in_front = 0, all = 0;
  for (std::size_t i = 0; i < matches.size(); i += std::max<std::size_t>(1, matches.size() / 300)) {
    if (matches[i].plane < 0) continue;
    const Eigen::Vector2d d = depths(pose, matches[i].ray.homogeneous(), K_inverse * matches[i].q.homogeneous());
    in_front += d[0] > 0 && d[1] > 0;
    ++all;
  }
  return all ? static_cast<double>(in_front) / all : 0;
}

// The one of four decompositions of an essential matrix that has the points in front of both devices.
bool pose_from_essential(const Eigen::Matrix3d& E, const Eigen::Matrix3d& K, const Matches& matches, Pose& pose) {
  Eigen::JacobiSVD<Eigen::Matrix3d> svd(E, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d U = svd.matrixU(), V = svd.matrixV(), W;
  if (U.determinant() < 0) U.col(2) *= -1;
  if (V.determinant() < 0) V.col(2) *= -1;
  W << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  double best = 0.5;
  for (const Eigen::Matrix3d& turn : {W, Eigen::Matrix3d(W.transpose())})
    for (double sign : {1.0, -1.0}) {
      const Pose candidate{U * turn * V.transpose(), sign * U.col(2)};
      const double share = share_in_front(candidate, K, matches);
      if (share > best) best = share, pose = candidate;
    }
  return best > 0.9;
}

}  // namespace

std::vector<Start> starts_from_epipolar(const Matches& matches, const ProjectorSpec& spec, double column) {
  const Eigen::Matrix3d F = fundamental(matches);
  const Eigen::Vector2d principal(column, prior_principal(spec).y());
  const double width = spec.resolution[0], height = spec.resolution[1];
  struct Cell {
    double score, f, cy;
  };
  std::vector<Cell> cells;
  for (double throw_ratio = 0.25; throw_ratio < 8; throw_ratio *= 1.05)
    for (double row = -1.5; row <= 2.5; row += 0.05) {
      const double cy = spec.lens_shift ? principal.y() : row * height;
      const double f = (spec.throw_ratio ? *spec.throw_ratio : throw_ratio) * width;
      const Eigen::Vector3d s =
          Eigen::JacobiSVD<Eigen::Matrix3d>(intrinsic_matrix(f, principal.x(), cy).transpose() * F).singularValues();
      cells.push_back({(s[0] - s[1]) / (s[0] + s[1]), f, cy});
    }
  std::sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) { return a.score < b.score; });
  std::vector<Start> starts;
  for (const Cell& cell : cells) {  // the best cells that are not neighbours of a better one
    const bool near_better = std::any_of(starts.begin(), starts.end(), [&](const Start& s) {
      return std::abs(std::log(s.focal / cell.f)) < 0.15 && std::abs(s.cy - cell.cy) < 0.15 * height;
    });
    if (near_better) continue;
    Start start{cell.f, principal.x(), cell.cy, {}, cell.score};
    const Eigen::Matrix3d K = intrinsic_matrix(start.focal, start.cx, start.cy);
    if (pose_from_essential(K.transpose() * F, K, matches, start.projector_from_camera)) starts.push_back(start);
    if (starts.size() == 8 || &cell - cells.data() > 600) break;
  }
  return starts;
}

std::vector<Start> starts_from_plane(const Matches& matches, const ProjectorSpec& spec, const Eigen::Matrix3d& H) {
  if (!spec.throw_ratio) return {};
  const Eigen::Vector2d principal = prior_principal(spec);
  const Eigen::Matrix3d K = intrinsic_matrix(*spec.throw_ratio * spec.resolution[0], principal.x(), principal.y());
  const Eigen::Matrix3d G = K.inverse() * H;  // rays to projector rays
  cv::Mat h(3, 3, CV_64F);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) h.at<double>(r, c) = G(r, c);
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(h, cv::Mat::eye(3, 3, CV_64F), rotations, translations, normals);
  std::vector<Start> starts;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    Start start{K(0, 0), K(0, 2), K(1, 2), {}, 0};
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) start.projector_from_camera.rotation(r, c) = rotations[i].at<double>(r, c);
      start.projector_from_camera.translation[r] = translations[i].at<double>(r);
    }
    if (start.projector_from_camera.translation.norm() < 1e-9) continue;
    start.projector_from_camera.translation.normalize();
    start.score = 1 - share_in_front(start.projector_from_camera, K, matches);
    if (start.score < 0.1) starts.push_back(start);
  }
  return starts;
}

std::optional<Start> resect(const Matches& matches, const std::vector<Eigen::Vector3d>& planes) {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Match& m : matches) {
    if (m.plane < 0 || planes[m.plane].norm() == 0) continue;
    points.push_back(m.ray.homogeneous() / planes[m.plane].dot(m.ray.homogeneous()));
    pixels.push_back(m.q);
    mean += points.back();
  }
  if (points.size() < 50) return std::nullopt;
  mean /= static_cast<double>(points.size());
  double spread = 0;
  for (const auto& x : points) spread += (x - mean).norm() / points.size();
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  T.topLeftCorner<3, 3>() /= spread;
  T.topRightCorner<3, 1>() = -mean / spread;
  const Eigen::Matrix3d U = normaliser(pixels);
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(12, 12);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector4d x = T * points[i].homogeneous();
    const Eigen::Vector3d q = U * pixels[i].homogeneous();
    Eigen::Matrix<double, 2, 12> rows = Eigen::Matrix<double, 2, 12>::Zero();
    rows.block<1, 4>(0, 0) = rows.block<1, 4>(1, 4) = x.transpose();
    rows.block<1, 4>(0, 8) = -q.x() * x.transpose();
    rows.block<1, 4>(1, 8) = -q.y() * x.transpose();
    normal += rows.transpose() * rows;
  }
  const SymmetricSolver eigen(normal);
  if (!(eigen.eigenvalues()[1] > 1e-9 * eigen.eigenvalues()[11])) return std::nullopt;  // one plane only
  Eigen::Matrix<double, 3, 4> P =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(eigen.eigenvectors().col(0).data());
  P = U.inverse() * P * T;
  if ((P * points[0].homogeneous()).z() < 0) P = -P;
  // P = K [R t]: the rows of its left part give K and R from below.
  const Eigen::Vector3d r1 = P.row(0).head<3>(), r2 = P.row(1).head<3>(), r3 = P.row(2).head<3>();
  const double scale = r3.norm();
  Start start;
  start.cx = r1.dot(r3) / (scale * scale);
  start.cy = r2.dot(r3) / (scale * scale);
  const Eigen::Vector3d x = r1 / scale - start.cx * r3 / scale, y = r2 / scale - start.cy * r3 / scale;
  start.focal = std::sqrt(x.norm() * y.norm());
  Eigen::Matrix3d R;
  R.row(0) = x.normalized(), R.row(1) = y.normalized(), R.row(2) = r3 / scale;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0 || !std::isfinite(start.focal)) return std::nullopt;
  const Eigen::Vector3d p = P.col(3) / scale;
  start.projector_from_camera = {
      R, {(p.x() - start.cx * p.z()) / start.focal, (p.y() - start.cy * p.z()) / start.focal, p.z()}};
  return start;
}

std::vector<Eigen::Vector3d> planes_from_start(const Start& start, const Matches& matches, int planes) {
  const Eigen::Matrix3d K_inverse = intrinsic_matrix(start.focal, start.cx, start.cy).inverse();
  std::vector<std::vector<Eigen::Vector3d>> points(planes);
  for (const Match& m : matches) {
    if (m.plane < 0) continue;
    const Eigen::Vector2d d = depths(start.projector_from_camera, m.ray.homogeneous(), K_inverse * m.q.homogeneous());
    if (d[0] > 0 && d[1] > 0 && std::isfinite(d[0])) points[m.plane].push_back(d[0] * m.ray.homogeneous());
  }
  std::vector<Eigen::Vector3d> result(planes, Eigen::Vector3d::Zero());
  for (int p = 0; p < planes; ++p) {
    if (points[p].size() < 10) continue;
    Eigen::Vector3d w = Eigen::Vector3d::Zero();
    for (int iteration = 0; iteration < 8; ++iteration) {  // reweighted least squares of w . x = 1
      Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
      Eigen::Vector3d b = Eigen::Vector3d::Zero();
      for (const Eigen::Vector3d& x : points[p]) {
        const double r = iteration ? std::abs(w.dot(x) - 1) : 0;
        const double weight = 1 / (1 + r * r * 400) / x.squaredNorm();
        A += weight * x * x.transpose();
        b += weight * x;
      }
      w = A.ldlt().solve(b);
    }
    result[p] = w;
  }
  return result;
}

}  // namespace countershade::solver::parts

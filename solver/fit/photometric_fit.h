// How light travels: direct gains a, indirect gains k and ambient e from the photometric frames (Ceres inside).
#pragma once

#include <Eigen/Dense>
#include <array>
#include <string>
#include <vector>

#include "calib/base/progress.h"
#include "calib/base/result.h"
#include "solver/transport/model.h"

namespace countershade::solver {

// One frame reduced to patches: radiosity m (P, 3) with its sigma, and light p_q (P, 3) per projector (0..1, black
// level included, mean over the same camera pixels; 0 where it does not light the patch).
struct PatchFrame {
  Radiosity m, sigma;
  std::vector<Radiosity> p;
  std::array<bool, 3> channels{true, true, true};  // those that the frame was made to tell about
  std::array<float, 3> mean{0, 0, 0};              // of the whole photo: the light that makes the camera's glare
  std::vector<std::array<float, 3>> shown = {};    // mean light of each whole picture: what makes a projector's flare
};

struct PhotometricData {
  std::vector<PatchFrame> frames;    // frames to fit
  std::vector<PatchFrame> held_out;  // frames to predict
  Eigen::VectorXf seen;              // (P): camera pixels per patch; 0 = unseen
  double white = 1;                  // W, for the held-out error [camera units]
  bool grey = false;                 // held-out frames are those of one_primary(): all channels hold their mean
};

struct PhotometricFit {
  std::vector<Radiosity> a;  // per projector (P, 3); 0 where never lit
  Radiosity e, k, k_sigma;   // (P, 3)
  double chi2 = 0;           // reduced, by the photos' noise alone
  double veil = 0;   // share of each photo's mean that lies evenly over it; taken out of the frames before the fit
  double flare = 0;  // share of its picture's mean that a projector lays over it, by the residuals; not modelled
  double sender_share = 0;    // eps: how far one value per sending patch is off, from the residuals
  double held_out_error = 0;  // mean |predicted - measured| / white over held-out frames and seen patches
  double held_out_p99 = 0;
  std::vector<std::string> notes;
};

struct PhotometricOptions {
  double robust_sigma = 4;  // Huber (1964) threshold in sigma
};

// What a camera without colours sees of one primary, as the reading of a camera with them, whose mean it would give:
// three times the frame's light beyond that of the black frame, and that. Only the primary's channel is right.
PatchFrame one_primary(const PatchFrame& frame, const PatchFrame& black);

// The same frames less a veil.
std::vector<PatchFrame> without_veil(std::vector<PatchFrame> frames, double share);

// Per patch and channel, linear in the unknowns because the observed radiosities stand on the right (PHYSICS 6):
//   m_i^f = sum_q a_qi p_qi^f + e_i + k_i (F m^f)_i
// with a prior on k_i: its surface's mean, with the spread that the data themselves show (empirical Bayes).
// Veiling glare in the camera lays a share v of the photo's mean evenly over it, also where F = 0 (the null blocks of
// PHYSICS 6). v is what all patches' residuals have in common with that mean once a, e, k and a flare of the projectors
// (light that is on the wall, in proportion to their pictures' means) are free (Frisch & Waugh 1933); it is taken out
// where it is five standard errors clear of zero and the held-out frames come out better (of a fit that would be
// refused without it: good). Patches that all projectors light, or one alone, know nothing of it. Errors: kRefused: k >
// 1 beyond its sigma (names the likely causes), patterns that do not identify a and k.
Result<PhotometricFit> fit_photometry(const Eigen::MatrixXf& F, const Patches& patches, const PhotometricData& data,
                                      const PhotometricOptions& options, Progress& progress);

}  // namespace countershade::solver

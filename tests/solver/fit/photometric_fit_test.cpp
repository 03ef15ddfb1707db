#include "solver/fit/photometric_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "calib/base/random.h"

namespace countershade::solver {
namespace {

// Two surfaces of 5 x 3 and 4 x 3 patches, form factors between them only, two projectors that overlap in part.
struct Truth {
  Patches patches{{{5, 3}, {4, 3}}};
  Eigen::MatrixXf F;
  std::vector<Radiosity> a;
  Radiosity k, e;

  explicit Truth(double k_scale = 1) {
    const int P = patches.size();
    Random random(hash_name("photometric truth"));
    F = Eigen::MatrixXf::Zero(P, P);
    for (int i = 0; i < P; ++i)
      for (int j = 0; j < P; ++j)
        if (patches.surface_of(i) != patches.surface_of(j)) F(i, j) = static_cast<float>(random.uniform(0.005, 0.04));
    a.assign(2, Radiosity::Zero(P, 3));
    k = e = Radiosity::Zero(P, 3);
    for (int i = 0; i < P; ++i)
      for (int c = 0; c < 3; ++c) {
        a[0](i, c) = i < 20 ? static_cast<float>(random.uniform(0.5, 0.8)) : 0.0f;
        a[1](i, c) = i > 12 ? static_cast<float>(random.uniform(0.5, 0.8)) : 0.0f;
        k(i, c) =
            static_cast<float>(k_scale * (0.7 + 0.03 * c + 0.05 * patches.surface_of(i) + random.uniform(-0.02, 0.02)));
        e(i, c) = 0.01f;
      }
  }

  double glare = 0;   // of a frame's mean, laid over it
  double flare = 0;   // of a picture's mean, laid over it
  double uneven = 0;  // share by which a sender's light, seen from one receiver, differs from its mean

  PatchFrame frame(std::vector<Radiosity> p, double noise, Random& random) const {
    Radiosity D = e;
    std::vector<std::array<float, 3>> shown;
    for (int q = 0; q < 2; ++q) {
      shown.push_back({p[q].col(0).mean(), p[q].col(1).mean(), p[q].col(2).mean()});
      Radiosity light = p[q];
      for (int c = 0; c < 3; ++c) light.col(c).array() += static_cast<float>(flare) * shown[q][c];
      D += a[q].cwiseProduct(light);
      p[q] = (a[q].array() > 0).select(p[q].array(), 0.0f).matrix();
    }
    Radiosity B = D;
    Eigen::MatrixXf seen = F;
    if (uneven > 0)
      for (float& f : seen.reshaped()) f *= static_cast<float>(1 + uneven * random.normal());
    for (int i = 0; i < 300; ++i) B = D + k.cwiseProduct(Radiosity(seen * B));
    PatchFrame frame{B,  Radiosity::Constant(B.rows(), 3, static_cast<float>(std::max(noise, 1e-6))),
                     p,  {true, true, true},
                     {}, shown};
    for (int c = 0; c < 3; ++c) {
      const auto mean = 0.7f * B.col(c).mean();  // of a photo a part of which shows no wall
      frame.mean[c] = static_cast<float>((1 + glare) * mean);
      for (int i = 0; i < B.rows(); ++i) frame.m(i, c) += static_cast<float>(glare * mean + noise * random.normal());
    }
    return frame;
  }

  // Complementary random blocks, black, each projector alone; two held-out frames.
  PhotometricData data(double noise) const {
    Random random(hash_name("photometric data"));
    const int P = patches.size();
    PhotometricData data;
    const auto constant = [&](float l, float r) {
      return std::vector<Radiosity>{Radiosity::Constant(P, 3, l), Radiosity::Constant(P, 3, r)};
    };
    std::vector<Radiosity> blocks = constant(0, 0), inverse = constant(1, 1), held = constant(0, 0);
    for (int q = 0; q < 2; ++q)
      for (int i = 0; i < P; ++i) {
        const bool lit = random.uniform() < 0.5;
        blocks[q].row(i).setConstant(lit ? 1.0f : 0.001f);
        inverse[q].row(i).setConstant(lit ? 0.001f : 1.0f);
        for (int c = 0; c < 3; ++c) held[q](i, c) = static_cast<float>(random.uniform(0.1, 0.9));
      }
    for (const auto& p : {blocks, inverse, constant(0.001f, 0.001f), constant(1, 0.001f), constant(0.001f, 1)})
      data.frames.push_back(frame(p, noise, random));
    data.held_out = {frame(held, noise, random), frame(constant(0.4f, 0.7f), noise, random)};
    data.seen = Eigen::VectorXf::Constant(P, 100);
    return data;
  }
};

TEST(PhotometricFit, RecoversGainsExactlyWithoutNoise) {
  const Truth truth;
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0), {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  // Float radiosities carry 1e-7; k is a difference over a shade of about .1.
  EXPECT_LT((fit->k - truth.k).cwiseAbs().maxCoeff(), 2e-3);
  for (int q = 0; q < 2; ++q) EXPECT_LT((fit->a[q] - truth.a[q]).cwiseAbs().maxCoeff(), 5e-4);
  EXPECT_LT((fit->e - truth.e).cwiseAbs().maxCoeff(), 5e-4);
  EXPECT_LT(fit->held_out_error, 1e-4);
}

TEST(PhotometricFit, NoiseGivesTheScatterThatSigmaPredicts) {
  const Truth truth;
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0.001), {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  double z2 = 0;
  for (int i = 0; i < truth.k.rows(); ++i)
    for (int c = 0; c < 3; ++c) z2 += std::pow((fit->k(i, c) - truth.k(i, c)) / fit->k_sigma(i, c), 2) / truth.k.size();
  EXPECT_GT(z2, 0.3);  // 81 values: the mean of z^2 is 1 +- .16, wider because patches share their neighbours' noise
  EXPECT_LT(z2, 2.0);
  EXPECT_GT(fit->chi2, 0.5);
  EXPECT_LT(fit->chi2, 1.5);
  EXPECT_LT(fit->held_out_error, 0.002);
}

TEST(PhotometricFit, UnevenSendersAreFoundAndCountInSigma) {
  Truth truth;
  truth.uneven = 0.04;
  for (int i = 0; i < 15; i += 5) truth.F(i, 15 + i / 5) = 0.35f;  // as beside a crease: one sender dominates
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0.0002), {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  // k = .75 of the unevenness arrives; one degree of freedom per patch and uneven leverage leave a factor of 2.
  EXPECT_GT(fit->sender_share, 0.75 * truth.uneven / 2);
  EXPECT_LT(fit->sender_share, 0.75 * truth.uneven * 2);
  // Were it not for the spread, one scale for all patches would stand in, and z would be small everywhere else.
  double z2 = 0;
  for (int i = 0; i < truth.k.rows(); ++i)
    for (int c = 0; c < 3; ++c) z2 += std::pow((fit->k(i, c) - truth.k(i, c)) / fit->k_sigma(i, c), 2) / truth.k.size();
  EXPECT_GT(z2, 0.3);
  EXPECT_LT(z2, 2.0);
}

TEST(PhotometricFit, VeilingGlareIsToldFromIndirectLightAndTakenOut) {
  Truth truth;
  SilentProgress progress;
  const auto plain = fit_photometry(truth.F, truth.patches, truth.data(0.0002), {}, progress);
  ASSERT_TRUE(plain);
  EXPECT_EQ(plain->veil, 0) << "noise is no glare";
  for (double glare : {0.01, 0.04, 0.15}) {
    truth.glare = glare;
    const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0.0002), {}, progress);
    ASSERT_TRUE(fit) << fit.error().message;
    EXPECT_NEAR(fit->veil, glare / (1 + glare), 0.0015) << glare;
    EXPECT_NEAR(fit->k.mean(), plain->k.mean(), 0.01) << glare;
    EXPECT_NEAR((fit->e - truth.e).mean(), 0, 1e-3) << glare;
    EXPECT_LT(fit->held_out_error, 1.2 * plain->held_out_error) << glare;
  }
}

// What looks like glare but makes frames that the fit has not seen worse is something else: here what lies over the
// held-out frames is not in proportion to their mean.
TEST(PhotometricFit, VeilThatHeldOutFramesContradictIsLeftIn) {
  Truth truth;
  truth.glare = 0.04;
  PhotometricData data = truth.data(0.0002);
  for (PatchFrame& frame : data.held_out) frame.mean = {0, 0, 0};
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, data, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_EQ(fit->veil, 0);
}

// Glare lets k come out beyond 1; once it is taken out the fit counts, if the held-out frames come out right.
TEST(PhotometricFit, FitThatGlareMadeImpossibleIsRescuedIfHeldOutFramesAgree) {
  Truth truth(1.2);
  truth.glare = 0.15;
  PhotometricData data = truth.data(0.0002);
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, data, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_NEAR(fit->veil, 0.15 / 1.15, 0.002);
  for (PatchFrame& frame : data.held_out) frame.m.array() += 0.03f;
  const auto refused = fit_photometry(truth.F, truth.patches, data, {}, progress);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("more than all"), std::string::npos);
  data.held_out.clear();
  EXPECT_FALSE(fit_photometry(truth.F, truth.patches, data, {}, progress));
}

TEST(PhotometricFit, PatchesThatNobodySeesSendNoGlare) {
  Truth clear;
  for (int i : {1, 6, 17, 22}) {  // black, so that nothing is missing
    for (Radiosity* part : {&clear.a[0], &clear.a[1], &clear.k, &clear.e}) part->row(i).setZero();
  }
  Truth truth = clear;
  truth.glare = 0.08;
  PhotometricData data = truth.data(0.00005), without = clear.data(0.00005);
  for (PhotometricData* d : {&data, &without}) {
    for (int i : {1, 6, 17, 22}) {
      d->seen[i] = 0;
      for (auto* frames : {&d->frames, &d->held_out})
        for (PatchFrame& frame : *frames) {
          frame.m.row(i).setZero();
          frame.sigma.row(i).setConstant(std::numeric_limits<float>::infinity());
        }
    }
  }
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, data, {}, progress),
             same = fit_photometry(truth.F, truth.patches, without, {}, progress);
  ASSERT_TRUE(fit && same);
  EXPECT_NEAR(fit->veil, 0.08 / 1.08, 0.001);
  EXPECT_NEAR(fit->k.mean(), same->k.mean(), 0.002);
}

// One projector alone: light adds, so that no frame is left to tell the veil by. A lamp that drifts must not pass for
// it.
TEST(PhotometricFit, OneProjectorAloneKnowsNothingOfGlare) {
  Truth truth;
  truth.a[0] = Radiosity::Constant(truth.patches.size(), 3, 0.6f), truth.a[1].setZero();
  SilentProgress progress;
  for (double drift : {0., 0.01}) {
    PhotometricData data = truth.data(0.0003);
    data.frames.pop_back();  // of the other projector alone: black
    for (int c = 0; c < 3; ++c) {
      data.frames[1].m.col(c) *= static_cast<float>(1 + drift);
      data.frames[1].mean[c] *= static_cast<float>(1 + drift);
    }
    const auto fit = fit_photometry(truth.F, truth.patches, data, {}, progress);
    EXPECT_EQ(fit ? fit->veil : 0, 0) << drift;
  }
}

TEST(PhotometricFit, FlareOfProjectorsIsNoGlareOfTheCamera) {
  Truth truth;
  truth.flare = 0.02;
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0.00005), {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_LT(fit->veil, 0.002);
  EXPECT_NEAR(fit->flare, 0.02, 0.002);
}

TEST(PhotometricFit, UnevenSendersAreNoGlare) {
  Truth truth;
  truth.uneven = 0.04;
  for (int i = 0; i < 15; i += 5) truth.F(i, 15 + i / 5) = 0.35f;
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0.0002), {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_LT(fit->veil, 0.002);
}

TEST(PhotometricFit, WrongFormFactorsShowInHeldOutFrames) {
  const Truth truth;
  SilentProgress progress;
  Eigen::MatrixXf wrong = truth.F;
  for (int i = 0; i < wrong.rows(); ++i)
    for (int j = 0; j < wrong.cols(); ++j) wrong(i, j) *= (i + 2 * j) % 3 == 0 ? 1.6f : 0.7f;
  const auto good = fit_photometry(truth.F, truth.patches, truth.data(0.0005), {}, progress);
  const auto bad = fit_photometry(wrong, truth.patches, truth.data(0.0005), {}, progress);
  ASSERT_TRUE(good && bad);
  EXPECT_GT(bad->held_out_error, 2 * good->held_out_error);
}

TEST(PhotometricFit, MoreIndirectLightThanAllIsRefusedWithLikelyCauses) {
  const Truth truth(1.6);
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, truth.data(0.0005), {}, progress);
  ASSERT_FALSE(fit);
  EXPECT_EQ(fit.error().code, ErrorCode::kRefused);
  EXPECT_NE(fit.error().message.find("veiling glare"), std::string::npos);
}

TEST(PhotometricFit, SaturatedPatchesTakeTheirSurfacesGain) {
  const Truth truth;
  PhotometricData data = truth.data(0.0005);
  for (PatchFrame& frame : data.frames) frame.sigma.row(3).setConstant(std::numeric_limits<float>::infinity());
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, data, {}, progress);
  ASSERT_TRUE(fit) << fit.error().message;
  EXPECT_NEAR(fit->k(3, 1), truth.k(3, 1), 0.05);  // the spread over a surface is .02
  EXPECT_GT(fit->k_sigma(3, 1), fit->k_sigma(2, 1));
}

TEST(PhotometricFit, TooFewFramesAreRefused) {
  const Truth truth;
  PhotometricData data = truth.data(0);
  data.frames.resize(2);
  SilentProgress progress;
  const auto fit = fit_photometry(truth.F, truth.patches, data, {}, progress);
  ASSERT_FALSE(fit);
  EXPECT_NE(fit.error().message.find("2 photometric frames"), std::string::npos);
}

// A camera that sees the mean of three channels, of which one primary's photo lights one, as what its colour channels
// would have read.
TEST(OnePrimary, IsWhatTheChannelWouldHaveRead) {
  const Radiosity coloured = (Radiosity(2, 3) << 5, 0.4f, 0.6f, 0.3f, 7, 0.2f).finished();
  const Radiosity dark = (Radiosity(2, 3) << 0.5f, 0.4f, 0.6f, 0.3f, 0.1f, 0.2f).finished();
  for (int c = 0; c < 2; ++c) {  // row c is lit in channel c
    const auto grey = [&](const Radiosity& m, float mean) {
      PatchFrame frame;
      frame.m = Radiosity::Constant(1, 3, m.row(c).mean()), frame.sigma = Radiosity::Constant(1, 3, 0.03f);
      frame.mean = {mean, mean, mean};
      return frame;
    };
    const PatchFrame told = one_primary(grey(coloured, 2), grey(dark, 0.5f));
    // What the channel gains, on top of the dark of all.
    EXPECT_NEAR(told.m(0, c), dark.row(c).mean() + coloured(c, c) - dark(c, c), 1e-5);
    EXPECT_NEAR(told.sigma(0, c), 0.03 * std::sqrt(13.0), 1e-6);
    EXPECT_NEAR(told.mean[c], 5, 1e-6);
  }
}

}  // namespace
}  // namespace countershade::solver

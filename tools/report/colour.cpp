#include "tools/report/colour.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace countershade::tools {

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kWhiteX = 0.95047, kWhiteZ = 1.08883;  // D65, Y = 1
constexpr double kEpsilon = 216.0 / 24389, kKappa = 24389.0 / 27;

double lab_root(double t) {
  return t > kEpsilon ? std::cbrt(t) : (kKappa * t + 16) / 116;
}
double lab_cube(double f) {
  return f * f * f > kEpsilon ? f * f * f : (116 * f - 16) / kKappa;
}

double radians(double degrees) {
  return degrees * kPi / 180;
}

// Hue angle in [0, 2 pi); 0 for grey.
double hue(double a, double b) {
  if (a == 0 && b == 0) return 0;
  const double h = std::atan2(b, a);
  return h < 0 ? h + 2 * kPi : h;
}

// C^7 / (C^7 + 25^7), square root.
double chroma_weight(double chroma) {
  const double power = std::pow(chroma, 7);
  return std::sqrt(power / (power + std::pow(25.0, 7)));
}

// Difference h2 - h1 and mean of two hues the short way round; where one colour is grey: 0 and the other's hue.
struct Hues {
  double difference, mean;
};
Hues compare_hues(double h1, double h2, bool one_is_grey) {
  if (one_is_grey) return {0, h1 + h2};
  double difference = h2 - h1, mean = (h1 + h2) / 2;
  if (std::abs(difference) > kPi) {
    difference += difference > 0 ? -2 * kPi : 2 * kPi;
    mean += h1 + h2 < 2 * kPi ? kPi : -kPi;
  }
  return {difference, mean};
}

}  // namespace

double srgb_encode(double linear) {
  const double v = std::clamp(linear, 0.0, 1.0);
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055;
}

double srgb_decode(double encoded) {
  const double v = std::clamp(encoded, 0.0, 1.0);
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

Lab lab_of_linear(const Rgb& linear) {
  double c[3];
  for (int i = 0; i < 3; ++i) c[i] = std::clamp(linear[i], 0.0, 1.0);
  const double fx = lab_root((0.4124564 * c[0] + 0.3575761 * c[1] + 0.1804375 * c[2]) / kWhiteX);
  const double fy = lab_root(0.2126729 * c[0] + 0.7151522 * c[1] + 0.0721750 * c[2]);
  const double fz = lab_root((0.0193339 * c[0] + 0.1191920 * c[1] + 0.9503041 * c[2]) / kWhiteZ);
  return {116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)};
}

Rgb linear_of_lab(const Lab& lab) {
  const double fy = (lab[0] + 16) / 116;
  const double x = kWhiteX * lab_cube(fy + lab[1] / 500), y = lab_cube(fy), z = kWhiteZ * lab_cube(fy - lab[2] / 200);
  return {3.2404542 * x - 1.5371385 * y - 0.4985314 * z, -0.9692660 * x + 1.8760108 * y + 0.0415560 * z,
          0.0556434 * x - 0.2040259 * y + 1.0572252 * z};
}

double delta_e_2000(const Lab& p, const Lab& q) {
  const double g = 0.5 * (1 - chroma_weight((std::hypot(p[1], p[2]) + std::hypot(q[1], q[2])) / 2));
  const double a1 = (1 + g) * p[1], a2 = (1 + g) * q[1];
  const double C1 = std::hypot(a1, p[2]), C2 = std::hypot(a2, q[2]);
  const auto [dh, h] = compare_hues(hue(a1, p[2]), hue(a2, q[2]), C1 * C2 == 0);
  const double L = (p[0] + q[0]) / 2, C = (C1 + C2) / 2;
  const double T = 1 - 0.17 * std::cos(h - radians(30)) + 0.24 * std::cos(2 * h) + 0.32 * std::cos(3 * h + radians(6)) -
                   0.20 * std::cos(4 * h - radians(63));
  const double turn = (h - radians(275)) / radians(25), theta = radians(30) * std::exp(-turn * turn);
  const double R_T = -std::sin(2 * theta) * 2 * chroma_weight(C);
  const double S_L = 1 + 0.015 * (L - 50) * (L - 50) / std::sqrt(20 + (L - 50) * (L - 50));
  const double l = (q[0] - p[0]) / S_L;
  const double c = (C2 - C1) / (1 + 0.045 * C);
  const double H = 2 * std::sqrt(C1 * C2) * std::sin(dh / 2) / (1 + 0.015 * C * T);
  return std::sqrt(std::max(0.0, l * l + c * c + H * H + R_T * c * H));
}

Rgb diverging(double t) {
  if (!std::isfinite(t)) return {0.5, 0.5, 0.5};
  const double amount = std::min(1.0, std::abs(t));
  // The hues turn a little on the way, because blue would drift to violet and red to pink.
  const double hue = radians(t < 0 ? 262 + 20 * amount : 32 + 4 * amount);
  const double chroma = (t < 0 ? 50 : 64) * std::pow(amount, 0.85);
  const Rgb linear = linear_of_lab({97 - 60 * amount, chroma * std::cos(hue), chroma * std::sin(hue)});
  return {srgb_encode(linear[0]), srgb_encode(linear[1]), srgb_encode(linear[2])};
}

}  // namespace countershade::tools

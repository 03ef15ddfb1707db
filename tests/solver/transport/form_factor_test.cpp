#include "solver/transport/form_factor.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "calib/base/check.h"
#include "calib/base/random.h"
#include "solver/transport/patch_flow.h"
#include "solver/transport/quadrature.h"

namespace countershade::solver {
namespace {

using V = Eigen::Vector3d;
using Rectangle = std::array<V, 4>;
constexpr double kPi = std::numbers::pi;

Rectangle rectangle(const V& origin, const V& u, const V& v) {
  return {origin, origin + u, origin + u + v, origin + v};
}

double area(Polygon p) {
  V sum = V::Zero();
  for (std::size_t i = 1; i + 1 < p.size(); ++i) sum += (p[i] - p[0]).cross(p[i + 1] - p[0]) / 2;
  return sum.norm();
}

// Unit vector that rises from the floor z = 0, x > 0 by the dihedral angle t about the y axis.
V up(double t) {
  return {std::cos(t), 0, std::sin(t)};
}

V random_direction(Random& random) {
  return V(random.normal(), random.normal(), random.normal()).normalized();
}

std::vector<V> random_polygon(Random& random, const V& centre, int corners) {
  const V n = random_direction(random), u = n.cross(random_direction(random)).normalized(), v = n.cross(u);
  std::vector<V> polygon;
  for (int i = 0; i < corners; ++i) {
    const double t = 2 * kPi * (i + random.uniform(-.3, .3)) / corners;  // on a circle: convex
    polygon.push_back(centre + .5 * (std::cos(t) * u + std::sin(t) * v));
  }
  return polygon;
}

TEST(FormFactor, AgreesWithTheUnitCube) {
  const Rectangle floor = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0)),
                  ceiling = rectangle(V(0, 0, 1), V(0, 1, 0), V(1, 0, 0));
  const Rectangle wall = rectangle(V(0, 0, 0), V(0, 1, 0), V(0, 0, 1));
  EXPECT_NEAR(form_factor(floor, ceiling), opposite_rectangles(1, 1, 1), 1e-12);
  EXPECT_NEAR(form_factor(floor, ceiling), 0.199825, 1e-6);  // the published value has six digits
  EXPECT_NEAR(form_factor(floor, wall), adjacent_rectangles(1, 1, 1), 1e-12);
  EXPECT_NEAR(form_factor(floor, wall), 0.200044, 1e-6);
}

// Exchange between perpendicular rectangles: a in z = 0 over x0..x1, y0..y1; b in x = 0 over z0..z1, v0..v1; by form
// factor algebra from C-14. Along y the kernel depends on the difference only, so that with K(l) = its double integral
// over a common stretch l: 2 exchange = K(|v1 - y0|) + K(|v0 - y1|) - K(|v0 - y0|) - K(|v1 - y1|).
double catalogue_exchange(const std::array<double, 2>& x, const std::array<double, 2>& y,
                          const std::array<double, 2>& v, const std::array<double, 2>& z) {
  const auto corner = [](double l, double a, double b) {
    return l > 0 && a > 0 && b > 0 ? a * l * adjacent_rectangles(l, a, b) : 0.0;
  };
  const auto K = [&](double l) {
    l = std::abs(l);
    return corner(l, x[1], z[1]) - corner(l, x[0], z[1]) - corner(l, x[1], z[0]) + corner(l, x[0], z[0]);
  };
  return .5 * (K(v[1] - y[0]) + K(v[0] - y[1]) - K(v[0] - y[0]) - K(v[1] - y[1]));
}

TEST(FormFactor, AgreesWithTheCatalogueOnParts) {
  struct Case {
    std::array<double, 2> x, y, v, z;
    const char* name;
  };
  const Case cases[] = {{{0, .7}, {0, 1.1}, {0, 1.1}, {0, .4}, "common edge"},
                        {{0, .7}, {0, 1.1}, {.3, .8}, {0, .4}, "part of a common edge"},
                        {{0, .7}, {0, 1.1}, {.3, 1.9}, {0, .4}, "overlapping edges"},
                        {{0, .7}, {0, .5}, {.5, 1.3}, {0, .4}, "common corner"},
                        {{0, .7}, {0, .5}, {.5001, 1.3}, {0, .4}, "nearly a common corner"},
                        {{.001, .7}, {0, .5}, {.2, 1.3}, {.002, .4}, "nearly a common edge"},
                        {{.2, .7}, {0, .5}, {.6, 1.3}, {.3, .4}, "apart"},
                        {{.2, .201}, {0, 1.5}, {.1, 1.3}, {.3, .301}, "strips"}};
  for (const Case& c : cases) {
    const Rectangle a = rectangle(V(c.x[0], c.y[0], 0), V(c.x[1] - c.x[0], 0, 0), V(0, c.y[1] - c.y[0], 0));
    const Rectangle b = rectangle(V(0, c.v[0], c.z[0]), V(0, c.v[1] - c.v[0], 0), V(0, 0, c.z[1] - c.z[0]));
    const double expected = catalogue_exchange(c.x, c.y, c.v, c.z);
    // The header's 1e-9, and the algebra's own cancellation: 1e-16 of whole walls of about 1 m^2.
    EXPECT_NEAR(form_factor(a, b) * area(a), expected, 1e-9 * expected + 1e-15) << c.name;
  }
}

TEST(FormFactor, AgreesWithTheCatalogueAtAnyDistance) {
  for (double d : {.01, .1, 1., 3., 5., 7., 10.}) {
    const Rectangle a = rectangle(V(0, 0, 0), V(1.3, 0, 0), V(0, .7, 0)),
                    b = rectangle(V(0, 0, d), V(0, .7, 0), V(1.3, 0, 0));
    // The closed form itself loses (d / size)^4 in rounding.
    EXPECT_NEAR(form_factor(a, b) / opposite_rectangles(1.3, .7, d), 1, 1e-11 + 1e-15 * std::pow(d, 4)) << d;
  }
}

// Faces of a tetrahedron: triangles that all share edges, at odd angles.
TEST(FormFactor, OfATetrahedronSumToOne) {
  const V c[] = {{0, 0, 0}, {1.3, .1, .2}, {.3, 1.1, -.1}, {.4, .2, .9}};
  const std::array<V, 3> faces[] = {{c[0], c[1], c[2]}, {c[0], c[3], c[1]}, {c[0], c[2], c[3]}, {c[1], c[3], c[2]}};
  for (const auto& a : faces) {
    double sum = 0;
    for (const auto& b : faces)
      if (&a != &b) sum += form_factor(a, b);
    EXPECT_NEAR(sum, 1, 1e-10);  // three times the quadrature's 1e-11
  }
}

TEST(FormFactor, ExchangeIsSymmetric) {
  Random random(hash_name("ExchangeIsSymmetric"));
  for (int k = 0, seen = 0; seen < 60; ++k) {
    ASSERT_LT(k, 5000);
    const V offset = random_direction(random) * std::exp(random.uniform(0, 6));
    const std::vector<V> a = random_polygon(random, V(0, 0, 0), 3 + k % 4),
                         b = random_polygon(random, offset, 3 + k % 3);
    const double ab = patch_flow(a, b, 1e-11), ba = patch_flow(b, a, 1e-11);
    if (!(ab > 0)) continue;
    ++seen;
    // The two orders do different sums; both round at about 1e-17 of the polygons' area.
    EXPECT_NEAR(ab, ba, 1e-9 * ab + 1e-16) << k;
  }
}

// Edges that pass each other closely at an angle, where the integrand has a kink inside.
TEST(FormFactor, ExchangeIsSymmetricOfNearPlatesTurnedAgainstEachOther) {
  Random random(hash_name("NearPlates"));
  for (double gap : {.1, .01, 1e-3})
    for (int k = 0; k < 5; ++k) {
      const double t = random.uniform(.1, 1.4);
      const V u(std::cos(t), std::sin(t), 0), v(-std::sin(t), std::cos(t), 0);
      const Rectangle a = rectangle(V(0, 0, 0), V(.8, 0, 0), V(0, .6, 0)),
                      b = rectangle(V(random.uniform(.2, .5), random.uniform(-.1, .2), gap), .5 * v, .7 * u);
      const double ab = patch_flow(a, b, 1e-11), ba = patch_flow(b, a, 1e-11);
      EXPECT_NEAR(ab / ba, 1, 1e-8) << gap << ' '
                                    << k;  // the header's 1e-9, with room; 4e-6 without the cut at the kink
    }
}

TEST(FormFactor, IsAdditive) {
  const Rectangle a = rectangle(V(0, 0, 0), V(1.3, 0, 0), V(0, .9, 0));
  for (double t : {.4, 1.2, 2.2, 3.0}) {
    const Rectangle whole = rectangle(V(0, 0, 0), V(0, .9, 0), .8 * up(t));
    double sum = 0;
    const double z[] = {0, .05, .3, .8}, y[] = {0, .2, .9};
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 2; ++j)
        sum += form_factor(
            a, rectangle(V(0, y[j], 0) + z[i] * up(t), V(0, y[j + 1] - y[j], 0), (z[i + 1] - z[i]) * up(t)));
    EXPECT_NEAR(sum / form_factor(a, whole), 1, 1e-9) << t;  // the header's bound
  }
}

TEST(FormFactor, DoesNotDependOnTheUnit) {
  const auto at = [](double unit, double t) {
    return form_factor(rectangle(V(0, 0, 0), V(unit, 0, 0), V(0, 2 * unit, 0)),
                       rectangle(V(0, .3 * unit, 0), V(0, 2 * unit, 0), .5 * unit * up(t)));
  };
  for (double t : {.7, 2.5})
    for (double unit : {1e-3, 1e-2, 100.}) EXPECT_NEAR(at(unit, t) / at(1, t), 1, 1e-11) << unit;  // rounding of ln
}

TEST(FormFactor, DoesNotDependOnTheOrigin) {
  const V far(300, -500, 700);
  const Rectangle a = rectangle(V(0, 0, 0), V(.1, 0, 0), V(0, .08, 0)),
                  b = rectangle(V(0, 0, 0), V(0, .08, 0), .1 * up(1.1));
  Rectangle a_far = a, b_far = b;
  for (V& x : a_far) x += far;
  for (V& x : b_far) x += far;
  EXPECT_NEAR(form_factor(a_far, b_far) / form_factor(a, b), 1, 1e-10);  // the corners round at 1e-13 of .1
}

TEST(FormFactor, OrdersOfQuadratureAgreeWhereTheyMeet) {
  Random random(hash_name("OrdersOfQuadratureAgreeWhereTheyMeet"));
  for (double distance = .11; distance < 60; distance *= 1.15) {
    const Rectangle a = rectangle(V(0, 0, 0), V(.1, 0, 0), V(0, .08, 0));
    const V u = (V(0, 1, 0) + .3 * random_direction(random)).normalized(), v = V(1, 0, 0) - u * u.x();
    const Rectangle b = rectangle(V(.02, 0, distance), .09 * u, .1 * v);
    EXPECT_NEAR(patch_flow(a, b, 1e-8) / patch_flow(a, b, 1e-12), 1, 1e-8) << distance;
    const std::span<const V> triangle(b.data(), 3);
    EXPECT_NEAR(patch_flow(a, triangle, 1e-8) / patch_flow(a, triangle, 1e-12), 1, 1e-8) << distance;
  }
}

TEST(FormFactor, KeepsItsToleranceWhereWallsAreNearlyFlat) {
  const Rectangle a = rectangle(V(0, 0, 0), V(.7, 0, 0), V(0, 1.1, 0));
  for (double degrees : {170., 178., 179.5}) {
    const Rectangle b = rectangle(V(0, .2, 0), V(0, .7, 0), .4 * up(degrees * kPi / 180));
    EXPECT_NEAR(patch_flow(a, b, 1e-8) / patch_flow(a, b, 1e-12), 1, 1e-8) << degrees;
  }
}

TEST(FormFactor, PartsBehindTheHorizonDoNotExchangeLight) {
  const Rectangle a = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0));
  const Rectangle half = rectangle(V(2, 0, 0), V(0, 1, 0), V(0, 0, 0.5));   // faces +x: turned away
  const Rectangle both = rectangle(V(2, 0, -0.5), V(0, 1, 0), V(0, 0, 1));  // reaches as far below a's plane
  const Rectangle facing_half = rectangle(V(2, 0, 0), V(0, 0, 0.5), V(0, 1, 0)),
                  facing_both = rectangle(V(2, 0, -0.5), V(0, 0, 1), V(0, 1, 0));
  EXPECT_EQ(form_factor(a, half), 0);
  EXPECT_EQ(form_factor(a, both), 0);
  EXPECT_GT(form_factor(a, facing_half), 0.01);
  EXPECT_NEAR(form_factor(a, facing_both) / form_factor(a, facing_half), 1, 1e-9);  // the header's bound
}

TEST(FormFactor, DegeneratePolygonsExchangeNothing) {
  const Rectangle a = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0));
  const Rectangle line = rectangle(V(0, 0, 1), V(0, 0, 0), V(1, 0, 0)),
                  point = rectangle(V(0, 0, 1), V(0, 0, 0), V(0, 0, 0));
  const std::vector<V> collinear{{.1, .2, 1}, {.3, .3, 1}, {.5, .4, 1}}, two{{.1, .2, 1}, {.3, .3, 1}};
  for (const Polygon b : {Polygon(line), Polygon(point), Polygon(collinear), Polygon(two), Polygon()}) {
    EXPECT_EQ(form_factor(a, b), 0);
    EXPECT_EQ(form_factor(b, a), 0);
  }
}

TEST(FormFactor, IsZeroWithinAPlane) {
  const V u = V(1, .3, -.2).normalized(), v = u.cross(V(.1, .2, 1)).normalized();
  for (double gap : {0., .01, 3.})
    EXPECT_EQ(
        form_factor(rectangle(V(1, 2, 3), .7 * u, .4 * v), rectangle(V(1, 2, 3) + (.7 + gap) * u, .5 * u, .4 * v)), 0);
}

TEST(FormFactor, HasNoExtraCornersFromRepeatedOnes) {
  const Rectangle a = rectangle(V(0, 0, 0), V(1, 0, 0), V(0, 1, 0)), b = rectangle(V(0, 0, 0), V(0, 1, 0), .6 * up(2));
  const std::vector<V> repeated{b[0], b[1], b[1], b[2], b[3], b[3]};
  EXPECT_NEAR(form_factor(a, repeated) / form_factor(a, b), 1, 1e-12);  // the same sum
}

TEST(CentreFormFactor, IsWrongByFiftyNinePercentAtAnEdgeAtEveryResolution) {
  for (int n : {2, 16, 128}) {
    const double s = 1.0 / n;
    const Rectangle a = rectangle(V(0, 0, 0), V(s, 0, 0), V(0, s, 0)),
                    b = rectangle(V(0, 0, 0), V(0, s, 0), V(0, 0, s));
    EXPECT_NEAR(centre_form_factor(a, b), 1 / kPi, 1e-12);  // cos = 1/sqrt 2 twice, r^2 = s^2 / 2, for every s
    EXPECT_NEAR(centre_form_factor(a, b) / form_factor(a, b), 1.5912, 1e-5);  // 1 / (pi .200044)
  }
}

TEST(CentreFormFactor, IsRightFarAway) {
  const Rectangle a = rectangle(V(0, 0, 0), V(.1, 0, 0), V(0, .08, 0)),
                  b = rectangle(V(7, 2, 5), V(0, .1, .02), V(.03, 0, -.1));
  EXPECT_GT(form_factor(b, a), 0);
  EXPECT_NEAR(centre_form_factor(b, a) / form_factor(b, a), 1, 1e-3);  // (size / distance)^2
}

TEST(PointFormFactor, AgreesWithTheRectangleOverACorner) {
  // A rectangle a x b in a parallel plane at distance c, one corner on the normal (Howell's catalogue, B-3).
  const double a = 1.7, b = .6, c = .9, A = a / c, B = b / c;
  const double expected = (A / std::hypot(1, A) * std::atan(B / std::hypot(1, A)) +
                           B / std::hypot(1, B) * std::atan(A / std::hypot(1, B))) /
                          (2 * kPi);
  const Rectangle above = rectangle(V(.2, .3, c), V(0, b, 0), V(a, 0, 0));
  EXPECT_NEAR(point_form_factor(V(.2, .3, 0), V(0, 0, 1), above), expected, 1e-15);
}

TEST(PointFormFactor, AveragesToThePatchFormFactor) {
  const Rectangle a = rectangle(V(.2, .1, 0), V(.6, 0, 0), V(0, .5, 0)),
                  b = rectangle(V(0, 0, .1), V(0, .9, 0), V(0, 0, .7));
  const GaussRule& rule = gauss_rule(16);
  double mean = 0;
  for (int i = 0; i < 16; ++i)
    for (int j = 0; j < 16; ++j)
      mean += rule.weight[i] * rule.weight[j] *
              point_form_factor(a[0] + rule.node[i] * (a[1] - a[0]) + rule.node[j] * (a[3] - a[0]), V(0, 0, 1), b);
  EXPECT_NEAR(mean / form_factor(a, b), 1, 1e-9);  // sixteen nodes over a smooth integrand
}

TEST(PointFormFactor, ClipsAtTheHorizon) {
  const V x(.1, .2, .3), n = V(.2, .1, 1).normalized();
  // A wall that crosses the horizon of n, and its upper part cut by hand.
  const V foot = x + 2 * V(1, 0, -.2), v(0, 1, -.1);  // both directions lie in the horizon plane
  ASSERT_NEAR((foot - x).dot(n), 0, 1e-15);
  const Rectangle whole = rectangle(foot - n - .4 * v, 2.5 * n, 1.3 * v),
                  part = rectangle(foot - .4 * v, 1.5 * n, 1.3 * v);
  ASSERT_GT(point_form_factor(x, n, part), .01);
  EXPECT_NEAR(point_form_factor(x, n, whole), point_form_factor(x, n, part), 1e-14);
}

TEST(PointFormFactor, IsHalfOfOnePlusCosineAtTheFootOfAnEndlessWall) {
  for (double degrees : {15., 60., 90., 130., 170.}) {
    const double t = degrees * kPi / 180;
    // Nearer and nearer to the edge of a wall of 2 m x 1 m: it looks endless; the deficit is of the order of distance.
    for (double distance : {1e-3, 1e-6, 1e-10}) {
      const Rectangle wall = rectangle(V(0, -1, 0), V(0, 2, 0), up(t));
      EXPECT_NEAR(point_form_factor(V(distance, .2, 0), V(0, 0, 1), wall), (1 + std::cos(t)) / 2, 2 * distance)
          << degrees;
    }
  }
}

TEST(PointFormFactor, IsZeroInThePlaneOfThePolygonAndBehindIt) {
  const Rectangle wall = rectangle(V(0, 0, 0), V(0, 1, 0), V(0, 0, 1));  // faces +x
  for (const V& n : {V(0, 0, 1), V(1, 0, 0), V(-1, 0, 0), V(0, 1, 0)})
    for (const V& x : {V(0, .5, 0), V(0, 0, 0), V(0, .3, .6), V(0, 2, -1), V(-.1, .5, .5), V(1e-18, .5, 0)})
      EXPECT_EQ(point_form_factor(x, n, wall), 0) << x.transpose() << " / " << n.transpose();
}

TEST(PointFormFactor, IsOneJustBeforeThePolygonThatItFaces) {
  const Rectangle wall = rectangle(V(0, 0, 0), V(0, 1, 0), V(0, 0, 1));
  for (double distance : {1e-4, 1e-8, 1e-11})
    EXPECT_NEAR(point_form_factor(V(distance, .3, .6), V(-1, 0, 0), wall), 1, 20 * distance * distance + 1e-15)
        << distance;
}

TEST(PointFormFactor, OfADegeneratePolygonIsZero) {
  const V x(0, 0, 0), n(0, 0, 1);
  EXPECT_EQ(point_form_factor(x, n, rectangle(V(0, 0, 1), V(0, 0, 0), V(1, 0, 0))), 0);
  EXPECT_EQ(point_form_factor(x, n, rectangle(V(0, 0, 1), V(0, 0, 0), V(0, 0, 0))), 0);
  EXPECT_EQ(point_form_factor(x, n, Polygon()), 0);
}

TEST(GaussRule, IntegratesPolynomialsUpToItsDegree) {
  for (int order : {1, 2, 5, 13, kMaxGaussOrder}) {
    const GaussRule& rule = gauss_rule(order);
    for (int degree = 0; degree < 2 * order; ++degree) {
      double sum = 0;
      for (int i = 0; i < order; ++i) sum += rule.weight[i] * std::pow(rule.node[i], degree);
      EXPECT_NEAR(sum, 1.0 / (degree + 1), 1e-14) << order << ' ' << degree;  // rounding of up to 24 terms
    }
  }
  EXPECT_THROW(gauss_rule(0), Bug);
  EXPECT_THROW(gauss_rule(kMaxGaussOrder + 1), Bug);
}

TEST(TanhSinh, IntegratesSingularitiesAtTheEnds) {
  EXPECT_NEAR(tanh_sinh(0, 2, [](double x) { return std::log(x); }), 2 * std::log(2) - 2, 1e-13);
  // The end of the rule cuts off sqrt(1e-20).
  EXPECT_NEAR(tanh_sinh(0, 1, [](double x) { return 1 / std::sqrt(x); }), 2, 1e-9);
  EXPECT_NEAR(tanh_sinh(-1, 3, [](double x) { return std::exp(x); }), std::exp(3) - std::exp(-1), 1e-13 * std::exp(3));
}

}  // namespace
}  // namespace countershade::solver

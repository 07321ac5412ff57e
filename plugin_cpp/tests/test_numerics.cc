// The step's weight, the scalar solve and the matrix exponential.
#include <algorithm>
#include <initializer_list>

#include "core/matrix.h"
#include "core/solve.h"
#include "core/weight.h"
#include "tests/check.h"

using mrdamp::EndWeight;
using mrdamp::Exponential;
using mrdamp::Matrix;
using mrdamp::SolveIncreasing;
using mrdamp::SolveSum;

namespace {

TEST(WeightHasItsLimits) {
  CHECK(EndWeight(0) == 0.5);
  CHECK(EndWeight(-1) == 0.5);
  CHECK(EndWeight(std::nan("")) == 0.5);
  NEAR(EndWeight(1e-6), 0.5 + 1e-6 / 12, 1e-12);
  NEAR(EndWeight(1e6), 1 - 1e-6, 1e-15);
  CHECK(EndWeight(INFINITY) == 1);
}

TEST(WeightRisesWithoutJumps) {
  double before = EndWeight(1e-9);
  for (double q = 1e-9; q < 1e9; q *= 1.01) {
    const double now = EndWeight(q);
    CHECK(now > before - 1e-12 && now < before + 0.01 && now <= 1);
    before = now;
  }
}

// One step of m v' = -c v, whatever c h / m.
TEST(WeightMakesTheDecayExact) {
  for (const double q : {1e-6, 9e-4, 1.1e-3, 0.1, 1.0, 3.0, 30.0, 499.0, 501.0, 1e8}) {
    const double theta = EndWeight(q);
    NEAR((1 - q * (1 - theta)) / (1 + q * theta), std::exp(-q), 3e-13);
  }
}

struct Counted {
  int calls = 0;
  template <class F>
  double Solve(F f, double x, double slope, double tolerance = 1e-10) {
    calls = 0;
    const double root = SolveIncreasing([&](double at) { calls++; return f(at); }, x, slope, tolerance);
    CHECK(calls <= 81);
    return root;
  }
};

TEST(SolveFindsSmoothRoots) {
  Counted c;
  for (const double slope : {1e-6, 1.0, 1e6}) {
    for (const double start : {-50.0, 0.0, 3.0, 80.0}) {
      NEAR(c.Solve([](double x) { return 4 * (x - 3); }, start, slope), 3, 1e-9);
      NEAR(c.Solve([](double x) { return x * x * x + x - 30; }, start, slope), 3, 1e-9);
      NEAR(c.Solve([](double x) { return std::atan(x - 3) + 0.01 * (x - 3); }, start, slope), 3, 1e-7);
    }
  }
  CHECK(c.Solve([](double x) { return 4 * (x - 3); }, 3, 1) == 3);
  CHECK(c.calls == 1);
}

TEST(SolvePassesKinks) {
  Counted c;
  for (const double ratio : {1e-6, 1e-3, 1e3, 1e6}) {  // slope left of the kink over slope right of it
    for (const double start : {-10.0, 2.0, 10.0}) {
      const auto f = [&](double x) { return (x < 2 ? ratio * (x - 2) : x - 2) + 0.5 * std::min(ratio, 1.0); };
      const double root = c.Solve(f, start, 1, 1e-12);
      NEAR(f(root), 0, 1e-8);  // rounding of x times the steep side
    }
  }
}

TEST(SolveEndsAtAJump) {
  Counted c;
  for (const double start : {-7.0, 0.0, 0.3, 9.0}) {
    for (const double slope : {0.01, 1.0, 100.0}) {
      NEAR(c.Solve([](double x) { return x < 0.3 ? -5 + x : 2 + x; }, start, slope), 0.3, 1e-9);
      // dry friction turned over a nanometre per second
      const auto friction = [](double x) { return 100 * std::tanh((x - 0.3) / 1e-9) + 2 * x - 40; };
      NEAR(c.Solve(friction, start, slope), 0.3, 2e-9);
      NEAR(friction(c.Solve(friction, start, slope)), 0, 1e-4);  // rounding of x times 1e11
    }
  }
}

TEST(SolveCrossesFlatStretches) {
  Counted c;
  for (const double start : {-3.0, 1.0, 3.0}) {
    // no force inside a clearance from -1 to 2, below what is asked for
    const auto f = [](double x) { return (x < -1 ? 50 * (x + 1) : (x > 2 ? 50 * (x - 2) : 0)) - 10; };
    NEAR(c.Solve(f, start, 50), 2.2, 1e-8);
    NEAR(c.Solve([&](double x) { return f(x) + 20; }, start, 50), -1.2, 1e-8);
  }
}

TEST(SolveReturnsFromWhatHasNoRoot) {
  Counted c;
  c.Solve([](double) { return std::nan(""); }, 1, 1);
  CHECK(c.calls == 1);
  c.Solve([](double) { return -1.0; }, 1, 1);
  c.Solve([](double x) { return x > 1 ? INFINITY : -1.0; }, 0, 1);
}

// A part that bends within a nanometre costs no calls of the one beside it that does not.
TEST(SolveSparesTheSlowPart) {
  for (const double width : {1e-9, 1e-3, 1.0}) {
    for (const double start : {-3.0, 0.25, 7.0}) {
      const auto bent = [&](double x, bool) { return 100 * std::tanh((x - 0.3) / width) + std::max(x - 2, 0.0); };
      for (const double pull : {40.0, 150.0, -150.0}) {
        int calls = 0;
        const auto slow = [&](double x, bool) { calls++; return 2 * x + 0.01 * x * x * x - pull; };
        const auto step = [&](double x, double y, double, double slope, bool) {
          const auto both = [&](double move) { return y + slope * move + bent(x + move, true); };
          return SolveIncreasing(both, 0, slope, 1e-9);
        };
        double rise = 1;
        const double root = SolveSum(slow, bent, step, start, &rise, 1e-6);
        CHECK(calls < (pull == 40 ? 8 : 20));
        if (pull == 40) NEAR(root, 0.3, std::max(1e-8, width));
        else NEAR(slow(root, true) + bent(root, true), 0, 1e-6);
      }
    }
  }
}

Matrix Of(int n, std::initializer_list<double> values) {
  Matrix m(n, n);
  std::copy(values.begin(), values.end(), m.a.begin());
  return m;
}

void Same(const Matrix& got, const Matrix& wanted, double tolerance) {
  for (std::size_t i = 0; i < wanted.a.size(); i++) NEAR(got.a[i], wanted.a[i], tolerance);
}

TEST(ExponentialOfKnownMatrices) {
  Same(Exponential(Matrix(3, 3)), Of(3, {1, 0, 0, 0, 1, 0, 0, 0, 1}), 0);
  Same(Exponential(Of(2, {-30, 0, 0, 1.5})), Of(2, {std::exp(-30.0), 0, 0, std::exp(1.5)}), 1e-13);
  Same(Exponential(Of(3, {0, 2, 3, 0, 0, 4, 0, 0, 0})), Of(3, {1, 2, 7, 0, 1, 4, 0, 0, 1}), 1e-14);
  for (const double w : {1e-8, 0.2, 3.0, 400.0}) {
    Same(Exponential(Of(2, {0, w, -w, 0})), Of(2, {std::cos(w), std::sin(w), -std::sin(w), std::cos(w)}), 1e-11);
  }
}

// x' = v, v' = -w^2 x - 2 zeta w v over a time t.
TEST(ExponentialOfAnOscillator) {
  const double w = 80, zeta = 0.03, t = 0.021, wd = w * std::sqrt(1 - zeta * zeta), s = zeta * w;
  const double decay = std::exp(-s * t), c = std::cos(wd * t), n = std::sin(wd * t);
  Same(Exponential(Of(2, {0, t, -w * w * t, -2 * s * t})),
       Of(2, {decay * (c + s / wd * n), decay * n / wd, -decay * w * w / wd * n, decay * (c - s / wd * n)}), 1e-11 * w);
}

TEST(ExponentialOfMinusIsTheInverse) {
  const Matrix m = Of(3, {0.3, -2, 1, 4, 0.1, -3, 2, 2, -0.7});
  Matrix minus = m;
  for (double& v : minus.a) v = -v;
  Same(Exponential(m) * Exponential(minus), Of(3, {1, 0, 0, 0, 1, 0, 0, 0, 1}), 1e-11);
}

}  // namespace

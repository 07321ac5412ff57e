// The laws against Runge-Kutta steps of their equations, and their single pieces against what they must be.
#include <functional>
#include <vector>

#include "laws/law.h"
#include "tests/check.h"
#include "tests/record_run.h"

using mrdamp::Coefficients;
using mrdamp::Fluid;
using mrdamp::HyperbolicTangent;
using mrdamp::Law;
using mrdamp::Params;

namespace {

TEST(RootOfTheTanhEquation) {
  for (const double a : {1e-6, 1.0, 2e4}) {
    for (const double f : {0.0, 0.5, 300.0}) {
      for (const double w : {1e-9, 1e-3, 2.0}) {
        for (const double b : {-1e5, -299.0, -1e-7, 0.0, 0.4999, 3.0, 301.0, 1e6}) {
          const double p = HyperbolicTangent::Root(a, f, w, b);
          // a rising function: the root lies where its sign changes
          const auto residual = [&](double x) { return a * x + f * std::tanh(x / w) - b; };
          const double step = 1e-7 * (std::fabs(p) + w);
          CHECK(residual(p - step) <= 1e-12 * std::fabs(b) && residual(p + step) >= -1e-12 * std::fabs(b));
          CHECK(HyperbolicTangent::Root(a, f, w, -b) == -p || b == 0);
        }
      }
    }
  }
}

TEST(RootOfTheSignEquation) {
  CHECK(HyperbolicTangent::Root(2, 5, 0, 4.9) == 0);
  CHECK(HyperbolicTangent::Root(2, 5, 0, -4.9) == 0);
  CHECK(HyperbolicTangent::Root(2, 5, 0, 9) == 2);
  CHECK(HyperbolicTangent::Root(2, 5, 0, -9) == -2);
  NEAR(HyperbolicTangent::Root(2, 5, 1e-12, 9), 2, 1e-9);
}

TEST(CoefficientsFollowTheField) {
  Params p;
  p.c0a = 100, p.c0b = 30, p.c0c = -2, p.c0e = 50, p.c0r = 0.7;
  p.fya = 7, p.fyb = -4;
  Fluid f;
  f.b = 1.5;
  f.viscosity = 0.5, f.yield = 0.25;
  const double c0 = 100 + 30 * 1.5 - 2 * 1.5 * 1.5 + 50 * (1 - std::exp(-0.7 * 1.5));
  NEAR(mrdamp::Evaluate(p, Law::kBingham, f, 0.3).c0, 0.5 * c0, 1e-12 * c0);
  NEAR(mrdamp::Evaluate(p, Law::kBingham, f, 0.3).yield, 0.25 * 1, 1e-12);
  f.b = 2;  // a straight line that falls below zero is cut off there
  CHECK(mrdamp::Evaluate(p, Law::kBingham, f, 0.3).yield == 0);
}

// A command, or remanence, may make the field negative: the saturating parts must not explode there.
TEST(SaturatingPartsAreHarmlessAtANegativeField) {
  Params p;
  p.c0a = 100, p.c0e = -50, p.c0r = 3, p.gamma = p.beta = 1e6, p.hysteresis_rate = 3;
  Fluid f;
  f.b = -500;
  const Coefficients k = mrdamp::Evaluate(p, Law::kBoucWen, f, 0);
  CHECK(k.c0 <= 200 && k.gamma <= 1e6 && k.beta <= 1e6);
}

TEST(HysteresisFallsWithTheField) {
  Params p;
  p.gamma = 8e5, p.beta = 3e5, p.hysteresis_rate = 2, p.hysteresis_floor = 0.25;
  Fluid f;
  f.b = 0.6;
  const double share = 0.25 + 0.75 * std::exp(-1.2);
  const Coefficients k = mrdamp::Evaluate(p, Law::kModifiedBoucWen, f, 0);
  NEAR(k.gamma, 8e5 * share, 1e-6);
  NEAR(k.beta, 3e5 * share, 1e-6);
}

TEST(ThinningIsThePowerLaw) {
  Params p;
  p.c0a = 1000, p.shear_thinning_v_s = 0.01;
  CHECK(mrdamp::Thinning(p, 5) == 1);
  p.shear_thinning_m = 0.4;
  CHECK(mrdamp::Thinning(p, 0) == 1);
  NEAR(mrdamp::Thinning(p, 0.01), std::pow(2, -0.3), 1e-12);
  NEAR(mrdamp::Thinning(p, -20) / mrdamp::Thinning(p, 10), std::pow(2, -0.6), 1e-5);
  p.shear_thinning_shape = 0.6;  // Cross
  for (const double v : {0.001, -0.01, 0.3}) NEAR(mrdamp::Thinning(p, v), 1 / (1 + std::pow(std::fabs(v) / 0.01, 0.6)), 1e-12);
  p.shear_thinning_m = 0, p.shear_thinning_shape = 20;  // a force that rises to c0 v_s and no further
  NEAR(mrdamp::Thinning(p, 0.005), 1, 1e-6);
  NEAR(mrdamp::Thinning(p, 0.04) * 0.04, 0.01, 1e-9);
}

TEST(ThinningTakesTheSeriesDashpotWhereAsked) {
  Params p;
  p.c0a = 1000, p.c1a = 8000, p.shear_thinning_v_s = 0.01, p.shear_thinning_m = 0.4;
  const double thin = std::pow(2, -0.3);
  for (const Law law : {Law::kModifiedBoucWen, Law::kHyperbolicTangent}) {
    for (const double share : {0.0, 0.5, 1.0}) {
      p.shear_thinning_series = share;
      const Coefficients k = mrdamp::Evaluate(p, law, Fluid(), -0.01);
      NEAR(k.c0, 1000 * thin, 1e-9);
      NEAR(k.c1, 8000 * (1 - share + share * thin), 1e-9);
    }
  }
}

TEST(BinghamIsTheSignFunctionInTheLimit) {
  Params p;
  p.c0a = 500, p.fya = 40;
  const Coefficients k = mrdamp::Evaluate(p, Law::kBingham, Fluid(), 0);
  NEAR(mrdamp::Bingham::Force(p, k, 0, 0, 0, 0.02).fluid, 50, 1e-12);
  NEAR(mrdamp::Bingham::Force(p, k, 0, 0, 0, -0.02).fluid, -50, 1e-12);
  CHECK(mrdamp::Bingham::Force(p, k, 0, 0, 0, 0).fluid == 0);
  p.v_ref = 0.02;
  NEAR(mrdamp::Bingham::Force(p, k, 0, 0, 0, 0.01).fluid, 5 + 40 * std::tanh(0.5), 1e-12);
}

// ---- whole laws over a record, by their equations ----------------------------------------------------

constexpr double kOmega = 35, kStroke = 0.004;  // rad/s, m
double X(double t) { return kStroke * (std::sin(kOmega * t) + 0.3 * std::sin(2.7 * kOmega * t)); }
double V(double t) { return kStroke * kOmega * (std::cos(kOmega * t) + 0.81 * std::cos(2.7 * kOmega * t)); }
double U(double t) { return 1 + 0.8 * std::sin(22 * t); }

using check::Setting;
using State = std::vector<double>;
using Rates = std::function<State(double, const State&)>;

constexpr double kEnd = 0.4, kGrid = 1e-4;  // s

// Force on the grid, stepped by the classical Runge-Kutta rule in steps far below every time constant.
std::vector<double> Exact(const Rates& rates, const std::function<double(double, const State&)>& force, State y) {
  constexpr int kFine = 50;
  std::vector<double> out;
  const auto along = [](const State& a, const State& b, double h) {
    State c = a;
    for (std::size_t i = 0; i < a.size(); i++) c[i] += h * b[i];
    return c;
  };
  for (int k = 0; k * kGrid <= kEnd * (1 + 1e-9); k++) {
    out.push_back(force(k * kGrid, y));
    const double h = kGrid / kFine;
    for (int j = 0; j < kFine; j++) {
      const double t = k * kGrid + j * h;
      const State a = rates(t, y), b = rates(t + 0.5 * h, along(y, a, 0.5 * h));
      const State c = rates(t + 0.5 * h, along(y, b, 0.5 * h)), d = rates(t + h, along(y, c, h));
      for (std::size_t i = 0; i < y.size(); i++) y[i] += h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
    }
  }
  return out;
}

std::vector<double> Run(const char* law, const std::vector<Setting>& settings, double dt, int n) {
  return check::Run(law, settings, check::Sample(dt, n, X, V, U), MRDAMP_TRUE);
}

double Rms(const std::vector<double>& a, const std::vector<double>& b) {
  double apart = 0, size = 0;
  for (std::size_t i = 0; i < a.size(); i++) apart += (a[i] - b[i]) * (a[i] - b[i]), size += b[i] * b[i];
  return std::sqrt(apart / size);
}

// At every step from 0.1 ms to 5 ms.
void Compare(const char* law, const std::vector<Setting>& p, const Rates& rates,
             const std::function<double(double, const State&)>& force, const State& start) {
  const std::vector<double> exact = Exact(rates, force, start);
  for (const int every : {1, 10, 20, 50}) {
    std::vector<double> wanted;
    for (std::size_t k = 0; k < exact.size(); k += every) wanted.push_back(exact[k]);
    const double error = Rms(Run(law, p, every * kGrid, static_cast<int>(wanted.size())), wanted);
    std::printf("     %s at %g ms: %.2f %%\n", law, 1e3 * every * kGrid, 100 * error);
    CHECK(error < (every > 20 ? 0.03 : 0.01));
  }
}

TEST(BoucWenOverARecord) {
  const std::vector<Setting> p = {{"c0a", 900}, {"c0b", 700}, {"alpha_a", 2e4}, {"alpha_b", 8e4}, {"gamma", 9e5}, {"beta", 4e5},
                                  {"A", 110}, {"n", 2}, {"k0", 2e5}, {"x0", 0.001}};
  const double gamma = 9e5, beta = 4e5, A = 110;
  const auto rates = [&](double t, const State& s) {
    const double v = V(t), z = s[0];
    return State{-gamma * std::fabs(v) * z * std::fabs(z) - beta * v * z * z + A * v};
  };
  const auto force = [](double t, const State& s) {
    return (900 + 700 * U(t)) * V(t) + (2e4 + 8e4 * U(t)) * s[0] + 2e5 * (X(t) - 0.001);
  };
  Compare("bouc_wen", p, rates, force, {0});
}

TEST(ModifiedBoucWenOverARecord) {  // Spencer et al. 1997, Table 2, without its preload
  const std::vector<Setting> p = {{"c0a", 2100}, {"c0b", 350}, {"c1a", 28300}, {"c1b", 295}, {"k0", 4690}, {"k1", 500},
                                  {"alpha_a", 14000}, {"alpha_b", 69500}, {"gamma", 3.63e6}, {"beta", 3.63e6}, {"A", 301}, {"n", 2}};
  const auto inner = [](double t, const State& s) {
    const double u = U(t);
    return ((14000 + 69500 * u) * s[1] + (2100 + 350 * u) * V(t) + 4690 * (X(t) - s[0])) / (2100 + 350 * u + 28300 + 295 * u);
  };
  const auto rates = [&](double t, const State& s) {
    const double y = inner(t, s), w = V(t) - y, z = s[1];
    return State{y, -3.63e6 * std::fabs(w) * z * std::fabs(z) - 3.63e6 * w * z * z + 301 * w};
  };
  const auto force = [&](double t, const State& s) { return (28300 + 295 * U(t)) * inner(t, s) + 500 * X(t); };
  Compare("modified_bouc_wen", p, rates, force, {0, 0});
}

TEST(HyperbolicTangentOverARecord) {
  const std::vector<Setting> p = {{"k0a", 200}, {"k0b", 100}, {"k1a", 9000}, {"k1b", 2e4}, {"c0a", 120}, {"c0b", 80}, {"c1a", 90},
                                  {"c1b", 20}, {"m0", 0.05}, {"f0a", 30}, {"f0b", 90}, {"v_ref", 0.01}};
  const auto rates = [&](double t, const State& s) {
    const double u = U(t), k0 = 200 + 100 * u, k1 = 9000 + 2e4 * u, c0 = 120 + 80 * u, c1 = 90 + 20 * u, f0 = 30 + 90 * u;
    return State{s[1], (-(k0 + k1) * s[0] - (c0 + c1) * s[1] + k1 * X(t) + c1 * V(t) - f0 * std::tanh(s[1] / 0.01)) / 0.05};
  };
  const auto force = [](double t, const State& s) {
    return (9000 + 2e4 * U(t)) * (X(t) - s[0]) + (90 + 20 * U(t)) * (V(t) - s[1]);
  };
  Compare("hyperbolic_tangent", p, rates, force, {0, 0});
}

TEST(BinghamOverARecord) {
  const std::vector<Setting> p = {{"c0a", 600}, {"c0b", 150}, {"fya", 40}, {"fyb", 300}, {"v_ref", 0.02}};
  const std::vector<double> got = Run("bingham", p, 1e-3, 200);
  for (int k = 0; k < 200; k++) {
    const double t = k * 1e-3;
    NEAR(got[k], (600 + 150 * U(t)) * V(t) + (40 + 300 * U(t)) * std::tanh(V(t) / 0.02), 1e-9);
  }
}

// Behind a mount, with the series dashpot far above the post-yield one and an inertia faster than any step: the
// piston's balance k (x - xp) = k1 (xp - g) + c1 (xp' - g') must be solved, not run away.
TEST(HyperbolicTangentBehindAMount) {
  const double c0 = 300, c1 = 3000, k1 = 5e4, f0 = 200, m0 = 0.05, k = 1e6;
  const std::vector<Setting> p = {{"c0a", c0}, {"c1a", c1}, {"k1a", k1}, {"f0a", f0}, {"m0", m0}, {"v_ref", 0.01}, {"mount_compliance_k", k}};
  const auto rates = [=](double t, const State& s) {
    const double v = (k * (X(t) - s[0]) - k1 * (s[0] - s[1])) / c1 + s[2];
    return State{v, s[2], (-k1 * s[1] - (c0 + c1) * s[2] + k1 * s[0] + c1 * v - f0 * std::tanh(s[2] / 0.01)) / m0};
  };
  Compare("hyperbolic_tangent", p, rates, [=](double t, const State& s) { return k * (X(t) - s[0]); }, {0, 0, 0});
}

// A device without inertia is the limit of one with less and less.
TEST(MasslessTanhIsTheLimit) {
  std::vector<Setting> p = {{"k1a", 9000}, {"c0a", 120}, {"c1a", 90}, {"m0", 0}, {"f0a", 30}, {"v_ref", 0.01}};
  const std::vector<double> without = Run("hyperbolic_tangent", p, 1e-3, 400);
  p[3].value = 1e-6;
  CHECK(Rms(Run("hyperbolic_tangent", p, 1e-3, 400), without) < 1e-2);
}

}  // namespace

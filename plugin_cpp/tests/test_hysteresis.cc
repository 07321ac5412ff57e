// Bouc-Wen's z over a path against fourth-order Runge-Kutta steps of the equation in time.
#include "laws/hysteresis.h"

#include <vector>

#include "tests/check.h"

using mrdamp::Hysteresis;
using mrdamp::HysteresisSlope;

namespace {

struct Shape {
  double A, beta, gamma, n;
};

// z' = -gamma |v| z |z|^(n-1) - beta v |z|^n + A v, as in the paper.
double Rate(const Shape& p, double z, double v) {
  const double a = std::fabs(z);
  return -p.gamma * std::fabs(v) * z * std::pow(a, p.n - 1) - p.beta * v * std::pow(a, p.n) + p.A * v;
}

double RungeKutta(const Shape& p, double z, double dx, int steps) {
  const double v = dx > 0 ? 0.37 : -0.37, h = dx / v / steps;  // m/s: the result must not depend on it
  for (int i = 0; i < steps; i++) {
    const double k1 = Rate(p, z, v), k2 = Rate(p, z + 0.5 * h * k1, v);
    const double k3 = Rate(p, z + 0.5 * h * k2, v), k4 = Rate(p, z + h * k3, v);
    z += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  }
  return z;
}

// Spencer's A and z at rest, at any exponent; part: beta's share of beta + gamma.
constexpr double kA = 301, kRest = 6.4389e-3;
constexpr double kReach = kRest / kA;  // m

Shape Make(double n, double part) {
  const double sum = kA / std::pow(kRest, n);
  return {kA, part * sum, (1 - part) * sum, n};
}

// Strokes with turns before, at and far past yielding, in units of the reach.
const double kStrokes[] = {0.3, -0.2, 0.9, -1.7, 2.5, -0.4, 0.05, -3.0, 4.0, -8.0, 6.0, -0.5};
const double kExponents[] = {1, 1.5, 2, 3};
const double kShares[] = {0.8, 0.5, 0.2};  // beta - gamma positive, zero, negative

// Largest error over the strokes in units of z at rest, with `calls` calls a stroke.
double Error(const Shape& p, int calls) {
  double z = 0, exact = 0, worst = 0;
  for (const double stroke : kStrokes) {
    const double dx = stroke * kReach;
    exact = RungeKutta(p, exact, dx, 4000);
    for (int i = 0; i < calls; i++) z = Hysteresis(z, dx / calls, p.A, p.beta, p.gamma, p.n);
    worst = std::fmax(worst, std::fabs(z - exact) / kRest);
  }
  return worst;
}

TEST(PathOfZFollowsTheEquation) {
  for (const double n : kExponents) {
    for (const double share : kShares) {
      const Shape p = Make(n, share);
      const double one = Error(p, 1), many = Error(p, 100);
      std::printf("     n = %g, beta / (beta + gamma) = %g: %.1e in one step a stroke, %.1e in 100\n", n, share, one, many);
      CHECK(one < (n == 1 || n == 2 ? 1e-8 : 5e-3));
      CHECK(many < (n == 1 || n == 2 ? 1e-8 : 2e-4));
    }
  }
}

// The closed forms are exact however a path is cut up.
TEST(ClosedFormsDoNotDependOnTheStep) {
  for (const double n : {1.0, 2.0}) {
    for (const double share : kShares) {
      const Shape p = Make(n, share);
      for (double z = -1.0; z <= 1.0; z += 0.125) {
        for (const double dx : {0.7 * kReach, -1.9 * kReach}) {
          double parts = z * kRest;
          for (const double part : {0.1, 0.35, 0.05, 0.5}) parts = Hysteresis(parts, part * dx, p.A, p.beta, p.gamma, p.n);
          NEAR(parts, Hysteresis(z * kRest, dx, p.A, p.beta, p.gamma, p.n), 1e-12 * kRest);
        }
      }
    }
  }
}

// An exponent at a bound of a fit, and one near it, give the same law.
TEST(ExponentsBesideTheClosedForms) {
  for (const double n : {1.0, 2.0}) {
    for (const double share : kShares) {
      const Shape p = Make(n, share);
      for (const double z : {-0.9, -0.2, 0.6}) {
        for (const double reaches : {0.3, 2.0, 40.0}) {
          const double dx = reaches * kReach, exact = Hysteresis(z * kRest, dx, p.A, p.beta, p.gamma, n);
          CHECK(Hysteresis(z * kRest, dx, p.A, p.beta, p.gamma, n + 5e-7) == exact);
          const double beside = n + 1e-5;
          const double change = std::pow(kRest, n - beside);
          NEAR(Hysteresis(z * kRest, dx, p.A, p.beta * change, p.gamma * change, beside), exact, 2e-3 * kRest);
        }
      }
    }
  }
}

TEST(MirrorImage) {
  for (const double n : kExponents) {
    const Shape p = Make(n, 0.7);
    for (const double z : {-0.9, -0.1, 0.0, 0.4}) {
      const double there = Hysteresis(z * kRest, 1.3 * kReach, p.A, p.beta, p.gamma, p.n);
      CHECK(Hysteresis(-z * kRest, -1.3 * kReach, p.A, p.beta, p.gamma, p.n) == -there);
    }
  }
}

TEST(LongPathsEndAtRest) {
  for (const double n : kExponents) {
    for (const double share : kShares) {
      const Shape p = Make(n, share);
      for (const double z : {-0.99, 0.0, 0.5, 1.0}) {
        for (const double reaches : {50.0, 1e4, 1e9}) {
          NEAR(Hysteresis(z * kRest, reaches * kReach, p.A, p.beta, p.gamma, n), kRest, 1e-6 * kRest);
          NEAR(Hysteresis(z * kRest, -reaches * kReach, p.A, p.beta, p.gamma, n), -kRest, 1e-6 * kRest);
        }
      }
    }
  }
}

TEST(NoPathNoChange) {
  for (const double n : kExponents) {
    const Shape p = Make(n, 0.5);
    CHECK(Hysteresis(0.3 * kRest, 0, p.A, p.beta, p.gamma, p.n) == 0.3 * kRest);
    const double tiny = 1e-14 * kReach;
    NEAR(Hysteresis(0.3 * kRest, tiny, p.A, p.beta, p.gamma, p.n) - 0.3 * kRest, 0, 1e-13 * kRest);
  }
}

// Where the field falls, z may stand past the rest of the new gamma and beta; the way back must not run away.
TEST(BeyondRestComesBack) {
  for (const double n : kExponents) {
    const Shape p = Make(n, 0.9);  // beta - gamma > 0: unloading from far outside has no turning point
    for (const double z : {1.2, 1.6, 5.0}) {
      for (const double sign : {1.0, -1.0}) {
        const double out = Hysteresis(sign * z * kRest, sign * 30 * kReach, p.A, p.beta, p.gamma, n);
        NEAR(out, sign * kRest, 1e-6 * kRest);
        double back = sign * z * kRest, largest = std::fabs(back);
        for (int i = 0; i < 400; i++) {
          back = Hysteresis(back, -0.25 * sign * kReach, p.A, p.beta, p.gamma, n);
          largest = std::fmax(largest, std::isfinite(back) ? std::fabs(back) : INFINITY);
        }
        CHECK(largest <= z * kRest * (1 + 1e-9));
        NEAR(back, -sign * kRest, 1e-6 * kRest);
      }
    }
  }
}

// With beta > gamma the far rest is unstable: no step from it may be long, however slowly z leaves it.
TEST(FarRestIsLeftInShortSteps) {
  for (const double n : {1.2, 1.5, 2.16, 3.0}) {
    for (const double share : {0.8, 0.999}) {
      const Shape p = Make(n, share);
      const double far = std::pow(p.A / (p.beta - p.gamma), 1 / n);
      for (const double part : {1.0, 1 - 1e-6, 0.999}) {
        for (const double reaches : {3.0, 1e3, 1e7}) {
          const double z = Hysteresis(-part * far, reaches * kReach, p.A, p.beta, p.gamma, n);
          CHECK(std::isfinite(z) && std::fabs(z) <= far);
        }
      }
      const double left = RungeKutta(p, -0.999 * far, 4 * kReach, 4000);
      NEAR(Hysteresis(-0.999 * far, 4 * kReach, p.A, p.beta, p.gamma, n), left, 5e-3 * kRest);
    }
  }
}

TEST(SlopeIsThatOfThePath) {
  for (const double n : kExponents) {
    for (const double share : kShares) {
      const Shape p = Make(n, share);
      for (const double z : {-0.8, -0.3, 0.2, 0.95}) {
        for (const double sign : {1.0, -1.0}) {
          const double h = 1e-6 * kReach * sign;
          const double ahead = Hysteresis(z * kRest, h, p.A, p.beta, p.gamma, n);
          NEAR(HysteresisSlope(z * kRest, sign, p.A, p.beta, p.gamma, n), (ahead - z * kRest) / h, 1e-4 * p.A);
        }
      }
    }
  }
}

}  // namespace

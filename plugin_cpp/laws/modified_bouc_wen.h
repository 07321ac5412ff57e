// Modified Bouc-Wen (Spencer, Dyke, Sain, Carlson 1997, doi:10.1061/(ASCE)0733-9399(1997)123:3(230)):
//   y' = (alpha z + c0 v + k0 (x - y)) / (c0 + c1),  z' over the path of x - y,  F = c1 y' + k1 (x - x0).
//
// With r = x - y, (c0 + c1) r' = c1 v - alpha z(r) - k0 r: one stiff scalar equation, since z follows the path
// of r in closed form. It is stepped with the exponential Rosenbrock rule of second order (Hochbruck, Ostermann,
// Schweitzer 2009, doi:10.1137/080717717), stable at any step.
#ifndef MRDAMP_LAWS_MODIFIED_BOUC_WEN_H_
#define MRDAMP_LAWS_MODIFIED_BOUC_WEN_H_

#include "laws/coefficients.h"
#include "laws/hysteresis.h"

namespace mrdamp {

struct ModifiedBoucWen {
  // r' at the piston velocity v
  static double Rate(const Coefficients& k, double z, double r, double v) {
    return (k.c1 * v - k.yield * z - k.k0 * r) / (k.c0 + k.c1);
  }

  // largest rate (1/s) of r, to be resolved by a step
  static double Stiffness(const Params& p, const Coefficients& k) { return (k.yield * p.A + k.k0) / (k.c0 + k.c1); }

  static void Step(const Params& p, const Coefficients& k, double* z, double* r, double va, double vb, double dt) {
    const double c = k.c0 + k.c1;
    if (!(c > 0)) return;
    const double rate = Rate(k, *z, *r, va);
    const double trend = k.c1 * (vb - va) / (dt * c);
    // The direction of the path determines the slope of z: taken at the middle of the step, so that a turn is not
    // missed.
    const double sign = rate + 0.5 * dt * trend >= 0 ? 1 : -1;
    const double slope = HysteresisSlope(*z, sign, p.A, k.beta, k.gamma, p.n);
    const double q = (k.yield * (slope > 0 ? slope : 0) + k.k0) * dt / c;
    double phi1, phi2;
    if (q < 1e-4) {
      phi1 = 1 - 0.5 * q;
      phi2 = 0.5 - q / 6;
    } else {
      phi1 = -std::expm1(-q) / q;
      phi2 = (1 - phi1) / q;
    }
    const double dr = dt * (phi1 * rate + phi2 * dt * trend);
    *z = Hysteresis(*z, dr, p.A, k.beta, k.gamma, p.n);
    *r += dr;
  }

  static LawForce Force(const Params& p, const Coefficients& k, double z, double r, double x, double v) {
    const double c = k.c0 + k.c1;
    if (!(c > 0)) return {0, k.k1 * (x - p.x0), 0};
    return {k.c1 * (v - Rate(k, z, r, v)), k.k1 * (x - p.x0), k.c1 * k.c0 / c};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_MODIFIED_BOUC_WEN_H_

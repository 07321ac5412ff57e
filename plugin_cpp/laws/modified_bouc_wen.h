// Modified Bouc-Wen (Spencer, Dyke, Sain, Carlson 1997, doi:10.1061/(ASCE)0733-9399(1997)123:3(230)):
//   y' = (alpha z + c0 v + k0 (x - y)) / (c0 + c1),  z' over the path of x - y,  F = c1 y' + k1 (x - x0).
//
// With r = x - y, (c0 + c1) r' = c1 v - alpha z(r) - k0 r: one stiff scalar equation, since z follows the path
// of r in closed form. It is stepped with the exponential Rosenbrock rule of second order (Hochbruck, Ostermann,
// Schweitzer 2009, doi:10.1137/080717717), stable at any step.
#ifndef MRDAMP_LAWS_MODIFIED_BOUC_WEN_H_
#define MRDAMP_LAWS_MODIFIED_BOUC_WEN_H_

#include "laws/bouc_wen.h"

namespace mrdamp {

struct ModifiedBoucWen : BoucWen {
  static constexpr LawKind kIs{true, false, true};

  static void Fill(const Params& p, const Fluid& f, Real series, Coefficients* k) {
    BoucWen::Fill(p, f, series, k);
    k->c1 = Follow(p.c1a, p.c1b, p.c1c, p.c1e, p.c1r, f.b) * f.viscosity * series;
    k->k1 = p.k1;
  }

  static bool Check(const Params& p, char* error, int size) {
    if (!BoucWen::Check(p, error, size)) return false;
    if (Head(p.c1a) > 0) return true;
    std::snprintf(error, size, "c1a = %g; it must be above 0, or no force passes", Head(p.c1a));
    return false;
  }

  // r' at the piston velocity v
  static Real Relative(const Coefficients& k, Real z, Real r, Real v) {
    return (k.c1 * v - k.yield * z - k.k0 * r) / (k.c0 + k.c1);
  }

  static void Step(const Params& p, const Coefficients& k, Real* z, Real* r, const LawStep& m) {
    const double dt = m.dt;
    const Real c = k.c0 + k.c1;
    const Mask solid = !(c > 0);
    const Real rate = Relative(k, *z, *r, m.va);
    const Real trend = k.c1 * (m.vb - m.va) / (dt * c);
    // The direction of the path determines the slope of z: taken at the middle of the step, so that a turn is not
    // missed.
    const Real sign = Select(rate + 0.5 * dt * trend >= 0, 1, -1);
    const Real slope = HysteresisSlope(*z, sign, p.A, k.beta, k.gamma, p.n);
    const Real q = (k.yield * max(slope, 0.0) + k.k0) * dt / c;
    const Mask small = q < 1e-4;
    const Real exact = All(small) ? 1 : -expm1(-q) / q;
    const Real phi1 = Select(small, 1 - 0.5 * q, exact), phi2 = Select(small, 0.5 - q / 6, (1 - exact) / q);
    const Real dr = Select(solid, 0, dt * (phi1 * rate + phi2 * dt * trend));
    *z = Hysteresis(*z, dr, p.A, k.beta, k.gamma, p.n);
    *r += dr;
  }

  static LawForce Force(const Params& p, const Coefficients& k, Real z, Real r, Real x, Real v) {
    const Real c = k.c0 + k.c1, spring = k.k1 * (x - p.x0);
    const Mask solid = !(c > 0);
    return {Select(solid, 0, k.c1 * (v - Relative(k, z, r, v))), spring, Select(solid, 0, k.c1 * k.c0 / c)};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_MODIFIED_BOUC_WEN_H_

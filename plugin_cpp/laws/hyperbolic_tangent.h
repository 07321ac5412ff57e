// Hyperbolic tangent (Gavin 2001; Gamota, Filisko 1991, doi:10.1122/1.550221):
//   m0 g'' = -(k0 + k1) g - (c0 + c1) g' + k1 x + c1 v - f0 tanh(g' / v_ref),  F = k1 (x - g) + c1 (v - g').
//
// With published parameters the rate f0 / (m0 v_ref) is near 5e5 1/s: g' nearly follows x, v and g. It is stepped by
// backward Euler and g by the exponentially fitted rule (core/weight.h): one monotone scalar equation per step,
// stable for any step, with a force that never decreases with the velocity, as the surrounding solves require.
#ifndef MRDAMP_LAWS_HYPERBOLIC_TANGENT_H_
#define MRDAMP_LAWS_HYPERBOLIC_TANGENT_H_

#include "core/weight.h"
#include "laws/coefficients.h"

namespace mrdamp {

struct HyperbolicTangent : PlainLaw {
  static constexpr LawKind kIs{false, true, false};

  static void Fill(const Params& p, const Fluid& f, Real series, Coefficients* k) {
    k->c1 = Follow(p.c1a, p.c1b, p.c1c, p.c1e, p.c1r, f.b) * f.viscosity * series;
    k->yield = Follow(p.f0a, p.f0b, p.f0c, p.f0e, p.f0r, f.b) * f.yield;
    k->k0 = Follow(p.k0a, p.k0b, p.k0c, p.k0e, p.k0r, f.b);
    k->k1 = Follow(p.k1a, p.k1b, p.k1c, p.k1e, p.k1r, f.b);
  }

  // Root of a p + f tanh(p / w) = b with a > 0, f >= 0; w -> 0 is the sign function. tanh is concave at the root, so
  // that Newton's steps from below converge without overshoot; one from an estimate above leads below it.
  static Real Root(Real a, Real f, Real w, Real b, Real guess = 0) {
    const Real sign = Select(b < 0, -1, 1);
    b = fabs(b);
    if (!(Head(w) > 0)) return sign * max(b - f, 0.0) / a;
    const Real low = max(b / (a + f / w), (b - f) / a);
    Real p = max(low, sign * guess);
    Mask open = true;
    for (int i = 0; i < 50 && Any(open); i++) {
      const Real t = tanh(p / w);
      const Real step = (b - a * p - f * t) / (a + f * (1 - t * t) / w);
      p = Select(open, max(low, p + step), p);
      open = open && step * step > 1e-13 * w * (p + w);  // the remaining error is below step^2 / w
    }
    return sign * p;
  }

  // The instantaneous g' if the device has no inertia.
  static Real MasslessRate(const Params& p, const Coefficients& k, Real g, Real x, Real v) {
    const Real a = k.c0 + k.c1;
    const Real b = k.k1 * x + k.c1 * v - (k.k0 + k.k1) * g;
    return Root(max(a, 1e-12), k.yield, p.v_ref, b);
  }

  // g' after dt by backward Euler, g as it is.
  static Real Rate(const Params& p, const Coefficients& k, Real g, Real rate, Real x, Real v, double dt) {
    const Real mass = p.m0 / dt, dashpot = max(k.c0 + k.c1, 1e-12);
    return Root(mass + dashpot, k.yield, p.v_ref, mass * rate + k.k1 * x + k.c1 * v - (k.k0 + k.k1) * g, rate);
  }

  static void Step(const Params& p, const Coefficients& k, Real* g, Real* rate, const LawStep& m) {
    const double dt = m.dt;
    const Real mass = p.m0 / dt, spring = k.k0 + k.k1, dashpot = max(k.c0 + k.c1, 1e-12);
    const Real weight = EndWeight(dt * spring / dashpot);
    const Real from = *g + (1 - weight) * dt * *rate;
    const Real x1 = m.x + 0.5 * (m.va + m.vb) * dt;
    *rate = Root(mass + dashpot + spring * weight * dt, k.yield, p.v_ref, mass * *rate + k.k1 * x1 + k.c1 * m.vb - spring * from, m.near);
    *g = from + weight * dt * *rate;
  }

  static LawForce Force(const Params& p, const Coefficients& k, Real g, Real rate, Real x, Real v) {
    Real slope = k.c1;
    if (!(Head(p.m0) > 0)) {
      rate = MasslessRate(p, k, g, x, v);
      slope = k.c0 * k.c1 / max(k.c0 + k.c1, 1e-12);
    }
    return {k.k1 * (x - g) + k.c1 * (v - rate), 0, slope};
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_HYPERBOLIC_TANGENT_H_

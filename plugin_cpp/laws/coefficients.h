// What the force laws are made of: their coefficients at one field and one temperature, and what they have in common.
#ifndef MRDAMP_LAWS_COEFFICIENTS_H_
#define MRDAMP_LAWS_COEFFICIENTS_H_

#include <algorithm>

#include "core/params.h"

namespace mrdamp {

// Present state of the fluid: the field variable b, and the factors by which heat lowers viscosity and yield force.
struct Fluid {
  Real b = 0;
  Real viscosity = 1;
  Real yield = 1;
};

// Force of a law: the fluid's part, on which the fluid effects act, and the parallel spring's.
struct LawForce {
  Real fluid = 0;
  Real spring = 0;
  Real slope = 0;  // N s/m, d(fluid)/dv at fixed inner state
};

struct Coefficients {
  Real c0, c1;                // N s/m
  Real yield;                 // fy, alpha or f0
  Real k0, k1;                // N/m
  Real gamma, beta;           // with their decrease at a large field
};

// p(b) = a + slope b + c b^2 + e (1 - exp(-r b)), never below zero: outside the range of its fit a line may cross
// zero, and a negative viscosity would supply energy.
inline Real Follow(Real a, Real slope, Real c, Real e, Real r, Real b) {
  Real p = a + b * (slope + c * b);
  if (Head(e) != 0) p += e * (1 - exp(-r * max(b, 0.0)));  // a saturating part is constant below zero
  return max(p, 0.0);
}

// Power-law thinning of the post-yield viscosity: (1 + |v / v_s|^a)^((m - 1) / a) (Carreau 1972 at a = 2; Yasuda,
// Armstrong, Cohen 1981, doi:10.1007/BF01513059; Cross 1965 at a = 1 - m), without a high-shear plateau.
inline Real Thinning(const Params& p, Real v) {
  if (Head(p.shear_thinning_m) == 1) return 1;
  const Real s = fabs(v) / p.shear_thinning_v_s, a = p.shear_thinning_shape;
  return pow(1 + (Head(a) == 2 ? s * s : pow(s, a)), (p.shear_thinning_m - 1) / a);
}

// Least velocity (m/s) over which they change with the velocity; infinite if they do not.
inline Real VelocityWidth(const Params& p) {
  const Real thin = Head(p.shear_thinning_m) == 1 ? kInf : p.shear_thinning_v_s;
  return Head(p.asymmetry_yield) != 0 || Head(p.asymmetry_viscous) != 0 ? min(thin, p.asymmetry_width) : thin;
}

// Motion of the fluid over a step from x on: velocity linear from va to vb. near: where a solve for the state r begins.
struct LawStep {
  Real x, va, vb;
  double dt;
  Real near;
};

// What the chain does for a law's state.
struct LawKind {
  bool hysteresis = false;  // the force follows Bouc-Wen's z
  bool inner = false;       // z is a displacement inside, r its rate, which is solved for at the end of a step
  bool slow = false;        // r is a stretch that takes longer than a run-in to settle; it starts at start_r
};

// A law without a state. A law (laws/NAME.h, type and parameters in core/attributes.def) hides what it has of its own;
// its states are z and r, which start at 0.
struct PlainLaw {
  static constexpr LawKind kIs{};

  // Coefficients besides c0; series: share of c1 that thinning leaves.
  static void Fill(const Params&, const Fluid&, Real /*series*/, Coefficients*) {}
  static void Step(const Params&, const Coefficients&, Real* /*z*/, Real* /*r*/, const LawStep&) {}
  static LawForce Force(const Params&, const Coefficients&, Real /*z*/, Real /*r*/, Real /*x*/, Real /*v*/) { return {}; }
  // r after dt at one x and v, where the law is `inner`.
  static Real Rate(const Params&, const Coefficients&, Real /*z*/, Real /*r*/, Real /*x*/, Real /*v*/, double /*dt*/) { return 0; }
  // What ranges alone do not check: false and one line.
  static bool Check(const Params&, char* /*error*/, int /*size*/) { return true; }
};

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_COEFFICIENTS_H_

// Coefficients of a law at one field and one temperature.
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

inline Real Either(Real given, Real own) { return Select(isnan(given), own, given); }

// turned: the velocity by which the direction counts, where it is not v.
inline Coefficients Evaluate(const Params& p, Law law, const Fluid& f, Real v, Real turned = kUnset) {
  Coefficients k{};
  const Real b = f.b;
  const Real thin = Thinning(p, v), thin_series = 1 + p.shear_thinning_series * (thin - 1);
  k.c0 = Follow(p.c0a, p.c0b, p.c0c, p.c0e, p.c0r, b) * f.viscosity * thin;
  switch (law) {
    case Law::kBingham:
      k.yield = Follow(p.fya, p.fyb, p.fyc, p.fye, p.fyr, b) * f.yield;
      break;
    case Law::kHyperbolicTangent:
      k.c1 = Follow(p.c1a, p.c1b, p.c1c, p.c1e, p.c1r, b) * f.viscosity * thin_series;
      k.yield = Follow(p.f0a, p.f0b, p.f0c, p.f0e, p.f0r, b) * f.yield;
      k.k0 = Follow(p.k0a, p.k0b, p.k0c, p.k0e, p.k0r, b);
      k.k1 = Follow(p.k1a, p.k1b, p.k1c, p.k1e, p.k1r, b);
      break;
    default:
      if (law == Law::kModifiedBoucWen) k.c1 = Follow(p.c1a, p.c1b, p.c1c, p.c1e, p.c1r, b) * f.viscosity * thin_series;
      k.yield = Follow(p.alpha_a, p.alpha_b, p.alpha_c, p.alpha_e, p.alpha_r, b) * f.yield;
      k.k0 = p.k0;
      k.k1 = p.k1;
      k.gamma = p.gamma;
      k.beta = p.beta;
      if (Head(p.hysteresis_rate) != 0) {
        const Real fall = p.hysteresis_floor + (1 - p.hysteresis_floor) * exp(-p.hysteresis_rate * max(b, 0.0));
        k.gamma *= fall;
        k.beta *= fall;
      }
  }
  if (Head(p.asymmetry_yield) != 0 || Head(p.asymmetry_viscous) != 0) {
    const Real side = tanh(Either(turned, v) / p.asymmetry_width);
    k.yield *= 1 + p.asymmetry_yield * side;
    k.c0 *= 1 + p.asymmetry_viscous * side;
  }
  return k;
}

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_COEFFICIENTS_H_

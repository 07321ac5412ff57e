// Coefficients of a law at one field and one temperature.
#ifndef MRDAMP_LAWS_COEFFICIENTS_H_
#define MRDAMP_LAWS_COEFFICIENTS_H_

#include <algorithm>
#include <cmath>

#include "core/params.h"

namespace mrdamp {

// Present state of the fluid: the field variable b, and the factors by which heat lowers viscosity and yield force.
struct Fluid {
  double b = 0;
  double viscosity = 1;
  double yield = 1;
};

// Force of a law: the fluid's part, on which the fluid effects act, and the parallel spring's.
struct LawForce {
  double fluid = 0;
  double spring = 0;
  double slope = 0;  // N s/m, d(fluid)/dv at fixed inner state
};

struct Coefficients {
  double c0, c1;                // N s/m
  double yield;                 // fy, alpha or f0
  double k0, k1;                // N/m
  double gamma, beta;           // with their decrease at a large field
};

// p(b) = a + slope b + c b^2 + e (1 - exp(-r b)), never below zero: outside the range of its fit a line may cross
// zero, and a negative viscosity would supply energy.
inline double Follow(double a, double slope, double c, double e, double r, double b) {
  double p = a + b * (slope + c * b);
  if (e != 0) p += e * (1 - std::exp(-r * std::max(b, 0.0)));  // a saturating part is constant below zero
  return std::max(p, 0.0);
}

// Power-law thinning of the post-yield viscosity: (1 + |v / v_s|^a)^((m - 1) / a) (Carreau 1972 at a = 2; Yasuda,
// Armstrong, Cohen 1981, doi:10.1007/BF01513059; Cross 1965 at a = 1 - m), without a high-shear plateau.
inline double Thinning(const Params& p, double v) {
  if (p.shear_thinning_m == 1) return 1;
  const double s = std::fabs(v) / p.shear_thinning_v_s, a = p.shear_thinning_shape;
  return std::pow(1 + (a == 2 ? s * s : std::pow(s, a)), (p.shear_thinning_m - 1) / a);
}

// Least velocity (m/s) over which they change with the velocity; infinite if they do not.
inline double VelocityWidth(const Params& p) {
  const double thin = p.shear_thinning_m == 1 ? kInf : p.shear_thinning_v_s;
  return p.asymmetry_yield != 0 || p.asymmetry_viscous != 0 ? std::min(thin, p.asymmetry_width) : thin;
}

// turned: the velocity by which the direction counts, where it is not v.
inline Coefficients Evaluate(const Params& p, Law law, const Fluid& f, double v, double turned = kUnset) {
  Coefficients k{};
  const double b = f.b;
  const double thin = Thinning(p, v), thin_series = 1 + p.shear_thinning_series * (thin - 1);
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
      if (p.hysteresis_rate != 0) {
        const double fall = p.hysteresis_floor + (1 - p.hysteresis_floor) * std::exp(-p.hysteresis_rate * std::max(b, 0.0));
        k.gamma *= fall;
        k.beta *= fall;
      }
  }
  if (p.asymmetry_yield != 0 || p.asymmetry_viscous != 0) {
    const double side = std::tanh((std::isnan(turned) ? v : turned) / p.asymmetry_width);
    k.yield *= 1 + p.asymmetry_yield * side;
    k.c0 *= 1 + p.asymmetry_viscous * side;
  }
  return k;
}

}  // namespace mrdamp

#endif  // MRDAMP_LAWS_COEFFICIENTS_H_

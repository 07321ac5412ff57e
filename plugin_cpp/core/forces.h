// Forces of a chain at one instant, from its state and the piston's motion.
#ifndef MRDAMP_CORE_FORCES_H_
#define MRDAMP_CORE_FORCES_H_

#include <algorithm>
#include <cmath>

#include "core/chain.h"
#include "effects/mechanics.h"
#include "laws/bingham.h"
#include "laws/bouc_wen.h"
#include "laws/hyperbolic_tangent.h"
#include "laws/modified_bouc_wen.h"

namespace mrdamp {

inline Fluid FluidAt(const Damper& d, const ChainState& c, double field) {
  Fluid f;
  f.b = field;
  if (d.p.heating_kappa != 0) f.viscosity = Thinned(d.p, c.heat);
  if (d.p.heating_kappa_yield != 0) f.yield = std::exp(-d.p.heating_kappa_yield * c.heat);
  return f;
}

inline double FieldNow(const Damper& d, const ChainState& c) { return FieldOf(d.p, d.Acting(c.coil.current), c.magnet.branch); }

inline LawForce ForceOfLaw(const Damper& d, const State& s, double field, double x, double v) {
  const ChainState& c = s.c;
  if (d.law == Law::kNarx) {
    const double now = c.time / d.net->sample_time - s.past->count;
    // Rounding must not move a grid sample into the next interval, nor the start before the first one.
    const double part = now < 1e-9 ? 0 : std::min(now, 1.0);
    const double yield = d.p.heating_kappa_yield != 0 ? std::exp(-d.p.heating_kappa_yield * c.heat) : 1;
    return {yield * Narx::Force(*d.net, *s.past, part, x, v, field), 0, 0};
  }
  const Coefficients k = Evaluate(d.p, d.law, FluidAt(d, c, field), v);
  switch (d.law) {
    case Law::kBingham: return Bingham::Force(d.p, k, v);
    case Law::kBoucWen: return BoucWen::Force(d.p, k, c.z, x, v);
    case Law::kHyperbolicTangent: return HyperbolicTangent::Force(d.p, k, c.z, c.r, x, v);
    default: return ModifiedBoucWen::Force(d.p, k, c.z, c.r, x, v);
  }
}

// Force of the fluid alone, moving at v, before any gas; the law's spring at the piston's x is returned in `spring`.
inline double FlowForce(const Damper& d, const State& s, double field, double x, double v, double* slope, double* spring) {
  const Params& p = d.p;
  LawForce f = ForceOfLaw(d, s, field, x, v);
  double rate = 1;
  if (p.asymmetry_travel > 0 || HasTimedPlate(p)) {
    rate = 1 + p.asymmetry_a * s.c.plate;
    f.fluid *= rate;
  } else if (p.asymmetry_force > 0 && p.asymmetry_a != 0) {
    f.fluid = AsymmetryByForce(p, f.fluid, &rate);
  } else {
    rate = Asymmetry(p, v);
    f.fluid *= rate;
  }
  *slope = rate * f.slope;
  *spring = f.spring;
  return f.fluid;
}

// The same with the effect of gas.
inline double FluidForce(const Damper& d, const State& s, double field, double x, double v, double* slope, double* spring) {
  const Params& p = d.p;
  double force = FlowForce(d, s, field, x, v, slope, spring);
  if (HasSecantPocket(p)) {
    if (CarriedByGas(p, force)) *slope = 0;
    return ThroughSecantPocket(p, s.c.gas, force);
  }
  if (!HasTrappedGas(p)) return force;
  Stroke stroke = s.c.stroke;
  stroke.Follow(x, p);
  if (p.trapped_gas_force > 0) {
    double limited;
    force = LimitedByGas(p, stroke, force, &limited);
    *slope *= limited;
    return force;
  }
  const double factor = TrappedGas(p, stroke, x, v);
  *slope *= factor;
  return factor * force;
}

// Force of damper and mechanics on the piston side of the mount, without inertia.
inline double PistonForce(const Damper& d, const State& s, double field, double x, double v, double* slope) {
  const Params& p = d.p;
  double spring, fluid = FluidForce(d, s, field, x, v, slope, &spring);
  if (HasPocket(p)) {
    // Compressed gas carries its own force at any velocity; at its stop it carries none.
    const double side = p.trapped_gas_direction;
    if (s.c.gas.stretch != 0 || !(fluid * side < 0)) {
      fluid = PocketForce(p, s.c.gas.stretch);
      *slope = 0;
    }
  }
  double force = fluid + spring + GasSpring(p, x);
  if (p.seal_friction_coulomb > 0 && p.seal_friction_width > 0) {
    double own;
    force += SealFriction::Slip(SealLimit(p, v), p.seal_friction_width, v, &own);
    *slope += own;
  } else if (p.seal_friction_coulomb > 0) {
    force += SealSigma(p) * s.c.bristle;
  }
  return force;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_FORCES_H_

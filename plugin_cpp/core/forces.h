// Forces of a chain at one instant, from its state and the piston's motion.
#ifndef MRDAMP_CORE_FORCES_H_
#define MRDAMP_CORE_FORCES_H_

#include <algorithm>

#include "core/chain.h"
#include "effects/mechanics.h"
#include "laws/law.h"

namespace mrdamp {

inline Fluid FluidAt(const Damper& d, const ChainState& c, Real field) {
  Fluid f;
  f.b = field;
  if (Head(d.p.heating_kappa) != 0) f.viscosity = Thinned(d.p, c.heat);
  if (Head(d.p.heating_kappa_yield) != 0) f.yield = exp(-d.p.heating_kappa_yield * c.heat);
  return f;
}

inline Real FieldNow(const Damper& d, const ChainState& c) { return FieldOf(d.p, d.Acting(c.coil.current), c.magnet.branch); }

// Velocities of what falls with the velocity, where they are not the fluid's own: in a balance that is solved for that,
// there would be more than one solution.
struct Pace {
  Real turned = kUnset;  // by which the direction counts
  Real slip = kUnset;    // of a seal's friction
};

inline LawForce ForceOfLaw(const Damper& d, const State& s, Real field, Real x, Real v, Pace pace = {}) {
  const ChainState& c = s.c;
  const Params& p = d.p;
  if (d.law == Law::kNarx) {
    const double now = Head(c.time) / d.net->sample_time - s.past->count;
    // Rounding must not move a grid sample into the next interval, nor the start before the first one.
    const double part = now < 1e-9 ? 0 : min(now, 1.0);
    return {FluidAt(d, c, field).yield * Narx::Force(*d.net, *s.past, part, Head(x), Head(v), Head(field)), 0, 0};
  }
  const Fluid fluid = FluidAt(d, c, field);
  const auto force = [&](Real at) {
    const Coefficients k = Evaluate(p, d.law, fluid, at, pace.turned);
    return OfLaw(d.law, [&](auto law) { return law.Force(p, k, c.z, c.r, x, at); });
  };
  LawForce f = force(v);
  // Coefficients that change with the velocity have a share in the slope.
  const Real width = VelocityWidth(p);
  if (Head(width) < kInf) {
    const Real dv = 1e-6 * (fabs(v) + width);
    f.slope = (force(v + dv).fluid - f.fluid) / dv;
  }
  return f;
}

// Force of the fluid alone, moving at v; the law's spring at the piston's x is returned in `spring`.
inline Real FluidForce(const Damper& d, const State& s, Real field, Real x, Real v, Real* slope, Real* spring,
                         Pace pace = {}) {
  LawForce f = ForceOfLaw(d, s, field, x, v, pace);
  ActOnFluid(d.p, s.c.stroke, s.c.plate, x, v, pace.turned, &f.fluid, &f.slope);
  *spring = f.spring;
  *slope = f.slope;
  return f.fluid;
}

// Force of damper and mechanics on the piston side of the mount, without inertia.
inline Real PistonForce(const Damper& d, const State& s, Real field, Real x, Real v, Real* slope,
                          Pace pace = {}) {
  const Params& p = d.p;
  Real spring, fluid = FluidForce(d, s, field, x, v, slope, &spring, pace);
  if (HasPocket(p)) {
    // Compressed gas carries its own force at any velocity; at its stop it carries none.
    const Real side = p.trapped_gas_direction;
    const Mask gas = s.c.gas.stretch != 0 || !(fluid * side < 0);
    fluid = Select(gas, PocketForce(p, s.c.gas.stretch), fluid);
    *slope = Select(gas, 0, *slope);
  }
  Real force = fluid + spring;
  s.c.mechanics.Act(p, x, v, Either(pace.slip, v), &force, slope);
  return force;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_FORCES_H_

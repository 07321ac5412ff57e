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

// Velocities of what falls with the velocity, where they are not the fluid's own: in a balance that is solved for that,
// there would be more than one solution.
struct Pace {
  double turned = kUnset;  // by which the direction counts
  double slip = kUnset;    // of a seal's friction
};

inline double Either(double given, double own) { return std::isnan(given) ? own : given; }

inline LawForce ForceOfLaw(const Damper& d, const State& s, double field, double x, double v, Pace pace = {}) {
  const ChainState& c = s.c;
  const Params& p = d.p;
  if (d.law == Law::kNarx) {
    const double now = c.time / d.net->sample_time - s.past->count;
    // Rounding must not move a grid sample into the next interval, nor the start before the first one.
    const double part = now < 1e-9 ? 0 : std::min(now, 1.0);
    const double yield = p.heating_kappa_yield != 0 ? std::exp(-p.heating_kappa_yield * c.heat) : 1;
    return {yield * Narx::Force(*d.net, *s.past, part, x, v, field), 0, 0};
  }
  const Fluid fluid = FluidAt(d, c, field);
  const auto force = [&](double at) {
    const Coefficients k = Evaluate(p, d.law, fluid, at, pace.turned);
    switch (d.law) {
      case Law::kBingham: return Bingham::Force(p, k, at);
      case Law::kBoucWen: return BoucWen::Force(p, k, c.z, x, at);
      case Law::kHyperbolicTangent: return HyperbolicTangent::Force(p, k, c.z, c.r, x, at);
      default: return ModifiedBoucWen::Force(p, k, c.z, c.r, x, at);
    }
  };
  LawForce f = force(v);
  // Coefficients that change with the velocity have a share in the slope.
  const double width = VelocityWidth(p);
  if (width < kInf) {
    const double dv = 1e-6 * (std::fabs(v) + width);
    f.slope = (force(v + dv).fluid - f.fluid) / dv;
  }
  return f;
}

// Force of the fluid alone, moving at v, before any gas; the law's spring at the piston's x is returned in `spring`.
inline double FlowForce(const Damper& d, const State& s, double field, double x, double v, double* slope, double* spring,
                        Pace pace) {
  const Params& p = d.p;
  const LawForce f = ForceOfLaw(d, s, field, x, v, pace);
  *spring = f.spring;
  if (p.asymmetry_travel > 0 || HasTimedPlate(p)) {
    const double factor = 1 + p.asymmetry_a * s.c.plate;
    *slope = factor * f.slope;
    return factor * f.fluid;
  }
  double rate;
  if (p.asymmetry_force > 0 && p.asymmetry_a != 0) {
    const double force = AsymmetryByForce(p, f.fluid, &rate);
    *slope = rate * f.slope;
    return force;
  }
  const double factor = Asymmetry(p, Either(pace.turned, v), &rate);
  *slope = factor * f.slope + (std::isnan(pace.turned) ? rate * f.fluid : 0);
  return factor * f.fluid;
}

// The same with the effect of gas.
inline double FluidForce(const Damper& d, const State& s, double field, double x, double v, double* slope, double* spring,
                         Pace pace = {}) {
  const Params& p = d.p;
  double force = FlowForce(d, s, field, x, v, slope, spring, pace);
  if (!HasTrappedGas(p)) return force;
  Stroke stroke = s.c.stroke;
  stroke.Follow(x, p);
  if (p.trapped_gas_force > 0) {
    double limited;
    force = LimitedByGas(p, stroke, force, &limited);
    *slope *= limited;
    return force;
  }
  const double factor = TrappedGas(p, stroke, x, Either(pace.turned, v));
  *slope *= factor;
  return factor * force;
}

// Force of damper and mechanics on the piston side of the mount, without inertia.
inline double PistonForce(const Damper& d, const State& s, double field, double x, double v, double* slope,
                          Pace pace = {}) {
  const Params& p = d.p;
  double spring, fluid = FluidForce(d, s, field, x, v, slope, &spring, pace);
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
    force += SealFriction::Slip(SealLimit(p, Either(pace.slip, v)), p.seal_friction_width, v, &own);
    *slope += own;
  } else if (p.seal_friction_coulomb > 0) {
    force += SealSigma(p) * s.c.bristle;
  }
  return force;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_FORCES_H_

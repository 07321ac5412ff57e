// Stage `mechanics`: forces parallel to the fluid's. A rigid moving mass is added where the acceleration is known.
#ifndef MRDAMP_EFFECTS_MECHANICS_H_
#define MRDAMP_EFFECTS_MECHANICS_H_


#include "core/params.h"
#include "effects/oscillator.h"

namespace mrdamp {

// gas_spring: k x (1 + k2 x + k3 x^2) + F0
inline Real GasSpring(const Params& p, Real x) {
  return p.gas_spring_k * x * (1 + (p.gas_spring_k2 + p.gas_spring_k3 * x) * x) + p.gas_spring_f0;
}

// moving_mass: part that moves rigidly with the rod (kg).
inline Real RigidMass(const Params& p) {
  return Head(p.moving_mass_hz) > 0 ? p.moving_mass_m * (1 - p.moving_mass_share) : p.moving_mass_m;
}

// Parts of it that move with the piston behind a mount and with the rod's end; without a mount they are one.
inline Real PistonMass(const Params& p) { return Head(p.moving_mass_beyond) > 0 ? 0 : RigidMass(p); }
inline Real RodMass(const Params& p, bool mount) { return mount && !(Head(p.moving_mass_beyond) > 0) ? 0 : RigidMass(p); }

// Accelerations (m/s2) of sprung masses' supports.
struct SprungMasses {
  Oscillator first, second;
};

inline bool HasRinging(const Params& p) { return Head(p.moving_mass_hz) > 0 || Head(p.moving_mass_hz2) > 0; }

// Update by the rod's acceleration a (m/s2) over dt.
inline void Ring(const Params& p, SprungMasses* sprung, Real a, double dt) {
  if (Head(p.moving_mass_hz) > 0) sprung->first.Step(2 * kPi * p.moving_mass_hz, p.moving_mass_ratio, a, a, dt);
  if (Head(p.moving_mass_hz2) > 0) sprung->second.Step(2 * kPi * p.moving_mass_hz2, p.moving_mass_ratio, a, a, dt);
}

// Force (N) of masses on springs and dashpots, from these accelerations.
inline Real RingingForce(const Params& p, const SprungMasses& sprung) {
  if (!(Head(p.moving_mass_hz) > 0)) return 0;
  const Real lag = p.moving_mass_ratio / kPi, first = sprung.first.y + lag / p.moving_mass_hz * sprung.first.rate;
  if (!(Head(p.moving_mass_hz2) > 0)) return p.moving_mass_m * p.moving_mass_share * first;
  const Real second = sprung.second.y + lag / p.moving_mass_hz2 * sprung.second.rate;
  return p.moving_mass_m * p.moving_mass_share * (first + p.moving_mass_share2 * (second - first));
}

// seal_friction: a bristle q (m) that follows the path, q' = v - |v| q sigma / g(v), with
// g = coulomb (1 + (breakaway - 1) exp(-(v / v_s)^2)) and sigma = coulomb breakaway / presliding
// (Canudas de Wit et al. 1995, doi:10.1109/9.376053, without its damping terms). Exact for a constant velocity.
struct SealFriction {
  static Real Limit(Real coulomb, Real breakaway, Real v_s, Real v) {
    if (Head(breakaway) == 1) return coulomb;
    const Real s = v / v_s;
    return coulomb * (1 + (breakaway - 1) * exp(-s * s));
  }
  static Real Follow(Real q, Real dx, Real limit, Real sigma) {
    const Real rest = Select(dx > 0, limit, -limit) / sigma;
    return Select(dx == 0, q, rest + (q - rest) * exp(-fabs(dx) * sigma / limit));
  }
  // Without presliding: smoothed over a small velocity. Its derivative in `slope`.
  static Real Slip(Real limit, Real width, Real v, Real* slope) {
    const Real t = tanh(v / width);
    *slope = limit / width * (1 - t * t);
    return limit * t;
  }
};

inline bool HasSeal(const Params& p) { return Head(p.seal_friction_coulomb) > 0; }

inline Real SealLimit(const Params& p, Real v) {
  return SealFriction::Limit(p.seal_friction_coulomb, p.seal_friction_breakaway, p.seal_friction_v_s, v);
}

inline Real SealSigma(const Params& p) { return p.seal_friction_coulomb * p.seal_friction_breakaway / p.seal_friction_presliding; }

// What the chain calls of this stage, with its state. slip: the velocity by which friction falls.
struct Mechanics {
  Real bristle = 0;  // m, seal friction

  void Follow(const Params& p, Real path, Real slip) {
    if (HasSeal(p)) bristle = SealFriction::Follow(bristle, path, SealLimit(p, slip), SealSigma(p));
  }

  // Adds the forces at displacement x and velocity v, and their slope (N s/m).
  void Act(const Params& p, Real x, Real v, Real slip, Real* force, Real* slope) const {
    *force += GasSpring(p, x);
    if (HasSeal(p) && Head(p.seal_friction_width) > 0) {
      Real own;
      *force += SealFriction::Slip(SealLimit(p, slip), p.seal_friction_width, v, &own);
      *slope += own;
    } else if (HasSeal(p)) {
      *force += SealSigma(p) * bristle;
    }
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MECHANICS_H_

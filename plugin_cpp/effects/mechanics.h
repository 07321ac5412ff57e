// Stage `mechanics`: forces parallel to the fluid's. A rigid moving mass is added where the acceleration is known.
#ifndef MRDAMP_EFFECTS_MECHANICS_H_
#define MRDAMP_EFFECTS_MECHANICS_H_

#include <cmath>

#include "core/params.h"
#include "effects/oscillator.h"

namespace mrdamp {

// gas_spring: k x (1 + k2 x + k3 x^2) + F0
inline double GasSpring(const Params& p, double x) {
  return p.gas_spring_k * x * (1 + (p.gas_spring_k2 + p.gas_spring_k3 * x) * x) + p.gas_spring_f0;
}

// moving_mass: part that moves rigidly with the rod (kg).
inline double RigidMass(const Params& p) {
  return p.moving_mass_hz > 0 ? p.moving_mass_m * (1 - p.moving_mass_share) : p.moving_mass_m;
}

// Parts of it that move with the piston behind a mount and with the rod's end; without a mount they are one.
inline double PistonMass(const Params& p) { return p.moving_mass_beyond > 0 ? 0 : RigidMass(p); }
inline double RodMass(const Params& p, bool mount) { return mount && !(p.moving_mass_beyond > 0) ? 0 : RigidMass(p); }

// Accelerations (m/s2) of sprung masses' supports.
struct Felt {
  Oscillator first, second;
};

// Update by the rod's acceleration a (m/s2) over dt.
inline void Ring(const Params& p, Felt* felt, double a, double dt) {
  if (p.moving_mass_hz > 0) felt->first.Step(2 * kPi * p.moving_mass_hz, p.moving_mass_ratio, a, a, dt);
  if (p.moving_mass_hz2 > 0) felt->second.Step(2 * kPi * p.moving_mass_hz2, p.moving_mass_ratio, a, a, dt);
}

// Force (N) of masses on springs and dashpots, from these accelerations.
inline double RingingForce(const Params& p, const Felt& felt) {
  if (!(p.moving_mass_hz > 0)) return 0;
  const double lag = p.moving_mass_ratio / kPi, first = felt.first.y + lag / p.moving_mass_hz * felt.first.rate;
  if (!(p.moving_mass_hz2 > 0)) return p.moving_mass_m * p.moving_mass_share * first;
  const double second = felt.second.y + lag / p.moving_mass_hz2 * felt.second.rate;
  return p.moving_mass_m * p.moving_mass_share * (first + p.moving_mass_share2 * (second - first));
}

// seal_friction: a bristle q (m) that follows the path, q' = v - |v| q sigma / g(v), with
// g = coulomb (1 + (breakaway - 1) exp(-(v / v_s)^2)) and sigma = coulomb breakaway / presliding
// (Canudas de Wit et al. 1995, doi:10.1109/9.376053, without its damping terms). Exact for a constant velocity.
struct SealFriction {
  static double Limit(double coulomb, double breakaway, double v_s, double v) {
    if (breakaway == 1) return coulomb;
    const double s = v / v_s;
    return coulomb * (1 + (breakaway - 1) * std::exp(-s * s));
  }
  static double Follow(double q, double dx, double limit, double sigma) {
    if (dx == 0) return q;
    const double rest = (dx > 0 ? limit : -limit) / sigma;
    return rest + (q - rest) * std::exp(-std::fabs(dx) * sigma / limit);
  }
  // Without presliding: smoothed over a small velocity. Its derivative in `slope`.
  static double Slip(double limit, double width, double v, double* slope) {
    const double t = std::tanh(v / width);
    *slope = limit / width * (1 - t * t);
    return limit * t;
  }
};

inline double SealLimit(const Params& p, double v) {
  return SealFriction::Limit(p.seal_friction_coulomb, p.seal_friction_breakaway, p.seal_friction_v_s, v);
}

inline double SealSigma(const Params& p) { return p.seal_friction_coulomb * p.seal_friction_breakaway / p.seal_friction_presliding; }

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MECHANICS_H_

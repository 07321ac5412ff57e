// Stage `fluid`: effects on the fluid's part of the force.
#ifndef MRDAMP_EFFECTS_FLUID_H_
#define MRDAMP_EFFECTS_FLUID_H_

#include <cmath>

#include "core/params.h"
#include "effects/driver.h"

namespace mrdamp {

// C T' = power - H T over dt, exact for a constant power (W).
inline double Warm(double rise, double power, double capacity, double loss, double dt) {
  if (!(loss > 0)) return rise + power * dt / capacity;
  const double rest = power / loss;
  return rest + (rise - rest) * std::exp(-loss / capacity * dt);
}

// heating of the fluid and, optionally, of the housing (K both).
struct Rise {
  double fluid, body;
};
inline Rise Heat(const Params& p, Rise r, double power, double dt) {
  if (!(p.heating_link > 0)) return {Warm(r.fluid, power, p.heating_capacity, p.heating_loss, dt), r.body};
  const double flow = p.heating_link * (r.fluid - r.body);
  return {Warm(r.fluid, power + p.heating_link * r.body, p.heating_capacity, p.heating_link, dt),
          Warm(r.body, flow, p.heating_body, p.heating_loss, dt)};
}

// Remaining share of the viscosity.
inline double Thinned(const Params& p, double rise) {
  if (!(p.heating_shape > 0)) return std::exp(-p.heating_kappa * rise);
  return std::pow(std::fmax(1 + p.heating_kappa * rise / p.heating_shape, 1e-3), -p.heating_shape);
}

// asymmetry: 1 + a sgn v, smoothed over a small velocity so that the force has no jump.
// Its derivative in `rate`.
inline double Asymmetry(const Params& p, double v, double* rate) {
  const double t = p.asymmetry_a == 0 ? 0 : std::tanh(v / p.asymmetry_width);
  *rate = p.asymmetry_a * (1 - t * t) / p.asymmetry_width;
  return 1 + p.asymmetry_a * t;
}

// The same with the sign of the force f; its derivative df'/df in `rate`.
inline double AsymmetryByForce(const Params& p, double f, double* rate) {
  const double q = f / p.asymmetry_force, t = std::tanh(q);
  *rate = 1 + p.asymmetry_a * (t + q * (1 - t * t));
  return f * (1 + p.asymmetry_a * t);
}

// asymmetry_travel: a plate that moves with the stroke from one stop (-1) to the other (1).
inline double FollowPlate(const Params& p, double plate, double path) {
  return std::fmin(std::fmax(plate + 2 * path / p.asymmetry_travel, -1), 1);
}

// asymmetry_time: a plate moved by pressure or flow against its spring and the fluid, first order.
inline bool HasTimedPlate(const Params& p) {
  return p.asymmetry_time > 0 && !(p.asymmetry_travel > 0) && p.asymmetry_a != 0;
}

// Equilibrium of the plate (-1 to 1) at the fluid's force f and velocity v.
inline double PlateRest(const Params& p, double f, double v) {
  return std::tanh(p.asymmetry_force > 0 ? f / p.asymmetry_force : v / p.asymmetry_width);
}

// Gas in series with the fluid, which then moves less than the piston.
inline bool HasPocket(const Params& p) { return p.trapped_gas_series > 0 && p.trapped_gas_force > 0; }

inline bool HasTrappedGas(const Params& p) { return p.trapped_gas_d != 0 || (p.trapped_gas_force > 0 && !HasPocket(p)); }

// Stroke over which a pocket is compressed completely; 0 if it opens at every turn.
inline double PocketReach(const Params& p) {
  if (p.trapped_gas_reach > 0) return p.trapped_gas_reach;
  return p.trapped_gas_time > 0 || p.trapped_gas_force > 0 ? p.trapped_gas_s_g : 0;
}

// trapped_gas: the stroke since the last turn. A turn counts after a minimum reversal, so that noise of a measured
// displacement causes none.
struct Stroke {
  double extreme = 0;    // m: furthest point of this stroke
  double turn = 0;       // m: start of the stroke
  double direction = 0;  // +1 extension, -1 compression, 0 not yet moved
  double last = 0;       // m
  double pocket = 0;     // m of compression by extension, 0 to its reach

  // dt: time since `last`, in which a pocket with a time constant opens while it is not compressed.
  void Follow(double x, const Params& p, double dt = 0) {
    const double reach = PocketReach(p), back = p.trapped_gas_turn;
    const bool compressed = p.trapped_gas_direction < 0;
    if (p.trapped_gas_time > 0 && (compressed ? last - x : x - last) <= 0) {
      const double open = compressed ? reach : 0;
      pocket = open + (pocket - open) * std::exp(-dt / p.trapped_gas_time);
    } else {
      pocket = std::fmin(std::fmax(pocket + x - last, 0), reach);
    }
    last = x;
    if (direction == 0) {
      if (std::fabs(x - turn) > back) {
        direction = x > turn ? 1 : -1;
        extreme = x;
      }
    } else if ((x - extreme) * direction >= 0) {
      extreme = x;
    } else if ((extreme - x) * direction > back) {
      turn = extreme;
      extreme = x;
      direction = -direction;
    }
  }
};

// Remaining share of the force.
inline double TrappedGas(const Params& p, const Stroke& stroke, double x, double v) {
  const double reach = PocketReach(p);
  const bool by_velocity = reach > 0 && p.trapped_gas_width > 0;
  const double direction = by_velocity ? v : stroke.direction;
  if (p.trapped_gas_d == 0 || direction == 0) return 1;
  if (p.trapped_gas_direction != 0 && direction * p.trapped_gas_direction < 0) return 1;
  const double pressed = direction > 0 ? stroke.pocket : reach - stroke.pocket;
  const double s = (reach > 0 ? pressed : x - stroke.turn) / p.trapped_gas_s_g;
  const double power = p.trapped_gas_shape == 2 ? s * s : std::pow(std::fabs(s), p.trapped_gas_shape);
  const double moving = by_velocity ? std::tanh(std::fabs(v) / p.trapped_gas_width) : 1;
  return 1 - p.trapped_gas_d * moving * (p.trapped_gas_end > 0 ? std::fmax(1 - power, 0) : std::exp(-power));
}

// The fluid's force f with gas that carries at most its own pressure until it is compressed: polytropic, limit =
// force (1 - s)^-shape, with a smoothed minimum of the two. Its derivative in `rate`.
inline double LimitedByGas(const Params& p, const Stroke& stroke, double f, double* rate) {
  *rate = 1;
  if (f * p.trapped_gas_direction < 0) return f;
  const double pressed = f > 0 ? stroke.pocket : PocketReach(p) - stroke.pocket;
  const double left = 1 - pressed / p.trapped_gas_s_g;
  if (!(left > 0)) return f;
  const double q = f / p.trapped_gas_force * std::pow(left, p.trapped_gas_shape);
  const double share = std::pow(1 + q * q * q * q, -0.25);
  *rate = share / (1 + q * q * q * q);
  return share * f;
}

// A pocket in series: gas at rest at the accumulator's pressure, force = pressure times area. Compression by q gives
// f = force ((1 - q / s_g)^-shape - 1), polytropic, equal to the fluid's force. In the other direction it is at its
// stop. Returns the lead of the piston over the fluid at the fluid's force f.
inline double PocketStretch(const Params& p, double f) {
  if (f * p.trapped_gas_direction < 0) return 0;
  const double q = -p.trapped_gas_s_g * std::expm1(-std::log1p(std::fabs(f) / p.trapped_gas_force) / p.trapped_gas_shape);
  return f < 0 ? -q : q;
}

// Force of the gas at a compression `stretch`.
inline double PocketForce(const Params& p, double stretch) {
  const double share = std::fmin(std::fabs(stretch) / p.trapped_gas_s_g, 1 - 1e-12);
  const double f = p.trapped_gas_force * std::expm1(-p.trapped_gas_shape * std::log1p(-share));
  return stretch < 0 ? -f : f;
}

// Its compliance (m/N) there.
inline double PocketGive(const Params& p, double stretch) {
  const double left = std::fmax(1 - std::fabs(stretch) / p.trapped_gas_s_g, 1e-12);
  return p.trapped_gas_s_g / (p.trapped_gas_shape * p.trapped_gas_force) * std::pow(left, p.trapped_gas_shape + 1);
}

// Share of the rate that the fluid lacks: all of it while the piston compresses the gas; on the way back the gas is
// refilled from behind the piston. Smoothed over a small velocity.
inline double PocketShare(const Params& p, double v) {
  return p.trapped_gas_direction == 0 ? 1 : 0.5 * (1 + std::tanh(v * p.trapped_gas_direction / std::fmax(p.trapped_gas_width, 1e-6)));
}

struct Pocket {
  double stretch = 0;  // m of compression, with the sign of the force
  double rate = 0;     // m/s
  double flow = 0;     // m/s, velocity of the fluid
  double slope = 0;    // N s/m, d(force)/dv of the fluid at the last balance, start of the next solve
};

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_FLUID_H_

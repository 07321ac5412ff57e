// Stage `fluid`: effects on the fluid's part of the force.
#ifndef MRDAMP_EFFECTS_FLUID_H_
#define MRDAMP_EFFECTS_FLUID_H_


#include "core/params.h"
#include "effects/driver.h"

namespace mrdamp {

// C T' = power - H T over dt, exact for a constant power (W).
inline Real Warm(Real rise, Real power, Real capacity, Real loss, double dt) {
  if (!(Head(loss) > 0)) return rise + power * dt / capacity;
  const Real rest = power / loss;
  return rest + (rise - rest) * exp(-loss / capacity * dt);
}

// heating of the fluid and, optionally, of the housing (K both).
struct Rise {
  Real fluid, body;
};
inline Rise Heat(const Params& p, Rise r, Real power, double dt) {
  if (!(Head(p.heating_link) > 0)) return {Warm(r.fluid, power, p.heating_capacity, p.heating_loss, dt), r.body};
  const Real flow = p.heating_link * (r.fluid - r.body);
  return {Warm(r.fluid, power + p.heating_link * r.body, p.heating_capacity, p.heating_link, dt),
          Warm(r.body, flow, p.heating_body, p.heating_loss, dt)};
}

// Remaining share of the viscosity.
inline Real Thinned(const Params& p, Real rise) {
  if (!(Head(p.heating_shape) > 0)) return exp(-p.heating_kappa * rise);
  return pow(fmax(1 + p.heating_kappa * rise / p.heating_shape, 1e-3), -p.heating_shape);
}

// asymmetry: 1 + a sgn v, smoothed over a small velocity so that the force has no jump.
// Its derivative in `rate`.
inline Real Asymmetry(const Params& p, Real v, Real* rate) {
  const Real t = Head(p.asymmetry_a) == 0 ? 0 : tanh(v / p.asymmetry_width);
  *rate = p.asymmetry_a * (1 - t * t) / p.asymmetry_width;
  return 1 + p.asymmetry_a * t;
}

// The same with the sign of the force f; its derivative df'/df in `rate`.
inline Real AsymmetryByForce(const Params& p, Real f, Real* rate) {
  const Real q = f / p.asymmetry_force, t = tanh(q);
  *rate = 1 + p.asymmetry_a * (t + q * (1 - t * t));
  return f * (1 + p.asymmetry_a * t);
}

// asymmetry_travel: a plate that moves with the stroke from one stop (-1) to the other (1).
inline Real FollowPlate(const Params& p, Real plate, Real path) {
  return fmin(fmax(plate + 2 * path / p.asymmetry_travel, -1.0), 1.0);
}

// asymmetry_time: a plate moved by pressure or flow against its spring and the fluid, first order.
inline bool HasTimedPlate(const Params& p) {
  return Head(p.asymmetry_time) > 0 && !(Head(p.asymmetry_travel) > 0) && Head(p.asymmetry_a) != 0;
}

// Equilibrium of the plate (-1 to 1) at the fluid's force f and velocity v.
inline Real PlateRest(const Params& p, Real f, Real v) {
  return tanh(Head(p.asymmetry_force) > 0 ? f / p.asymmetry_force : v / p.asymmetry_width);
}

// Gas in series with the fluid, which then moves less than the piston.
inline bool HasPocket(const Params& p) { return Head(p.trapped_gas_series) > 0 && Head(p.trapped_gas_force) > 0; }

inline bool HasTrappedGas(const Params& p) { return Head(p.trapped_gas_d) != 0 || (Head(p.trapped_gas_force) > 0 && !HasPocket(p)); }

// Stroke over which a pocket is compressed completely; 0 if it opens at every turn.
inline Real PocketReach(const Params& p) {
  if (Head(p.trapped_gas_reach) > 0) return p.trapped_gas_reach;
  return Head(p.trapped_gas_time) > 0 || Head(p.trapped_gas_force) > 0 ? p.trapped_gas_s_g : 0;
}

// trapped_gas: the stroke since the last turn. A turn counts after a minimum reversal, so that noise of a measured
// displacement causes none.
struct Stroke {
  Real extreme = 0;    // m: furthest point of this stroke
  Real turn = 0;       // m: start of the stroke
  Real direction = 0;  // +1 extension, -1 compression, 0 not yet moved
  Real last = 0;       // m
  Real pocket = 0;     // m of compression by extension, 0 to its reach

  // dt: time since `last`, in which a pocket with a time constant opens while it is not compressed.
  void Follow(Real x, const Params& p, double dt = 0) {
    const Real reach = PocketReach(p), back = p.trapped_gas_turn;
    const Real pressed = fmin(fmax(pocket + x - last, 0.0), reach);
    if (Head(p.trapped_gas_time) > 0) {
      const bool compressed = Head(p.trapped_gas_direction) < 0;
      const Real open = compressed ? reach : 0;
      const Real eased = open + (pocket - open) * exp(-dt / p.trapped_gas_time);
      pocket = Select((compressed ? last - x : x - last) <= 0, eased, pressed);
    } else {
      pocket = pressed;
    }
    last = x;
    const Mask unmoved = direction == 0, begins = unmoved && fabs(x - turn) > back;
    const Mask onward = !unmoved && (x - extreme) * direction >= 0, turns = !unmoved && (extreme - x) * direction > back;
    turn = Select(turns, extreme, turn);
    extreme = Select(begins || onward || turns, x, extreme);
    direction = Select(begins, Select(x > turn, 1, -1), Select(turns, -direction, direction));
  }
};

// Remaining share of the force.
inline Real TrappedGas(const Params& p, const Stroke& stroke, Real x, Real v) {
  const Real reach = PocketReach(p);
  const bool by_stroke = Head(reach) > 0, by_velocity = by_stroke && Head(p.trapped_gas_width) > 0;
  const Real direction = by_velocity ? v : stroke.direction;
  if (Head(p.trapped_gas_d) == 0) return 1;
  const Mask whole = direction == 0 || direction * p.trapped_gas_direction < 0;
  if (All(whole)) return 1;
  const Real pressed = Select(direction > 0, stroke.pocket, reach - stroke.pocket);
  const Real s = (by_stroke ? pressed : x - stroke.turn) / p.trapped_gas_s_g;
  const Real power = Head(p.trapped_gas_shape) == 2 ? s * s : pow(fabs(s), p.trapped_gas_shape);
  const Real moving = by_velocity ? tanh(fabs(v) / p.trapped_gas_width) : 1;
  const Real lost = Head(p.trapped_gas_end) > 0 ? fmax(1 - power, 0.0) : exp(-power);
  return Select(whole, 1, 1 - p.trapped_gas_d * moving * lost);
}

// The fluid's force f with gas that carries at most its own pressure until it is compressed: polytropic, limit =
// force (1 - s)^-shape, with a smoothed minimum of the two. Its derivative in `rate`.
inline Real LimitedByGas(const Params& p, const Stroke& stroke, Real f, Real* rate) {
  const Real pressed = Select(f > 0, stroke.pocket, PocketReach(p) - stroke.pocket);
  const Real left = 1 - pressed / p.trapped_gas_s_g;
  const Mask whole = f * p.trapped_gas_direction < 0 || !(left > 0);
  const Real q = f / p.trapped_gas_force * pow(left, p.trapped_gas_shape), more = 1 + q * q * q * q;
  const Real share = Select(whole, 1, 1 / sqrt(sqrt(more)));
  *rate = Select(whole, 1, share / more);
  return share * f;
}

// A pocket in series: gas at rest at the accumulator's pressure, force = pressure times area. Compression by q gives
// f = force ((1 - q / s_g)^-shape - 1), polytropic, equal to the fluid's force. In the other direction it is at its
// stop. Returns the lead of the piston over the fluid at the fluid's force f.
inline Real PocketStretch(const Params& p, Real f) {
  const Real q = -p.trapped_gas_s_g * expm1(-log1p(fabs(f) / p.trapped_gas_force) / p.trapped_gas_shape);
  return Select(f * p.trapped_gas_direction < 0, 0, Select(f < 0, -q, q));
}

// Force of the gas at a compression `stretch`.
inline Real PocketForce(const Params& p, Real stretch) {
  const Real share = fmin(fabs(stretch) / p.trapped_gas_s_g, 1 - 1e-12);
  const Real f = p.trapped_gas_force * expm1(-p.trapped_gas_shape * log1p(-share));
  return Select(stretch < 0, -f, f);
}

// Its compliance (m/N) there.
inline Real PocketGive(const Params& p, Real stretch) {
  const Real left = fmax(1 - fabs(stretch) / p.trapped_gas_s_g, 1e-12);
  return p.trapped_gas_s_g / (p.trapped_gas_shape * p.trapped_gas_force) * pow(left, p.trapped_gas_shape + 1);
}

// Share of the rate that the fluid lacks: all of it while the piston compresses the gas; on the way back the gas is
// refilled from behind the piston. Smoothed over a small velocity.
inline Real PocketShare(const Params& p, Real v) {
  return Head(p.trapped_gas_direction) == 0 ? 1 : 0.5 * (1 + tanh(v * p.trapped_gas_direction / fmax(p.trapped_gas_width, 1e-6)));
}

struct GasPocket {
  Real stretch = 0;  // m of compression, with the sign of the force
  Real rate = 0;     // m/s
  Real flow = 0;     // m/s, velocity of the fluid
  Real slope = 0;    // N s/m, d(force)/dv of the fluid at the last balance, start of the next solve
};

// What the chain calls of this stage: the effects on the fluid's force and on its slope (N s/m) at x and v. turned: the
// velocity by which the direction counts, where it is not v.
inline void ActOnFluid(const Params& p, Stroke stroke, Real plate, Real x, Real v, Real turned, Real* force, Real* slope) {
  Real rate = 0;
  if (Head(p.asymmetry_travel) > 0 || HasTimedPlate(p)) {
    const Real factor = 1 + p.asymmetry_a * plate;
    *force *= factor;
    *slope *= factor;
  } else if (Head(p.asymmetry_force) > 0 && Head(p.asymmetry_a) != 0) {
    *force = AsymmetryByForce(p, *force, &rate);
    *slope *= rate;
  } else {
    const Real factor = Asymmetry(p, Either(turned, v), &rate);
    *slope = factor * *slope + Select(isnan(turned), rate * *force, 0);
    *force *= factor;
  }
  if (!HasTrappedGas(p)) return;
  stroke.Follow(x, p);
  if (Head(p.trapped_gas_force) > 0) {
    *force = LimitedByGas(p, stroke, *force, &rate);
    *slope *= rate;
  } else {
    const Real factor = TrappedGas(p, stroke, x, Either(turned, v));
    *force *= factor;
    *slope *= factor;
  }
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_FLUID_H_

// Stage `fluid`: what happens to the fluid's share of the force.
#ifndef MRDAMP_EFFECTS_FLUID_H_
#define MRDAMP_EFFECTS_FLUID_H_

#include <cmath>

#include "core/params.h"

namespace mrdamp {

// heating: C T' = power - H T over dt, exact for a constant power (W).
inline double Heat(const Params& p, double rise, double power, double dt) {
  if (!(p.heating_loss > 0)) return rise + power * dt / p.heating_capacity;
  const double rest = power / p.heating_loss;
  return rest + (rise - rest) * std::exp(-p.heating_loss / p.heating_capacity * dt);
}

// asymmetry: 1 + a sgn v, turned over a small velocity so that the force has no jump.
inline double Asymmetry(const Params& p, double v) {
  return p.asymmetry_a == 0 ? 1 : 1 + p.asymmetry_a * std::tanh(v / p.asymmetry_width);
}

// The same by the side that the force f pushes to; its derivative df'/df in `rate`.
inline double AsymmetryByForce(const Params& p, double f, double* rate) {
  const double q = f / p.asymmetry_force, t = std::tanh(q);
  *rate = 1 + p.asymmetry_a * (t + q * (1 - t * t));
  return f * (1 + p.asymmetry_a * t);
}

// trapped_gas: the stroke since the last turn. A turn counts from 10 um of way back, so that the noise of a
// measured displacement is none.
struct Stroke {
  double extreme = 0;    // m: furthest point of this stroke
  double turn = 0;       // m: where it began
  double direction = 0;  // +1 extension, -1 compression, 0 not yet moved
  double last = 0;       // m
  double pocket = 0;     // m that the gas is pressed together by extension, 0 to its reach

  void Follow(double x, double reach) {
    constexpr double kBack = 1e-5;
    pocket = std::fmin(std::fmax(pocket + x - last, 0), reach);
    last = x;
    if (direction == 0) {
      if (std::fabs(x - turn) > kBack) {
        direction = x > turn ? 1 : -1;
        extreme = x;
      }
    } else if ((x - extreme) * direction >= 0) {
      extreme = x;
    } else if ((extreme - x) * direction > kBack) {
      turn = extreme;
      extreme = x;
      direction = -direction;
    }
  }
};

inline double TrappedGas(const Params& p, const Stroke& stroke, double x) {
  if (p.trapped_gas_d == 0 || stroke.direction == 0) return 1;
  if (p.trapped_gas_direction != 0 && stroke.direction * p.trapped_gas_direction < 0) return 1;
  const double pressed = stroke.direction > 0 ? stroke.pocket : p.trapped_gas_reach - stroke.pocket;
  const double s = (p.trapped_gas_reach > 0 ? pressed : x - stroke.turn) / p.trapped_gas_s_g;
  const double power = p.trapped_gas_shape == 2 ? s * s : std::pow(std::fabs(s), p.trapped_gas_shape);
  return 1 - p.trapped_gas_d * std::exp(-power);
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_FLUID_H_

// A second-order oscillator: a mass on a spring, and a low-pass with a pair of complex poles.
#ifndef MRDAMP_EFFECTS_OSCILLATOR_H_
#define MRDAMP_EFFECTS_OSCILLATOR_H_

#include "core/real.h"

namespace mrdamp {

// y'' + 2 zeta w y' + w^2 y = w^2 x with 0 <= zeta < 1. Plain doubles.
struct Oscillator {
  Real y = 0, rate = 0;

  // Exact for an x that is linear from x0 to x1 in dt.
  void Step(Real w, Real zeta, Real x0, Real x1, double dt) {
    const Real slope = (x1 - x0) / dt, behind = 2 * zeta / w * slope;
    const Real e = y - (x0 - behind), f = rate - slope;  // deviation from the particular solution
    const Real decay = exp(-zeta * w * dt), wd = w * sqrt(1 - zeta * zeta);
    const Real c = decay * Each(std::cos, wd * dt), s = decay * Each(std::sin, wd * dt) / wd;
    y = x1 - behind + e * c + (f + zeta * w * e) * s;
    rate = slope + f * c - (zeta * w * f + w * w * e) * s;
  }
};

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_OSCILLATOR_H_

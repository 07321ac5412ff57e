// Stage `magnetics`: from the coil current to the field variable b of the law.
#ifndef MRDAMP_EFFECTS_MAGNETICS_H_
#define MRDAMP_EFFECTS_MAGNETICS_H_


#include "core/params.h"
#include "effects/driver.h"

namespace mrdamp {

// i_s tanh(i / i_s), or i / (1 + |i / i_s|^p)^(1/p).
inline Real SaturationCurve(const Params& p, Real i) {
  const Real q = i / p.saturation_i_s;
  if (Head(p.saturation_shape) == 0) return p.saturation_i_s * tanh(q);
  return i / pow(1 + pow(fabs(q), p.saturation_shape), 1 / p.saturation_shape);
}

// saturation: a curve with slope one at zero, or scaled so that it equals the current at `full`, where the law's
// coefficients were calibrated.
inline Real Saturate(const Params& p, Real i) {
  if (!(Head(p.saturation_i_s) > 0)) return i;
  const Real b = SaturationCurve(p, i);
  return Head(p.saturation_full) > 0 ? b * p.saturation_full / SaturationCurve(p, p.saturation_full) : b;
}

// Bound of the branch at the current i on the side of `sign`, approached from zero with increasing (1) or decreasing
// (-1) current.
inline Real Bound(const Params& p, Real i, Real sign) {
  const Real growth = Select(sign * i < 0, p.remanence_down, p.remanence_up);
  return fmax(1 + growth * fabs(i), 0);
}

// remanence: h' = (i' / D)(L(i) - sgn(i') h), a function of the path of i alone; exact if the bound L is linear.
inline Real Branch(const Params& p, Real h, Real from, Real to) {
  const Real sign = Select(to > from, 1, -1), way = to - from;
  const Real u0 = sign * Bound(p, from, sign), u1 = sign * Bound(p, to, sign);
  return Select(way == 0, h, Lag(h, u0, u1, p.remanence_d, fabs(way)));
}

// State of the hysteresis of a magnetic circuit. Plain doubles.
struct Magnet {
  static constexpr int kStops = 6;
  Real branch = 0;         // h
  Real stop[kStops] = {};  // in units of the current, for remanence_stops

  // At rest with the first command u.
  void Start(const Params& p, Real u) {
    const Real before = (1 - p.remanence_rise) * u;
    branch = p.remanence_start * Bound(p, before, p.remanence_start);
    for (int k = 0; k < kStops; k++) stop[k] = branch * Width(p, k);
    Follow(p, before, u);
  }
  // Along a path of the current. With stops (Prandtl and Ishlinskii) minor loops close; those of the equation do not.
  // From the demagnetised state both begin with the slope 1 / D.
  void Follow(const Params& p, Real from, Real to) {
    if (All(to == from)) return;
    const Mask crosses = from * to < 0 && (p.remanence_up != 0 || p.remanence_down != 0);
    if (Any(crosses)) {  // the bounds have a corner at zero
      Follow(p, from, Select(crosses, 0, from));
      from = Select(crosses, 0, from);
    }
    if (!(Head(p.remanence_stops) > 0)) {
      branch = Branch(p, branch, from, to);
      return;
    }
    const Mask still = to == from;
    Real sum = 0;
    for (int k = 0; k < kStops; k++) {
      const Real width = Width(p, k);
      stop[k] = Select(still, stop[k], fmin(fmax(stop[k] + to - from, -width * Bound(p, to, -1)), width * Bound(p, to, 1)));
      sum += stop[k] / (kStops * p.remanence_d);
    }
    branch = Select(still, branch, sum);
  }

 private:
  // Their mean is D.
  static Real Width(const Params& p, int k) { return p.remanence_d * 2 * (k + 1) / (kStops + 1); }
};

// Loops close towards saturation of the core, where the path has no influence.
inline Real FieldOf(const Params& p, Real i, Real h) {
  if (!(Head(p.remanence_b) > 0)) return Saturate(p, i);
  const Real q = i / p.remanence_knee, faded = Head(p.remanence_knee) > 0 ? h * exp(-q * q) : h;
  return Saturate(p, i - p.remanence_b * faded);
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MAGNETICS_H_

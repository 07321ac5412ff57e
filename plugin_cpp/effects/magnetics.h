// Stage `magnetics`: from the coil current to the field variable b of the law.
#ifndef MRDAMP_EFFECTS_MAGNETICS_H_
#define MRDAMP_EFFECTS_MAGNETICS_H_

#include <cmath>

#include "core/params.h"
#include "effects/driver.h"

namespace mrdamp {

// i_s tanh(i / i_s), or i / (1 + |i / i_s|^p)^(1/p).
inline double SaturationCurve(const Params& p, double i) {
  const double q = i / p.saturation_i_s;
  if (p.saturation_shape == 0) return p.saturation_i_s * std::tanh(q);
  return i / std::pow(1 + std::pow(std::fabs(q), p.saturation_shape), 1 / p.saturation_shape);
}

// saturation: a curve with slope one at zero, or scaled so that it equals the current at `full`, where the law's
// coefficients were calibrated.
inline double Saturate(const Params& p, double i) {
  if (!(p.saturation_i_s > 0)) return i;
  const double b = SaturationCurve(p, i);
  return p.saturation_full > 0 ? b * p.saturation_full / SaturationCurve(p, p.saturation_full) : b;
}

// Bound of the branch at the current i on the side of `sign`, approached from zero with increasing (1) or decreasing
// (-1) current.
inline double Bound(const Params& p, double i, double sign) {
  const double growth = sign * i < 0 ? p.remanence_down : p.remanence_up;
  return std::fmax(1 + growth * std::fabs(i), 0);
}

// remanence: h' = (i' / D)(L(i) - sgn(i') h), a function of the path of i alone; exact if the bound L is linear.
inline double Branch(const Params& p, double h, double from, double to) {
  const double sign = to > from ? 1 : -1, way = to - from;
  return Lag(h, sign * Bound(p, from, sign), sign * Bound(p, to, sign), p.remanence_d, std::fabs(way));
}

// State of the hysteresis of a magnetic circuit. Plain doubles.
struct Magnet {
  static constexpr int kStops = 6;
  double branch = 0;         // h
  double stop[kStops] = {};  // in units of the current, for remanence_stops

  // At rest with the first command u.
  void Start(const Params& p, double u) {
    const double before = (1 - p.remanence_rise) * u;
    branch = p.remanence_start * Bound(p, before, p.remanence_start);
    for (int k = 0; k < kStops; k++) stop[k] = branch * Width(p, k);
    Follow(p, before, u);
  }
  // Along a path of the current. With stops (Prandtl and Ishlinskii) minor loops close; those of the equation do not.
  // From the demagnetised state both begin with the slope 1 / D.
  void Follow(const Params& p, double from, double to) {
    if (to == from) return;
    if (from * to < 0 && (p.remanence_up != 0 || p.remanence_down != 0)) {  // the bounds have a corner at zero
      Follow(p, from, 0);
      from = 0;
    }
    if (!(p.remanence_stops > 0)) {
      branch = Branch(p, branch, from, to);
      return;
    }
    branch = 0;
    for (int k = 0; k < kStops; k++) {
      const double width = Width(p, k);
      stop[k] = std::fmin(std::fmax(stop[k] + to - from, -width * Bound(p, to, -1)), width * Bound(p, to, 1));
      branch += stop[k] / (kStops * p.remanence_d);
    }
  }

 private:
  // Their mean is D.
  static double Width(const Params& p, int k) { return p.remanence_d * 2 * (k + 1) / (kStops + 1); }
};

// Loops close towards saturation of the core, where the path has no influence.
inline double FieldOf(const Params& p, double i, double h) {
  const double q = p.remanence_knee > 0 ? i / p.remanence_knee : 0;
  return Saturate(p, i - p.remanence_b * h * std::exp(-q * q));
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MAGNETICS_H_

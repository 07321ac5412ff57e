// Stage `magnetics`: from the coil current to the field variable b of the law.
#ifndef MRDAMP_EFFECTS_MAGNETICS_H_
#define MRDAMP_EFFECTS_MAGNETICS_H_

#include <cmath>

#include "core/params.h"

namespace mrdamp {

// saturation: i_s tanh(i / i_s), or i / (1 + |i / i_s|^p)^(1/p).
inline double Saturate(const Params& p, double i) {
  if (!(p.saturation_i_s > 0)) return i;
  const double q = i / p.saturation_i_s;
  if (p.saturation_shape == 0) return p.saturation_i_s * std::tanh(q);
  return i / std::pow(1 + std::pow(std::fabs(q), p.saturation_shape), 1 / p.saturation_shape);
}

// remanence: h' = (i' / D)(1 - sgn(i') h), a function of the path of i alone.
inline double Branch(const Params& p, double h, double from, double to) {
  const double sign = to > from ? 1 : -1;
  return sign + (h - sign) * std::exp(-std::fabs(to - from) / p.remanence_d);
}

inline double FieldOf(const Params& p, double i, double h) { return Saturate(p, i - p.remanence_b * h); }

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MAGNETICS_H_

// Weight of the force at the end of a step.
#ifndef MRDAMP_CORE_WEIGHT_H_
#define MRDAMP_CORE_WEIGHT_H_

#include <cmath>

namespace mrdamp {

// For m v' = -c v and q = c h / m the rule v1 = v0 - h/m c ((1 - theta) v0 + theta v1) is exact with
// theta = 1 / (1 - exp(-q)) - 1 / q: one half (second order) where q is small, one (no ringing) where it is large.
inline double EndWeight(double q) {
  if (!(q > 1e-3)) return 0.5 + (q > 0 ? q / 12 : 0);
  if (q > 500) return 1 - 1 / q;
  return -1 / std::expm1(-q) - 1 / q;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_WEIGHT_H_

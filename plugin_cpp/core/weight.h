// Weight of the force at the end of a step.
#ifndef MRDAMP_CORE_WEIGHT_H_
#define MRDAMP_CORE_WEIGHT_H_

#include "core/real.h"

namespace mrdamp {

// For m v' = -c v and q = c h / m the rule v1 = v0 - h/m c ((1 - theta) v0 + theta v1) is exact with
// theta = 1 / (1 - exp(-q)) - 1 / q: one half (second order) where q is small, one (no ringing) where it is large.
inline Real EndWeight(Real q) {
  const Mask small = !(q > 1e-3);
  const Real start = 0.5 + Select(q > 0, q / 12, 0);
  return All(small) ? start : Select(small, start, -1 / expm1(-q) - 1 / q);
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_WEIGHT_H_

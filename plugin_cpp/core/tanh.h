// The hyperbolic tangent of the laws, which call it in every step.
#ifndef MRDAMP_CORE_TANH_H_
#define MRDAMP_CORE_TANH_H_

#include <cmath>

namespace mrdamp {

// tanh of q >= 0 to a few parts in 1e15, in half the time of the library's.
inline double Tanh(double q) {
  if (q > 0.05) return 1 - 2 / (std::exp(2 * q) + 1);
  const double s = q * q;
  return q * (1 - s * (1.0 / 3 - s * (2.0 / 15 - s * (17.0 / 315 - s * (62.0 / 2835)))));
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_TANH_H_

// channel_shift of a record: a displacement channel that is early or late against the others.
#ifndef MRDAMP_CORE_SHIFT_H_
#define MRDAMP_CORE_SHIFT_H_

#include <cmath>

#include "core/lane.h"

namespace mrdamp {

// The true motion x_true(t) = x_read(t + d), by cubic Hermite pieces, in the 3 n numbers of `store`, which the lane then
// has. Beyond its ends the motion goes on at its velocity: to stand still there would be a jump.
inline void Shift(double d, double dt, double* store, MrdampLane* lane) {
  const int n = lane->n;
  double *x = store, *v = x + n, *a = v + n;
  for (int i = 0; i < n; i++) {
    const double at = i + d / dt, last = n - 1;
    const double below = std::floor(at);
    const int k = static_cast<int>(below < 0 ? 0 : below > n - 2 ? n - 2 : below);
    const double w = at - k < 0 ? 0 : at - k > 1 ? 1 : at - k;
    const double x0 = lane->x[k], x1 = lane->x[k + 1], v0 = lane->v[k] * dt, v1 = lane->v[k + 1] * dt;
    const double b = 3 * (x1 - x0) - 2 * v0 - v1, c = 2 * (x0 - x1) + v0 + v1;
    x[i] = x0 + w * (v0 + w * (b + w * c));
    const double beyond = at < 0 ? at : at > last ? at - last : 0;
    v[i] = (v0 + w * (2 * b + 3 * w * c)) / dt;
    if (beyond != 0) x[i] += beyond * dt * v[i];
    a[i] = beyond != 0 ? 0 : lane->a[k] + w * (lane->a[k + 1] - lane->a[k]);
  }
  lane->x = x;
  lane->v = v;
  lane->a = a;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_SHIFT_H_

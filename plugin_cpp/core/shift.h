// channel_shift and motion_lag: a displacement channel that is early or late, and filtered or averaged.
#ifndef MRDAMP_CORE_SHIFT_H_
#define MRDAMP_CORE_SHIFT_H_

#include <cmath>

#include "core/lane.h"
#include "core/params.h"

namespace mrdamp {

// True if the channel reads something else than the motion.
inline bool Misread(const Params& p) {
  return Head(p.channel_shift_d) != 0 || Head(p.motion_lag_tau) > 0 || Head(p.motion_lag_width) > 0;
}

// What the channel reads of a motion, to second order.
inline Real Recorded(const Params& p, Real x, Real v, Real a) {
  const Real d = p.channel_shift_d, tau = p.motion_lag_tau, width = p.motion_lag_width;
  return x - (d + tau) * v + (d * (0.5 * d + tau) + tau * tau + width * width / 24) * a;
}

// Takes a centred average over `width` back from n samples, to fourth order: what it has erased is not differentiated.
// spare: n.
inline void Sharpen(double width, double dt, int n, double* y, double* spare) {
  const int span = width > 6 * dt ? static_cast<int>(0.25 * width / dt + 0.5) : 1;
  const double share = width * width / (24 * span * span * dt * dt);
  for (int i = 0; i < n; i++) {
    const int low = i > span ? i - span : 0, high = i + span < n ? i + span : n - 1;
    const bool inside = high - i == i - low;
    spare[i] = y[i] - (inside ? share * (y[high] - 2 * y[i] + y[low]) : 0);
  }
  for (int i = 0; i < n; i++) y[i] = spare[i];
}

// Takes a low-pass of time constant tau back from n samples of a motion.
inline void Hasten(double tau, double dt, int n, double* x, double* v, double* a) {
  for (int i = 0; i < n; i++) x[i] += tau * v[i];
  for (int i = 0; i < n; i++) v[i] += tau * a[i];
  for (int i = 0; i < n; i++) {
    const int before = i > 0 ? i - 1 : 0, after = i < n - 1 ? i + 1 : n - 1;
    if (after > before) a[i] = (v[after] - v[before]) / ((after - before) * dt);
  }
}

// The true motion x_true(t) = x_read(t + d), by cubic Hermite pieces, in the 4 n numbers of `store`, which the lane then
// has. Beyond its ends the motion goes on at its velocity: to stand still there would be a jump.
inline void TakeBack(double d, double tau, double width, double dt, double* store, MrdampLane* lane) {
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
  if (width > 0) {
    for (int k = 0; k < 3; k++) Sharpen(width, dt, n, store + k * n, a + n);
  }
  if (tau > 0) Hasten(tau, dt, n, x, v, a);
  lane->x = x;
  lane->v = v;
  lane->a = a;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_SHIFT_H_

// channel_shift and motion_lag: a displacement channel that is early or late, and filtered or averaged.
#ifndef MRDAMP_CORE_SHIFT_H_
#define MRDAMP_CORE_SHIFT_H_

#include <algorithm>
#include <cmath>
#include <cstddef>

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

// An average is taken back on a grid of kGrid points in its duration, by least squares with a penalty on the curvature of
// the correction: of the frequency 1 / width, which it erases, noise is raised by 1 / (2 kFaint) at most. Triangles at .5 to
// .8 Hz averaged over .4 s lose two thirds of the error that the average makes, over .9 s half; finer grids gain nothing;
// a third of kFaint takes nine tenths off for twice the noise. kRoom: doubles for each sample; without an average kMotion.
constexpr int kGrid = 8, kBand = 2 * kGrid, kMotion = 3, kRoom = kMotion + 1 + kBand + 1;
constexpr double kFaint = 0.03;

// Weights of the points -kGrid to kGrid in an average of straight lines over 2 `half` points.
inline void AverageOf(double half, double* w) {
  const int whole = static_cast<int>(half);
  const double part = half - whole;
  for (int j = -kGrid; j <= kGrid; j++) {
    const int beyond = (j < 0 ? -j : j) - whole;  // the last whole point
    double weight = beyond < 0;
    if (beyond == 0) weight = 0.5 * (whole > 0) + part * (1 - 0.5 * part);
    if (beyond == 1) weight = 0.5 * part * part;
    w[kGrid + j] = weight / (2 * half);
  }
  if (whole == 0) w[kGrid] *= 2;  // the end of both sides
}

// Takes a centred average over `width` back from `count` channels of n samples, one after the other; of the averages at the
// ends, over more than there is, nothing is known. store: the rest of kRoom.
inline void Sharpen(double width, double dt, int n, int count, double* channels, double* store) {
  const int span = width > kGrid * dt ? static_cast<int>(width / (kGrid * dt)) : 1, m = (n - 1) / span + 1;
  const double half = 0.5 * width / (span * dt);
  const int lost = static_cast<int>(std::ceil(half)), last = m - 1 - lost;  // whole averages: from `lost` to `last`
  if (last <= lost) return;
  const double penalty = kFaint * kFaint * std::pow(half / 3.141592653589793, 4);
  double w[2 * kGrid + 1];
  AverageOf(half, w);
  double *const own = store, *const matrix = store + n;  // its lower band, (i, j) at i (kBand + 1) + i - j
  const auto at = [&](int i, int j) -> double& { return matrix[static_cast<std::size_t>(i) * (kBand + 1) + i - j]; };
  const auto first = [](int i) { return i > kBand ? i - kBand : 0; };
  std::fill_n(matrix, static_cast<std::size_t>(m) * (kBand + 1), 0.0);
  const auto add = [&](int from, int size, const double* row, double share) {
    for (int j = 0; j < size; j++) {
      for (int k = 0; row[j] != 0 && k <= j; k++) {
        if (row[k] != 0) at(from + j, from + k) += share * row[j] * row[k];
      }
    }
  };
  const double bend[] = {1, -2, 1};
  for (int i = 0; i < m; i++) {
    if (i >= lost && i <= last) add(i - kGrid, 2 * kGrid + 1, w, 1);
    if (i > 0 && i < m - 1) add(i - 1, 3, bend, penalty);
  }
  for (int i = 0; i < m; i++) {  // Cholesky's factor in its place
    for (int j = first(i); j <= i; j++) {
      double sum = at(i, j);
      for (int k = first(i); k < j; k++) sum -= at(i, k) * at(j, k);
      at(i, j) = i == j ? std::sqrt(sum) : sum / at(j, j);
    }
  }
  for (double* y = channels; count > 0; count--, y += n) {
    std::fill_n(own, m, 0.0);
    for (int i = lost; i <= last; i++) {
      double off = y[i * span];
      for (int j = -kGrid; j <= kGrid; j++) {
        if (w[kGrid + j] != 0) off -= w[kGrid + j] * y[(i + j) * span];
      }
      for (int j = -kGrid; j <= kGrid; j++) {
        if (w[kGrid + j] != 0) own[i + j] += w[kGrid + j] * off;
      }
    }
    for (int i = 0; i < m; i++) {
      for (int j = first(i); j < i; j++) own[i] -= at(i, j) * own[j];
      own[i] /= at(i, i);
    }
    for (int i = m; i-- > 0;) {
      own[i] /= at(i, i);
      for (int j = first(i); j < i; j++) own[j] -= at(i, j) * own[i];
    }
    for (int i = 0; i < n; i++) {
      const int k = i / span;
      const double part = static_cast<double>(i % span) / span;
      y[i] += k + 1 < m ? own[k] + part * (own[k + 1] - own[k]) : own[m - 1];
    }
  }
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

// The true motion x_true(t) = x_read(t + d), by cubic Hermite pieces, in the first of the kRoom n numbers of `store`, which
// the lane then has. Beyond its ends the motion goes on at its velocity: to stand still there would be a jump.
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
  if (width > 0) Sharpen(width, dt, n, 3, store, a + n);
  if (tau > 0) Hasten(tau, dt, n, x, v, a);
  lane->x = x;
  lane->v = v;
  lane->a = a;
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_SHIFT_H_

#include "mujoco/step.h"

#include <algorithm>
#include <cmath>

#include "core/balance.h"

namespace mrdamp {

namespace {

// Solves a x = b in place by elimination with row exchange; a is n x n.
void Eliminate(std::vector<double>* a, std::vector<double>* b) {
  const int n = static_cast<int>(b->size());
  for (int k = 0; k < n; k++) {
    int best = k;
    for (int i = k + 1; i < n; i++) {
      if (std::fabs((*a)[i * n + k]) > std::fabs((*a)[best * n + k])) best = i;
    }
    for (int j = 0; j < n; j++) std::swap((*a)[k * n + j], (*a)[best * n + j]);
    std::swap((*b)[k], (*b)[best]);
    const double pivot = (*a)[k * n + k];
    if (pivot == 0) continue;
    for (int i = k + 1; i < n; i++) {
      const double f = (*a)[i * n + k] / pivot;
      if (f == 0) continue;
      for (int j = k; j < n; j++) (*a)[i * n + j] -= f * (*a)[k * n + j];
      (*b)[i] -= f * (*b)[k];
    }
  }
  for (int k = n; k-- > 0;) {
    for (int j = k + 1; j < n; j++) (*b)[k] -= (*a)[k * n + j] * (*b)[j];
    const double pivot = (*a)[k * n + k];
    (*b)[k] = pivot != 0 ? (*b)[k] / pivot : 0;
  }
}

// Newton's method on the forces of dampers that act on each other: F_k = law_k(v_k(F)), with steps halved until the
// misfit falls. law(k, v, &slope) gives force and slope. False where it did not arrive.
template <class LawOf>
bool Newton(double h, const std::vector<StepDamper>& d, const std::vector<double>& w, LawOf&& law,
            std::vector<double>* force) {
  const int n = static_cast<int>(d.size());
  std::vector<double> v(n), f(n), slope(n), misfit(n), step(n), trial(n), matrix(static_cast<std::size_t>(n) * n);
  const auto velocities = [&](const std::vector<double>& forces) {
    for (int k = 0; k < n; k++) {
      v[k] = d[k].free;
      for (int j = 0; j < n; j++) v[k] -= h * w[k * n + j] * forces[j];
    }
  };
  const auto measure = [&](const std::vector<double>& forces, bool slopes) {
    velocities(forces);
    double sum = 0;
    for (int k = 0; k < n; k++) {
      f[k] = law(k, v[k], slopes ? &slope[k] : nullptr);
      misfit[k] = forces[k] - f[k];
      sum += misfit[k] * misfit[k];
    }
    return sum;
  };
  double now = measure(*force, true);
  for (int i = 0; i < 40; i++) {
    double size = 0;
    for (int k = 0; k < n; k++) size += (*force)[k] * (*force)[k] + f[k] * f[k];
    if (!(now > 1e-22 * size + 1e-24)) return true;
    for (int k = 0; k < n; k++) {
      for (int j = 0; j < n; j++) matrix[k * n + j] = (k == j) + slope[k] * h * w[k * n + j];
      step[k] = -misfit[k];
    }
    Eliminate(&matrix, &step);
    double best = now, share = 1;
    for (int half = 0; half < 12; half++, share *= 0.5) {
      for (int k = 0; k < n; k++) trial[k] = (*force)[k] + share * step[k];
      best = measure(trial, false);
      if (best < now) break;
    }
    if (!(best < now)) return false;  // a kink holds it up
    *force = trial;
    now = measure(*force, true);
  }
  return false;
}

}  // namespace

void PresentForces(double h, const std::vector<StepDamper>& d, const std::vector<double>& w, std::vector<double>* force) {
  const int n = static_cast<int>(d.size());
  std::vector<double> matrix(static_cast<std::size_t>(n) * n), a(n);
  for (int k = 0; k < n; k++) {
    a[k] = (d[k].free - d[k].velocity) / h;
    for (int j = 0; j < n; j++) {
      a[k] -= w[k * n + j] * d[j].force;
      matrix[k * n + j] = (k == j) + w[k * n + j] * d[j].mass;
    }
  }
  Eliminate(&matrix, &a);
  for (int k = 0; k < n; k++) (*force)[k] = d[k].force + d[k].mass * a[k];
}

void SolveStep(double h, const std::vector<StepDamper>& d, const std::vector<double>& w, std::vector<double>* force) {
  const int n = static_cast<int>(d.size());
  if (n == 1) {
    (*force)[0] = SolveOne(h, d[0], w[0]);
    return;
  }
  bool coupled = false;
  for (int k = 0; k < n; k++) {
    for (int j = 0; j < n; j++) coupled |= j != k && std::fabs(w[k * n + j]) > 1e-12 * std::fabs(w[k * n + k]);
  }
  if (!coupled) {
    for (int k = 0; k < n; k++) (*force)[k] = SolveOne(h, d[k], w[k * n + k]);
    return;
  }
  const auto difference = [&](int k, double v, double part, double at) {
    const double dv = 1e-6 * (std::fabs(v) + std::fabs(d[k].velocity)) + 1e-10;
    return std::max((d[k].trial(v + dv, part) - at) / dv, 0.0);
  };
  // The moving mass is a force of its own here: m (v1 - v0) / h.
  const auto inertia = [&](int k, double v, double* slope) {
    if (slope) *slope += d[k].mass / h;
    return d[k].mass * (v - d[k].velocity) / h;
  };
  std::vector<double> firm(n), chord(n), q(n, 0.0);
  for (int k = 0; k < n; k++) firm[k] = d[k].force;
  const bool arrived = Newton(h, d, w, [&](int k, double v, double* slope) {
    const double f = d[k].trial(v, h);
    if (slope) *slope = difference(k, v, h, f);
    return f + inertia(k, v, slope);
  }, &firm);
  // Kinks: one after the other, each exactly.
  for (int sweep = 0; !arrived && sweep < 200; sweep++) {
    double moved = 0, size = 0;
    for (int k = 0; k < n; k++) {
      double free = d[k].free;
      for (int j = 0; j < n; j++) free -= j == k ? 0 : h * w[k * n + j] * firm[j];
      const double qk = h * w[k * n + k];
      if (!(qk > 0)) continue;
      const auto residual = [&](double v) { return (v - free) / qk + d[k].trial(v, h) + inertia(k, v, nullptr); };
      const double v = SolveIncreasing(residual, free - qk * firm[k], 1 / qk, 1e-7 * std::fabs(firm[k]) + 1e-9);
      const double force = (free - v) / qk;
      moved = std::max(moved, std::fabs(force - firm[k]));
      size = std::max(size, std::fabs(force));
      firm[k] = force;
    }
    if (!(moved > 1e-6 * size)) break;
  }
  // How stiff each is: its slope and the chord over what all of them bring, against the mobility they share.
  std::vector<double> slopes(n), present(n);
  for (int k = 0; k < n; k++) {
    double v = d[k].free;
    for (int j = 0; j < n; j++) v -= h * w[k * n + j] * firm[j];
    const double span = d[k].free - v, end = d[k].trial(v, h);
    chord[k] = span != 0 ? std::max(0.0, (d[k].trial(d[k].free, h) - end) / span) : std::max(0.0, d[k].slope);
    slopes[k] = LocalSlope(d[k], v, end, h, std::fabs(span));
    present[k] = LocalSlope(d[k], v, d[k].trial(v, 0), 0, std::fabs(span));
  }
  for (int k = 0; k < n; k++) {
    for (int j = 0; j < n; j++) q[k] += h * std::fabs(w[k * n + j]) * std::max(slopes[j], chord[j]);
  }
  std::vector<Blend> blend(n);
  double most = 0;
  for (int k = 0; k < n; k++) {
    blend[k] = BlendOf(q[k], d[k].bare, slopes[k], chord[k], present[k]);
    most = std::max(most, blend[k].firm);
  }
  std::vector<double> smooth = firm;
  if (most < 1) {
    Newton(h, d, w, [&](int k, double v, double* slope) {
      const double f = d[k].trial(v, 0);
      if (slope) *slope = blend[k].weight * difference(k, v, 0, f);
      return (1 - blend[k].weight) * d[k].force + blend[k].weight * f + inertia(k, v, slope);
    }, &smooth);
  }
  // One share for all: forces that belong to one motion.
  for (int k = 0; k < n; k++) (*force)[k] = smooth[k] + most * (firm[k] - smooth[k]);
}

}  // namespace mrdamp

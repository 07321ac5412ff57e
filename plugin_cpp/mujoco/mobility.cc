#include "mujoco/mobility.h"

#include <algorithm>

namespace mrdamp {

namespace {

// Beyond this the small dense factorisation would cost more than it is worth; the mobility is then too large, which
// damps less but never rings.
constexpr int kMostEqualities = 60;

double Product(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; i++) sum += a[i] * b[i];
  return sum;
}

}  // namespace

void Mobility::Update(const mjModel* m, mjData* d, const std::vector<int>& others) {
  const int nv = m->nv;
  push_.resize(nv);
  row_.resize(nv);
  solve_.resize(nv);
  damping_ = false;
  for (int k = 0; k < nv && !damping_; k++) damping_ = m->dof_damping[k] > 0;
  for (int k = 0; k < nv; k++) push_[k] = d->qfrc_passive[k] + d->qfrc_applied[k] - d->qfrc_bias[k];
  for (int b = 1; b < m->nbody; b++) {
    const mjtNum* f = d->xfrc_applied + 6 * b;
    if (f[0] == 0 && f[1] == 0 && f[2] == 0 && f[3] == 0 && f[4] == 0 && f[5] == 0) continue;
    mj_applyFT(m, d, f, f + 3, d->xipos + 3 * b, b, push_.data());
  }
  // Actuators of the engine's own types have their force already; plugins that come later do not.
  for (int a : others) {
    for (int o = m->actuator_outadr[a]; o < m->actuator_outadr[a] + m->actuator_outnum[a]; o++) {
      const double force = d->actuator_force[o];
      if (force == 0) continue;
      const int begin = d->moment_rowadr[o];
      for (int k = begin; k < begin + d->moment_rownnz[o]; k++) push_[d->moment_colind[k]] += d->actuator_moment[k] * force;
    }
  }
  equalities_ = d->ne <= kMostEqualities ? d->ne : 0;
  if (equalities_ > 0) Equalities(m, d);
  if (d->nf > 0 && d->nf <= kMostEqualities) Frictions(m, d);
}

// Dry friction of joints and tendons, each on its own: what would hold it, within its limits.
void Mobility::Frictions(const mjModel* m, mjData* d) {
  const int nv = m->nv;
  std::vector<double> row(nv), inverse(nv), rest = push_;
  impulse_.assign(d->nefc, 0.0);
  for (int i = d->ne; i < d->ne + d->nf; i++) {
    impulse_[i] = 1;
    mj_mulJacTVec(m, d, row.data(), impulse_.data());
    impulse_[i] = 0;
    mj_solveM(m, d, inverse.data(), row.data(), 1);
    const double give = Product(row.data(), inverse.data(), nv) + d->efc_R[i];
    const double limit = d->efc_frictionloss[i];
    const double wanted = (d->efc_aref[i] - Product(inverse.data(), rest.data(), nv)) / give;
    const double force = std::clamp(wanted, -limit, limit);
    for (int k = 0; k < nv; k++) push_[k] += row[k] * force;
  }
}

// Active equality constraints act like stiff springs: (J M^-1 J' + R) f = a_ref - J a, as the engine's solver has it.
void Mobility::Equalities(const mjModel* m, mjData* d) {
  const int ne = equalities_, nv = m->nv;
  jacobian_.resize(static_cast<std::size_t>(ne) * nv);
  inverse_.resize(static_cast<std::size_t>(ne) * nv);
  factor_.resize(static_cast<std::size_t>(ne) * ne);
  reference_.resize(ne);
  impulse_.assign(d->nefc, 0.0);
  for (int i = 0; i < ne; i++) {
    impulse_[i] = 1;
    mj_mulJacTVec(m, d, jacobian_.data() + static_cast<std::size_t>(i) * nv, impulse_.data());
    impulse_[i] = 0;
  }
  mj_solveM(m, d, inverse_.data(), jacobian_.data(), ne);
  for (int i = 0; i < ne; i++) {
    for (int j = 0; j < ne; j++) {
      factor_[i * ne + j] = Product(jacobian_.data() + i * nv, inverse_.data() + j * nv, nv) + (i == j ? d->efc_R[i] : 0);
    }
  }
  if (mju_cholFactor(factor_.data(), ne, mjMINVAL) < ne) {
    equalities_ = 0;
    return;
  }
  // Where they drive the free motion: push += J' f.
  mj_solveM(m, d, solve_.data(), push_.data(), 1);
  for (int i = 0; i < ne; i++) reference_[i] = d->efc_aref[i] - Product(jacobian_.data() + i * nv, solve_.data(), nv);
  mju_cholSolve(impulse_.data(), factor_.data(), reference_.data(), ne);
  for (int i = 0; i < ne; i++) {
    for (int k = 0; k < nv; k++) push_[k] += jacobian_[i * nv + k] * impulse_[i];
  }
}

double Mobility::Row(const mjModel* m, mjData* d, int output, double h, std::vector<double>* inverse) {
  const int nv = m->nv, ne = equalities_;
  std::vector<double>& x = *inverse;
  x.resize(nv);
  std::fill(row_.begin(), row_.end(), 0.0);
  const int begin = d->moment_rowadr[output];
  for (int k = begin; k < begin + d->moment_rownnz[output]; k++) row_[d->moment_colind[k]] = d->actuator_moment[k];
  mj_solveM(m, d, x.data(), row_.data(), 1);
  // Euler and the implicit integrators treat joint damping implicitly: (M + h D) instead of M, by one correction
  // where h D is small; where it is not, the larger mobility only damps less.
  if (damping_) {
    double size = 0, change = 0;
    for (int k = 0; k < nv; k++) {
      const double y = h * m->dof_damping[k] * x[k];
      size += row_[k] * x[k];
      change += y * x[k];
      row_[k] = y;
    }
    if (change < 0.3 * size) {
      mj_solveM(m, d, solve_.data(), row_.data(), 1);
      for (int k = 0; k < nv; k++) x[k] -= solve_[k];
    }
  }
  const double free = Product(x.data(), push_.data(), nv);
  if (ne > 0) {
    for (int i = 0; i < ne; i++) reference_[i] = Product(jacobian_.data() + i * nv, x.data(), nv);
    mju_cholSolve(impulse_.data(), factor_.data(), reference_.data(), ne);
    for (int i = 0; i < ne; i++) {
      for (int k = 0; k < nv; k++) x[k] -= inverse_[i * nv + k] * impulse_[i];
    }
  }
  return free;
}

}  // namespace mrdamp

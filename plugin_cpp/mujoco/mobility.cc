#include "mujoco/mobility.h"

#include <algorithm>
#include <cmath>
#include <cstring>

// The matrix that the engine's implicit integrators use, d->qDeriv. Exported, but in no public header of 4.0.0.
extern "C" void mjd_smooth_vel(const mjModel* m, mjData* d, int flg_bias);

namespace mrdamp {

namespace {

constexpr int kMostRounds = 12, kFullRounds = 5;

double Product(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; i++) sum += a[i] * b[i];
  return sum;
}

// to += scale * from
void Add(double* to, const double* from, double scale, int n) {
  for (int i = 0; i < n; i++) to[i] += scale * from[i];
}

// Moment of an actuator output, as a dense vector.
void Moment(const mjData* d, int output, double scale, double* to) {
  const int begin = d->moment_rowadr[output];
  for (int k = begin; k < begin + d->moment_rownnz[output]; k++) to[d->moment_colind[k]] += scale * d->actuator_moment[k];
}

// f(column, value) for the entries of a row of the constraints' Jacobian.
template <class F>
void ForEntries(const mjModel* m, const mjData* d, int row, F&& f) {
  if (mj_isSparse(m)) {
    const int begin = d->efc_J_rowadr[row];
    for (int k = begin; k < begin + d->efc_J_rownnz[row]; k++) f(d->efc_J_colind[k], d->efc_J[k]);
    return;
  }
  for (int k = 0; k < m->nv; k++) {
    const double value = d->efc_J[static_cast<std::size_t>(row) * m->nv + k];
    if (value != 0) f(k, value);
  }
}

// Derivative with v of the damping force v (linear + poly[0] |v| + poly[1] v^2).
double DampingAt(double linear, const double* poly, double v) {
  return linear + 2 * poly[0] * std::fabs(v) + 3 * poly[1] * v * v;
}

}  // namespace

// All forces but those of dampers and constraints. Actuators of the engine's own types have their force already, before
// its limits; plugins that come later do not. The limit of a joint that a damper acts on is one on the sum, so that it
// limits the damper's force: as for a limit of the damper's own, the end of the step is right without it.
void Mobility::ReadForces(const mjModel* m, mjData* d, const std::vector<int>& others, const std::vector<int>& outputs) {
  push_.assign(nv_, 0.0);
  for (int a : others) {
    const int begin = m->actuator_outadr[a];
    for (int o = begin; o < begin + m->actuator_outnum[a]; o++) {
      double force = d->actuator_force[o];
      if (m->actuator_forcelimited[a]) {
        force = std::clamp(force, m->actuator_forcerange[2 * a], m->actuator_forcerange[2 * a + 1]);
      }
      if (force != 0) Moment(d, o, force, push_.data());
    }
  }
  for (int j = 0; j < m->njnt; j++) {
    if (!m->jnt_actgravcomp[j] && !m->jnt_actfrclimited[j]) continue;
    const int dof = m->jnt_dofadr[j];
    if (m->jnt_actgravcomp[j]) push_[dof] += d->qfrc_gravcomp[dof];
    bool damped = false;
    for (int o : outputs) {
      const int begin = d->moment_rowadr[o];
      for (int k = begin; k < begin + d->moment_rownnz[o]; k++) damped |= d->moment_colind[k] == dof;
    }
    if (m->jnt_actfrclimited[j] && !damped) push_[dof] = std::clamp(push_[dof], m->jnt_actfrcrange[2 * j], m->jnt_actfrcrange[2 * j + 1]);
  }
  for (int k = 0; k < nv_; k++) push_[k] += d->qfrc_passive[k] + d->qfrc_applied[k] - d->qfrc_bias[k];
  for (int b = 1; b < m->nbody; b++) {
    const mjtNum* f = d->xfrc_applied + 6 * b;
    if (f[0] == 0 && f[1] == 0 && f[2] == 0 && f[3] == 0 && f[4] == 0 && f[5] == 0) continue;
    mj_applyFT(m, d, f, f + 3, d->xipos + 3 * b, b, push_.data());
  }
}

// Euler takes the damping of joints implicitly, the implicit integrators all that depends on velocities.
void Mobility::ReadDamping(const mjModel* m, mjData* d) {
  const bool implicit = m->opt.integrator == mjINT_IMPLICIT || m->opt.integrator == mjINT_IMPLICITFAST;
  const int off = mjDSBL_DAMPER | (implicit ? 0 : mjDSBL_EULERDAMP);
  damping_ = kNone;
  if (m->opt.integrator == mjINT_RK4) return;
  if (implicit) {
    bool more = m->opt.viscosity > 0 || m->opt.density > 0 || m->nflex > 0;
    for (int t = 0; t < m->ntendon; t++) more |= m->tendon_damping[t] != 0 || m->tendon_dampingpoly[mjNPOLY * t] != 0;
    for (int a = 0; a < m->nactuator; a++) {
      more |= m->actuator_plugin[a] < 0 && (m->actuator_biastype[a] != mjBIAS_NONE || m->actuator_gaintype[a] != mjGAIN_FIXED);
      more |= m->actuator_damping[a] != 0 && m->actuator_trntype[a] == mjTRN_TENDON;
    }
    if (more) {
      mjd_smooth_vel(m, d, 0);
      damping_ = kAll;
      return;
    }
  }
  if (m->opt.disableflags & off) return;
  joints_.resize(nv_);
  for (int k = 0; k < nv_; k++) {
    joints_[k] = DampingAt(m->dof_damping[k], m->dof_dampingpoly + mjNPOLY * k, d->qvel[k]);
    if (joints_[k] != 0) damping_ = kJoints;
  }
  for (int a = 0; a < m->nactuator; a++) {
    const int type = m->actuator_trntype[a];
    if ((type != mjTRN_JOINT && type != mjTRN_JOINTINPARENT) || m->actuator_damping[a] == 0) continue;
    const int joint = m->actuator_trnid[2 * a], dof = m->jnt_dofadr[joint];
    if (m->jnt_type[joint] != mjJNT_SLIDE && m->jnt_type[joint] != mjJNT_HINGE) continue;
    const double gear = m->actuator_gear[6 * m->actuator_outadr[a]];
    joints_[dof] += gear * gear * DampingAt(m->actuator_damping[a], m->actuator_dampingpoly + mjNPOLY * a, d->qvel[dof]);
    damping_ = kJoints;
  }
}

// out += h B x with the damping matrix B.
void Mobility::Damp(const mjModel* m, const mjData* d, const double* x, double* out) const {
  const double h = m->opt.timestep;
  for (int i = 0; i < nv_; i++) {
    if (damping_ == kJoints) {
      out[i] += h * joints_[i] * x[i];
      continue;
    }
    for (int k = m->D_rowadr[i]; k < m->D_rowadr[i] + m->D_rownnz[i]; k++) out[i] -= h * d->qDeriv[k] * x[m->D_colind[k]];
  }
}

void Mobility::Update(const mjModel* m, mjData* d, const std::vector<int>& others, const std::vector<int>& outputs) {
  nv_ = m->nv;
  rows_ = round_ = 0;
  row_.resize(nv_);
  solve_.resize(nv_);
  ReadForces(m, d, others, outputs);
  ReadDamping(m, d);
  if (d->nefc == 0) return;
  Choose(m, d, outputs);
  now_.assign(d->qacc_warmstart, d->qacc_warmstart + nv_);
  Evaluate(m, d);
  Linearise(m, d);
}

// The constraints that dampers feel: those on trees that one acts on, and on trees that these constrain in turn.
void Mobility::Choose(const mjModel* m, const mjData* d, const std::vector<int>& outputs) {
  felt_.assign(m->ntree, false);
  near_.assign(d->nefc, false);
  for (int o : outputs) {
    for (int k = d->moment_rowadr[o]; k < d->moment_rowadr[o] + d->moment_rownnz[o]; k++) felt_[m->dof_treeid[d->moment_colind[k]]] = true;
  }
  for (bool more = true; more;) {
    more = false;
    for (int i = 0; i < d->nefc; i++) {
      if (near_[i]) continue;
      ForEntries(m, d, i, [&](int k, double) { near_[i] |= felt_[m->dof_treeid[k]]; });
      if (!near_[i]) continue;
      ForEntries(m, d, i, [&](int k, double) { felt_[m->dof_treeid[k]] = true; });
      more = true;
    }
  }
}

// Forces of the constraints, their states and the Hessians of sliding contacts, at the acceleration `now_`.
void Mobility::Evaluate(const mjModel* m, mjData* d) {
  work_.resize(d->nefc);
  mj_mulJacVec(m, d, work_.data(), now_.data());
  for (int i = 0; i < d->nefc; i++) work_[i] -= d->efc_aref[i];
  mj_constraintUpdate(m, d, work_.data(), nullptr, 1);
}

// One more row of C^1/2 J: the sum of `count` constraints from `row`, each times its share.
void Mobility::AddRow(const mjModel* m, const mjData* d, int row, const double* share, int count) {
  jacobian_.resize(static_cast<std::size_t>(rows_ + 1) * nv_);
  double* to = jacobian_.data() + static_cast<std::size_t>(rows_++) * nv_;
  std::fill_n(to, nv_, 0.0);
  for (int i = 0; i < count; i++) {
    ForEntries(m, d, row + i, [&](int k, double value) { to[k] += share[i] * value; });
  }
}

void Mobility::Linearise(const mjModel* m, mjData* d) {
  rows_ = 0;
  closed_ = false;
  for (int i = 0; i < d->nefc;) {
    const bool cone = d->efc_type[i] == mjCNSTR_CONTACT_ELLIPTIC;
    const int size = cone ? d->contact[d->efc_id[i]].dim : 1, before = rows_;
    if (near_[i] && d->efc_state[i] == mjCNSTRSTATE_QUADRATIC) {
      for (int k = 0; k < size; k++) {
        const double share = std::sqrt(d->efc_D[i + k]);
        AddRow(m, d, i + k, &share, 1);
      }
    } else if (near_[i] && d->efc_state[i] == mjCNSTRSTATE_CONE) {
      double half[36], column[6];
      std::copy_n(d->contact[d->efc_id[i]].H, size * size, half);
      mju_cholFactor(half, size, mjMINVAL);  // H = L L', the lower triangle
      for (int k = 0; k < size; k++) {
        for (int j = k; j < size; j++) column[j - k] = half[j * size + k];
        AddRow(m, d, i + k, column, size - k);
      }
    }
    closed_ |= i >= d->ne + d->nf && rows_ > before;
    i += size;
  }
  total_ = push_;
  Add(total_.data(), d->qfrc_constraint, 1, nv_);
  if (rows_ == 0) return;
  for (int i = 0; i < rows_; i++) Add(total_.data(), Row(i), Product(Row(i), now_.data(), nv_), nv_);
  order_ = std::min(rows_, nv_);
  factor_.resize(static_cast<std::size_t>(order_) * order_);
  impulse_.resize(rows_);
  if (rows_ <= nv_) {  // 1 + C^1/2 A C^1/2 with A = J M^-1 J'
    inverse_.resize(jacobian_.size());
    mj_solveM(m, d, inverse_.data(), jacobian_.data(), rows_);
    for (int i = 0; i < rows_; i++) {
      for (int j = 0; j <= i; j++) {
        factor_[i * rows_ + j] = Product(Row(i), inverse_.data() + static_cast<std::size_t>(j) * nv_, nv_) + (i == j ? 1 : 0);
      }
    }
  } else {  // M + J' C J
    mj_fullM(m, d, factor_.data());
    for (int i = 0; i < rows_; i++) {
      for (int k = 0; k < nv_; k++) {
        if (Row(i)[k] != 0) Add(factor_.data() + static_cast<std::size_t>(k) * nv_, Row(i), Row(i)[k], k + 1);
      }
    }
  }
  mju_cholFactor(factor_.data(), order_, mjMINVAL);
  mj_solveM(m, d, solve_.data(), total_.data(), 1);
  Release(m, d, solve_.data(), total_.data());
}

// Takes from a generalised force what the constraints carry of it: leaves M (M + J' C J)^-1 force; solved = M^-1 force.
void Mobility::Release(const mjModel* m, mjData* d, const double* solved, double* force) {
  if (rows_ == 0) return;
  if (rows_ > nv_) {
    work_.resize(nv_);
    mju_cholSolve(work_.data(), factor_.data(), force, nv_);
    mj_mulM(m, d, force, work_.data());
    return;
  }
  for (int i = 0; i < rows_; i++) impulse_[i] = Product(Row(i), solved, nv_);
  mju_cholSolve(impulse_.data(), factor_.data(), impulse_.data(), rows_);
  for (int i = 0; i < rows_; i++) Add(force, Row(i), -impulse_[i], nv_);
}

// Notes what the response of an output is made of; true if nothing of it has changed.
bool Mobility::Unchanged(const mjModel* m, const mjData* d, OutputResponse* r) {
  made_of_.assign(d->qLD, d->qLD + m->nC);
  made_of_.insert(made_of_.end(), d->qLDiagInv, d->qLDiagInv + nv_);
  const int begin = d->moment_rowadr[r->output];
  for (int k = begin; k < begin + d->moment_rownnz[r->output]; k++) {
    made_of_.insert(made_of_.end(), {static_cast<double>(d->moment_colind[k]), d->actuator_moment[k]});
  }
  if (damping_ == kJoints) made_of_.insert(made_of_.end(), joints_.begin(), joints_.end());
  made_of_.insert(made_of_.end(), {static_cast<double>(damping_), m->opt.timestep});
  if (rows_ > 0 || damping_ == kAll) made_of_.clear();
  const std::size_t size = made_of_.size();
  if (size > 0 && size == r->made_of.size() && !std::memcmp(made_of_.data(), r->made_of.data(), size * sizeof(double))) return true;
  r->made_of.swap(made_of_);
  return false;
}

void Mobility::Respond(const mjModel* m, mjData* d, int output, OutputResponse* r) {
  r->output = output;
  if (!Unchanged(m, d, r)) Solve(m, d, r);
  r->free = Product(r->end.data(), d->nefc > 0 ? total_.data() : push_.data(), nv_);
}

void Mobility::Solve(const mjModel* m, mjData* d, OutputResponse* r) {
  r->push.assign(nv_, 0.0);
  r->end.resize(nv_);
  Moment(d, r->output, 1, r->push.data());
  mj_solveM(m, d, r->end.data(), r->push.data(), 1);
  const double size = Product(r->push.data(), r->end.data(), nv_);
  Release(m, d, r->end.data(), r->push.data());
  // A contact stops a body within a step as strong damping does.
  const double bare = closed_ ? size : Product(r->push.data(), r->end.data(), nv_);
  // (M + h B)^-1 by conjugate gradients, preconditioned by M^-1: M z = residual, so that M times a direction is known.
  if (damping_ != kNone) {
    std::vector<double>&left = row_, &z = solve_, &along = along_, &pushed = pushed_;
    left.assign(nv_, 0.0);
    Damp(m, d, r->end.data(), left.data());
    for (double& x : left) x = -x;
    along = pushed = left;
    double before = 0;
    for (int i = 0; i < 50; i++) {
      mj_solveM(m, d, z.data(), left.data(), 1);
      const double now = Product(left.data(), z.data(), nv_), turn = i > 0 ? now / before : 0;
      if (!(now > 1e-12 * size)) break;
      for (int k = 0; k < nv_; k++) {
        along[k] = z[k] + turn * along[k];
        pushed[k] = left[k] + turn * pushed[k];  // M along; h B along is added for the step alone
      }
      work_.assign(pushed.begin(), pushed.end());
      Damp(m, d, along.data(), work_.data());
      const double share = now / Product(along.data(), work_.data(), nv_);
      Add(r->end.data(), along.data(), share, nv_);
      if (now < 1e-6 * size) break;  // weak damping: the next step would change the square of that
      Add(left.data(), work_.data(), -share, nv_);
      before = now;
    }
  }
  r->own = Weight(*r, *r);
  r->bare = std::max(1.0, bare / r->own);
}

double Mobility::Weight(const OutputResponse& of, const OutputResponse& at) const {
  return Product(of.end.data(), at.push.data(), nv_);
}

bool Mobility::Arrived(const mjModel* m, mjData* d, const std::vector<const OutputResponse*>& at,
                       const std::vector<double>& forces) {
  if (d->nefc == d->ne || ++round_ == kMostRounds) return true;  // equalities alone are straight
  row_ = total_;
  for (std::size_t k = 0; k < at.size(); k++) Add(row_.data(), at[k]->push.data(), -forces[k], nv_);
  mj_solveM(m, d, solve_.data(), row_.data(), 1);
  // Rounds that go in a circle end between its points.
  const double share = round_ > kFullRounds && round_ % 2 ? 0.5 : 1;
  for (int k = 0; k < nv_; k++) now_[k] += share * (solve_[k] - now_[k]);
  Evaluate(m, d);
  for (std::size_t k = 0; k < at.size(); k++) Moment(d, at[k]->output, forces[k], row_.data());
  double misfit = 0, size = 0;
  for (int k = 0; k < nv_; k++) {
    if (!felt_[m->dof_treeid[k]]) continue;
    const double line = row_[k] - push_[k];
    misfit = std::max(misfit, std::fabs(d->qfrc_constraint[k] - line));
    size = std::max({size, std::fabs(line), std::fabs(push_[k])});
  }
  if (!(misfit > 1e-9 * size)) return true;
  Linearise(m, d);
  return false;
}

}  // namespace mrdamp

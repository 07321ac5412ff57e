#include "mujoco/damper.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <type_traits>

#include "core/config.h"
#include "core/solve.h"
#include "core/weight.h"
#include "effects/mount.h"

namespace mrdamp {

namespace {

// Layout of plugin_state: a flag (0: not started), time, length, velocity and command of the last step's start,
// the chain's state there, then the delay line and the network's past where the attributes ask for them.
constexpr int kSnapshot = 5;
constexpr int kLineSize = sizeof(DelayLine) / sizeof(double);
constexpr int kPastSize = sizeof(NarxHistory) / sizeof(double);

bool Given(const mjModel* m, int instance, const char* name) {
  const char* value = AttributeOf(m, instance, name);
  return value && *value;
}

bool HasLine(const mjModel* m, int instance) { return Given(m, instance, "command_delay_d"); }

bool HasPast(const mjModel* m, int instance) {
  const char* law = AttributeOf(m, instance, "law");
  return law && !std::strcmp(law, "narx");
}

int StateSize(const mjModel* m, int instance) {
  return kSnapshot + kChainSize + (HasLine(m, instance) ? kLineSize : 0) + (HasPast(m, instance) ? kPastSize : 0);
}

int AttributeEnd(const mjModel* m, int instance) {
  return instance + 1 < m->nplugin ? m->plugin_attradr[instance + 1] : static_cast<int>(m->npluginattr);
}

DamperInstance* Data(const mjData* d, int instance) {
  return reinterpret_cast<DamperInstance*>(d->plugin_data[instance]);
}

bool IsDamper(const mjModel* m, int instance) {
  const mjpPlugin* plugin = mjp_getPluginAtSlot(m->plugin[instance]);
  return plugin && !std::strcmp(plugin->name, kDamperName);
}

// The stores are plain doubles, as their sizes assert.
template <class Store>
void Load(Store* to, const double* from) {
  static_assert(std::is_trivially_copyable_v<Store> && sizeof(Store) % sizeof(double) == 0);
  std::memcpy(static_cast<void*>(to), from, sizeof(Store));
}

double Dot(const mjData* d, int output, const double* x) {
  double sum = 0;
  const int begin = d->moment_rowadr[output], count = d->moment_rownnz[output];
  for (int k = begin; k < begin + count; k++) sum += d->actuator_moment[k] * x[d->moment_colind[k]];
  return sum;
}

}  // namespace

const char* AttributeOf(const mjModel* m, int instance, const char* name) { return mj_getPluginConfig(m, instance, name); }

std::string Describe(const mjModel* m, int object_type, const char* kind, int id) {
  const char* name = id >= 0 ? mj_id2name(m, object_type, id) : nullptr;
  if (name && *name) return std::string(kind) + " '" + name + "'";
  return std::string(kind) + " " + std::to_string(id);
}

const DamperInstance* DamperOf(const mjModel* m, const mjData* d, int actuator) {
  const int instance = m->actuator_plugin[actuator];
  return instance >= 0 && IsDamper(m, instance) ? Data(d, instance) : nullptr;
}

bool DamperInstance::Parse(const mjModel* m, std::string* error) {
  const int begin = m->plugin_attradr[instance_], end = AttributeEnd(m, instance_);
  attributes_.assign(m->plugin_attr + begin, m->plugin_attr + end);
  const Lookup config = [&](const char* name) { return AttributeOf(m, instance_, name); };
  const Lookup text = [&](const char* name) -> const char* {
    const int id = mj_name2id(m, mjOBJ_TEXT, name);
    return id < 0 ? nullptr : m->text_data + m->text_adr[id];
  };
  if (!ParseDamper(config, text, &damper_, &net_, error)) return false;
  if (damper_.law == Law::kNarx && !HasPast(m, instance_)) return false;
  damper_.hold = true;
  mount_ = HasMount(damper_.p);
  return true;
}

std::unique_ptr<DamperInstance> DamperInstance::Make(const mjModel* m, int instance, std::string* error) {
  std::unique_ptr<DamperInstance> made(new DamperInstance);
  made->instance_ = instance;
  int count = 0;
  for (int i = 0; i < m->nactuator; i++) {
    if (m->actuator_plugin[i] != instance) continue;
    made->actuator_ = i;
    count++;
  }
  const std::string who = count ? Describe(m, mjOBJ_ACTUATOR, "actuator", made->actuator_)
                                : Describe(m, mjOBJ_PLUGIN, "plugin instance", instance);
  const int a = made->actuator_;
  if (count == 0) {
    *error = who + ": no actuator uses this damper; add <actuator><plugin plugin=\"mrdamp.damper\" instance=.../>";
    return nullptr;
  }
  if (count > 1) {
    *error = who + ": " + std::to_string(count) + " actuators share one damper; give each its own instance";
    return nullptr;
  }
  if (m->actuator_actnum[a] != 0) {
    *error = who + ": actdim = " + std::to_string(m->actuator_actnum[a]) +
             "; the damper keeps its own state, leave actdim and dyntype out (0)";
    return nullptr;
  }
  if (m->actuator_outnum[a] != 1 || m->actuator_ctrlnum[a] != 1) {
    *error = who + ": the transmission has " + std::to_string(m->actuator_outnum[a]) +
             " outputs; allowed: a slide or hinge joint, a tendon or a site with one direction";
    return nullptr;
  }
  made->output_ = m->actuator_outadr[a];
  std::string why;
  if (!made->Parse(m, &why)) {
    *error = who + ": " + why;
    return nullptr;
  }
  for (int i = 0; i < m->nplugin; i++) {
    if (IsDamper(m, i)) made->peers_.push_back(i);
  }
  for (int i = 0; i < m->nactuator; i++) {
    if (m->actuator_plugin[i] < 0 || !IsDamper(m, m->actuator_plugin[i])) made->others_.push_back(i);
  }
  made->inverse_.resize(m->nv);
  if (HasLine(m, instance)) made->now_.line = &made->line_;
  if (HasPast(m, instance)) {
    made->now_.past = &made->past_;
    made->trial_.past = &made->trial_past_;
  }
  made->trial_.line = made->now_.line;
  return made;
}

void DamperInstance::Refresh(const mjModel* m) {
  const char* begin = m->plugin_attr + m->plugin_attradr[instance_];
  const std::size_t size = AttributeEnd(m, instance_) - m->plugin_attradr[instance_];
  if (size == attributes_.size() && !std::memcmp(begin, attributes_.data(), size)) return;
  char line[400];
  {
    std::string error;
    if (Parse(m, &error)) {
      if ((damper_.law != Law::kNarx || now_.past) && (damper_.p.command_delay_d == 0 || now_.line)) return;
      error = "the state laid out at compile time has no room for this law or delay; compile the model again";
    }
    std::snprintf(line, sizeof line, "%s: %s", Describe(m, mjOBJ_ACTUATOR, "actuator", actuator_).c_str(), error.c_str());
  }
  mju_error("%s", line);
}

void DamperInstance::CatchUp(const mjModel* m, const mjData* d) {
  const double* s = d->plugin_state + m->plugin_stateadr[instance_];
  const int control = m->actuator_ctrladr[actuator_];
  const double delay = m->actuator_delay[actuator_];
  double buffer = 0;
  x_ = d->actuator_length[output_];
  v_ = d->actuator_velocity[output_];
  u_ = d->ctrl[control];
  if (delay > 0) {
    const mjtNum* late = mj_readCtrl(m, d, actuator_, d->time, &buffer, m->actuator_history[2 * actuator_ + 1]);
    u_ = late ? *late : buffer;
  }
  if (m->actuator_ctrllimited[control] && !(m->opt.disableflags & mjDSBL_CLAMPCTRL)) {
    u_ = std::clamp(u_, m->actuator_ctrlrange[2 * control], m->actuator_ctrlrange[2 * control + 1]);
  }
  if (!std::isfinite(u_)) u_ = 0;
  time_ = d->time;
  if (s[0] == 0) {
    Start(damper_, &now_, x_, v_, u_);
  } else {
    Load(&now_.c, s + kSnapshot);
    int at = kSnapshot + kChainSize;
    if (now_.line) {
      Load(now_.line, s + at);
      at += kLineSize;
    }
    if (now_.past) Load(now_.past, s + at);
    double dt = d->time - s[1];
    // A clock set by hand: one step on, rather than an hour of it.
    if (dt > 4 * m->opt.timestep) dt = m->opt.timestep;
    if (dt > 0) {
      mrdamp::Advance(damper_, &now_, {s[2], s[3], x_, v_, dt}, s[4], s[4]);
      if (now_.line) now_.line->Push(now_.c.time, damper_.Clamp(u_), damper_.p.command_delay_d);
    }
  }
  seen_ = Observe(damper_, now_, x_, v_, 0, u_);
}

// Force without the moving mass when a part of the step has gone by and the velocity is v.
double DamperInstance::Trial(double v, double h) {
  const State* s = &now_;
  double x = x_;
  if (h > 0) {
    s = &trial_;
    trial_.c = now_.c;
    if (trial_.past) trial_past_ = past_;
    x += h * v;
    mrdamp::Advance(damper_, &trial_, {x_, v_, x, v, h}, u_, u_);
  }
  const Observation o = Observe(damper_, *s, x, v, 0, u_);
  return mount_ ? o.force : o.damper;
}

// Mean force over the step with v1 = free - h w F, F = (1 - weight) F0 + weight F(v1) + m (v1 - v0) / h.
//
// The engine's Euler step is a leapfrog: velocities stand half a step before positions, so the force that it
// takes belongs to the position at the start of the step and the mean of both velocities. Where the damper is
// soft against the mass (q = h w dF/dv small) F(v1) is therefore the present state's force at v1; the stiffer it
// is, the more of the step the state is taken through before, and the more F(v1) counts (core/weight.h).
double DamperInstance::SolveStep(double free_velocity, double mobility, double h) {
  const double start = mount_ ? seen_.force : seen_.damper;
  const double mass = mount_ ? 0 : damper_.p.moving_mass_m;
  if (!(mobility > 0)) return start;
  const double q = h * mobility;
  // With a moving mass the force without it acts on the heavier body.
  const double heavier = 1 / (1 + mobility * mass);
  const double free = v_ + (free_velocity - v_) * heavier, qm = q * heavier;
  // The slope over all that the step may bring: from no force to the present force.
  const double va = free, fa = Trial(va, h), vb = free - qm * fa;
  double slope = std::max(seen_.slope, 0.0);
  if (std::fabs(vb - va) > 1e-12 * (std::fabs(va) + std::fabs(vb)) + 1e-15) {
    slope = std::max((Trial(vb, h) - fa) / (vb - va), slope);
  }
  const double weight = EndWeight(qm * slope);
  const double part = weight > 0.501 ? (2 * weight - 1) * h : 0;
  // In units of force; increasing in v wherever the law is.
  const auto residual = [&](double v) { return (v - free) / qm + (1 - weight) * start + weight * Trial(v, part); };
  const double guess = free - qm * ((1 - weight) * start + weight * fa) / (1 + weight * qm * slope);
  const double tolerance = 1e-6 * (std::fabs(start) + std::fabs(fa)) + 1e-9;
  const double v1 = SolveIncreasing(residual, guess, 1 / qm + weight * slope, tolerance);
  return (free_velocity - v1) / q;
}

void DamperInstance::Compute(const mjModel* m, mjData* d) {
  const double h = m->opt.timestep;
  const int n = static_cast<int>(peers_.size());
  for (int i : peers_) {
    DamperInstance* p = Data(d, i);
    p->Refresh(m);
    p->CatchUp(m, d);
    const int group = m->actuator_group[p->actuator_];
    p->force_ = group >= 0 && group < 31 && (m->opt.disableactuator & (1 << group)) ? 0 : p->seen_.force;
  }
  if (m->opt.integrator != mjINT_RK4) {
    bool damping = false;
    for (int k = 0; k < m->nv && !damping; k++) damping = m->dof_damping[k] > 0;
    bool applied = false;
    for (int k = 6; k < 6 * m->nbody && !applied; k++) applied = d->xfrc_applied[k] != 0;
    std::vector<double>& push = push_;
    push.resize(m->nv);
    for (int k = 0; k < m->nv; k++) push[k] = d->qfrc_passive[k] + d->qfrc_applied[k] - d->qfrc_bias[k];
    for (int b = 1; applied && b < m->nbody; b++) {
      const mjtNum* f = d->xfrc_applied + 6 * b;
      mj_applyFT(m, d, f, f + 3, d->xipos + 3 * b, b, push.data());
    }
    // Actuators that are no damper have their force already.
    for (int a : others_) {
      for (int o = m->actuator_outadr[a]; o < m->actuator_outadr[a] + m->actuator_outnum[a]; o++) {
        const double force = d->actuator_force[o];
        if (force == 0) continue;
        const int begin = d->moment_rowadr[o];
        for (int k = begin; k < begin + d->moment_rownnz[o]; k++) push[d->moment_colind[k]] += d->actuator_moment[k] * force;
      }
    }
    for (int i : peers_) {
      DamperInstance* p = Data(d, i);
      std::vector<double>& x = p->inverse_;
      std::vector<double>& row = row_;
      row.assign(m->nv, 0.0);
      const int begin = d->moment_rowadr[p->output_];
      for (int k = begin; k < begin + d->moment_rownnz[p->output_]; k++) row[d->moment_colind[k]] = d->actuator_moment[k];
      mj_solveM(m, d, x.data(), row.data(), 1);
      // Euler and the implicit integrators treat joint damping implicitly: (M + h D) instead of M, by one
      // correction where h D is small; where it is not, the larger mobility only damps less.
      if (damping) {
        double size = 0, change = 0;
        for (int k = 0; k < m->nv; k++) {
          const double y = h * m->dof_damping[k] * x[k];
          size += row[k] * x[k];
          change += y * x[k];
          row[k] = y;
        }
        if (change < 0.3 * size) {
          std::vector<double>& y = solve_;
          y.resize(m->nv);
          mj_solveM(m, d, y.data(), row.data(), 1);
          for (int k = 0; k < m->nv; k++) x[k] -= y[k];
        }
      }
      double free = p->v_;
      for (int k = 0; k < m->nv; k++) free += h * x[k] * push[k];
      p->free_ = free;
    }
    // Dampers that act on each other: Gauss-Seidel over their forces.
    for (int sweep = 0; sweep < (n > 1 ? 60 : 1); sweep++) {
      double moved = 0, size = 0;
      for (int i : peers_) {
        DamperInstance* p = Data(d, i);
        const int group = m->actuator_group[p->actuator_];
        if (group >= 0 && group < 31 && (m->opt.disableactuator & (1 << group))) continue;
        double free = p->free_;
        for (int j : peers_) {
          const DamperInstance* o = Data(d, j);
          if (j != i) free -= h * Dot(d, o->output_, p->inverse_.data()) * o->force_;
        }
        const double force = p->SolveStep(free, Dot(d, p->output_, p->inverse_.data()), h);
        moved = std::max(moved, std::fabs(force - p->force_));
        size = std::max(size, std::fabs(force));
        p->force_ = force;
      }
      if (!(moved > 1e-7 * size)) break;
    }
  }
  for (int i : peers_) {
    const DamperInstance* p = Data(d, i);
    d->actuator_force[p->output_] = -p->force_;
  }
}

void DamperInstance::Advance(const mjModel* m, mjData* d) {
  double* s = d->plugin_state + m->plugin_stateadr[instance_];
  s[0] = 1;
  s[1] = time_;
  s[2] = x_;
  s[3] = v_;
  s[4] = u_;
  std::memcpy(s + kSnapshot, &now_.c, sizeof(ChainState));
  int at = kSnapshot + kChainSize;
  if (now_.line) {
    std::memcpy(s + at, now_.line, sizeof(DelayLine));
    at += kLineSize;
  }
  if (now_.past) std::memcpy(s + at, now_.past, sizeof(NarxHistory));
}

void DamperInstance::Register() {
  static std::vector<const char*> attributes = [] {
    std::vector<const char*> names{"law", "weights"};
    for (const Attribute& a : kAttributes) names.push_back(a.name);
    return names;
  }();
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = kDamperName;
  plugin.capabilityflags = mjPLUGIN_ACTUATOR;
  plugin.nattribute = static_cast<int>(attributes.size());
  plugin.attributes = attributes.data();
  plugin.nstate = StateSize;
  plugin.init = [](const mjModel* m, mjData* d, int instance) {
    char line[400];
    {
      std::string error;
      if (std::unique_ptr<DamperInstance> made = DamperInstance::Make(m, instance, &error)) {
        d->plugin_data[instance] = reinterpret_cast<uintptr_t>(made.release());
        return 0;
      }
      std::snprintf(line, sizeof line, "%s", error.c_str());
    }
    mju_warning("%s", line);
    return -1;
  };
  plugin.destroy = [](mjData* d, int instance) {
    delete Data(d, instance);
    d->plugin_data[instance] = 0;
  };
  plugin.reset = [](const mjModel* m, mjtNum* state, void*, int instance) {
    std::fill_n(state, m->plugin_statenum[instance], 0.0);
  };
  plugin.compute = [](const mjModel* m, mjData* d, int instance, int) {
    DamperInstance* damper = Data(d, instance);
    if (damper->peers_.front() == instance) damper->Compute(m, d);
  };
  plugin.advance = [](const mjModel* m, mjData* d, int instance) { Data(d, instance)->Advance(m, d); };
  mjp_registerPlugin(&plugin);
}

}  // namespace mrdamp

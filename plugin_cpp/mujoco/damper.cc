#include "mujoco/damper.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <type_traits>

#include "core/balance.h"
#include "core/config.h"
#include "effects/mechanics.h"
#include "effects/mount.h"
#include "mujoco/plugin.h"

namespace mrdamp {

namespace {

// Layout of plugin_state: the last step's start, then the delay line and the network's past where the attributes ask for
// them.
constexpr int kStartSize = sizeof(StepStart) / sizeof(double);
constexpr int kLineSize = sizeof(DelayLine) / sizeof(double);
constexpr int kPastSize = sizeof(NarxHistory) / sizeof(double);

bool Given(const mjModel* m, int instance, const char* name) {
  const char* value = AttributeOf(m, instance, name);
  return value && *value;
}

bool HasLine(const mjModel* m, int instance) { return Given(m, instance, "command_delay_d") || Given(m, instance, "command_delay_period"); }

bool HasPast(const mjModel* m, int instance) {
  const char* law = AttributeOf(m, instance, "law");
  return law && !std::strcmp(law, "narx");
}

int StateSize(const mjModel* m, int instance) {
  return kStartSize + (HasLine(m, instance) ? kLineSize : 0) + (HasPast(m, instance) ? kPastSize : 0);
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

}  // namespace

const char* AttributeOf(const mjModel* m, int instance, const char* name) { return mj_getPluginConfig(m, instance, name); }

std::string Describe(const mjModel* m, int object_type, const char* kind, int id) {
  const char* name = id >= 0 ? mj_id2name(m, object_type, id) : nullptr;
  if (name && *name) return std::string(kind) + " '" + name + "'";
  return std::string(kind) + " " + std::to_string(id);
}

DamperInstance* DamperOf(const mjModel* m, const mjData* d, int actuator) {
  const int instance = m->actuator_plugin[actuator];
  return instance >= 0 && IsDamper(m, instance) ? Data<DamperInstance>(d, instance) : nullptr;
}

bool DamperInstance::Parse(const mjModel* m, std::string* error) {
  KeepAttributes(m, instance_, &attributes_);
  const Lookup config = [&](const char* name) { return AttributeOf(m, instance_, name); };
  const Lookup text = [&](const char* name) -> const char* {
    const int id = mj_name2id(m, mjOBJ_TEXT, name);
    return id < 0 ? nullptr : m->text_data + m->text_adr[id];
  };
  if (!ParseDamper(config, text, &damper_, &net_, error)) return false;
  damper_.hold = true;
  steps_ = StepsFor(damper_);
  return true;
}

std::unique_ptr<DamperInstance> DamperInstance::Make(const mjModel* m, int instance, std::string* error) {
  std::unique_ptr<DamperInstance> made(new DamperInstance);
  made->instance_ = instance;
  made->at_.damper = &made->damper_;
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
  const int transmission = m->actuator_trntype[a], target = m->actuator_trnid[2 * a];
  const bool joint = transmission == mjTRN_JOINT || transmission == mjTRN_JOINTINPARENT;
  if (joint ? m->jnt_type[target] != mjJNT_SLIDE && m->jnt_type[target] != mjJNT_HINGE
            : transmission != mjTRN_TENDON && transmission != mjTRN_SITE && transmission != mjTRN_SLIDERCRANK) {
    *error = who + ": this transmission has no length; allowed: a slide or hinge joint, a tendon, a site or a slider-crank";
    return nullptr;
  }
  // Ports of the engine that do not know plugins would take a motor in its place, with the control as its force; MJX
  // refuses this type of bias. The engine itself does not look at it in an actuator of a plugin.
  if (m->actuator_biastype[a] != mjBIAS_USER) const_cast<mjModel*>(m)->actuator_biastype[a] = mjBIAS_USER;
  // The engine gives no length along a site's own axes: it is the path of the velocity then.
  made->integrate_ = transmission == mjTRN_SITE && m->actuator_trnid[2 * a + 1] < 0;
  made->output_ = m->actuator_outadr[a];
  made->turns_ = !joint && !(transmission == mjTRN_TENDON && m->wrap_type[m->tendon_adr[target]] == mjWRAP_JOINT);
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
  if (HasLine(m, instance)) made->at_.now.line = &made->line_;
  if (HasPast(m, instance)) {
    made->at_.now.past = &made->past_;
    made->at_.trial.past = &made->trial_past_;
  }
  made->at_.trial.line = made->at_.now.line;
  return made;
}

void DamperInstance::Refresh(const mjModel* m) {
  if (!AttributesChanged(m, instance_, attributes_)) return;
  char line[400];
  {
    std::string error;
    if (Parse(m, &error)) {
      if ((damper_.law != Law::kNarx || at_.now.past) && (!HasDelay(damper_.p) || at_.now.line)) return;
      error = "the state laid out at compile time has no room for this law or delay; compile the model again";
    }
    std::snprintf(line, sizeof line, "%s: %s", Describe(m, mjOBJ_ACTUATOR, "actuator", actuator_).c_str(), error.c_str());
  }
  mju_error("%s", line);
}

void DamperInstance::Watch(const mjData* d) {
  if (!integrate_) at_.x = d->actuator_length[output_];
  at_.v = Along(d, output_, d->qvel);
  at_.time = d->time;
}

void DamperInstance::CatchUp(const mjModel* m, const mjData* d) {
  const double* s = d->plugin_state + m->plugin_stateadr[instance_];
  const int control = m->actuator_ctrladr[actuator_];
  const double delay = m->actuator_delay[actuator_], h = m->opt.timestep, before = at_.v;
  const bool stages = m->opt.integrator == mjINT_RK4;
  double buffer = 0, u = d->ctrl[control];
  Watch(d);
  if (delay > 0) {
    const mjtNum* late = mj_readCtrl(m, d, actuator_, d->time, &buffer, m->actuator_history[2 * actuator_ + 1]);
    u = late ? *late : buffer;
  }
  if (m->actuator_ctrllimited[control] && !(m->opt.disableflags & mjDSBL_CLAMPCTRL)) {
    u = std::clamp(u, m->actuator_ctrlrange[2 * control], m->actuator_ctrlrange[2 * control + 1]);
  }
  at_.u = std::isfinite(u) ? u : 0;
  StepStart start;
  Load(&start, s);
  const auto within = [&](double clock) { return d->time >= clock && d->time <= clock + (1 + 1e-6) * h; };
  // The state is stored after the last stage of a step: the later stages of the first one go on from its first stage.
  if (stages && start.started == 0 && !first_.empty() && d->time > first_clock_ && within(first_clock_)) Load(&start, s = first_.data());
  int at = kStartSize;
  if (at_.now.line) {
    Load(at_.now.line, s + at);
    at += kLineSize;
  }
  if (at_.now.past) Load(at_.now.past, s + at);
  // Steps are counted: a program may set the engine's clock. The stages within a step are told by it.
  if (start.started != 0) at_.time = start.time + start.step + (stages && within(start.clock) ? d->time - start.clock : 0);
  // The engine moves positions at the velocity of the step's end, and in a stage of Runge-Kutta at that of the stage before.
  if (integrate_) at_.x = start.started == 0 ? 0 : start.x + (at_.time - start.time) * (stages ? before : at_.v);
  steps_->catch_up(&at_, &start, h);
  if (stages && start.started == 0) {
    first_.resize(StateSize(m, instance_));
    Store(first_.data(), at_.Stored(at_.v, 0, d->time));
    first_clock_ = d->time;
  }
}

void DamperInstance::Store(double* to, const StepStart& start) const {
  std::memcpy(to, &start, sizeof start);
  int at = kStartSize;
  if (at_.now.line) {
    std::memcpy(to + at, at_.now.line, sizeof(DelayLine));
    at += kLineSize;
  }
  if (at_.now.past) std::memcpy(to + at, at_.now.past, sizeof(NarxHistory));
}

double DamperInstance::Turning(const mjModel* m, const mjData* d) {
  if (!turns_ || !(Mass() > 0)) return 0;
  constexpr double kAhead = 1e-7;  // s
  if (!ahead_) ahead_.reset(mj_makeData(m));
  mjData* a = ahead_.get();
  mju_copy(a->qpos, d->qpos, m->nq);
  mju_copy(a->mocap_pos, d->mocap_pos, 3 * m->nmocap);
  mju_copy(a->mocap_quat, d->mocap_quat, 4 * m->nmocap);
  mj_integratePos(m, a->qpos, d->qvel, kAhead);
  mj_kinematics(m, a);
  mj_comPos(m, a);
  mj_tendon(m, a);
  mj_transmission(m, a);
  return (Along(a, output_, d->qvel) - at_.v) / kAhead;
}

bool DamperInstance::Acts(const mjModel* m) const {
  const int group = m->actuator_group[actuator_];
  const bool off = group >= 0 && group < 31 && (m->opt.disableactuator & (1 << group));
  return !off && !(m->opt.disableflags & mjDSBL_ACTUATION);
}

double DamperInstance::Applied(const mjModel* m, const mjData* d) const {
  const double force = -d->actuator_force[output_];
  const int type = m->actuator_trntype[actuator_], joint = m->actuator_trnid[2 * actuator_];
  if ((type != mjTRN_JOINT && type != mjTRN_JOINTINPARENT) || !m->jnt_actfrclimited[joint]) return force;
  const int dof = m->jnt_dofadr[joint];
  for (int o = 0; o < m->nout; o++) {
    if (o == output_ || d->actuator_force[o] == 0) continue;
    for (int k = d->moment_rowadr[o]; k < d->moment_rowadr[o] + d->moment_rownnz[o]; k++) {
      if (d->moment_colind[k] == dof) return force;
    }
  }
  const double gear = d->actuator_moment[d->moment_rowadr[output_]];
  return d->qfrc_actuator[dof] == -gear * force ? force : -d->qfrc_actuator[dof] / gear;
}

void DamperInstance::Compute(const mjModel* m, mjData* d) {
  const double h = m->opt.timestep;
  const bool explicit_step = m->opt.integrator == mjINT_RK4;
  bool mass = false;
  acting_.clear();
  for (int i : peers_) {
    DamperInstance* p = Data<DamperInstance>(d, i);
    p->Refresh(m);
    p->CatchUp(m, d);
    p->force_ = 0;
    if (!p->Acts(m)) continue;
    acting_.push_back(p);
    p->force_ = explicit_step ? p->at_.seen.force : p->at_.start.force;
    p->turn_ = p->Mass() * p->Turning(m, d);
    mass |= p->Mass() > 0;
  }
  const std::size_t n = acting_.size();
  if (n > 0 && (!explicit_step || mass)) {
    outputs_.clear();
    responses_.clear();
    for (DamperInstance* p : acting_) {
      outputs_.push_back(p->output_);
      responses_.push_back(&p->response_);
    }
    step_.resize(n);
    weight_.resize(n * n);
    forces_.resize(n);
    mobility_.Update(m, d, others_, outputs_);
    do {
      for (std::size_t k = 0; k < n; k++) {
        DamperInstance* p = acting_[k];
        const Observation& now = explicit_step ? p->at_.seen : p->at_.start;
        mobility_.Respond(m, d, p->output_, &p->response_);
        step_[k] = {{p->at_.v, p->at_.v + h * p->response_.free, now.force, now.slope, p->Mass(), p->response_.bare, &p->at_}, p->steps_};
      }
      for (std::size_t k = 0; k < n; k++) {
        for (std::size_t j = 0; j < n; j++) {
          weight_[k * n + j] = j == k ? responses_[k]->own : mobility_.Weight(*responses_[k], *responses_[j]);
        }
      }
      for (std::size_t k = 0; k < n; k++) {
        for (std::size_t j = 0; j < n; j++) step_[k].free -= h * weight_[k * n + j] * acting_[j]->turn_;
      }
      if (explicit_step) PresentForces(h, step_, weight_, &forces_);
      else SolveStep(h, step_, weight_, &forces_);
      for (std::size_t k = 0; k < n; k++) forces_[k] += acting_[k]->turn_;
    } while (!mobility_.Arrived(m, d, responses_, forces_));
    for (std::size_t k = 0; k < n; k++) acting_[k]->force_ = forces_[k];
  }
  for (int i : peers_) {
    const DamperInstance* p = Data<DamperInstance>(d, i);
    d->actuator_force[p->output_] = -p->force_;
  }
}

void DamperInstance::Advance(const mjModel* m, mjData* d) {
  const bool stages = m->opt.integrator == mjINT_RK4;
  StepStart start = at_.Stored(Along(d, output_, d->qvel), stages ? 0 : m->opt.timestep, d->time);
  // Without actuation the engine does not ask for the force: the damper starts anew when it does.
  start.started = !(m->opt.disableflags & mjDSBL_ACTUATION);
  Store(d->plugin_state + m->plugin_stateadr[instance_], start);
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
  SetLife<DamperInstance>(&plugin);
  plugin.compute = [](const mjModel* m, mjData* d, int instance, int) {
    DamperInstance* damper = Data<DamperInstance>(d, instance);
    if (damper->peers_.front() == instance) damper->Compute(m, d);
  };
  plugin.visualize = [](const mjModel* m, mjData* d, const mjvOption*, mjvScene* scene, int instance) {
    Data<DamperInstance>(d, instance)->Visualize(m, d, scene);
  };
  mjp_registerPlugin(&plugin);
}

}  // namespace mrdamp

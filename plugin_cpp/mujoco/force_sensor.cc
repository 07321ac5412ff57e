#include "mujoco/force_sensor.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "core/config.h"
#include "core/random.h"
#include "mujoco/plugin.h"

namespace mrdamp {

namespace {

struct Option {
  const char* name;
  const char* unit;
  double def, min, max;
};
const Option kOptions[] = {
    {"sensitivity", "pC/N", -158.248, -1e12, 1e12}, {"resolution", "N", 0, 0, kInf}, {"range", "N", 0, 0, kInf},
    {"noise", "N", 0, 0, kInf},                     {"seed", "1", 0, 0, 9007199254740992.0},
};
const char* const kOwn[] = {"sensor_gain_g", "sensor_offset_f", "sensor_leakage_tau", "sensor_lag_tau", "sensor_lag_tau2",
                            "sensor_leakage_share", "sensor_leakage_tau2", "sensor_lag_ratio", "sensor_offset_settle",
                            "sensor_offset_time"};
const char* const kSignalNames[] = {"force",           "charge", "true_force", "applied_force", "unlimited_force", "stroke",
                                    "stroke_velocity", "power",  "energy",     "current",       "field",           "temperature"};

}  // namespace

bool ForceSensorInstance::Parse(const mjModel* m, std::string* error) {
  static_assert(std::size(kSignalNames) == kSignals);
  KeepAttributes(m, instance_, &attributes_);
  const char* signal = AttributeOf(m, instance_, "signal");
  signal_ = kForce;
  if (signal && *signal) {
    const auto* found = std::find_if(std::begin(kSignalNames), std::end(kSignalNames),
                                     [&](const char* name) { return !std::strcmp(name, signal); });
    if (found == std::end(kSignalNames)) {
      *error = "attribute 'signal' = '" + std::string(signal).substr(0, 60) + "'; allowed:";
      for (const char* name : kSignalNames) *error += std::string(" ") + name;
      return false;
    }
    signal_ = static_cast<int>(found - kSignalNames);
  }
  const auto number = [&](const char* name, const char* unit, double lo, double hi, double* value) {
    const char* text = AttributeOf(m, instance_, name);
    if (!text || !*text) return true;
    std::string why;
    char line[200];
    if (!ParseNumber(text, value, &why)) {
      *error = "attribute '" + std::string(name) + "' = " + why + "; allowed: a number (" + unit + ")";
      return false;
    }
    if (*value < lo || *value > hi) {
      std::snprintf(line, sizeof line, "attribute '%s' = %.9g is outside [%g, %g] %s", name, *value, lo, hi, unit);
      *error = line;
      return false;
    }
    return true;
  };
  double values[std::size(kOptions)];
  for (std::size_t i = 0; i < std::size(kOptions); i++) {
    const Option& o = kOptions[i];
    values[i] = o.def;
    if (!number(o.name, o.unit, o.min, o.max, &values[i])) return false;
  }
  for (std::size_t i = 0; i < std::size(kOwn); i++) {
    const Attribute& a = kAttributes[FindAttribute(kOwn[i])];
    own_[i] = kUnset;
    if (!number(a.name, a.unit, a.min, a.max, &own_[i])) return false;
  }
  sensitivity_ = values[0];
  resolution_ = values[1];
  range_ = values[2];
  noise_ = values[3];
  if (values[4] != std::floor(values[4])) {
    *error = "attribute 'seed' = '" + std::string(AttributeOf(m, instance_, "seed")) + "' is not a whole number";
    return false;
  }
  seed_ = static_cast<std::uint64_t>(values[4]);
  if (sensitivity_ == 0) {
    *error = "attribute 'sensitivity' is 0; allowed: any other number (pC/N)";
    return false;
  }
  return true;
}

std::unique_ptr<ForceSensorInstance> ForceSensorInstance::Make(const mjModel* m, int instance, std::string* error) {
  auto made = std::make_unique<ForceSensorInstance>();
  made->instance_ = instance;
  int count = 0;
  for (int i = 0; i < m->nsensor; i++) {
    if (m->sensor_type[i] != mjSENS_PLUGIN || m->sensor_plugin[i] != instance) continue;
    made->sensor_ = i;
    count++;
  }
  if (count != 1) {
    *error = Describe(m, mjOBJ_PLUGIN, "plugin instance", instance) + ": " + std::to_string(count) +
             " sensors use this force sensor; each needs its own instance";
    return nullptr;
  }
  const std::string who = Describe(m, mjOBJ_SENSOR, "sensor", made->sensor_);
  const int type = m->sensor_objtype[made->sensor_], id = m->sensor_objid[made->sensor_];
  const mjpPlugin* damper = mjp_getPlugin(kDamperName, nullptr);
  const int plugin = type == mjOBJ_ACTUATOR && id >= 0 ? m->actuator_plugin[id] : -1;
  if (plugin < 0 || mjp_getPluginAtSlot(m->plugin[plugin]) != damper) {
    *error = who + ": objtype and objname name no mrdamp.damper; allowed: objtype=\"actuator\" objname=\"NAME\" of one";
    return nullptr;
  }
  made->actuator_ = id;
  std::string why;
  if (!made->Parse(m, &why)) {
    *error = who + ": " + why;
    return nullptr;
  }
  return made;
}

void ForceSensorInstance::Refresh(const mjModel* m) {
  if (!AttributesChanged(m, instance_, attributes_)) return;
  char line[400];
  {
    std::string error;
    if (Parse(m, &error)) return;
    std::snprintf(line, sizeof line, "%s: %s", Describe(m, mjOBJ_SENSOR, "sensor", sensor_).c_str(), error.c_str());
  }
  mju_error("%s", line);
}

// What stands on the sensor itself counts; else what the damper that it reads carries.
SensorParams ForceSensorInstance::Reading(const Params& p) const {
  SensorParams r = SensorParams::Of(p);
  double* const value[] = {&r.gain, &r.offset, &r.leakage, &r.lag, &r.lag2, &r.share, &r.leakage2, &r.ratio,
                           &r.settle, &r.settle_time};
  static_assert(std::size(value) == std::size(kOwn));
  for (std::size_t i = 0; i < std::size(kOwn); i++) {
    if (!std::isnan(own_[i])) *value[i] = own_[i];
  }
  return r;
}

// Standard normal number of the step `count`: a function of seed, sensor and step alone, so that the same
// trajectory has the same noise after reset, copy and restore.
double ForceSensorInstance::Noise(double count) const {
  const std::uint64_t key = Mix(seed_ ^ Mix(static_cast<std::uint64_t>(sensor_) + 1));
  return Normal(key, static_cast<std::uint64_t>(count));
}

void ForceSensorInstance::Compute(const mjModel* m, mjData* d) {
  Refresh(m);
  DamperInstance* damper = DamperOf(m, d, actuator_);
  const double acceleration = Along(d, m->actuator_outadr[actuator_], d->qacc);
  const bool acts = damper->Acts(m);
  if (!acts) damper->Watch(d);
  const double own = acts ? damper->Force(acceleration) : 0, applied = acts ? damper->Applied(m, d) : 0;
  const double force = applied == damper->exerted() ? own : applied;  // where a limit acts it is the limit
  const double jump = acts && force == own ? damper->Jump() : 0;
  const SensorParams reading = Reading(damper->damper().p);
  Stored s;
  std::memcpy(static_cast<void*>(&s), d->plugin_state + m->plugin_stateadr[instance_], sizeof s);
  if (s.started == 0) {
    s.sensor.Start(reading, force);
    s.count = s.energy = 0;
  } else {
    double dt = d->time - s.time;
    if (dt > 4 * m->opt.timestep) dt = m->opt.timestep;
    if (dt > 0) {
      s.sensor.Step(reading, force - jump, dt);
      s.sensor.Step(reading, force, 0);
      // Runge-Kutta's force is that of the state, the others' the mean over the step.
      const double mean = m->opt.integrator == mjINT_RK4 ? 0.5 * (s.applied + applied) : s.applied;
      s.energy += mean * 0.5 * (s.velocity + damper->velocity()) * dt;
    }
  }
  s.started = 1;
  s.time = d->time;
  s.velocity = damper->velocity();
  s.applied = applied;
  next_ = s;
  double value = 0;
  switch (signal_) {
    case kForce:
    case kCharge:
      value = s.sensor.Read(reading);
      if (noise_ > 0) value += noise_ * Noise(s.count);
      if (resolution_ > 0) value = resolution_ * std::nearbyint(value / resolution_);
      if (range_ > 0) value = std::clamp(value, -range_, range_);
      if (signal_ == kCharge) value *= sensitivity_;  // Eq. (3): F = Q / k
      break;
    case kTrueForce: value = force; break;
    case kAppliedForce: value = applied; break;
    case kUnlimitedForce: value = own; break;
    case kPower: value = force * damper->velocity(); break;
    case kEnergy: value = s.energy; break;
    case kStroke: {
      // channel_shift: the channel reads x(t - d), to second order.
      const double shift = damper->damper().p.channel_shift_d;
      value = damper->length() - shift * (damper->velocity() - 0.5 * shift * acceleration);
      break;
    }
    case kStrokeVelocity: value = damper->velocity(); break;
    case kCurrent: value = damper->seen().current; break;
    case kField: value = damper->seen().field; break;
    default: value = damper->seen().temperature;
  }
  d->sensordata[m->sensor_adr[sensor_]] = value;
}

void ForceSensorInstance::Advance(const mjModel* m, mjData* d) {
  next_.count += 1;
  std::memcpy(d->plugin_state + m->plugin_stateadr[instance_], &next_, sizeof next_);
}

void ForceSensorInstance::Register() {
  static std::vector<const char*> attributes = [] {
    std::vector<const char*> names{"signal"};
    for (const Option& o : kOptions) names.push_back(o.name);
    for (const char* name : kOwn) names.push_back(name);
    return names;
  }();
  mjpPlugin plugin;
  mjp_defaultPlugin(&plugin);
  plugin.name = kForceSensorName;
  plugin.capabilityflags = mjPLUGIN_SENSOR;
  plugin.needstage = mjSTAGE_ACC;
  plugin.nattribute = static_cast<int>(attributes.size());
  plugin.attributes = attributes.data();
  plugin.nstate = [](const mjModel*, int) { return static_cast<int>(sizeof(Stored) / sizeof(double)); };
  plugin.nsensordata = [](const mjModel*, int, int) { return 1; };
  SetLife<ForceSensorInstance>(&plugin);
  plugin.compute = [](const mjModel* m, mjData* d, int instance, int) { Data<ForceSensorInstance>(d, instance)->Compute(m, d); };
  mjp_registerPlugin(&plugin);
}

}  // namespace mrdamp

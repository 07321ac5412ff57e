#include "mujoco/force_sensor.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>

#include "core/config.h"
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
  reading_.signal = kForce;
  if (signal && *signal) {
    const auto* found = std::find_if(std::begin(kSignalNames), std::end(kSignalNames),
                                     [&](const char* name) { return !std::strcmp(name, signal); });
    if (found == std::end(kSignalNames)) {
      *error = "attribute 'signal' = '" + std::string(signal).substr(0, 60) + "'; allowed:";
      for (const char* name : kSignalNames) *error += std::string(" ") + name;
      return false;
    }
    reading_.signal = static_cast<int>(found - kSignalNames);
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
  reading_ = {reading_.signal, values[0], values[1], values[2], values[3], 0};
  if (values[4] != std::floor(values[4])) {
    *error = "attribute 'seed' = '" + std::string(AttributeOf(m, instance_, "seed")) + "' is not a whole number";
    return false;
  }
  reading_.key = Mix(static_cast<std::uint64_t>(values[4]) ^ Mix(static_cast<std::uint64_t>(sensor_) + 1));
  if (reading_.sensitivity == 0) {
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
SensorParams ForceSensorInstance::Effects(const Params& p) const {
  SensorParams r = SensorParams::Of(p);
  double* const value[] = {&r.gain, &r.offset, &r.leakage, &r.lag, &r.lag2, &r.share, &r.leakage2, &r.ratio,
                           &r.settle, &r.settle_time};
  static_assert(std::size(value) == std::size(kOwn));
  for (std::size_t i = 0; i < std::size(kOwn); i++) {
    if (!std::isnan(own_[i])) *value[i] = own_[i];
  }
  return r;
}

void ForceSensorInstance::Compute(const mjModel* m, mjData* d) {
  Refresh(m);
  DamperInstance* damper = DamperOf(m, d, actuator_);
  const double acceleration = Along(d, m->actuator_outadr[actuator_], d->qacc);
  const bool acts = damper->Acts(m);
  if (m->opt.disableflags & mjDSBL_ACTUATION) damper->Watch(d);
  const Exerted now{acts ? damper->Force(acceleration) : 0, acts ? damper->Applied(m, d) : 0, acceleration};
  const bool limited = now.applied != damper->exerted() || !acts;
  const SensorParams effects = Effects(damper->damper().p);
  std::memcpy(static_cast<void*>(&next_), d->plugin_state + m->plugin_stateadr[instance_], sizeof next_);
  // Runge-Kutta's force is that of the state, the others' the mean over the step.
  Follow(effects, damper->at(), now, limited, m->opt.integrator != mjINT_RK4, &next_);
  d->sensordata[m->sensor_adr[sensor_]] = Value(reading_, effects, damper->at(), now, limited, next_);
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
  plugin.nstate = [](const mjModel*, int) { return static_cast<int>(sizeof(ReadingState) / sizeof(double)); };
  plugin.nsensordata = [](const mjModel*, int, int) { return 1; };
  SetLife<ForceSensorInstance>(&plugin);
  plugin.compute = [](const mjModel* m, mjData* d, int instance, int) { Data<ForceSensorInstance>(d, instance)->Compute(m, d); };
  mjp_registerPlugin(&plugin);
}

}  // namespace mrdamp

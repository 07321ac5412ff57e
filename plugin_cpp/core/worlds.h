// Dampers in many copies of a model (worlds), a thread each: the data are MuJoCo Warp's, in float, on a CPU or a GPU.
#ifndef MRDAMP_CORE_WORLDS_H_
#define MRDAMP_CORE_WORLDS_H_

#include "core/balance.h"
#include "core/reading.h"

namespace mrdamp {

// Dampers of a model at most: their steps lie on a thread's stack.
#ifdef MRDAMP_DAMPERS
inline constexpr int kMostDampers = MRDAMP_DAMPERS;
#else
inline constexpr int kMostDampers = 8;
#endif

// Some of one kind in place of a std::vector, which a GPU has not.
template <class T, int most>
struct Few {
  T x[most];
  int n;

  explicit Few(int count) : n(count) {
    for (int i = 0; i < n; i++) x[i] = T();
  }
  int size() const { return n; }
  T& operator[](int i) { return x[i]; }
  const T& operator[](int i) const { return x[i]; }
};

// Two starts of steps: the one before the present instant, and the present as the start of the next. An instant that is
// computed again, as by a call of forward, begins from the former. Zeros to begin with.
struct WorldDamper {
  StepStart last, next;
  double clock = 0;  // the world's time (s), as the engine has it in float
  double force = 0;  // N, after the limits
};
// Optional parts of both, and a network's past in trials.
struct WorldLine {
  DelayLine last, next;
};
struct WorldPast {
  NarxHistory last, next, trial;
};

// All arrays begin with the worlds, row-major. Dampers are numbered from 0; an actuator is a column of the engine's arrays.
struct Worlds {
  int worlds, dampers, actuators, controls, sensors, readings;
  int sets;          // of parameters: 1, or one a world
  double timestep;   // s
  const int* law;            // dampers
  const double* params;      // sets x dampers x attributes, in the order of Params
  const NarxNet* const* net; // dampers; null without networks
  const int* actuator;       // dampers
  const int* control;        // dampers
  const double* control_range;  // dampers x 2
  const double* force_range;    // dampers x 2, N, of the actuator
  WorldDamper* store;        // dampers
  WorldLine* lines;          // dampers; null without a delay
  WorldPast* pasts;          // dampers; null without networks
  // The engine's.
  const float* time;         // s
  const float *length, *velocity;  // actuators; m, m/s
  const float* ctrl;         // controls
  float* force;              // actuators; N
  // Accelerations of the dampers over the step: without any damper's force (dampers, m/s2), for unit forces (dampers x
  // dampers, 1/kg), the same without the implicit damping of joints, and in the end (dampers, m/s2).
  const float *free, *weight, *bare, *acceleration;
  // Sensors: the damper, what is read, its column; effects of the sensor (readings x SensorParams).
  const int *reading_damper, *reading_column;
  const Reading* reading;
  const double *effects, *cutoff;  // cutoff: largest size of a reading; 0: none
  ReadingState* reading_store;  // readings
  float* sensordata;            // sensors
};

namespace worlds {

inline void Fill(const Worlds& a, int world, int k, Damper* d) {
#ifndef MRDAMP_PACK_LAW
  d->law = static_cast<Law>(a.law[k]);
#endif
  const double* p = a.params + (static_cast<std::size_t>(a.sets > 1 ? world : 0) * a.dampers + k) * kParamCount;
  for (int i = 0; i < kParamCount; i++) d->p.data()[i] = p[i];
  d->net = a.net ? a.net[k] : nullptr;
}

// The present of a damper in its world, from what is stored.
inline void Present(const Worlds& a, int world, int k, const Damper& d, Stepping* at) {
  const std::size_t place = static_cast<std::size_t>(world) * a.dampers + k;
  const std::size_t column = static_cast<std::size_t>(world) * a.actuators + a.actuator[k];
  WorldDamper& own = a.store[place];
  const double u = a.ctrl[static_cast<std::size_t>(world) * a.controls + a.control[k]], clock = a.time[world];
  const bool on = own.next.started != 0 && clock > own.clock;
  if (on) own.last = own.next;
  if (clock < own.clock) own.last.started = 0;  // the world was reset
  own.clock = clock;
  at->damper = &d;
  if (HasDelay(d.p) && a.lines) {
    WorldLine& line = a.lines[place];
    (on ? line.last : line.next) = on ? line.next : line.last;
    at->now.line = at->trial.line = &line.next;
  }
  if (d.law == Law::kNarx) {
    WorldPast& past = a.pasts[place];
    (on ? past.last : past.next) = on ? past.next : past.last;
    at->now.past = &past.next;
    at->trial.past = &past.trial;
  }
  at->x = a.length[column];
  at->v = a.velocity[column];
  at->u = isfinite(u) ? min(max(u, a.control_range[2 * k]), a.control_range[2 * k + 1]) : 0;
  // Steps are counted: a clock in float is too coarse after a minute.
  at->time = own.last.started != 0 ? own.last.time + a.timestep : 0;
  at->CatchUp(own.last, a.timestep);
}

}  // namespace worlds

// Forces of a world's dampers over the step to come.
inline void ActInWorld(const Worlds& a, int world) {
  using Numbers = Few<double, kMostDampers * kMostDampers>;
  Damper damper[kMostDampers];
  Stepping at[kMostDampers];
  const int n = a.dampers;
  const double h = a.timestep;
  const std::size_t first = static_cast<std::size_t>(world) * n;
  Few<StepDamper, kMostDampers> step(n);
  Numbers weight(n * n), force(n);
  for (int i = 0; i < n * n; i++) weight[i] = a.weight[first * n + i];
  for (int k = 0; k < n; k++) {
    worlds::Fill(a, world, k, &damper[k]);
    worlds::Present(a, world, k, damper[k], &at[k]);
    const double own = weight[k * n + k], bare = a.bare[first * n + k * n + k];
    force[k] = at[k].start.force;
    step[k] = {at[k].v, at[k].v + h * a.free[first + k], force[k], at[k].start.slope, at[k].Mass(), own > 0 ? bare / own : 1, &at[k]};
  }
  SolveStep(h, step, weight, &force);
  for (int k = 0; k < n; k++) {
    WorldDamper& own = a.store[first + k];
    own.force = -min(max(-force[k], a.force_range[2 * k]), a.force_range[2 * k + 1]);
    a.force[static_cast<std::size_t>(world) * a.actuators + a.actuator[k]] = static_cast<float>(-own.force);
    double end = a.free[first + k];
    for (int j = 0; j < n; j++) end -= weight[k * n + j] * force[j];
    own.next = at[k].Stored(at[k].v + h * end, h);
  }
}

// Readings of a world's force sensors, once the accelerations of the step are known.
inline void ReadWorld(const Worlds& a, int world) {
  constexpr int kEffects = sizeof(SensorParams) / sizeof(double);
  const std::size_t first = static_cast<std::size_t>(world) * a.dampers;
  for (int r = 0; r < a.readings; r++) {
    const int k = a.reading_damper[r];
    const double force = a.store[first + k].force, acceleration = a.acceleration[first + k];
    Damper damper;
    Stepping at;
    worlds::Fill(a, world, k, &damper);
    worlds::Present(a, world, k, damper, &at);
    SensorParams effects = SensorParams::Of(damper.p);
    for (int i = 0; i < kEffects; i++) {
      const double given = a.effects[r * kEffects + i];
      if (!isnan(given)) reinterpret_cast<double*>(&effects)[i] = given;
    }
    ReadingState& s = a.reading_store[static_cast<std::size_t>(world) * a.readings + r];
    if (at.time == 0) s.started = 0;
    const bool stepped = s.started != 0 && at.time > s.time;
    const bool limited = force == -a.force_range[2 * k] || force == -a.force_range[2 * k + 1];
    const Exerted now{at.seen.force + at.Mass() * acceleration, force, acceleration};
    Follow(effects, at, now, limited, true, &s);
    s.count += stepped;
    double value = Value(a.reading[r], effects, at, now, limited, s);
    if (a.cutoff[r] > 0) value = min(max(value, -a.cutoff[r]), a.cutoff[r]);
    a.sensordata[static_cast<std::size_t>(world) * a.sensors + a.reading_column[r]] = static_cast<float>(value);
  }
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_WORLDS_H_

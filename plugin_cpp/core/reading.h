// What the damper's force sensor reads in an engine's steps.
#ifndef MRDAMP_CORE_READING_H_
#define MRDAMP_CORE_READING_H_

#include "core/random.h"
#include "core/shift.h"
#include "core/stepping.h"
#include "effects/sensor.h"

namespace mrdamp {

enum Signal {
  kForce, kCharge, kTrueForce, kAppliedForce, kUnlimitedForce, kStroke, kStrokeVelocity, kPower, kEnergy, kCurrent, kField,
  kTemperature, kSignals
};

// A sensor's fixed part.
struct Reading {
  int signal = kForce;
  double sensitivity = -158.248;  // pC/N
  double resolution = 0, range = 0, noise = 0;  // N; 0: none
  std::uint64_t key = 0;  // of the noise
};

// Its state between steps. Plain doubles.
struct ReadingState {
  double started = 0, time = 0, count = 0;
  double velocity = 0, applied = 0, energy = 0;  // m/s and N at the last step; J
  Sensor sensor;
};

// The damper at the end of a step. own: force on the rod (N) by the law and the moving mass; applied: what the engine
// exerts; a: acceleration along the damper.
struct Exerted {
  double own, applied, a;
};

// Brings the state to the present. limited: what acts is a limit of the engine's. mean: the force applied is the mean over
// a step; otherwise that of an instant.
inline void Follow(const SensorParams& p, const Stepping& damper, const Exerted& now, bool limited, bool mean,
                   ReadingState* s) {
  const double force = limited ? now.applied : now.own, jump = limited ? 0 : damper.seen.force - damper.ended;
  if (s->started == 0) {
    s->sensor.Start(p, force);
    s->count = s->energy = 0;
  } else {
    const double dt = damper.time - s->time;
    if (dt > 0) {
      s->sensor.Step(p, force - jump, dt);
      s->sensor.Step(p, force, 0);
      s->energy += (mean ? s->applied : 0.5 * (s->applied + now.applied)) * 0.5 * (s->velocity + damper.v) * dt;
    }
  }
  s->started = 1;
  s->time = damper.time;
  s->velocity = damper.v;
  s->applied = now.applied;
}

// The signal's value. The noise is a function of key and step alone, so that the same trajectory has the same after
// reset, copy and restore.
inline double Value(const Reading& r, const SensorParams& p, const Stepping& damper, const Exerted& now, bool limited,
                    const ReadingState& s) {
  const double force = limited ? now.applied : now.own;
  switch (r.signal) {
    case kForce:
    case kCharge: {
      double value = s.sensor.Read(p);
      if (r.noise > 0) value += r.noise * Normal(r.key, static_cast<std::uint64_t>(s.count));
      if (r.resolution > 0) value = r.resolution * std::nearbyint(value / r.resolution);
      if (r.range > 0) value = min(max(value, -r.range), r.range);
      return r.signal == kCharge ? value * r.sensitivity : value;  // Eq. (3): F = Q / k
    }
    case kTrueForce: return force;
    case kAppliedForce: return now.applied;
    case kUnlimitedForce: return now.own;
    case kPower: return force * damper.v;
    case kEnergy: return s.energy;
    case kStroke: return Recorded(damper.damper->p, damper.x, damper.v, now.a);
    case kStrokeVelocity: return damper.v;
    case kCurrent: return damper.seen.current;
    case kField: return damper.seen.field;
    default: return damper.seen.temperature;
  }
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_READING_H_

// A damper in an engine's steps: its chain from the start of the last step to the present motion, and trials of the
// step to come.
#ifndef MRDAMP_CORE_STEPPING_H_
#define MRDAMP_CORE_STEPPING_H_

#include "core/chain.h"
#include "effects/mechanics.h"
#include "effects/mount.h"

namespace mrdamp {

// The start of a step as it is stored between steps. Plain doubles.
struct StepStart {
  double started = 0, time = 0, x = 0, v = 0, u = 0;
  double end = 0;  // velocity at the step's end
  double step = 0, clock = 0;  // s, from the start to the step's end, and the engine's clock there
  ChainState chain;
};

struct Stepping {
  const Damper* damper = nullptr;
  double x = 0, v = 0, u = 0, time = 0;  // at the present
  // `line` and `past` of `now` are stored beside StepStart; `trial` has the same line and a past of its own.
  State now, trial;
  Observation seen{}, start{};  // of the present state; of the step's start
  SprungMasses sprung;          // as stored, before it is moved on to the present
  double jump = 0;              // of an inner rate with the command
  double ended = 0;             // N, before a jump of the command

  double Mass() const { return RodMass(damper->p, HasMount(damper->p)); }

  // From the stored start `s` to the motion (x, v) at `time`, with the command u from now on; h: the engine's step.
  void CatchUp(const StepStart& s, double h) {
    const Damper& d = *damper;
    double before = u, lead = 0, rate = 0, dt = 0;
    if (s.started == 0) {
      Start(d, &now, x, v, 0);  // no current before the first command
      if (now.line) now.line->Push(0, d.Clamp(u), Reach(d.p));
      Settle(d, &now, x, v, u);
    } else {
      now.c = s.chain;
      dt = time - s.time;
      const bool within = s.step == 0;  // a stage of a step, in which the command is the new one already
      const auto push = [&] {
        if (now.line) now.line->Push(now.c.time, d.Clamp(u), Reach(d.p));
      };
      if (within) push();
      else before = s.u;
      if (dt > 0) {
        Advance(d, &now, {s.x, s.v, x, v, dt}, before, before);
        // The engine's step has gone all the way at its last velocity; a motion that is imposed has not.
        const double rise = v - s.v, off = max(fabs((x - s.x) / dt - v), fabs(v - s.end));
        if (off < 0.25 * fabs(rise)) lead = 0.5 * rise;
        rate = lead / dt;
      } else {
        before = s.u;
      }
      if (!within) push();
      Settle(d, &now, x, v, u);
    }
    // The engine's velocities stand half a step before its positions, unless they are imposed; so do masses that ring
    // with their changes.
    sprung = now.c.sprung;
    if (lead != 0) Ring(d.p, &now.c.sprung, 2 * rate, 0.5 * dt);
    seen = Observe(d, now, x, v + lead, 0, u);
    ended = CurrentJumps(d) ? Observe(d, now, x, v + lead, 0, before, kBefore).force : seen.force;
    // So does the start of the step, before a jump of the command.
    start = Observe(d, now, x, v, 0, before, kBefore);
    jump = RateJump(d, now, x, v + lead, before, u, 0.5 * h);
  }

  // Force without the moving mass after `h` of the step at the velocity to; 0: the present state.
  double Trial(double to, double h) {
    const State* s = &now;
    double at = x;
    if (h > 0) {
      s = &trial;
      trial.c = now.c;
      if (trial.past) *trial.past = *now.past;
      at += h * to;
      // At that velocity all the way, as the engine moves the position: the law's end then belongs to it.
      Advance(*damper, &trial, {x, to, at, to, h}, u, u);
      trial.c.sprung = now.c.sprung;
      Ring(damper->p, &trial.c.sprung, (to - v) / h, h);
    } else if (jump != 0) {
      s = &trial;
      trial.c = now.c;
      trial.c.r += jump;
    }
    return Observe(*damper, *s, at, to, 0, u).force;
  }

  // The start of the step to come; end, step, clock: as of StepStart.
  StepStart Stored(double end, double step = 0, double clock = 0) const {
    StepStart s{1, time, x, v, u, end, step, clock, now.c};
    s.chain.sprung = sprung;
    return s;
  }
};

// A damper in the step to come, for core/balance.h.
struct StepDamper {
  double velocity = 0, free = 0, force = 0, slope = 0, mass = 0, bare = 1;
  Stepping* at = nullptr;
  double trial(double v, double part) const { return at->Trial(v, part); }
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_STEPPING_H_

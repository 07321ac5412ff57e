// The code that steps a damper in an engine: made for its law and without the effects that it lacks, where there is such.
#ifndef MRDAMP_CORE_STEPS_H_
#define MRDAMP_CORE_STEPS_H_

#include "core/stepping.h"

// mrdamp::Stepping and mrdamp::StepStart, whose layouts are the same in all code for one lane.
struct MrdampSteps {
  void (*catch_up)(void* stepping, const void* start, double h);
  double (*trial)(void* stepping, double to, double h);
};

namespace mrdamp {

constexpr MrdampSteps OwnSteps() {
  return {[](void* at, const void* start, double h) { static_cast<Stepping*>(at)->CatchUp(*static_cast<const StepStart*>(start), h); },
          [](void* at, double to, double h) { return static_cast<Stepping*>(at)->Trial(to, h); }};
}

// The code that steps a damper in MuJoCo (mujoco/steps.cc).
const MrdampSteps* StepsFor(const Damper& d);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_STEPS_H_

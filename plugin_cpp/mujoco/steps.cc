// The code for a law's dampers without most effects (lanes/steps.cc), and for all others.
#include "core/steps.h"

#include "core/packs.h"

namespace mrdamp {

namespace {

constexpr MrdampSteps kAnyDamper = OwnSteps();

}  // namespace

#define MRDAMP_LAW(name, Type, ...) extern "C" const MrdampSteps mrdamp_steps_k##Type;
#include "core/attributes.def"

const MrdampSteps* StepsFor(const Damper& d) {
  static const MrdampSteps* const plain[] = {
#define MRDAMP_LAW(name, Type, ...) &mrdamp_steps_k##Type,
#include "core/attributes.def"
  };
  return d.law != Law::kNarx && Plain(d.p) ? plain[static_cast<int>(d.law)] : &kAnyDamper;
}

}  // namespace mrdamp

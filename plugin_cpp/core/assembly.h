// A linear structure with dampers and nonlinear storeys. The structure is stepped exactly; all forces that depend on
// its motion are solved for within the step.
#ifndef MRDAMP_CORE_ASSEMBLY_H_
#define MRDAMP_CORE_ASSEMBLY_H_

#include <vector>

#include "core/chain.h"
#include "core/linear.h"
#include "core/run.h"

namespace mrdamp {

// Forces of a storey in addition to its stiffness and damping, see mrdamp_frame.
struct Storey {
  double friction = 0, friction_width = 0, presliding = 1e-5;
  double one_sided = 0, cubic = 0, damping2 = 0;
  // Largest tension (N) of its linear spring and dashpot, as of a tyre with this static load; 0: unlimited.
  double lift = 0, stiffness = 0, damping = 0;

  bool Acts() const { return friction > 0 || one_sided != 0 || cubic != 0 || damping2 > 0 || lift > 0; }
  // Force at the end of a step of drift dx that ends at x with velocity v; updates the bristle q of the dry friction.
  Real Force(Real x, Real v, Real dx, Real* q) const;
};

// Its elements are the dampers, then the storeys. The whole state is public and plain.
class Assembly {
 public:
  struct Element {
    Real force = 0;    // N, at the present
    Real next = 0;     // N, at the end of the step being solved
    Real start = 0;    // N, at the start of the step
    Real rise = kUnset;  // N s/m, its slope over the range of the step; unset before the first step
    Mask ready = false;  // the damper's trial state is that of the solution
  };
  struct Site {
    const Damper* d;
    OwnedState state, trial;
    Real acceleration = 0;  // m/s2 along it, over the last step
    Real work = 0;          // J taken in over the last step

    explicit Site(const Damper& damper) : d(&damper), state(damper), trial(damper) {}
  };

  // All three must outlive it. quick: a damper with a small slope is solved from the last step's solution, to 1e-5 of
  // its force (the laws are within 1e-4 of their equations); else from two trials, to 1e-7.
  Assembly(const Linear& linear, const std::vector<Damper>& dampers, const std::vector<Storey>& storeys, bool quick = false);

  // State of rest with a command for each damper.
  void Start(const Real* command);
  // The damper's force at the present, with a new command.
  void Command(int damper, Real command);
  // The same where a delayed command may jump at the present; false if it cannot.
  bool Arrives(int damper, Real command);
  // A step with loads linear from load0 to load1 and commands from u0 to u1; `settle`: those at its end.
  void Step(const Real* load0, const Real* load1, const Real* u0, const Real* u1, const Real* settle);

  Real Stroke(int element) const { return linear_.Along(element, q.data(), 0); }
  Real Velocity(int element) const { return linear_.Along(element, q.data(), linear_.n()); }
  const Linear& linear() const { return linear_; }

  std::vector<Real> q;  // 2 n
  std::vector<Element> elements;
  std::vector<Real> bristle;  // of the storeys
  std::vector<Site> sites;

 private:
  void Balance(int j, int sweep, Real u0, Real u1, Mask here, Real* moved, Real* size);

  const Linear& linear_;
  const std::vector<Storey>& storeys_;
  const double tolerance_;  // relative, of a solved force
  const bool quick_;
  std::vector<Real> free_, next_, blend_;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_ASSEMBLY_H_

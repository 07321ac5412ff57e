// A linear structure with its dampers, and storeys that are more than a spring and a dashpot: one step at a time, the
// structure exact, all forces that hang on its motion solved for within the step.
#ifndef MRDAMP_CORE_ASSEMBLY_H_
#define MRDAMP_CORE_ASSEMBLY_H_

#include <vector>

#include "core/chain.h"
#include "core/linear.h"
#include "core/record.h"

namespace mrdamp {

// What a storey has beside its stiffness and damping, see mrdamp_frame.
struct Storey {
  double friction = 0, friction_width = 0, presliding = 1e-5;
  double one_sided = 0, cubic = 0, damping2 = 0;
  // Its stiffness and damping, which the structure holds too, pull with `lift` (N) at most, as a tyre on a road that
  // carries that load at rest; 0: as much as they do.
  double lift = 0, stiffness = 0, damping = 0;

  bool Acts() const { return friction > 0 || one_sided != 0 || cubic != 0 || damping2 > 0 || lift > 0; }
  // Force at the end of a step of drift dx that ends at x with velocity v; the dry friction's bristle q follows.
  double Force(double x, double v, double dx, double* q) const;
};

// Its elements are the dampers, then the storeys. Everything that a later step hangs on is public and plain.
class Assembly {
 public:
  struct Element {
    double force = 0;    // N, now
    double next = 0;     // N, at the end of the step that is solved for
    double start = 0;    // N, that the step's force ran from
    double rise = kUnset;  // N s/m, its slope over what the step may bring; unset before the first step
    bool ready = false;  // the damper's trial state was stepped to the end that was found
  };
  struct Site {
    const Damper* d;
    OwnedState state, trial;
    double acceleration = 0;  // m/s2 along it, over the last step
    double work = 0;          // J taken in over the last step

    explicit Site(const Damper& damper) : d(&damper), state(damper), trial(damper) {}
  };

  // All three must outlive it. quick: a damper that gives way softly is solved for from where the last step left it, to
  // 1e-5 of its force (the laws are within 1e-4 of their equations); else from two trials of its own, to 1e-7.
  Assembly(const Linear& linear, const std::vector<Damper>& dampers, const std::vector<Storey>& storeys, bool quick = false);

  // At rest with a command to each damper.
  void Start(const double* command);
  // The damper's force now, under a command that has just been given.
  void Command(int damper, double command);
  // A step over which loads run from load0 to load1 and commands from u0 to u1; `settle`: those at its end.
  void Step(const double* load0, const double* load1, const double* u0, const double* u1, const double* settle);

  double Stroke(int element) const { return linear_.Along(element, q.data(), 0); }
  double Velocity(int element) const { return linear_.Along(element, q.data(), linear_.n()); }
  const Linear& linear() const { return linear_; }

  std::vector<double> q;  // 2 n
  std::vector<Element> elements;
  std::vector<double> bristle;  // of the storeys
  std::vector<Site> sites;

 private:
  void Balance(int j, int sweep, double u0, double u1, double* moved, double* size);

  const Linear& linear_;
  const std::vector<Storey>& storeys_;
  const double tolerance_;  // of a force that is solved for, over it
  const bool quick_;
  std::vector<double> free_, next_, blend_;
};

}  // namespace mrdamp

#endif  // MRDAMP_CORE_ASSEMBLY_H_

// The force that dampers exert over one step of the engine, solved within the step.
#ifndef MRDAMP_MUJOCO_STEP_H_
#define MRDAMP_MUJOCO_STEP_H_

#include <functional>
#include <vector>

namespace mrdamp {

// What the step knows of one damper. Trial(v, part): its force (without the moving mass) after the part of the step
// has gone by at the velocity v; part 0 is the present state.
struct StepDamper {
  double velocity;   // m/s, now
  double free;       // m/s at the end of the step, without any damper's force
  double force;      // N, now
  double slope;      // N s/m, of the present state's force in the velocity
  double mass;       // kg, moving mass along the damper
  std::function<double(double v, double part)> trial;
};

// Mean forces (n) over a step of h with mobility w (n x n, 1/kg, row-major): velocities end at free - h w F.
void SolveStep(double h, const std::vector<StepDamper>& dampers, const std::vector<double>& w, std::vector<double>* force);

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_STEP_H_

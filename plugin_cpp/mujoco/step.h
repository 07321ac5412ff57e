// The force that dampers exert over one step of the engine, solved within the step.
#ifndef MRDAMP_MUJOCO_STEP_H_
#define MRDAMP_MUJOCO_STEP_H_

#include <functional>
#include <vector>

namespace mrdamp {

// One damper in a step. Trial(v, part): its force (without the moving mass) after the fraction `part` of the step at
// the velocity v; part 0 is the present state.
struct StepDamper {
  double velocity;   // m/s, at the present
  double free;       // m/s at the end of the step, without any damper's force
  double force;      // N, at the present
  double slope;      // N s/m, derivative of the present state's force with the velocity
  double mass;       // kg, moving mass along the damper
  double bare;       // its mobility without the structure's implicit damping and closed contacts over that with them; at least 1
  std::function<double(double v, double part)> trial;
};

// Mean forces (n) over a step of h with mobility w (n x n, 1/kg, row-major): velocities end at free - h w F.
void SolveStep(double h, const std::vector<StepDamper>& dampers, const std::vector<double>& w, std::vector<double>* force);

// The forces (n) at the present for Runge-Kutta's stages; of them the moving masses alone need the acceleration.
void PresentForces(double h, const std::vector<StepDamper>& dampers, const std::vector<double>& w,
                   std::vector<double>* force);

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_STEP_H_

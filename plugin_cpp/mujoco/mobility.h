// Response of a model's actuator outputs to forces within a step, and their motion without the dampers' forces.
#ifndef MRDAMP_MUJOCO_MOBILITY_H_
#define MRDAMP_MUJOCO_MOBILITY_H_

#include <mujoco/mujoco.h>

#include <vector>

namespace mrdamp {

// Product of an actuator output's moment with a vector of nv.
inline double Along(const mjData* d, int output, const double* x) {
  double sum = 0;
  const int begin = d->moment_rowadr[output];
  for (int k = begin; k < begin + d->moment_rownnz[output]; k++) sum += d->actuator_moment[k] * x[d->moment_colind[k]];
  return sum;
}

// What a damper's output does within a step; vectors of nv.
struct OutputResponse {
  int output = 0;
  std::vector<double> end;   // acceleration of the output over the step for unit generalised forces
  std::vector<double> push;  // generalised forces of a unit force at the output, less what constraints carry of it
  double own = 0, bare = 1;  // 1/kg, its weight on itself; as in StepDamper
  double free = 0;           // acceleration of the output over the step without any damper's force
  // Where no constraint is felt: factors of the mass matrix, moment, damping and step that gave the rest.
  std::vector<double> made_of;
};

// The engine solves M a = push + J' f(J a - a_ref) - moments of the dampers' forces for the acceleration a, with the
// forces f of equalities, dry friction, limits and contacts (Todorov 2014, doi:10.1109/ICRA.2014.6907751). Around one
// acceleration f is a straight line, f0 - C J (a - a0), so that the motion is linear in the dampers' forces. Update
// linearises at the last step's acceleration, Arrived at the one that the dampers' forces lead to (Newton's method).
class Mobility {
 public:
  // Reads the forces of this step, those of the actuators `others` included, and the constraints that `outputs` feel.
  void Update(const mjModel* m, mjData* d, const std::vector<int>& others, const std::vector<int>& outputs);
  void Respond(const mjModel* m, mjData* d, int output, OutputResponse* r);
  // Acceleration (1/kg) over the step of the output `of` for a unit force at the output `at`.
  double Weight(const OutputResponse& of, const OutputResponse& at) const;
  // True if the constraints' forces at the motion that follows from the dampers' forces are on the straight line, to
  // 1e-9 of the largest force. Else they are linearised there. A bounded number of calls is false.
  bool Arrived(const mjModel* m, mjData* d, const std::vector<const OutputResponse*>& at, const std::vector<double>& forces);

 private:
  void ReadForces(const mjModel* m, mjData* d, const std::vector<int>& others, const std::vector<int>& outputs);
  void ReadDamping(const mjModel* m, mjData* d);
  void Damp(const mjModel* m, const mjData* d, const double* x, double* out) const;
  void Choose(const mjModel* m, const mjData* d, const std::vector<int>& outputs);
  void Evaluate(const mjModel* m, mjData* d);
  void AddRow(const mjModel* m, const mjData* d, int row, const double* share, int count);
  void Linearise(const mjModel* m, mjData* d);
  bool Unchanged(const mjModel* m, const mjData* d, OutputResponse* r);
  void Solve(const mjModel* m, mjData* d, OutputResponse* r);
  void Release(const mjModel* m, mjData* d, const double* solved, double* force);
  const double* Row(int i) const { return jacobian_.data() + static_cast<std::size_t>(i) * nv_; }

  enum { kNone, kJoints, kAll } damping_ = kNone;
  bool closed_ = false;  // contacts or limits that a damper feels are closed
  int nv_ = 0, rows_ = 0, order_ = 0, round_ = 0;
  std::vector<double> push_;                 // nv, generalised forces without dampers and constraints
  std::vector<double> joints_;               // nv, damping of the joints
  std::vector<double> now_, total_;          // nv, acceleration of the linearisation; M times that without dampers
  std::vector<double> row_, solve_, work_, along_, pushed_, made_of_;
  std::vector<char> felt_, near_;  // trees and constraints that a damper feels
  // C^1/2 J; M^-1 times its rows; the Cholesky factor of the smaller of the two matrices that give (M + J' C J)^-1.
  std::vector<double> jacobian_, inverse_, factor_, impulse_;
};

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_MOBILITY_H_

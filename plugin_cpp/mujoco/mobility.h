// Response of a model's actuator outputs to forces, and their motion without the dampers' forces.
#ifndef MRDAMP_MUJOCO_MOBILITY_H_
#define MRDAMP_MUJOCO_MOBILITY_H_

#include <mujoco/mujoco.h>

#include <vector>

namespace mrdamp {

// Product of an actuator output's moment with a vector (nv).
inline double Dot(const mjData* d, int output, const double* x) {
  double sum = 0;
  const int begin = d->moment_rowadr[output], count = d->moment_rownnz[output];
  for (int k = begin; k < begin + count; k++) sum += d->actuator_moment[k] * x[d->moment_colind[k]];
  return sum;
}

class Mobility {
 public:
  // Reads the forces of this step, including those of the actuators `others`, and the equality constraints.
  void Update(const mjModel* m, mjData* d, const std::vector<int>& others);
  // Fills inverse (nv) with M^-1 J' of an output and returns its acceleration without any damper's force.
  double Row(const mjModel* m, mjData* d, int output, double h, std::vector<double>* inverse);

 private:
  void Equalities(const mjModel* m, mjData* d);
  void Frictions(const mjModel* m, mjData* d);

  std::vector<double> push_, row_, solve_;  // nv
  bool damping_ = false;
  // Equality constraints: rows of their Jacobian, M^-1 times them, and the Cholesky factor of J M^-1 J' + R.
  int equalities_ = 0;
  std::vector<double> jacobian_, inverse_, factor_, reference_, impulse_;
};

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_MOBILITY_H_

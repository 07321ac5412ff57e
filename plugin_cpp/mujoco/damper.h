// mrdamp.damper: the chain as a MuJoCo actuator whose control is the commanded current.
#ifndef MRDAMP_MUJOCO_DAMPER_H_
#define MRDAMP_MUJOCO_DAMPER_H_

#include <mujoco/mujoco.h>

#include <memory>
#include <string>
#include <vector>

#include "core/record.h"
#include "core/steps.h"
#include "mujoco/mobility.h"

namespace mrdamp {

// A damper in the step to come, by the code for its law and effects.
struct PluginDamper : StepDamper {
  const MrdampSteps* steps = nullptr;
  double trial(double v, double part) const { return steps->trial(at, v, part); }
};

inline constexpr char kDamperName[] = "mrdamp.damper";

// Data of an instance in addition to MuJoCo's state: parsed attributes, and the results of the last compute().
class DamperInstance {
 public:
  // Null and a line on failure.
  static std::unique_ptr<DamperInstance> Make(const mjModel* m, int instance, std::string* error);
  static void Register();

  void Compute(const mjModel* m, mjData* d);
  void Advance(const mjModel* m, mjData* d);
  // Reads time, length and velocity.
  void Watch(const mjData* d);
  // Adds the force as an arrow, coloured by the current, to a scene.
  void Visualize(const mjModel* m, const mjData* d, mjvScene* scene) const;

  // Input of the force sensor; `a` is the acceleration along the actuator.
  double Force(double a) const { return at_.seen.force + Mass() * a + turn_; }
  const Stepping& at() const { return at_; }
  const Damper& damper() const { return damper_; }
  int actuator() const { return actuator_; }
  // Force of this step, before the engine's limits.
  double exerted() const { return force_; }
  // What of it acts on the model, after forcerange and actuatorfrcrange; known once the engine has applied them. The
  // limit of a joint counts where this is its only actuator.
  double Applied(const mjModel* m, const mjData* d) const;
  // True unless switched off by the actuation flag or its group.
  bool Acts(const mjModel* m) const;
  // Reads the attributes again if their bytes have changed.
  void Refresh(const mjModel* m);

 private:
  DamperInstance() = default;
  bool Parse(const mjModel* m, std::string* error);
  // Brings the chain from its stored state to the motion in d.
  void CatchUp(const mjModel* m, const mjData* d);
  // plugin_state of a start.
  void Store(double* to, const StepStart& start) const;

  int instance_ = 0, actuator_ = 0, output_ = 0;
  bool integrate_ = false;
  Damper damper_;
  const MrdampSteps* steps_ = nullptr;
  std::unique_ptr<NarxNet> net_;
  std::vector<char> attributes_;
  std::vector<int> peers_;  // all dampers of the model, including this one; the first one solves for all

  std::vector<int> others_;  // actuators that are not dampers

  Stepping at_;
  std::vector<double> first_;  // plugin_state at Runge-Kutta's first stage after a reset
  double first_clock_ = 0;     // s, then
  NarxHistory past_, trial_past_;
  DelayLine line_;
  double force_ = 0;
  OutputResponse response_;

  // Of a moving mass, along a transmission whose moment changes with the motion.
  struct DeleteData {
    void operator()(mjData* d) const { mj_deleteData(d); }
  };
  bool turns_ = false;
  double turn_ = 0;  // N, the mass times the acceleration of the length at constant velocities
  std::unique_ptr<mjData, DeleteData> ahead_;

  double Mass() const { return at_.Mass(); }
  // m/s2, that acceleration: the change of the moment, by the positions a tenth of a microsecond ahead.
  double Turning(const mjModel* m, const mjData* d);

  // Of the first damper, which solves for all.
  Mobility mobility_;
  std::vector<DamperInstance*> acting_;
  std::vector<PluginDamper> step_;
  std::vector<int> outputs_;
  std::vector<const OutputResponse*> responses_;
  std::vector<double> weight_, forces_;
};

// The damper of an actuator, or null.
DamperInstance* DamperOf(const mjModel* m, const mjData* d, int actuator);

// Value of a plugin attribute; null if it is not given.
const char* AttributeOf(const mjModel* m, int instance, const char* name);

// Name for a message: "actuator 'mr'".
std::string Describe(const mjModel* m, int object_type, const char* kind, int id);

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_DAMPER_H_

// mrdamp.force_sensor: the piezoelectric force sensor embedded in the damper (Chen, Ni, Or 2015).
#ifndef MRDAMP_MUJOCO_FORCE_SENSOR_H_
#define MRDAMP_MUJOCO_FORCE_SENSOR_H_

#include <mujoco/mujoco.h>

#include <memory>
#include <string>
#include <vector>

#include "core/reading.h"
#include "mujoco/damper.h"

namespace mrdamp {

inline constexpr char kForceSensorName[] = "mrdamp.force_sensor";

class ForceSensorInstance {
 public:
  static std::unique_ptr<ForceSensorInstance> Make(const mjModel* m, int instance, std::string* error);
  static void Register();

  void Compute(const mjModel* m, mjData* d);
  void Advance(const mjModel* m, mjData* d);

 private:
  bool Parse(const mjModel* m, std::string* error);
  void Refresh(const mjModel* m);
  SensorParams Effects(const Params& p) const;

  int instance_ = 0, sensor_ = 0, actuator_ = 0;
  Reading reading_;
  double own_[10];  // sensor_* given here rather than on the damper; NaN: not given
  std::vector<char> attributes_;
  ReadingState next_{};
};

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_FORCE_SENSOR_H_

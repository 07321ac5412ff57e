// mrdamp.force_sensor: the piezoelectric force sensor embedded in the damper (Chen, Ni, Or 2015).
#ifndef MRDAMP_MUJOCO_FORCE_SENSOR_H_
#define MRDAMP_MUJOCO_FORCE_SENSOR_H_

#include <mujoco/mujoco.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "effects/sensor.h"
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
  enum Signal {
    kForce, kCharge, kTrueForce, kAppliedForce, kUnlimitedForce, kStroke, kStrokeVelocity, kPower, kEnergy, kCurrent, kField,
    kTemperature, kSignals
  };
  struct Stored {  // plugin_state
    double started, time, count;
    double velocity, applied, energy;  // m/s and N at the last step; J
    Sensor sensor;
  };

  bool Parse(const mjModel* m, std::string* error);
  void Refresh(const mjModel* m);
  SensorParams Reading(const Params& p) const;
  double Noise(double count) const;

  int instance_ = 0, sensor_ = 0, actuator_ = 0;
  int signal_ = kForce;
  double sensitivity_ = -158.248;  // pC/N
  double own_[10];                  // sensor_* given here rather than on the damper; NaN: not given
  double resolution_ = 0, range_ = 0, noise_ = 0;
  std::uint64_t seed_ = 0;
  std::vector<char> attributes_;
  Stored next_{};
};

}  // namespace mrdamp

#endif  // MRDAMP_MUJOCO_FORCE_SENSOR_H_

#include <mujoco/mjplugin.h>
#include <mujoco/mujoco.h>

#include <cstdio>

#include "mujoco/damper.h"
#include "mujoco/force_sensor.h"

namespace mrdamp {

mjPLUGIN_LIB_INIT(mrdamp) {
  // The engine does not check this, and other headers mean other struct offsets.
  if (mj_version() != mjVERSION_HEADER) {
    std::fprintf(stderr, "mrdamp: built for MuJoCo 4.0.0, but %s is loaded; pip install mujoco==4.0.0\n", mj_versionString());
    return;
  }
  DamperInstance::Register();
  ForceSensorInstance::Register();
}

}  // namespace mrdamp

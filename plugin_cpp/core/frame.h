// A shear frame as a linear structure with elements, and one of a damper run from end to end.
#ifndef MRDAMP_CORE_FRAME_H_
#define MRDAMP_CORE_FRAME_H_

#include <vector>

#include "core/assembly.h"
#include "core/chain.h"
#include "effects/sensor.h"
#include "mrdamp.h"

namespace mrdamp {

// Floors' accelerations, displacements, then force, true force, stroke, its velocity, current, field, temperature.
inline int FrameColumns(int storeys) { return 2 * storeys + 7; }

// Its coordinates are the floors' displacements to the ground, its load the ground's acceleration, its elements the
// dampers, between pairs of floors, and then the storeys that are more than a spring and a dashpot.
struct FrameSystem {
  LinearSystem system;
  std::vector<Storey> storeys;

  FrameSystem(const mrdamp_frame& f, int dampers, const int* between);
};

// Of each floor's accelerometer.
std::vector<SensorParams> FloorSensors(const mrdamp_frame& f);

bool CheckFrame(const mrdamp_frame& f, char* error, int error_size);

// out: FrameColumns x n. ag: ground acceleration (m/s2), u: command; straight lines between the samples of ag.
void RunFrame(const Damper& d, const mrdamp_frame& f, double dt, int n, const double* ag, const double* u, double* out);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_FRAME_H_

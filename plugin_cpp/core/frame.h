// A shear frame as a linear structure with elements, and its simulation with a damper over a record.
#ifndef MRDAMP_CORE_FRAME_H_
#define MRDAMP_CORE_FRAME_H_

#include <vector>

#include "core/assembly.h"
#include "core/chain.h"
#include "effects/sensor.h"
#include "mrdamp.h"

namespace mrdamp {

// Accelerations and displacements of the floors, then force, true force, stroke, its velocity, current, field,
// temperature.
inline int FrameColumns(int storeys) { return 2 * storeys + 7; }

// Coordinates: the floors' displacements relative to the ground, then those of a foundation that moves. Load: the
// ground's acceleration. Elements: the dampers, between pairs of floors, then the nonlinear storeys.
struct FrameSystem {
  LinearSystem system;
  std::vector<Storey> storeys;

  FrameSystem(const mrdamp_frame& f, int dampers, const int* between);
};

// Accelerometer of each floor.
std::vector<SensorParams> FloorSensors(const mrdamp_frame& f);

bool CheckFrame(const mrdamp_frame& f, char* error, int error_size);

// out: FrameColumns x n. ag: ground acceleration (m/s2), u: command; both linear between the samples of ag.
void RunFrame(const Damper& d, const mrdamp_frame& f, double dt, int n, const double* ag, const double* u, double* out);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_FRAME_H_

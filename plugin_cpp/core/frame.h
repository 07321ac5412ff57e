// A shear frame with one damper: the structure exact (matrix exponential), the damper solved within the step.
#ifndef MRDAMP_CORE_FRAME_H_
#define MRDAMP_CORE_FRAME_H_

#include "core/chain.h"
#include "mrdamp.h"

namespace mrdamp {

// Floors' accelerations, displacements, then force, true force, stroke, its velocity, current, field, temperature.
inline int FrameColumns(int storeys) { return 2 * storeys + 7; }

bool CheckFrame(const mrdamp_frame& f, char* error, int error_size);

// out: FrameColumns x n. ag: ground acceleration (m/s2), u: command; straight lines between the samples of ag.
void RunFrame(const Damper& d, const mrdamp_frame& f, double dt, int n, const double* ag, const double* u, double* out);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_FRAME_H_

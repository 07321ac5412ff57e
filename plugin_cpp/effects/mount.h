// Stage `mount`: a spring and a clearance in series with the damper; the piston moves less than the rod end.
#ifndef MRDAMP_EFFECTS_MOUNT_H_
#define MRDAMP_EFFECTS_MOUNT_H_

#include "core/params.h"

namespace mrdamp {

inline bool HasMount(const Params& p) { return p.mount_compliance_k > 0 || p.backlash_gap > 0; }

inline double MountStiffness(const Params& p) {
  return p.mount_compliance_k > 0 ? p.mount_compliance_k : p.backlash_k;
}

// What of a stretch d = x - x_piston is beyond the clearance.
inline double BeyondGap(const Params& p, double d) {
  const double half = 0.5 * p.backlash_gap;
  return d > half ? d - half : d < -half ? d + half : 0;
}

// Force (N) through the mount stretched by d: k d (1 + k3 d^2) beyond the clearance.
inline double MountForce(const Params& p, double d) {
  d = BeyondGap(p, d);
  return MountStiffness(p) * d * (1 + p.mount_compliance_k3 * d * d);
}

// Its slope (N/m), within the clearance that at its ends.
inline double MountSlope(const Params& p, double d) {
  d = BeyondGap(p, d);
  return MountStiffness(p) * (1 + 3 * p.mount_compliance_k3 * d * d);
}

}  // namespace mrdamp

#endif  // MRDAMP_EFFECTS_MOUNT_H_

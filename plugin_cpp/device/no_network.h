// In place of laws/narx.cc on a GPU: networks hold their weights in host memory.
#ifndef MRDAMP_DEVICE_NO_NETWORK_H_
#define MRDAMP_DEVICE_NO_NETWORK_H_

#include "laws/narx.h"

namespace mrdamp {
inline void Narx::Start(const NarxNet&, NarxHistory*, double, double, double) {}
inline void Narx::Push(const NarxNet&, NarxHistory*, double, double, double) {}
inline void Narx::Amend(const NarxNet&, NarxHistory*, double, double, double) {}
inline double Narx::Force(const NarxNet&, const NarxHistory&, double, double, double, double) { return 0; }
}  // namespace mrdamp

#endif  // MRDAMP_DEVICE_NO_NETWORK_H_

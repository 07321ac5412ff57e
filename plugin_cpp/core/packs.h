// Which dampers may share a pack, and the code for it on this processor.
#ifndef MRDAMP_CORE_PACKS_H_
#define MRDAMP_CORE_PACKS_H_

#include <string>
#include <vector>

#include "core/chain.h"
#include "core/lane.h"

namespace mrdamp {

// Dampers whose texts are equal are alike: which terms and effects they have, and how long their steps are. Empty: it is
// stepped alone, because a delayed command jumps at times of its own, and a network has a grid of its own.
std::string Alike(const Damper& d);

inline bool KnownLanes(int lanes) { return lanes == 0 || lanes == 1 || lanes == 2 || lanes == 4 || lanes == 8; }

// Dampers in a pack on this processor, at most `asked` (0: any): 8 by AVX-512, 4 by AVX2, 2 by NEON, else 1.
int Widest(int asked);

// The code for packs of `lanes` of dampers of one law; null where there is none.
const MrdampPack* PackFor(const std::vector<Damper>& dampers, int lanes);

// True without the effects that plain packs and plain steps lack.
bool Plain(const Params& p);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_PACKS_H_

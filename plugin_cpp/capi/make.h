// Shared parts of the C entries: errors, and dampers from parameter vectors.
#ifndef MRDAMP_CAPI_MAKE_H_
#define MRDAMP_CAPI_MAKE_H_

#include <cstdio>
#include <cstring>
#include <memory>
#include <string>

#include "core/chain.h"
#include "mrdamp.h"

struct mrdamp_narx {
  std::unique_ptr<mrdamp::NarxNet> net;
};

namespace mrdamp {

inline int Fail(char* err, int size, const std::string& text) {
  if (err && size > 0) std::snprintf(err, size, "%s", text.c_str());
  return 1;
}

// A damper from a parameter vector; `error` as by Check.
inline bool Make(int law, const double* params, const mrdamp_narx* net, const mrdamp_options* options, Damper* d, char* err,
                 int size) {
  if (law < 0 || law >= kLawCount) {
    Fail(err, size, "law number " + std::to_string(law) + " is unknown");
    return false;
  }
  d->law = static_cast<Law>(law);
  std::memcpy(d->p.data(), params, sizeof(Params));
  d->net = net ? net->net.get() : nullptr;
  if (options) {
    d->hold = options->hold != 0;
    if (options->substep > 0) d->p.substep = options->substep;
  }
  return Check(*d, err, size);
}

}  // namespace mrdamp

#endif  // MRDAMP_CAPI_MAKE_H_

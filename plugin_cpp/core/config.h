// A damper from text attributes, as MJCF gives them.
#ifndef MRDAMP_CORE_CONFIG_H_
#define MRDAMP_CORE_CONFIG_H_

#include <functional>
#include <memory>
#include <string>

#include "core/chain.h"

namespace mrdamp {

// Value of an attribute; null or empty: not given.
using Lookup = std::function<const char*(const char* name)>;

// Strict: the whole text is one finite number. false and one line (without the attribute's name) otherwise.
bool ParseNumber(const char* text, double* value, std::string* error);

// Reads `law`, its parameters, the effects and, for narx, `weights`: "text:NAME" is looked up by `text`, anything
// else is a file, by its path or in a folder of the environment variable MRDAMP_PATH. false and one line on failure.
bool ParseDamper(const Lookup& config, const Lookup& text, Damper* damper, std::unique_ptr<NarxNet>* net,
                 std::string* error);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_CONFIG_H_

// Any parameter set through the checks, and what passes them through a few steps of the chain.
//
// The input is text: the name of a law, then name=value, parted by spaces or line ends; what does not parse
// is passed over. A refused set must say why in one line, and cannot be made into a damper; an accepted one
// must step, and give the same force again after a reset.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <string>
#include <vector>

#include "mrdamp.h"

namespace {

constexpr int kSteps = 8;
constexpr double kStep = 1e-3;  // s

void Run(mrdamp_damper* damper, double* force) {
  for (int k = 0; k < kSteps; ++k) {
    const double phase = 60.0 * kStep * k;
    const double x = 0.01 * std::sin(phase), v = 0.6 * std::cos(phase);
    force[k] = mrdamp_damper_step(damper, kStep, x, v, k < 4 ? 0.0 : 1.0);
  }
}

int Index(const std::string& name) {
  for (int i = 0; i < mrdamp_attribute_count(); ++i) {
    if (name == mrdamp_attribute_name(i)) return i;
  }
  return -1;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream text(std::string(reinterpret_cast<const char*>(data), size));
  std::string item;
  text >> item;
  const int law = mrdamp_law_find(item.c_str());
  if (law < 0 || law == mrdamp_law_find("narx")) return 0;  // narx_text is about networks
  std::vector<double> params(static_cast<std::size_t>(mrdamp_attribute_count()));
  mrdamp_defaults(params.data());
  while (text >> item) {
    const std::size_t equals = item.find('=');
    const int i = Index(item.substr(0, equals));
    if (equals != std::string::npos && i >= 0) {
      params[static_cast<std::size_t>(i)] = std::strtod(item.c_str() + equals + 1, nullptr);
    }
  }
  double& substep = params[static_cast<std::size_t>(Index("substep"))];
  if (substep < 5e-5) substep = 5e-5;  // keeps a run short

  char err[256] = "";
  const bool refused = mrdamp_check(law, params.data(), err, sizeof err) != 0;
  if (refused && (err[0] == '\0' || std::strchr(err, '\n') != nullptr)) std::abort();
  mrdamp_damper* damper = mrdamp_damper_new(law, params.data(), nullptr, err, sizeof err);
  if ((damper == nullptr) != refused) std::abort();
  if (refused) return 0;
  double first[kSteps], again[kSteps];
  Run(damper, first);
  mrdamp_damper_reset(damper);
  Run(damper, again);
  if (std::memcmp(first, again, sizeof first) != 0) std::abort();
  mrdamp_damper_free(damper);
  return 0;
}

// Any text as a NARX weights file: it is refused with one line, or it gives a network that can be run.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "mrdamp.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  char err[256] = "";
  mrdamp_narx* net = mrdamp_narx_parse(text.c_str(), err, sizeof err);
  if (net == nullptr) {
    if (err[0] == '\0' || std::strchr(err, '\n') != nullptr) std::abort();
    return 0;
  }
  if (!(mrdamp_narx_sample_time(net) > 0) || mrdamp_narx_inputs(net) < 1) std::abort();
  const std::vector<double> in(static_cast<std::size_t>(mrdamp_narx_inputs(net)), 0.25);
  if (!std::isfinite(mrdamp_narx_forward(net, in.data()))) std::abort();
  mrdamp_narx_free(net);
  return 0;
}

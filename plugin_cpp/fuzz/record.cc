// Any motion and command through mrdamp_run with any parameters in their ranges: refused with one line, or
// finite numbers in every column.
//
// The input is text: a law, then name=value up to a line "---"; numbers are moved into their range, and dt is the
// sample time. Behind the line two bytes a sample: the piston's velocity and the command, as their distance from
// 'm' in steps of 0.02 m/s and 0.1.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <sstream>
#include <string>
#include <vector>

#include "mrdamp.h"

namespace {

constexpr double kLargest = 1e9;  // of any parameter: beyond, products of a few of them overflow
constexpr std::size_t kSamples = 48;
const char kNet[] =
    "mrdamp-narx 1 sample_time 0.0015 inputs 4 v:0 v:2 i:1 F:1 offset 0 0 0.5 0 scale 3 3 1 0.002 force 0 500 "
    "hidden 1 2 weight 0.9 -0.3 0.2 0.4 0.1 0.8 -0.5 0.3 bias 0 0.1 weight 1 -0.7 bias 0.02 end";

double Within(double value, double low, double high) {
  return std::isnan(value) ? low : std::clamp(value, low, high);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string all(reinterpret_cast<const char*>(data), size);
  const std::size_t border = std::min(all.find("---\n"), all.size());
  std::istringstream text(all.substr(0, border));
  std::string item;
  text >> item;
  const int law = mrdamp_law_find(item.c_str());
  if (law < 0) return 0;
  std::vector<double> params(static_cast<std::size_t>(mrdamp_attribute_count()));
  mrdamp_defaults(params.data());
  double dt = 1e-3;
  while (text >> item) {
    const std::size_t equals = item.find('=');
    if (equals == std::string::npos) continue;
    const std::string name = item.substr(0, equals);
    const double value = std::strtod(item.c_str() + equals + 1, nullptr);
    if (name == "dt") dt = Within(value, 1e-6, 5e-3);
    for (int i = 0; i < mrdamp_attribute_count(); ++i) {
      if (name != mrdamp_attribute_name(i)) continue;
      params[static_cast<std::size_t>(i)] = Within(value, std::fmax(mrdamp_attribute_min(i), -kLargest), std::fmin(mrdamp_attribute_max(i), kLargest));
      if (name == "substep") params[static_cast<std::size_t>(i)] = Within(value, 2e-4, 1);  // keeps a run short
    }
  }
  // Behind a mount the piston is free: a spring that pulls it away has no rest, and no finite answer.
  for (int i = 0; i < mrdamp_attribute_count(); ++i) {
    const std::string name = mrdamp_attribute_name(i);
    double& value = params[static_cast<std::size_t>(i)];
    if (name == "gas_spring_k") value = std::fmax(value, 0);
    if (name == "gas_spring_k2") value = 0;
  }
  std::vector<double> x, v, u;
  double at = 0;
  for (std::size_t k = border + 4; k + 1 < all.size() && x.size() < kSamples; k += 2) {
    v.push_back(0.02 * (static_cast<unsigned char>(all[k]) - 'm'));
    u.push_back(0.1 * (static_cast<unsigned char>(all[k + 1]) - 'm'));
    x.push_back(at += dt * v.back());
  }
  const int n = static_cast<int>(x.size());
  const int columns[] = {0, 1, 2, 3, 4, 5, 6, 7};
  std::vector<double> out(MRDAMP_COLUMNS * (x.size() + 1));
  char err[300] = "";
  mrdamp_narx* net = mrdamp_narx_parse(kNet, err, sizeof err);
  if (net == nullptr) std::abort();
  const bool refused = mrdamp_run(law, net, 1, params.data(), dt, n, x.data(), v.data(), nullptr, u.data(), nullptr, MRDAMP_COLUMNS,
                                  columns, out.data(), err, sizeof err) != 0;
  mrdamp_narx_free(net);
  if (refused != (err[0] != '\0') || std::strchr(err, '\n') != nullptr) std::abort();
  for (int k = 0; !refused && k < MRDAMP_COLUMNS * n; ++k) {
    if (std::isfinite(out[static_cast<std::size_t>(k)])) continue;
    std::fprintf(stderr, "column %d, sample %d: %g\n", k / n, k % n, out[static_cast<std::size_t>(k)]);
    std::abort();
  }
  return 0;
}

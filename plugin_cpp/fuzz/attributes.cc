// Any attributes, as MJCF gives them, through the parser: refused with one line, or a damper that passes the
// checks with every number finite.
//
// The input is lines "name value"; behind a line "---" stands the text that `weights text:...` means.
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <memory>
#include <sstream>
#include <string>

#include "core/config.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream input(std::string(reinterpret_cast<const char*>(data), size));
  std::map<std::string, std::string> given;
  std::string line;
  while (std::getline(input, line) && line != "---") {
    const std::size_t space = line.find(' ');
    if (space != std::string::npos) given[line.substr(0, space)] = line.substr(space + 1);
  }
  std::string weights;
  std::getline(input, weights, '\0');
  if (given["weights"].rfind("text:", 0) != 0) given.erase("weights");  // no files here

  const auto config = [&given](const char* name) {
    const auto found = given.find(name);
    return found == given.end() ? nullptr : found->second.c_str();
  };
  const auto text = [&weights](const char* name) { return *name == '\0' ? nullptr : weights.c_str(); };
  mrdamp::Damper damper;
  std::unique_ptr<mrdamp::NarxNet> net;
  std::string error;
  if (!mrdamp::ParseDamper(config, text, &damper, &net, &error)) {
    if (error.empty() || error.find('\n') != std::string::npos) std::abort();
    return 0;
  }
  if ((damper.law == mrdamp::Law::kNarx) != (net != nullptr)) std::abort();
  for (int i = 0; i < mrdamp::kParamCount; ++i) {
    const mrdamp::Attribute& a = mrdamp::kAttributes[i];
    const double value = damper.p.data()[i];
    const bool not_given = std::isnan(a.def) && std::isnan(value);
    if (!not_given && !(value >= a.min && value <= a.max)) std::abort();
    if (std::isinf(value)) std::abort();
  }
  return 0;
}

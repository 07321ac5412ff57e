#include "core/config.h"

#include <charconv>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

namespace mrdamp {

namespace {

std::string Quote(const char* text) { return "'" + std::string(text).substr(0, 60) + "'"; }

std::string Laws() {
  std::string list;
  for (const char* name : kLawNames) list += (list.empty() ? "" : ", ") + std::string(name);
  return list;
}

std::string Parameters(Law law) {
  std::string list;
  for (int i = 0; i < kParamCount; i++) {
    if (LawUses(law, i) == 1) list += (list.empty() ? "" : " ") + std::string(kAttributes[i].name);
  }
  return list.empty() ? "none" : list;
}

bool ReadFile(const std::string& name, std::string* text) {
  std::ifstream file(name, std::ios::binary);
  if (!file) return false;
  constexpr std::size_t kMost = 16u << 20;
  std::string all(kMost, '\0');
  file.read(all.data(), static_cast<std::streamsize>(kMost));
  all.resize(static_cast<std::size_t>(file.gcount()));
  *text = std::move(all);
  return true;
}

bool FindWeights(const std::string& name, std::string* text) {
  if (ReadFile(name, text)) return true;
  const char* path = std::getenv("MRDAMP_PATH");
  if (!path || name.empty() || name[0] == '/') return false;
  std::istringstream folders(path);
  for (std::string folder; std::getline(folders, folder, ':');) {
    if (!folder.empty() && ReadFile(folder + "/" + name, text)) return true;
  }
  return false;
}

}  // namespace

bool ParseNumber(const char* text, double* value, std::string* error) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; };
  const char *begin = text, *last = text + std::strlen(text);
  while (begin != last && blank(*begin)) begin++;
  while (begin != last && blank(last[-1])) last--;
  if (begin != last && *begin == '+') begin++;
  // Not strtod: it reads numbers as the host program's locale writes them.
  const std::from_chars_result read = std::from_chars(begin, last, *value);
  const bool too_large = read.ec == std::errc::result_out_of_range;
  if (begin == last || read.ptr != last || (read.ec != std::errc() && !too_large)) {
    *error = Quote(text) + " is not a number";
    return false;
  }
  if (too_large || !std::isfinite(*value)) {
    *error = Quote(text) + " is not a finite number";
    return false;
  }
  return true;
}

bool ParseDamper(const Lookup& config, const Lookup& text, Damper* damper, std::unique_ptr<NarxNet>* net,
                 std::string* error) {
  const char* law_name = config("law");
  const int law = law_name ? FindLaw(law_name) : -1;
  if (law < 0) {
    *error = "attribute 'law' is " + (law_name && *law_name ? Quote(law_name) : std::string("missing")) +
             "; allowed: " + Laws();
    return false;
  }
  damper->law = static_cast<Law>(law);
  damper->p = Params();
  damper->net = nullptr;
  std::string missing;
  for (int i = 0; i < kParamCount; i++) {
    const Attribute& a = kAttributes[i];
    const char* value = config(a.name);
    const bool given = value && *value;
    const bool of_law = !std::strcmp(a.group, "law") || !std::strcmp(a.group, "dependence");
    const int use = of_law ? LawUses(damper->law, i) : 2;
    if (given && use == 0) {
      *error = "attribute '" + std::string(a.name) + "' = " + Quote(value) + " is no parameter of law " + law_name +
               "; it takes " + Parameters(damper->law);
      return false;
    }
    if (!given) {
      if (use == 1) missing += std::string(missing.empty() ? "'" : ", '") + a.name + "' (" + a.unit + ")";
      continue;
    }
    std::string why;
    if (!ParseNumber(value, damper->p.data() + i, &why)) {
      *error = "attribute '" + std::string(a.name) + "' = " + why + "; allowed: a number (" + a.unit + ")";
      return false;
    }
  }
  if (!missing.empty()) {
    *error = "law " + std::string(law_name) + " needs attribute " + missing;
    return false;
  }
  const char* weights = config("weights");
  const bool given = weights && *weights;
  if (damper->law == Law::kNarx && given) {
    std::string content;
    if (!std::strncmp(weights, "text:", 5)) {
      const char* inside = text(weights + 5);
      if (!inside) {
        *error = "attribute 'weights' = " + Quote(weights) + ": the model has no <custom><text> of that name";
        return false;
      }
      content = inside;
    } else if (!FindWeights(weights, &content)) {
      *error = "attribute 'weights' = " + Quote(weights) +
               ": no such file; allowed: a file, one in a folder of MRDAMP_PATH, or text:NAME";
      return false;
    }
    *net = ParseNarx(content, error);
    if (!*net) {
      *error = "attribute 'weights' = " + Quote(weights) + ": " + *error;
      return false;
    }
    damper->net = net->get();
  } else if (given) {
    *error = "attribute 'weights' = " + Quote(weights) + " is for law narx alone; the law here is " + law_name;
    return false;
  }
  char line[300];
  if (!Check(*damper, line, sizeof line)) {
    *error = std::string("attribute ") + line;
    if (damper->law == Law::kNarx && !damper->net) *error = line;
    return false;
  }
  return true;
}

}  // namespace mrdamp

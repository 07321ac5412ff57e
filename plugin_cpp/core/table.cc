#include <cstring>

#include "core/params.h"

namespace mrdamp {

const Attribute kAttributes[kParamCount] = {
#define MRDAMP_ATTRIBUTE(name, group, unit, def, lo, hi, meaning) {#name, #group, unit, def, lo, hi, meaning},
#include "core/attributes.def"
};

const char* const kLawNames[kLawCount] = {
#define MRDAMP_LAW(name, ...) #name,
#include "core/attributes.def"
    "narx"};

const LawRow kLawRows[kLawCount] = {
#define MRDAMP_LAW(name, Type, equations, parameters, search, sources) {equations, parameters, search, sources},
#include "core/attributes.def"
    {"a network over lagged `x`, `v`, `b` and its own past force (Chen, Ni, Or 2015, Eqs. 5, 9, 11)", "|", "", "chen2015 mackay1992"}};

int FindAttribute(const char* name) {
  for (int i = 0; i < kParamCount; i++) {
    if (!std::strcmp(name, kAttributes[i].name)) return i;
  }
  return -1;
}

int FindLaw(const char* name) {
  for (int i = 0; i < kLawCount; i++) {
    if (!std::strcmp(name, kLawNames[i])) return i;
  }
  return -1;
}

int LawUses(Law law, int attribute) {
  const char* name = kAttributes[attribute].name;
  const std::size_t length = std::strlen(name);
  int found = 1;
  for (const char* word = kLawRows[static_cast<int>(law)].parameters; *word;) {
    const std::size_t n = std::strcspn(word, " ");
    if (n == 1 && *word == '|') found = 2;
    else if (n == length && !std::strncmp(word, name, n)) return found;
    word += n;
    while (*word == ' ') word++;
  }
  return 0;
}

}  // namespace mrdamp

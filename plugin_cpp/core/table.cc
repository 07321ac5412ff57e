#include <cstring>

#include "core/params.h"

namespace mrdamp {

const Attribute kAttributes[kParamCount] = {
#define MRDAMP_ATTRIBUTE(name, group, unit, def, lo, hi, meaning) {#name, #group, unit, def, lo, hi, meaning},
#include "core/attributes.def"
};

const char* const kLawNames[kLawCount] = {"bingham", "bouc_wen", "hyperbolic_tangent", "modified_bouc_wen", "narx"};

namespace {

// Parameters of each law, in the contract's order; behind the bar the optional ones.
const char* const kLawParameters[kLawCount] = {
    "c0a c0b fya fyb v_ref | c0c c0e c0r fyc fye fyr",
    "c0a c0b alpha_a alpha_b gamma beta A n k0 x0 | c0c c0e c0r alpha_c alpha_e alpha_r hysteresis_rate "
    "hysteresis_floor",
    "k0a k0b k1a k1b c0a c0b c1a c1b m0 f0a f0b v_ref | c0c c0e c0r c1c c1e c1r f0c f0e f0r k0c k0e k0r k1c k1e k1r",
    "c0a c0b c1a c1b k0 k1 x0 alpha_a alpha_b gamma beta A n | c0c c0e c0r c1c c1e c1r alpha_c alpha_e alpha_r "
    "hysteresis_rate hysteresis_floor",
    "|"};

}  // namespace

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
  for (const char* word = kLawParameters[static_cast<int>(law)]; *word;) {
    const std::size_t n = std::strcspn(word, " ");
    if (n == 1 && *word == '|') found = 2;
    else if (n == length && !std::strncmp(word, name, n)) return found;
    word += n;
    while (*word == ' ') word++;
  }
  return 0;
}

}  // namespace mrdamp

// All parameters of one damper (or of a pack of them) as a plain struct of numbers, generated from attributes.def.
#ifndef MRDAMP_CORE_PARAMS_H_
#define MRDAMP_CORE_PARAMS_H_

#include "core/real.h"

namespace mrdamp {

struct Params {
#ifdef MRDAMP_FIELDS  // made for the attributes in use: the others are constants
#include "core/fields.h"
#else
#define MRDAMP_ATTRIBUTE(name, group, unit, def, lo, hi, meaning) Real name = def;
#ifdef MRDAMP_PLAIN  // code without these effects: as constants they cost nothing, and the layout stays
#define MRDAMP_EFFECT(name, group, unit, def, lo, hi, meaning) \
  static constexpr double name = def;                          \
  Real name##_left_out = def;
#endif
#include "core/attributes.def"
#endif

  Real* data() { return reinterpret_cast<Real*>(this); }
  const Real* data() const { return reinterpret_cast<const Real*>(this); }

  // f(number, attribute) of those that are no constants
  template <class F>
  void Each(F&& f) {
    int number = 0;
#define MRDAMP_ATTRIBUTE(name, group, unit, def, lo, hi, meaning) f(number++, name);
#ifdef MRDAMP_PLAIN
#define MRDAMP_EFFECT(name, group, unit, def, lo, hi, meaning) number++;
#endif
#include "core/attributes.def"
  }
};

inline constexpr int kParamCount = sizeof(Params) / sizeof(Real);

// One row of the attribute table.
struct Attribute {
  const char* name;
  const char* group;
  const char* unit;
  double def;
  double min, max;
  const char* meaning;
};
extern const Attribute kAttributes[kParamCount];

enum class Law : int {
#define MRDAMP_LAW(name, Type, ...) k##Type,
#include "core/attributes.def"
  kNarx,
};
inline constexpr int kLawCount = static_cast<int>(Law::kNarx) + 1;
extern const char* const kLawNames[kLawCount];
// The rest of a law's row in attributes.def.
struct LawRow {
  const char *equations, *parameters, *search, *sources;
};
extern const LawRow kLawRows[kLawCount];

// Index of an attribute in Params; -1 if there is none of that name.
int FindAttribute(const char* name);
// Number of the law; -1 if there is none of that name.
int FindLaw(const char* name);
// 1 if the attribute is a required, 2 if it is an optional parameter of the law, else 0.
int LawUses(Law law, int attribute);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_PARAMS_H_

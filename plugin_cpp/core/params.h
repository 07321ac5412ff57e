// All parameters of one damper as a plain struct of doubles, generated from attributes.def.
#ifndef MRDAMP_CORE_PARAMS_H_
#define MRDAMP_CORE_PARAMS_H_

#include <cmath>
#include <limits>

namespace mrdamp {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kInf = std::numeric_limits<double>::infinity();
inline constexpr double kUnset = std::numeric_limits<double>::quiet_NaN();

struct Params {
#define MRDAMP_ATTRIBUTE(name, group, unit, def, lo, hi, meaning) double name = def;
#include "core/attributes.def"
#undef MRDAMP_ATTRIBUTE

  double* data() { return reinterpret_cast<double*>(this); }
  const double* data() const { return reinterpret_cast<const double*>(this); }
};

inline constexpr int kParamCount = sizeof(Params) / sizeof(double);

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

enum class Law : int { kBingham, kBoucWen, kHyperbolicTangent, kModifiedBoucWen, kNarx };
inline constexpr int kLawCount = 5;
extern const char* const kLawNames[kLawCount];

// Index of an attribute in Params; -1 if there is none of that name.
int FindAttribute(const char* name);
// Number of the law; -1 if there is none of that name.
int FindLaw(const char* name);
// 1 if the attribute is a required, 2 if it is an optional parameter of the law, else 0.
int LawUses(Law law, int attribute);

}  // namespace mrdamp

#endif  // MRDAMP_CORE_PARAMS_H_

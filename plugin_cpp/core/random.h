// Counter-based random numbers: a function of a key and a count, so that the same run has the same noise after a copy.
#ifndef MRDAMP_CORE_RANDOM_H_
#define MRDAMP_CORE_RANDOM_H_

#include <cmath>
#include <cstdint>

namespace mrdamp {

// A 64-bit mix with good avalanche (Steele, Lea, Flood 2014, doi:10.1145/2660193.2660195).
inline std::uint64_t Mix(std::uint64_t z) {
  z += 0x9e3779b97f4a7c15ull;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

// Above 0, below 1.
inline double Unit(std::uint64_t bits) { return (static_cast<double>(bits >> 11) + 0.5) * 0x1p-53; }

// Standard normal number, by Box and Muller.
inline double Normal(std::uint64_t key, std::uint64_t count) {
  const double a = Unit(Mix(key ^ Mix(2 * count))), b = Unit(Mix(key ^ Mix(2 * count + 1)));
  return std::sqrt(-2 * std::log(a)) * std::cos(6.283185307179586 * b);
}

}  // namespace mrdamp

#endif  // MRDAMP_CORE_RANDOM_H_

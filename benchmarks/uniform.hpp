#pragma once

#include <cstdint>

namespace rbres::bench {

/// Uniform numbers from splitmix64 (Steele, Lea, Flood 2014): what is benchmarked does not depend on rbres's
/// own generator.
class Uniform {
 public:
  explicit Uniform(std::uint64_t seed) : state_(seed) {}
  double operator()(double from, double to) {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return from + (to - from) * static_cast<double>((z ^ (z >> 31)) >> 11) * 0x1p-53;
  }

 private:
  std::uint64_t state_;
};

}  // namespace rbres::bench

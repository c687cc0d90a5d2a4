#pragma once

#include <rbres/core/error.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/nn/kernels.hpp>

#include <algorithm>

#include <cstddef>
#include <cstdint>

namespace rbres::RBRES_ABI {

/// Which numbers Dropout keeps: a pure function of seed, step, stage, sample and feature, so that threads
/// change nothing.
struct DropoutMask {
  /// Probability of becoming 0, in [0, 1), in steps of 1/65536; below 0 no number does, not even in a
  /// FixedDropout.
  double rate = -1;
  /// Of the run.
  std::uint64_t seed = 0;
  /// Of the optimiser.
  std::uint64_t step = 0;
  std::uint32_t first = 0;  ///< number of the first sample, so that parts of a batch differ

  /// Throws Error where the rate is none.
  void check() const {
    if (!(rate < 1)) detail::refuse("DropoutMask::rate", "below 1", rate);
  }
};

namespace detail {

/// Sixteen blocks of philox4x32, a register of them at a time: word w of block b in words[w][b]. The blocks'
/// counters differ in their first word: first, first + 1, ...
inline void philox_blocks(std::uint32_t first, std::uint32_t second, std::uint32_t third,
                          std::uint32_t fourth, std::uint64_t seed, std::uint32_t (&words)[4][16]) noexcept {
  using Register = Simd<std::uint64_t>;  // 32 bits in each lane, so that products fit
  constexpr int width = simd_width<std::uint64_t>;
  for (int block = 0; block < 16; block += width) {
    std::uint64_t counters[width];
    for (int b = 0; b < width; ++b) counters[b] = first + static_cast<std::uint32_t>(block + b);
    Register c[4] = {load(counters), Register{} + second, Register{} + third, Register{} + fourth};
    std::uint64_t key[2] = {seed & 0xffffffffu, seed >> 32};
    for (int round = 0; round < 10; ++round) {
      const Register x = multiply_low(c[0], 0xD2511F53u), y = multiply_low(c[2], 0xCD9E8D57u);
      c[0] = y >> 32 ^ c[1] ^ key[0];
      c[2] = x >> 32 ^ c[3] ^ key[1];
      c[1] = y & 0xffffffffu;
      c[3] = x & 0xffffffffu;
      key[0] = (key[0] + 0x9E3779B9u) & 0xffffffffu;
      key[1] = (key[1] + 0xBB67AE85u) & 0xffffffffu;
    }
    for (int w = 0; w < 4; ++w)
      for (int b = 0; b < width; ++b) words[w][block + b] = static_cast<std::uint32_t>(c[w][b]);
  }
}

/// The mask of a layer that has a rate of its own, if that is not negative.
inline DropoutMask of_layer(DropoutMask mask, double own_rate) noexcept {
  mask.rate = mask.rate < 0 ? 0 : own_rate < 0 ? mask.rate : own_rate;
  return mask;
}

/// Writes 0 or 1 / (1 - rate) for the features of one sample: sixteen bits of randomness for each.
template <class T>
void fill_dropout(const DropoutMask& mask, int stage, int features, Panels<T> factors,
                  std::ptrdiff_t sample) noexcept {
  const auto threshold = static_cast<std::uint32_t>(mask.rate * 65536 + 0.5);
  const T factor[2] = {T{}, static_cast<T>(1 / (1 - threshold / 65536.0))};
  const auto high =
      static_cast<std::uint32_t>(mask.step >> 32) | 0x80000000u;  // apart from every stream of Random
  std::uint32_t words[4][16];
  for (int first = 0; first < features; first += 128) {
    philox_blocks(static_cast<std::uint32_t>(stage << 16 | first / 8),
                  mask.first + static_cast<std::uint32_t>(sample), static_cast<std::uint32_t>(mask.step),
                  high, mask.seed, words);
    T numbers[128];
    for (int w = 0; w < 4; ++w)
      for (int b = 0; b < 16; ++b) {
        numbers[w * 32 + b] = (words[w][b] & 0xffffu) < threshold ? factor[0] : factor[1];
        numbers[w * 32 + 16 + b] = words[w][b] >> 16 < threshold ? factor[0] : factor[1];
      }
    for (int f = first; f < features && f < first + 128; f += lanes<T>)
      std::copy_n(numbers + (f - first), lanes<T>, factors.at(f, sample));
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

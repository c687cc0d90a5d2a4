#pragma once

#include <cstdint>
#include <rbres/core/abi.hpp>

namespace rbres::RBRES_ABI {

/// The upper half of a float: its sign, exponent, and 7 of the 23 bits of its fraction. Numbers are stored
/// so, in half the memory, and read as floats; there is no arithmetic of its own. (libc++ 13 has no
/// bit_cast.)
struct bfloat16 {
  std::uint16_t bits = 0;  ///< as they stand in memory

  /// Zero.
  constexpr bfloat16() noexcept = default;
  /// The nearest one, ties to even: off by at most a 256th of x. What is not finite stays so; the largest
  /// floats become infinite.
  constexpr explicit bfloat16(float x) noexcept {
    const auto whole = __builtin_bit_cast(std::uint32_t, x);
    const bool is_nan = (whole & 0x7fffffff) > 0x7f800000;
    const std::uint32_t rounded = is_nan ? whole | 0x400000 : whole + 0x7fff + (whole >> 16 & 1);
    bits = static_cast<std::uint16_t>(rounded >> 16);
  }
  /// The one that stands in memory so.
  static constexpr bfloat16 of_bits(std::uint16_t bits) noexcept {
    bfloat16 out;
    out.bits = bits;
    return out;
  }
  /// Exactly.
  constexpr operator float() const noexcept {
    return __builtin_bit_cast(float, static_cast<std::uint32_t>(bits) << 16);
  }
};

}  // namespace rbres::RBRES_ABI

#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <rbres/core/abi.hpp>
#include <string_view>

namespace rbres::RBRES_ABI::detail {

/// A whole number of up to 800 decimal digits: room for that of a double times a power of ten.
class LongNumber {
 public:
  explicit LongNumber(std::uint64_t number) {
    for (; number > 0; number /= base) parts_[size_++] = static_cast<std::uint32_t>(number % base);
  }
  /// Multiplies by factor^times; factor^most must be less than 2^32.
  void multiply(std::uint32_t factor, int times, int most) {
    for (; times > 0; times -= most) {
      std::uint64_t by = 1, carry = 0;
      for (int k = 0; k < std::min(times, most); ++k) by *= factor;
      for (std::size_t i = 0; i < size_; ++i) {
        carry += by * parts_[i];
        parts_[i] = static_cast<std::uint32_t>(carry % base);
        carry /= base;
      }
      for (; carry > 0; carry /= base) parts_[size_++] = static_cast<std::uint32_t>(carry % base);
    }
  }
  /// Digit i from the lowest.
  int digit(int i) const {
    std::uint32_t part = parts_[static_cast<std::size_t>(i / 9)];
    for (int k = 0; k < i % 9; ++k) part /= 10;
    return static_cast<int>(part % 10);
  }
  /// How many digits it has, the highest of which is not 0.
  int digits() const {
    int count = static_cast<int>(9 * size_);
    while (count > 0 && digit(count - 1) == 0) --count;
    return count;
  }

 private:
  static constexpr std::uint64_t base = 1'000'000'000;
  std::array<std::uint32_t, 90> parts_{};  ///< the lowest first
  std::size_t size_ = 0;
};

/// A number with up to 12 digits as printf's %.12g writes it, rounded to the nearest; it stands in `room`.
/// What the standard library has for this brings exceptions, and with them the heap, to small processors.
[[gnu::cold]] inline std::string_view number_text(double x, std::array<char, 24>& room) {
  constexpr int most = 12;
  char* to = room.data();
  const auto text = [&](std::string_view words) {
    to = std::copy(words.begin(), words.end(), to);
    return std::string_view(room.data(), static_cast<std::size_t>(to - room.data()));
  };
  const auto bits = __builtin_bit_cast(std::uint64_t, x);
  const int power = static_cast<int>(bits >> 52 & 0x7ff);
  const std::uint64_t fraction = bits & ((std::uint64_t{1} << 52) - 1);
  if (bits >> 63 != 0) *to++ = '-';
  if (power == 0x7ff) return text(fraction != 0 ? "nan" : "inf");
  if (power == 0 && fraction == 0) return text("0");

  // x = whole 2^exponent = number 10^-shift
  const std::uint64_t whole = power == 0 ? fraction : fraction | std::uint64_t{1} << 52;
  const int exponent = std::max(power, 1) - 1075, shift = std::max(-exponent, 0);
  LongNumber number(whole);
  number.multiply(2, exponent, 31);
  number.multiply(5, shift, 13);
  const int digits = number.digits();
  int place = digits - 1 - shift;  // of the first digit: it counts 10^place
  std::uint64_t kept = 0;
  for (int i = 0; i < most; ++i)
    kept = 10 * kept + static_cast<std::uint64_t>(i < digits ? number.digit(digits - 1 - i) : 0);
  if (digits > most) {
    const int next = digits - 1 - most;
    bool more = false;
    for (int i = 0; i < next; ++i) more = more || number.digit(i) != 0;
    const int first = number.digit(next);
    if (first > 5 || (first == 5 && (more || kept % 2 == 1))) ++kept;
    if (kept == 1'000'000'000'000) kept /= 10, ++place;
  }
  int count = most;
  for (; kept % 10 == 0; kept /= 10) --count;
  std::array<char, most> digit;
  for (int i = count; i-- > 0; kept /= 10)
    digit[static_cast<std::size_t>(i)] = static_cast<char>('0' + kept % 10);

  const bool scientific = place < -4 || place >= most;
  const int before = scientific ? 1 : place + 1;  // digits before the point
  if (before <= 0) to = std::fill_n(std::copy_n("0.", 2, to), -before, '0');
  for (int i = 0; i < std::max(count, before); ++i) {
    if (i == before && i > 0) *to++ = '.';
    *to++ = i < count ? digit[static_cast<std::size_t>(i)] : '0';
  }
  if (scientific) {
    const int size = std::max(place, -place);
    *to++ = 'e';
    *to++ = place < 0 ? '-' : '+';
    if (size >= 100) *to++ = static_cast<char>('0' + size / 100);
    *to++ = static_cast<char>('0' + size / 10 % 10);
    *to++ = static_cast<char>('0' + size % 10);
  }
  return text("");
}

}  // namespace rbres::RBRES_ABI::detail

#pragma once

#include <charconv>
#include <cstdint>
#include <type_traits>

/// The program, which is the same on host and target.
void run();

/// Where its words go: stdout on the host, the debugger's console on the target.
void print(const char* words);
[[noreturn]] void stop(int status);

/// Instructions since the start, to within 40; 0 where nobody counts them.
std::uint64_t instructions();
/// Bytes of stack that have been in use so far; 0 where nobody looks.
std::uint32_t stack_used();

inline void print(const char* name, std::uint64_t number) {
  char digits[24];
  *std::to_chars(digits, digits + 23, number).ptr = '\0';
  print(name);
  print(" ");
  print(digits);
  print("\n");
}

/// A vector's numbers to the last bit: as the hexadecimal digits of what stands in memory.
template <class Vector>
void print_bits(const char* name, const Vector& v) {
  print(name);
  for (const auto number : {v.x, v.y, v.z}) {
    using Bits = std::conditional_t<sizeof number == 4, std::uint32_t, std::uint64_t>;
    char digits[24];
    *std::to_chars(digits, digits + 23, __builtin_bit_cast(Bits, number), 16).ptr = '\0';
    print(" ");
    print(digits);
  }
  print("\n");
}

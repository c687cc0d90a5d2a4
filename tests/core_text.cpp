// What errors say: words and numbers without streams, as streams would write them.
#include <doctest/doctest.h>

#include <array>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <limits>
#include <ostream>
#include <rbres/core/error.hpp>
#include <rbres/core/philox.hpp>
#include <string>
#include <string_view>

#include "error_of.hpp"

namespace {

std::string printed(double x) {
  std::array<char, 40> words;
  std::snprintf(words.data(), words.size(), "%.12g", x);
  return words.data();
}

std::string refused(double found) {
  return error_of([&] { rbres::detail::refuse("it", "another", found); });
}

/// Converts to a number, and streams as something else, as JSON does.
struct Streamed {
  operator bool() const { return true; }
};
std::ostream& operator<<(std::ostream& out, Streamed) { return out << "streamed"; }

}  // namespace

TEST_CASE("parts of a text stand in it as they would be streamed") {
  using rbres::detail::text;
  CHECK(text(Streamed{}, ' ', true, false, " a", 'b', std::string("c"), std::string_view("d")) ==
        "streamed 10 abcd");
  CHECK(text(0, ' ', -1, ' ', 42u, ' ', std::int8_t{-128}) == "0 -1 42 -128");
  CHECK(text(std::numeric_limits<std::int64_t>::min(), ' ', std::numeric_limits<std::uint64_t>::max()) ==
        "-9223372036854775808 18446744073709551615");
}

TEST_CASE("an error has a number as printf writes it, with twelve digits") {
  const auto same = [](double x) { CHECK(refused(x) == "it: expected another, found " + printed(x)); };
  for (const double x : {0.0,
                         -0.0,
                         1.0,
                         0.1,
                         -2.5,
                         1e-4,
                         1e-5,
                         123456789012.0,
                         1234567890123.0,
                         999999999999.5,
                         0.00099999999999950001,
                         5e-324,
                         2.2250738585072014e-308,
                         0.5,
                         1e22,
                         1e23,
                         12.0,
                         100.0,
                         2.5e11,
                         1.000000000005,
                         1.000000000015,
                         8388608.00000005,
                         1.7976931348623157e308}) {
    same(x);
    same(static_cast<double>(static_cast<float>(x)));
  }
  for (const double x : {std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()})
    same(x), same(-x);
  rbres::Random random(4);
  for (int k = 0; k < 20000; ++k) {
    same(random.normal());
    const auto bits = static_cast<std::uint64_t>(random.uniform(0, 1) * 9.2e18);
    same(std::bit_cast<double>(bits));
  }
}

TEST_CASE("ties go to the even digit") {
  // halves of whole numbers are exact
  for (const double x : {100000000000.5, 100000000001.5, 999999999998.5})
    CHECK(refused(x) == "it: expected another, found " + printed(x));
}

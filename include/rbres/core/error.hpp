#pragma once

#include <array>
#include <charconv>
#include <rbres/core/abi.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace rbres {

/// What every refused input throws: says what was expected and what was found.
/// Thrown only where things are built, loaded or configured, never from a hot loop. One type for all
/// instruction sets (see abi.hpp): what one file throws another can catch.
class Error : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace rbres

namespace rbres::RBRES_ABI::detail {

/// Concatenates anything that streams, with enough digits to tell two doubles apart.
template <class... Parts>
std::string text(const Parts&... parts) {
  std::ostringstream out;
  out.precision(12);
  (out << ... << parts);
  return out.str();
}

/// The shortest text that reads back as the same number.
inline std::string exact(double x) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), x).ptr};
}

/// Throws "WHAT: expected EXPECTED, found FOUND".
template <class Found>
[[noreturn]] void refuse(std::string_view what, std::string_view expected, const Found& found) {
  throw Error(text(what, ": expected ", expected, ", found ", found));
}

/// Calls f(); what it refuses begins with who(), such as "plane 1, ", which says whose fault it is.
template <class Who, class F>
decltype(auto) naming(const Who& who, const F& f) {
  try {
    return f();
  } catch (const Error& fault) {
    throw Error(text(who(), fault.what()));
  }
}

}  // namespace rbres::RBRES_ABI::detail

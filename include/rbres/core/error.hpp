#pragma once

#include <array>
#include <atomic>
#include <charconv>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <rbres/core/abi.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

/// The library. Everything but Error and error_handler stands in an inline namespace, see abi.hpp.
namespace rbres {

/// What every refused input throws: says what was expected and what was found.
/// Thrown only where things are built, loaded or configured, never from a hot loop. One type for all
/// instruction sets (see abi.hpp): what one file throws another can catch.
class Error : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// What files compiled without exceptions call in place of throwing an Error, with its words. It must not
/// return: where it does, and where it is null, as it is at first, the words go to stderr and the program
/// aborts.
inline std::atomic<void (*)(const char* what)> error_handler{nullptr};

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
#if defined(_LIBCPP_VERSION) && _LIBCPP_VERSION < 14000  // has no to_chars of doubles
  for (int digits = 1; digits <= 17; ++digits) {
    std::snprintf(text.data(), text.size(), "%.*g", digits, x);
    if (std::strtod(text.data(), nullptr) == x) break;
  }
  return text.data();
#else
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), x).ptr};
#endif
}

/// Throws Error(what); without exceptions, see error_handler.
[[noreturn]] inline void fail(const std::string& what) {
#if RBRES_HAS_EXCEPTIONS
  throw Error(what);
#else
  if (const auto handler = error_handler.load()) handler(what.c_str());
  std::fprintf(stderr, "rbres: %s\n", what.c_str());
  std::abort();
#endif
}

/// Calls f(); where it throws, otherwise(), which may throw again.
template <class F, class Otherwise>
void attempt(const F& f, [[maybe_unused]] const Otherwise& otherwise) {
#if RBRES_HAS_EXCEPTIONS
  try {
    f();
  } catch (...) {
    otherwise();
  }
#else
  f();
#endif
}

/// Throws "WHAT: expected EXPECTED, found FOUND".
template <class Found>
[[noreturn]] void refuse(std::string_view what, std::string_view expected, const Found& found) {
  fail(text(what, ": expected ", expected, ", found ", found));
}

/// Error where `all` things do not have the numbers first ... first + count - 1.
inline void check_range(std::string_view things, std::ptrdiff_t all, std::ptrdiff_t first,
                        std::ptrdiff_t count) {
  if (first < 0 || first > all || count < 0 || count > all - first)
    refuse(things, text("some of ", all, ", the first of which is 0"),
           text(count, ", the first of which is ", first));
}

/// Calls f(); what it refuses begins with who(), such as "plane 1, ", which says whose fault it is. Without
/// exceptions it begins with nothing.
template <class Who, class F>
decltype(auto) naming([[maybe_unused]] const Who& who, const F& f) {
#if RBRES_HAS_EXCEPTIONS
  try {
    return f();
  } catch (const Error& fault) {
    fail(text(who(), fault.what()));
  }
#else
  return f();
#endif
}

}  // namespace rbres::RBRES_ABI::detail

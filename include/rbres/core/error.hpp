#pragma once

#include <atomic>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <rbres/core/abi.hpp>
#include <rbres/core/text.hpp>
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
/// aborts. (Without an operating system there is no stderr.) Words beyond 511 characters are cut.
inline std::atomic<void (*)(const char* what)> error_handler{nullptr};

}  // namespace rbres

namespace rbres::RBRES_ABI::detail {

/// See fail(): one function for all lists of parts.
[[noreturn, gnu::cold, gnu::noinline]] inline void fail_with(TextParts parts) {
#if RBRES_HAS_EXCEPTIONS
  throw Error(joined(parts));
#else
  const Line what(parts);
  if (const auto handler = error_handler.load()) handler(what.c_str());
#if defined(__unix__) || defined(__APPLE__) || defined(_WIN32)
  std::fprintf(stderr, "rbres: %s\n", what.c_str());
#endif
  std::abort();
#endif
}

/// Throws Error of these parts of a text, see text(); without exceptions, see error_handler.
template <class... Any>
[[noreturn, gnu::cold]] void fail(const Any&... parts) {
  fail_with({TextPart(as_part(parts))...});
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
[[noreturn, gnu::cold]] void refuse(std::string_view what, std::string_view expected, const Found& found) {
  fail(what, ": expected ", expected, ", found ", found);
}

/// Error where `all` things do not have the numbers first ... first + count - 1.
inline void check_range(std::string_view things, std::ptrdiff_t all, std::ptrdiff_t first,
                        std::ptrdiff_t count) {
  if (first < 0 || first > all || count < 0 || count > all - first)
    refuse(things, Line("some of ", all, ", the first of which is 0"),
           Line(count, ", the first of which is ", first));
}

/// Calls f(); what it refuses begins with who(), such as "plane 1, ", which says whose fault it is. Without
/// exceptions it begins with nothing.
template <class Who, class F>
decltype(auto) naming([[maybe_unused]] const Who& who, const F& f) {
#if RBRES_HAS_EXCEPTIONS
  try {
    return f();
  } catch (const Error& fault) {
    fail(who(), fault.what());
  }
#else
  return f();
#endif
}

}  // namespace rbres::RBRES_ABI::detail

#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <rbres/core/abi.hpp>
#include <rbres/core/number_text.hpp>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// Appends a part to a text: words, numbers, or anything that streams. Floating-point numbers have enough
/// digits to tell two apart: 12, as printf's %.12g. Neither words nor numbers bring in streams or the heap.
template <class Text, class Part>
void append_text(Text& text, const Part& part) {
  if constexpr (std::is_convertible_v<const Part&, std::string_view>) {
    text.append(std::string_view(part));
  } else if constexpr (std::same_as<Part, char>) {
    text.append(std::string_view(&part, 1));
  } else if constexpr (std::same_as<Part, bool>) {
    text.append(std::string_view(part ? "1" : "0"));
  } else if constexpr (std::integral<Part>) {
    std::array<char, 24> digits;
    const char* end = std::to_chars(digits.data(), digits.data() + digits.size(), part).ptr;
    text.append(std::string_view(digits.data(), static_cast<std::size_t>(end - digits.data())));
  } else if constexpr (std::floating_point<Part>) {
    std::array<char, 24> room;
    text.append(number_text(static_cast<double>(part), room));
  } else {
    std::ostringstream out;
    out.precision(12);
    out << part;
    text.append(out.str());
  }
}

/// Concatenates parts, see append_text().
template <class... Parts>
std::string text(const Parts&... parts) {
  std::string all;
  (append_text(all, parts), ...);
  return all;
}

/// The same in a room of its own, for what a program without a heap may refuse. Words that find no room are
/// left out.
class Line {
 public:
  template <class... Parts>
  explicit Line(const Parts&... parts) {
    (append_text(*this, parts), ...);
    words_[size_] = '\0';
  }
  void append(std::string_view words) {
    const std::size_t count = std::min(words.size(), words_.size() - 1 - size_);
    std::copy_n(words.data(), count, words_.data() + size_);
    size_ += count;
  }
  operator std::string_view() const { return {words_.data(), size_}; }
  const char* c_str() const { return words_.data(); }

 private:
  std::array<char, 512> words_;
  std::size_t size_ = 0;
};

/// The shortest text that reads back as the same number.
inline std::string exact(double x) {
  std::array<char, 32> text;
#if defined(_LIBCPP_VERSION) && _LIBCPP_VERSION < 14000
  for (int digits = 1; digits <= 17; ++digits) {
    std::snprintf(text.data(), text.size(), "%.*g", digits, x);
    if (std::strtod(text.data(), nullptr) == x) break;
  }
  return text.data();
#else
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), x).ptr};
#endif
}

}  // namespace rbres::RBRES_ABI::detail

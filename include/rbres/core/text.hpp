#pragma once

#include <algorithm>
#include <array>
#include <charconv>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <rbres/core/abi.hpp>
#include <rbres/core/number_text.hpp>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// A whole number as text, which stands in `room`.
inline std::string_view integer_text(std::uint64_t size, bool negative, std::array<char, 24>& room) {
  std::size_t at = room.size();
  do room[--at] = static_cast<char>('0' + size % 10);
  while ((size /= 10) > 0);
  if (negative) room[--at] = '-';
  return {room.data() + at, room.size() - at};
}

/// A part of a text: words, which must outlive it, or a number. Floating-point numbers have enough digits to
/// tell two apart: 12, as printf's %.12g. Neither brings in streams or the heap. What only converts to a
/// number, as JSON does, is streamed before. So that little is compiled for each list of parts, what becomes
/// of them is no template.
class TextPart {
 public:
  /// @{
  template <class T>
  requires(std::is_convertible_v<const T&, std::string_view>) TextPart(const T& words) : words_(words) {}
  template <std::integral T>
  TextPart(T x) {
    if constexpr (std::same_as<T, char>) {
      room_[0] = x;
      words_ = {room_.data(), 1};
    } else if constexpr (std::same_as<T, bool>) {
      words_ = x ? "1" : "0";
    } else {
      const auto bits = static_cast<std::uint64_t>(x);
      words_ = integer_text(x < T(0) ? 0 - bits : bits, x < T(0), room_);
    }
  }
  template <std::floating_point T>
  TextPart(T number) : words_(number_text(static_cast<double>(number), room_)) {}
  TextPart(const TextPart&) = delete;
  TextPart& operator=(const TextPart&) = delete;
  /// @}

  std::string_view words() const { return words_; }

 private:
  std::array<char, 24> room_;
  std::string_view words_;
};
using TextParts = std::initializer_list<TextPart>;

/// What is no TextPart itself, as it streams.
template <class T>
decltype(auto) as_part(const T& part) {
  if constexpr (std::is_constructible_v<TextPart, const T&>) {
    return (part);
  } else {
    std::ostringstream out;
    out.precision(12);
    out << part;
    return out.str();
  }
}

/// See text(): one function for all lists of parts.
[[gnu::noinline]] inline std::string joined(TextParts parts) {
  std::string all;
  for (const TextPart& part : parts) all.append(part.words());
  return all;
}

/// Concatenates parts: words, numbers, or anything that streams.
template <class... Any>
std::string text(const Any&... parts) {
  return joined({TextPart(as_part(parts))...});
}

/// The same in a room of its own, for what a program without a heap may refuse. Words that find no room are
/// left out.
class Line {
 public:
  template <class... Any>
  explicit Line(const Any&... parts) : Line(TextParts{TextPart(as_part(parts))...}) {}
  [[gnu::noinline]] explicit Line(TextParts parts) {
    for (const TextPart& part : parts) {
      const std::string_view words = part.words();
      const std::size_t count = std::min(words.size(), words_.size() - 1 - size_);
      std::copy_n(words.data(), count, words_.data() + size_);
      size_ += count;
    }
    words_[size_] = '\0';
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

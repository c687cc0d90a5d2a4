#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include <rbres/core/abi.hpp>
#include <rbres/io/utf8.hpp>

/// @file
/// Strings of JSON (RFC 8259, section 7) without a library of JSON, which would take longer to compile than
/// all else that loads a model.
namespace rbres::RBRES_ABI::detail {

/// A string of UTF-8 in quotes, in which only what must be is escaped.
[[gnu::cold]] inline std::string json_string(std::string_view text) {
  constexpr std::string_view named = "\"\\\b\f\n\r\t", names = "\"\\bfnrt", digits = "0123456789abcdef";
  std::string out = "\"";
  for (const char c : text) {
    const auto code = static_cast<unsigned char>(c);
    if (const std::size_t name = named.find(c); name != named.npos) {
      (out += '\\') += names[name];
    } else if (code < 0x20) {
      ((out += "\\u00") += digits[code >> 4]) += digits[code & 15u];
    } else {
      out += c;
    }
  }
  return out += '"';
}

/// Puts the string that begins with the quote text[at] into `out`, and `at` behind its end. False where it is
/// no string of JSON, or not of UTF-8: `at` then is where this was seen.
[[gnu::cold]] inline bool read_quoted(std::string_view text, std::size_t& at, std::string& out) {
  const auto code_unit = [&](std::uint32_t& unit) {
    unit = 0;
    for (int k = 0; k < 4; ++k, ++at) {
      constexpr std::string_view digits = "0123456789abcdef0123456789ABCDEF";
      const std::size_t digit = at < text.size() ? digits.find(text[at]) : digits.npos;
      if (digit == digits.npos) return false;
      unit = unit << 4 | (digit & 15u);
    }
    return true;
  };
  out.clear();
  for (++at; at < text.size();) {
    const char c = text[at];
    if (static_cast<unsigned char>(c) < 0x20) return false;
    ++at;
    if (c == '"') return is_utf8(out);  // escapes end no character that other bytes began
    if (c != '\\') {
      out += c;
      continue;
    }
    constexpr std::string_view names = "\"\\/bfnrt", named = "\"\\/\b\f\n\r\t";
    if (at == text.size()) return false;
    if (const std::size_t name = names.find(text[at]); name != names.npos) {
      out += named[name];
      ++at;
      continue;
    }
    std::uint32_t code, low;
    if (text[at++] != 'u' || !code_unit(code)) return false;
    if (code >= 0xd800 && code < 0xdc00) {  // the first half of a character beyond 16 bits
      if (text.substr(at, 2) != "\\u") return false;
      at += 2;
      if (!code_unit(low) || low < 0xdc00 || low >= 0xe000) return false;
      code = 0x10000 + ((code & 0x3ffu) << 10 | (low & 0x3ffu));
    }
    append_utf8(out, code);  // a second half alone is not UTF-8
  }
  return false;
}

}  // namespace rbres::RBRES_ABI::detail

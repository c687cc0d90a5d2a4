#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include <rbres/core/error.hpp>
#include <rbres/core/sha256.hpp>
#include <rbres/io/file.hpp>

namespace rbres::RBRES_ABI {

/// Whether a file without a digest is taken.
enum class Digest { required, optional };

namespace detail {

/// A file says its own SHA-256 in its JSON under this key, as 64 hexadecimal digits; while the digest is
/// taken they are zeros.
inline constexpr std::string_view digest_key = "sha256";
inline const std::string no_digest(64, '0');

/// Where the digits of the file's digest stand in its JSON; npos where there are none. Quotes within strings
/// are escaped, so the key is found nowhere else.
[[gnu::cold]] inline std::size_t digest_place(std::string_view json) {
  constexpr std::string_view space = " \t\r\n", key = "\"sha256\"";
  for (std::size_t at = 0; (at = json.find(key, at)) != json.npos;) {
    at = json.find_first_not_of(space, at + key.size());
    if (at == json.npos || json[at] != ':') continue;
    at = json.find_first_not_of(space, at + 1);
    if (at == json.npos || json[at] != '"') continue;
    const std::size_t end = json.find('"', at + 1);
    if (end == at + 1 + no_digest.size()) return at + 1;
  }
  return json.npos;
}

/// Adds the bytes of a file from `from` to `end`.
inline void add_bytes(Sha256& hash, const InputFile& file, std::uint64_t from, std::uint64_t end) {
  std::array<char, 1 << 16> part;
  for (; from < end; from += part.size()) {
    const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(part.size(), end - from));
    file.read(from, part.data(), size);
    hash.add(part.data(), size);
  }
}

/// Error when the file's bytes are not those of which `expected` is the digest.
[[gnu::cold]] inline void require_digest(const std::filesystem::path& path, const std::string& expected,
                                         const Sha256& found) {
  if (found.text() != expected)
    refuse(path.string() + ": SHA-256 digest", expected,
           found.text() + ": the file is not as it was written");
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

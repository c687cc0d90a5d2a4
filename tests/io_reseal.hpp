#pragma once

#include <cstddef>
#include <cstring>
#include <string>

#include <rbres/core/sha256.hpp>

/// Puts the right digest into the bytes of a changed file (safetensors, or a data set's description), as
/// whoever means the change would: so that tests and fuzzers reach what reads behind the digest. Bytes
/// without a place for one stay as they are.
inline std::string resealed(std::string bytes) {
  constexpr std::size_t digits = 64;
  for (const std::string key : {"\"sha256\":\"", "\"sha256\": \""}) {
    const std::size_t at = bytes.find(key);
    if (at == std::string::npos || bytes.size() - at - key.size() < digits) continue;
    bytes.replace(at + key.size(), digits, digits, '0');
    rbres::Sha256 hash;
    hash.add(bytes.data(), bytes.size());
    bytes.replace(at + key.size(), digits, hash.text());
  }
  return bytes;
}

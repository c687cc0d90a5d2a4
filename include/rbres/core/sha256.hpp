#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <rbres/core/abi.hpp>
#include <string>

namespace rbres::RBRES_ABI {

/// The SHA-256 digest of a sequence of bytes (FIPS 180-4, section 6.2), given in parts of any length. A copy
/// goes on from where its source stands.
class Sha256 {
 public:
  /// A digest.
  using Bytes = std::array<std::uint8_t, 32>;

  /// Adds so many bytes from `data` on.
  void add(const void* data, std::size_t size) noexcept {
    const auto* from = static_cast<const std::uint8_t*>(data);
    size_ += size;
    if (filled_ > 0) {
      const std::size_t part = std::min(size, block_.size() - filled_);
      copy(from, part);
      from += part;
      size -= part;
      if (filled_ < block_.size()) return;
      compress(block_.data());
      filled_ = 0;
    }
    for (; size >= block_.size(); size -= block_.size(), from += block_.size()) compress(from);
    copy(from, size);
  }

  /// The digest of all bytes so far.
  Bytes digest() const noexcept {
    Sha256 end = *this;
    constexpr std::uint8_t padding[64] = {0x80};
    const std::uint64_t bits = 8 * size_;
    end.add(padding, 1 + (119 - size_ % 64) % 64);
    std::uint8_t length[8];
    for (std::size_t i = 0; i < 8; ++i) length[i] = static_cast<std::uint8_t>(bits >> (56 - 8 * i));
    end.add(length, sizeof length);
    Bytes bytes;
    for (std::size_t i = 0; i < bytes.size(); ++i)
      bytes[i] = static_cast<std::uint8_t>(end.state_[i / 4] >> (24 - 8 * (i % 4)));
    return bytes;
  }

  /// The digest as 64 hexadecimal digits, as the program sha256sum prints it.
  std::string text() const {
    std::string digits;
    for (const std::uint8_t byte : digest()) {
      digits += "0123456789abcdef"[byte >> 4];
      digits += "0123456789abcdef"[byte & 15];
    }
    return digits;
  }

 private:
  // Section 4.2.2.
  static constexpr std::uint32_t constants[64] = {
      0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
      0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
      0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
      0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
      0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
      0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
      0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
      0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};

  void copy(const std::uint8_t* from, std::size_t size) noexcept {
    if (size > 0) std::memcpy(block_.data() + filled_, from, size);
    filled_ += size;
  }

  using Word = std::uint32_t;

  /// One t of step 3 of section 6.2.2; the new a and e stand where h and d stood.
  static void step(Word a, Word b, Word c, Word& d, Word e, Word f, Word g, Word& h, Word added) noexcept {
    h += (std::rotr(e, 6) ^ std::rotr(e, 11) ^ std::rotr(e, 25)) + ((e & f) ^ (~e & g)) + added;
    d += h;
    h += (std::rotr(a, 2) ^ std::rotr(a, 13) ^ std::rotr(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
  }

  /// Section 6.2.2, for the 64 bytes at `block`.
  void compress(const std::uint8_t* block) noexcept {
    Word w[64];
    for (std::size_t t = 0; t < 16; ++t)
      w[t] = std::uint32_t{block[4 * t]} << 24 | std::uint32_t{block[4 * t + 1]} << 16 |
             std::uint32_t{block[4 * t + 2]} << 8 | std::uint32_t{block[4 * t + 3]};
    for (std::size_t t = 16; t < 64; ++t) {
      const Word x = w[t - 15], y = w[t - 2];
      w[t] = w[t - 16] + (std::rotr(x, 7) ^ std::rotr(x, 18) ^ x >> 3) + w[t - 7] +
             (std::rotr(y, 17) ^ std::rotr(y, 19) ^ y >> 10);
    }
    auto [a, b, c, d, e, f, g, h] = state_;
    // The letters change places in the calls, so that no number is moved.
    for (std::size_t t = 0; t < 64; t += 8) {
      step(a, b, c, d, e, f, g, h, constants[t] + w[t]);
      step(h, a, b, c, d, e, f, g, constants[t + 1] + w[t + 1]);
      step(g, h, a, b, c, d, e, f, constants[t + 2] + w[t + 2]);
      step(f, g, h, a, b, c, d, e, constants[t + 3] + w[t + 3]);
      step(e, f, g, h, a, b, c, d, constants[t + 4] + w[t + 4]);
      step(d, e, f, g, h, a, b, c, constants[t + 5] + w[t + 5]);
      step(c, d, e, f, g, h, a, b, constants[t + 6] + w[t + 6]);
      step(b, c, d, e, f, g, h, a, constants[t + 7] + w[t + 7]);
    }
    const Word last[8] = {a, b, c, d, e, f, g, h};
    for (std::size_t i = 0; i < 8; ++i) state_[i] += last[i];
  }

  // Section 5.3.3.
  std::array<std::uint32_t, 8> state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<std::uint8_t, 64> block_{};
  std::size_t filled_ = 0;  ///< bytes in block_
  std::uint64_t size_ = 0;  ///< bytes so far
};

}  // namespace rbres::RBRES_ABI

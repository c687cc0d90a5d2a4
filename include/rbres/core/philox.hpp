#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <rbres/core/abi.hpp>

namespace rbres::RBRES_ABI {

/// One block of Philox 4x32-10: four 32-bit random words as a pure function of a 128-bit counter and a 64-bit
/// key. Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3", SC 2011, section 4.3.
constexpr std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter,
                                                  std::array<std::uint32_t, 2> key) noexcept {
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t a = std::uint64_t{0xD2511F53u} * counter[0];
    const std::uint64_t b = std::uint64_t{0xCD9E8D57u} * counter[2];
    counter = {static_cast<std::uint32_t>(b >> 32) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(b),
               static_cast<std::uint32_t>(a >> 32) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(a)};
    key[0] += 0x9E3779B9u;
    key[1] += 0xBB67AE85u;
  }
  return counter;
}

/// A stream of random numbers that is a pure function of (seed, stream, position): stream i never depends on
/// stream i - 1, so work may be split over any number of threads without changing a number.
class Random {
 public:
  /// The stream of this seed and number, from a position on.
  constexpr explicit Random(std::uint64_t seed, std::uint64_t stream = 0, std::uint64_t position = 0) noexcept
      : seed_(seed), stream_(stream), position_(position) {}

  /// Number of 32-bit words drawn so far; with seed and stream, the whole state.
  constexpr std::uint64_t position() const noexcept { return position_; }
  /// The seed that it was made with.
  constexpr std::uint64_t seed() const noexcept { return seed_; }
  /// The stream's number that it was made with.
  constexpr std::uint64_t stream() const noexcept { return stream_; }

  /// The next 32 random bits.
  constexpr std::uint32_t word() noexcept {
    const std::uint64_t block = position_ / 4;
    if (!filled_ || block != block_) {
      words_ = philox4x32({low(block), high(block), low(stream_), high(stream_)}, {low(seed_), high(seed_)});
      block_ = block;
      filled_ = true;
    }
    return words_[position_++ % 4];
  }

  /// Uniform in [0, 1), 53 random bits.
  constexpr double uniform() noexcept {
    const std::uint64_t upper = word();
    const std::uint64_t lower = word();
    return static_cast<double>(((upper << 32) | lower) >> 11) * 0x1p-53;
  }

  /// Uniform in [from, to).
  constexpr double uniform(double from, double to) noexcept { return from + (to - from) * uniform(); }

  /// Uniform integer in [0, bound), without bias (Lemire 2019, "Fast random integer generation in an
  /// interval").
  constexpr std::uint32_t below(std::uint32_t bound) noexcept {
    std::uint64_t product = std::uint64_t{word()} * bound;
    if (static_cast<std::uint32_t>(product) < bound) {
      const std::uint32_t threshold = (0u - bound) % bound;
      while (static_cast<std::uint32_t>(product) < threshold) product = std::uint64_t{word()} * bound;
    }
    return static_cast<std::uint32_t>(product >> 32);
  }

  /// Standard normal (Box and Muller 1958; the second number of each pair is dropped, so that no state is
  /// hidden).
  double normal() noexcept {
    const double u = 1.0 - uniform();  // in (0, 1]
    const double v = uniform();
    return std::sqrt(-2.0 * std::log(u)) * std::cos(2.0 * std::numbers::pi * v);
  }

 private:
  static constexpr std::uint32_t low(std::uint64_t x) noexcept { return static_cast<std::uint32_t>(x); }
  static constexpr std::uint32_t high(std::uint64_t x) noexcept {
    return static_cast<std::uint32_t>(x >> 32);
  }

  std::uint64_t seed_, stream_, position_;
  std::uint64_t block_ = 0;
  std::array<std::uint32_t, 4> words_{};
  bool filled_ = false;
};

}  // namespace rbres::RBRES_ABI

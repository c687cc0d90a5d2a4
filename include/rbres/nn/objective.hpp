#pragma once

#include <rbres/nn/gradient.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <span>
#include <string>
#include <vector>

namespace rbres::RBRES_ABI {

/// Numbers of items, see Objective.
using Items = std::span<const std::uint32_t>;

/// What training makes small: the mean over items of something that a network's parameters decide. An item is
/// a number in [0, count()), and means whatever the objective says: a column with its target, a rollout.
///
///     struct Mine {
///       struct Scratch { ... };                     // what one thread needs: tapes, states
///       Scratch scratch() const;
///       std::ptrdiff_t count() const;               // items
///       std::ptrdiff_t chunk() const;               // at most so many items a call
///       double value(const Net&, Items, Scratch&) const;
///       double differentiate(const Net&, Items, const DropoutMask&, Scratch&, ParameterGradient<Net>&)
///       const;
///     };
///
/// value() gives the sum over the items; differentiate() too, with what the mask drops, and adds the sum's
/// derivative to the gradient. Both are const, because threads call them at once, each with a scratch of its
/// own, and must depend on nothing but their arguments: calls are for chunks whose bounds do not depend on
/// the threads, and what they give is added in the order of the chunks, so that neither do the bits of a run.
/// They may throw. States may be double where the network is float.
///
/// An objective may also have a digest() (std::uint64_t) of all that its values depend on; with it a
/// checkpoint knows its own objective again.
template <class O, class Net>
concept Objective = requires(const O& objective, const Net& network, Items items, const DropoutMask& mask,
                             typename O::Scratch& scratch, ParameterGradient<Net>& gradient) {
  { objective.scratch() } -> std::same_as<typename O::Scratch>;
  { objective.count() } -> std::convertible_to<std::ptrdiff_t>;
  { objective.chunk() } -> std::convertible_to<std::ptrdiff_t>;
  { objective.value(network, items, scratch) } -> std::convertible_to<double>;
  { objective.differentiate(network, items, mask, scratch, gradient) } -> std::convertible_to<double>;
};

namespace detail {

/// The numbers of all items.
inline std::vector<std::uint32_t> all_items(std::ptrdiff_t count) {
  if (count < 0 || count > std::ptrdiff_t{0xffffffff}) refuse("Objective: items", "0 to 2^32 - 1", count);
  std::vector<std::uint32_t> items(static_cast<std::size_t>(count));
  std::iota(items.begin(), items.end(), 0u);
  return items;
}

/// How many chunks `count` items of an objective are.
template <class O>
std::ptrdiff_t chunks(const O& objective, std::ptrdiff_t count) {
  const std::ptrdiff_t chunk = objective.chunk();
  if (chunk < 1) refuse("Objective: items of a chunk", "at least 1", chunk);
  return (count + chunk - 1) / chunk;
}

/// Chunk number i.
inline Items part(Items items, std::ptrdiff_t i, std::ptrdiff_t chunk) {
  const auto first = static_cast<std::size_t>(i * chunk);
  return items.subspan(first, std::min(static_cast<std::size_t>(chunk), items.size() - first));
}

/// All sixteen digits.
inline std::string hexadecimal(std::uint64_t x) {
  std::string digits(16, '0');
  for (std::size_t i = 16; i-- > 0; x >>= 4) digits[i] = "0123456789abcdef"[x & 15];
  return digits;
}

/// A number of 64 bits from many: another for nearly every other sequence of bytes.
class Digest {
 public:
  void add(std::uint64_t word) noexcept {
    sum_ = (sum_ ^ word) * 0x9E3779B97F4A7C15u;
    sum_ ^= sum_ >> 32;
  }
  /// The sequence's length and bits.
  template <class T>
  void add(const T* numbers, std::size_t count) noexcept {
    add(count);
    std::size_t bytes = count * sizeof(T);
    const auto* from = reinterpret_cast<const unsigned char*>(numbers);
    for (; bytes > 0;) {
      std::uint64_t word = 0;
      const std::size_t now = std::min(bytes, sizeof word);
      std::memcpy(&word, from, now);
      add(word);
      from += now, bytes -= now;
    }
  }
  std::uint64_t value() const noexcept { return sum_; }

 private:
  std::uint64_t sum_ = 0xcbf29ce484222325u;
};

}  // namespace detail
}  // namespace rbres::RBRES_ABI

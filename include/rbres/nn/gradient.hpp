#pragma once

#include <rbres/core/parallel.hpp>
#include <rbres/nn/network.hpp>

#include <algorithm>
#include <span>

namespace rbres::RBRES_ABI {

/// The derivatives of a number by all parameters of a network, in the layout of its block: the derivative by
/// Net::parameters()[i] stands at [i]. Starts as zeros. A move is a copy.
template <class Net>
class ParameterGradient {
 public:
  /// The network's numbers.
  using Scalar = typename Net::Scalar;

  /// A copy has numbers of its own.
  /// @{
  ParameterGradient() : numbers_(Net::block_size) {}
  ParameterGradient(const ParameterGradient&) = default;
  ParameterGradient& operator=(const ParameterGradient&) = default;
  /// @}

  /// One for each number of the network's block.
  /// @{
  std::span<Scalar> numbers() noexcept { return {numbers_.data(), Net::block_size}; }
  std::span<const Scalar> numbers() const noexcept { return {numbers_.data(), Net::block_size}; }
  /// @}

  /// Sets all numbers to 0.
  void set_zero() noexcept { std::fill_n(numbers_.data(), Net::block_size, Scalar{}); }

  /// Adds number by number.
  ParameterGradient& operator+=(const ParameterGradient& other) noexcept {
    for (std::size_t i = 0; i < Net::block_size; ++i) numbers_[i] += other.numbers_[i];
    return *this;
  }

 private:
  AlignedBuffer<Scalar> numbers_;
};

namespace detail {

/// Parts of a network's block that threads share; their bounds do not depend on the threads.
inline constexpr std::size_t slice = 16384;
template <class Net>
inline constexpr std::ptrdiff_t slice_count = static_cast<std::ptrdiff_t>((Net::block_size + slice - 1) /
                                                                          slice);

/// Calls f(number of the slice, begin, end, is_weight) for ranges of whole registers that cover all slices.
template <class Net, class F>
void each_slice(const Team& team, const F& f) {
  team.share(slice_count<Net>, [&](std::ptrdiff_t number) {
    const std::size_t first = static_cast<std::size_t>(number) * slice;
    Net::Passes::each_range(
        first, std::min(first + slice, Net::block_size),
        [&](std::size_t begin, std::size_t end, bool is_weight) { f(number, begin, end, is_weight); });
  });
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

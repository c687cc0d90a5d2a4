#pragma once

#include <rbres/nn/network.hpp>

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <tuple>
#include <vector>

namespace rbres::RBRES_ABI {

/// One of several networks that share a block: it looks at parameters that stand elsewhere, which must
/// outlive it.
template <class Net>
class NetworkPart {
  using T = typename Net::Scalar;

 public:
  /// Samples as columns.
  using Columns = typename Net::Columns;
  /// Scratch, which the caller keeps.
  using Workspace = typename Net::Workspace;

  /// Looks at Net::block_size numbers from here on.
  explicit NetworkPart(const T* parameters) noexcept : parameters_(parameters) {}

  /// The part's share of the block.
  std::span<const T> parameters() const noexcept { return {parameters_, Net::block_size}; }

  /// As Network::forward, for columns of the right sizes: output_size x n from input_size x n. Allocates
  /// nothing.
  void forward(const Eigen::Ref<const Columns, 0, Eigen::OuterStride<>>& inputs,
               Eigen::Ref<Columns, 0, Eigen::OuterStride<>> outputs, Workspace& workspace) const noexcept {
    Net::predict(parameters_, inputs, outputs, workspace);
  }

 private:
  const T* parameters_;
};

/// Several networks, one for each Sequential<...>, whose parameters stand in one block, part after part: what
/// a model of several networks trains, clips and saves as one. A move is a copy.
template <std::floating_point T, class... Layers>
class NetworkParts {
 public:
  /// The type of its numbers.
  using Scalar = T;
  /// The type in which its parameters are kept.
  using Weight = T;
  /// The layers of each part.
  using Architecture = std::tuple<Layers...>;
  /// How many networks there are.
  static constexpr int part_count = sizeof...(Layers);
  /// The type of network I.
  template <int I>
  using Part = Network<T, std::tuple_element_t<static_cast<std::size_t>(I), Architecture>>;

  /// Where part i begins in the block; that of part_count is the size of the whole.
  static constexpr std::size_t offset(int i) {
    constexpr std::array<std::size_t, sizeof...(Layers)> sizes{Network<T, Layers>::block_size...};
    std::size_t sum = 0;
    for (int k = 0; k < i; ++k) sum += sizes[static_cast<std::size_t>(k)];
    return sum;
  }
  /// Numbers in the block, with filling.
  static constexpr std::size_t block_size = offset(part_count);
  /// Numbers that are learned.
  static constexpr std::size_t parameter_count = (0 + ... + Network<T, Layers>::parameter_count);

  /// What training has to know of the block.
  struct Passes {
    /// As that of a Network.
    template <class F>
    static void each_range(std::size_t first, std::size_t last, const F& f) {
      detail::unrolled<part_count>([&](auto i) {
        constexpr std::size_t begin = offset(i), end = offset(i + 1);
        if (last <= begin || first >= end) return;
        Part<i>::Passes::each_range(
            std::max(first, begin) - begin, std::min(last, end) - begin,
            [&](std::size_t from, std::size_t to, bool weight) { f(begin + from, begin + to, weight); });
      });
    }
  };

  /// All parameters zero.
  NetworkParts() : parameters_(block_size) {}
  /// Every part initialised as a Network is, each from a seed of its own.
  explicit NetworkParts(std::uint64_t seed) : NetworkParts() {
    detail::unrolled<part_count>([&](auto i) {
      const Part<i> part(seed * std::uint64_t{part_count} + std::uint64_t{i});
      std::copy_n(part.parameters().data(), part.parameters().size(), parameters_.data() + offset(i));
    });
  }

  /// A copy has a block of its own.
  /// @{
  NetworkParts(const NetworkParts&) = default;
  NetworkParts& operator=(const NetworkParts&) = default;
  /// @}

  /// The whole block. Filling must stay zero.
  /// @{
  std::span<T> parameters() noexcept { return {parameters_.data(), block_size}; }
  std::span<const T> parameters() const noexcept { return {parameters_.data(), block_size}; }
  /// @}

  /// Network I, which looks at this block.
  template <int I>
  NetworkPart<Part<I>> part() const noexcept {
    return NetworkPart<Part<I>>(parameters_.data() + offset(I));
  }

  /// The share of part I in a buffer of the block's layout, as a gradient that a Tape adds to.
  template <int I>
  static auto part_of(std::span<T> block) noexcept {
    struct Gradient {
      std::span<T> share;
      std::span<T> numbers() const noexcept { return share; }
    };
    return Gradient{block.subspan(offset(I), Part<I>::block_size)};
  }

  /// Every tensor of every part, named "PART.LAYER.weight" and so on, in the order of the block.
  static std::vector<ParameterTensor> tensors() {
    std::vector<ParameterTensor> all;
    detail::unrolled<part_count>([&](auto i) {
      for (ParameterTensor tensor : Part<i>::tensors()) {
        tensor.name = std::to_string(int{i}) + "." + tensor.name;
        tensor.offset += offset(i);
        all.push_back(std::move(tensor));
      }
    });
    return all;
  }

 private:
  AlignedBuffer<T> parameters_;
};

}  // namespace rbres::RBRES_ABI

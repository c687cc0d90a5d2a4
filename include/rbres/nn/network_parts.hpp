#pragma once

#include <rbres/nn/network.hpp>

#include <algorithm>
#include <array>
#include <concepts>
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
  using W = typename Net::Weight;

 public:
  /// Samples as columns.
  using Columns = typename Net::Columns;
  /// Scratch, which the caller keeps.
  using Workspace = typename Net::Workspace;

  /// Looks at Net::block_size numbers from here on.
  explicit NetworkPart(const W* parameters) noexcept : parameters_(parameters) {}

  /// The part's share of the block.
  std::span<const W> parameters() const noexcept { return {parameters_, Net::block_size}; }

  /// As Network::forward, for columns of the right sizes: output_size x n from input_size x n. Allocates
  /// nothing.
  void forward(const Eigen::Ref<const Columns, 0, Eigen::OuterStride<>>& inputs,
               Eigen::Ref<Columns, 0, Eigen::OuterStride<>> outputs, Workspace& workspace) const noexcept {
    Net::predict(parameters_, inputs, outputs, workspace);
  }

 private:
  const W* parameters_;
};

/// Several networks (Network<...>, all of the same Scalar and Weight) whose parameters stand in one block,
/// part after part: what a model of several networks trains, clips and saves as one. A move is a copy.
template <class First, class... Rest>
class NetworkParts {
  using W = typename First::Weight;
  static_assert((std::same_as<W, typename Rest::Weight> && ...) &&
                    (std::same_as<typename First::Scalar, typename Rest::Scalar> && ...),
                "NetworkParts: its networks have the same numbers");

 public:
  /// The type of its numbers.
  using Scalar = typename First::Scalar;
  /// The type in which its parameters are kept.
  using Weight = W;
  /// The layers of each part.
  using Architecture = std::tuple<typename First::Architecture, typename Rest::Architecture...>;
  /// How many networks there are.
  static constexpr int part_count = 1 + sizeof...(Rest);
  /// The type of network I.
  template <int I>
  using Part = std::tuple_element_t<static_cast<std::size_t>(I), std::tuple<First, Rest...>>;

  /// Where part i begins in the block; that of part_count is the size of the whole.
  static constexpr std::size_t offset(int i) {
    constexpr std::array<std::size_t, 1 + sizeof...(Rest)> sizes{First::block_size, Rest::block_size...};
    std::size_t sum = 0;
    for (int k = 0; k < i; ++k) sum += sizes[static_cast<std::size_t>(k)];
    return sum;
  }
  /// Numbers in the block, with filling.
  static constexpr std::size_t block_size = offset(part_count);
  /// Numbers that are learned.
  static constexpr std::size_t parameter_count = (First::parameter_count + ... + Rest::parameter_count);

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

  /// The same networks with their parameters kept in another type, each rounded to the nearest.
  template <class... Others>
  requires(sizeof...(Others) == part_count &&
           !std::same_as<typename NetworkParts<Others...>::Weight,
                         W>) explicit NetworkParts(const NetworkParts<Others...>& other)
      : NetworkParts() {
    detail::round_parameters<NetworkParts<Others...>, NetworkParts>(other.parameters(), parameters());
  }

  /// A copy has a block of its own.
  /// @{
  NetworkParts(const NetworkParts&) = default;
  NetworkParts& operator=(const NetworkParts&) = default;
  /// @}

  /// The whole block. Filling must stay zero.
  /// @{
  std::span<W> parameters() noexcept { return {parameters_.data(), block_size}; }
  std::span<const W> parameters() const noexcept { return {parameters_.data(), block_size}; }
  /// @}

  /// Network I, which looks at this block.
  template <int I>
  NetworkPart<Part<I>> part() const noexcept {
    return NetworkPart<Part<I>>(parameters_.data() + offset(I));
  }

  /// The share of part I in a buffer of the block's layout, as a gradient that a Tape adds to.
  template <int I>
  static auto part_of(std::span<Scalar> block) noexcept {
    struct Gradient {
      std::span<Scalar> share;
      std::span<Scalar> numbers() const noexcept { return share; }
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
  AlignedBuffer<W> parameters_;
};

}  // namespace rbres::RBRES_ABI

#pragma once

#include <rbres/core/aligned.hpp>
#include <rbres/core/philox.hpp>
#include <rbres/nn/network_function.hpp>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace rbres::RBRES_ABI {

/// One tensor of a network's parameters: its name and shape as PyTorch's state_dict has them, and where its
/// numbers stand.
struct ParameterTensor {
  std::string name;  ///< "2.0.weight", "2.0.bias": layers counted as in nn.Sequential
  bool is_bias;      ///< a bias, or a LayerNorm's weight: shape [rows]; else [rows, columns]
  /// Outputs and inputs; a bias has one column.
  /// @{
  int rows, columns;
  /// @}
  std::size_t offset;           ///< in the network's block
  detail::WeightLayout layout;  ///< from there on

  /// Place of number (row, column) in the network's block (and in gradients and moments, which share its
  /// layout).
  std::size_t index(int row, int column = 0) const noexcept { return offset + layout.index(row, column); }
};

namespace detail {

/// Adds weight and bias of a stage that is a layer of this name.
template <class W>
[[gnu::cold]] void append_tensors(std::vector<ParameterTensor>& all, const std::string& name,
                                  const Stage& stage, std::size_t offset, std::size_t weight_size) {
  const int rows = stage.outputs, columns = stage.has_linear ? stage.inputs : 1;
  all.push_back({name + ".weight", stage.has_norm, rows, columns, offset, weight_layout<W>(rows, columns)});
  all.push_back({name + ".bias", true, rows, 1, offset + weight_size, weight_layout<W>(rows, 1)});
}

/// The parameters of one network as those of another, which keeps them in another type, each rounded to the
/// nearest.
template <class From, class To>
void round_parameters(std::span<const typename From::Weight> from, std::span<typename To::Weight> to) {
  const std::vector<ParameterTensor> theirs = From::tensors(), ours = To::tensors();
  for (std::size_t i = 0; i < ours.size(); ++i)
    for (int row = 0; row < ours[i].rows; ++row)
      for (int column = 0; column < ours[i].columns; ++column) {
        const typename From::Scalar number(from[theirs[i].index(row, column)]);
        to[ours[i].index(row, column)] = typename To::Weight(number);
      }
}

}  // namespace detail

/// A network as a value: `Layers` is a Sequential<...>, T float or double. All parameters stand in one flat
/// block, aligned to a cache line; a copy is a copy, and what a move leaves is as Network(), all zero. In
/// PyTorch the same network is the nn.Sequential of the same layers.
///
/// W is what the parameters are kept in. With bfloat16 a float network takes half the memory, and less time
/// where reading its parameters is what takes time (few samples at once). It computes in float, and cannot
/// be trained: train a Network<float, Layers>, then convert it.
template <std::floating_point T, class Layers, WeightOf<T> W = T>
class Network : public NetworkFunction<Network<T, Layers, W>, T, Layers, W> {
  using Function = NetworkFunction<Network, T, Layers, W>;

 public:
  using Function::block_size;
  using typename Function::Compiled;
  using typename Function::Passes;

  /// All parameters zero.
  Network() : parameters_(Function::block_size) {}

  /// Weights drawn from a normal distribution of variance 2 / inputs, biases zero (He, Zhang, Ren, Sun 2015,
  /// section 2.2); the weights of a LayerNorm one.
  explicit Network(std::uint64_t seed) : Network() {
    Random random(seed);
    for (const ParameterTensor& tensor : tensors()) {
      if (tensor.is_bias) continue;
      const double deviation = std::sqrt(2.0 / tensor.columns);
      for (int r = 0; r < tensor.rows; ++r)
        for (int c = 0; c < tensor.columns; ++c)
          parameters_[tensor.index(r, c)] = W(static_cast<T>(deviation * random.normal()));
    }
    for (int s = 0; s < Function::Compiled::stage_count; ++s)
      if (Function::Compiled::stage(s).has_norm)
        std::fill_n(parameters_.data() + Function::Passes::offset(s), Function::Compiled::stage(s).outputs,
                    W(T{1}));
  }

  /// The same network with its parameters kept in another type, each rounded to the nearest.
  template <class Other>
  requires(!std::same_as<Other, W>) explicit Network(const Network<T, Layers, Other>& other) : Network() {
    detail::round_parameters<Network<T, Layers, Other>, Network>(other.parameters(), parameters());
  }

  /// The whole block. Numbers that no tensor names are filling and must stay zero.
  std::span<W> parameters() {
    if (parameters_.size() == 0) parameters_ = AlignedBuffer<W>(Function::block_size);
    return {parameters_.data(), Function::block_size};
  }
  /// The same, to read only.
  std::span<const W> parameters() const noexcept { return {block(), Function::block_size}; }

  /// Every tensor, in the order of the block: weight and bias of each Linear and LayerNorm.
  static std::vector<ParameterTensor> tensors() {
    std::vector<std::string> names;
    detail::append_names(names, "", Layers{});
    std::vector<ParameterTensor> all;
    for (int s = 0, layer = 0; s < Function::Compiled::stage_count; ++s) {
      const detail::Stage& stage = Function::Compiled::stage(s);
      if (!stage.has_linear && !stage.has_norm) continue;
      const std::string& name = names[static_cast<std::size_t>(layer++)];
      detail::append_tensors<W>(all, name, stage, Function::Passes::offset(s),
                                Function::Passes::weight_size(s));
    }
    return all;
  }

 private:
  friend Function;
  const W* block() const noexcept { return parameters_.size() == 0 ? zeros : parameters_.data(); }

  alignas(64) static inline W zeros[Function::block_size] = {};  ///< nobody writes them
  AlignedBuffer<W> parameters_;                                  ///< empty after a move
};

}  // namespace rbres::RBRES_ABI

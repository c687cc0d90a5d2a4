#pragma once

#include <rbres/nn/network.hpp>

#include <algorithm>
#include <iterator>
#include <span>

namespace rbres::RBRES_ABI {

template <class Net, const auto& numbers>
class ConstantNetwork;

/// A network whose parameters are the constants `numbers`, an array in the order of Network::parameters(),
/// aligned to 64 bytes. They are read where they stand, in flash, say: it needs no heap, and all objects of
/// the type are one network. What export_header() writes.
template <std::floating_point T, class Layers, WeightOf<T> W, const auto& numbers>
class ConstantNetwork<Network<T, Layers, W>, numbers>
    : public NetworkFunction<ConstantNetwork<Network<T, Layers, W>, numbers>, T, Layers, W> {
  using Function = NetworkFunction<ConstantNetwork, T, Layers, W>;
  static_assert(std::size(numbers) == Function::block_size, "a number for each parameter and filling");

 public:
  /// The whole block.
  std::span<const W> parameters() const noexcept { return {block(), Function::block_size}; }

  /// The same network with parameters of its own, which may be trained.
  explicit operator Network<T, Layers, W>() const {
    Network<T, Layers, W> network;
    const auto own = parameters();
    std::copy(own.begin(), own.end(), network.parameters().begin());
    return network;
  }

 private:
  friend Function;
  const W* block() const noexcept { return std::data(numbers); }
};

}  // namespace rbres::RBRES_ABI

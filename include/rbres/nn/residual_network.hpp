#pragma once

#include <rbres/nn/network.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// Sequential<First..., Middle... repeated Count times, Last...>
template <int Count, class First, class Middle, class Last>
struct Repeat;
template <int Count, class... First, class... Middle, class Last>
struct Repeat<Count, Sequential<First...>, Sequential<Middle...>, Last>
    : Repeat<Count - 1, Sequential<First..., Middle...>, Sequential<Middle...>, Last> {};
template <class... First, class... Middle, class... Last>
struct Repeat<0, Sequential<First...>, Sequential<Middle...>, Sequential<Last...>> {
  using type = Sequential<First..., Last...>;
};

template <int In, int Width, int Blocks, int Out, class Block>
using BlockNetwork =
    typename Repeat<Blocks, Sequential<Linear<In, Width>, Relu>, Block, Sequential<Linear<Width, Out>>>::type;

}  // namespace detail

/// The network of "Predicting 3D Rigid Body Dynamics with Deep Residual Network" (arXiv 2407.18798, section
/// 3), whose Width is 256 and whose released program has 10 blocks: Linear, ReLU, Blocks times x + W2
/// drop(relu(W1 x + b1)) + b2, Linear. In PyTorch, with the class Residual of layers.hpp:
///
///     nn.Sequential(nn.Linear(In, Width), nn.ReLU(),
///                   *[Residual(nn.Linear(Width, Width), nn.ReLU(), nn.Dropout(p), nn.Linear(Width, Width))
///                   for _ in range(Blocks)], nn.Linear(Width, Out))
///
/// Weight = bfloat16 keeps its parameters in half the memory (see Network).
template <class Scalar, int In, int Width, int Blocks, int Out, class Weight = Scalar>
using ResidualNetwork = Network<
    Scalar,
    detail::BlockNetwork<In, Width, Blocks, Out,
                         Sequential<Residual<Linear<Width, Width>, Relu, Dropout, Linear<Width, Width>>>>,
    Weight>;

/// The baseline: the same Linear layers without skips, and as is usual without them a ReLU after every Linear
/// but the last: Linear, ReLU, Blocks times drop(relu(W1 x + b1)), relu(W2 x + b2), Linear.
template <class Scalar, int In, int Width, int Blocks, int Out, class Weight = Scalar>
using FeedForwardNetwork =
    Network<Scalar,
            detail::BlockNetwork<In, Width, Blocks, Out,
                                 Sequential<Linear<Width, Width>, Relu, Dropout, Linear<Width, Width>, Relu>>,
            Weight>;

}  // namespace rbres::RBRES_ABI

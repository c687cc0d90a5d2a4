#pragma once

#include <rbres/nn/gradient.hpp>
#include <rbres/nn/optimizer.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace rbres::RBRES_ABI::detail {

/// How an optimiser changes a network's weights: as the gradient comes, register by register, or, where it
/// clips, from the whole gradient. What it needs for that has room here from the start.
template <class Net, class Optimizer>
class Update {
  using T = typename Net::Scalar;

 public:
  static constexpr std::size_t moments_size = Optimizer::moment_count * Net::block_size;

  /// Throws Error where a number of the optimiser is out of its range.
  explicit Update(const Optimizer& optimizer) : optimizer_(optimizer) {
    if constexpr (requires { optimizer_.check(); }) optimizer_.check();
    if constexpr (ClipsGradients<Optimizer>)
      if (optimizer_.clips()) gradient_.emplace();
  }

  const Optimizer& optimizer() const noexcept { return optimizer_; }

  /// Step number `step`, counted from 1, with the gradients of a source (see gradient_source.hpp). All
  /// threads of the team call it.
  template <class Source>
  void operator()(const Team& team, const Source& gradients, double rate, double l2_factor,
                  std::uint64_t step, Net& network, AlignedBuffer<T>& all_moments) {
    const auto rule = optimizer_.template rule<T>(rate, step);
    const auto l2 = static_cast<T>(2 * l2_factor);
    T* parameters = network.parameters().data();
    T* moments = all_moments.data();
    const auto step_register = [=](std::size_t at, Simd<T> g, bool is_weight) {
      // What is updated next is on its way from memory while its gradient is summed.
      constexpr std::size_t next = gradient_rows<T> * lanes<T>;
      __builtin_prefetch(parameters + at + next, 1);
      for (std::size_t i = 0; i < Optimizer::moment_count; ++i)
        __builtin_prefetch(moments + i * Net::block_size + at + next, 1);
      auto w = load(parameters + at);
      Simd<T> m[Optimizer::moment_count];
      for (std::size_t i = 0; i < Optimizer::moment_count; ++i)
        m[i] = load(moments + i * Net::block_size + at);
      if (is_weight) g += l2 * w;
      store(parameters + at, rule(w, g, m, is_weight));
      for (std::size_t i = 0; i < Optimizer::moment_count; ++i)
        store(moments + i * Net::block_size + at, m[i]);
    };
    if constexpr (ClipsGradients<Optimizer>)
      if (gradient_) return clipped(team, gradients, step_register);
    gradients.parameter_gradient(team, step_register);
  }

  /// The weights that are validated after so many steps: the newest, or their moving average.
  const Net& current(const Net& network, const AlignedBuffer<T>& moments, std::uint64_t step) {
    if constexpr (AveragesWeights<Optimizer>) {
      if (!average_) average_.emplace();
      const T* sum = moments.data() + Optimizer::average_moment * Net::block_size;
      const auto scale = static_cast<T>(optimizer_.average_scale(step));
      for (std::size_t i = 0; i < Net::block_size; ++i) average_->parameters()[i] = scale * sum[i];
      return *average_;
    } else {
      return network;
    }
  }

 private:
  /// The whole gradient first, then its norm, then the step.
  template <class Source, class Step>
  void clipped(const Team& team, const Source& gradients, const Step& step_register) {
    T* whole = gradient_->sum.numbers().data();
    gradients.parameter_gradient(team,
                                 [whole](std::size_t at, const auto& g, bool) { store(whole + at, g); });
    each_slice<Net>(team, [&](std::ptrdiff_t number, std::size_t begin, std::size_t end, bool) {
      double& squares = gradient_->squares[static_cast<std::size_t>(number)];
      if (begin == static_cast<std::size_t>(number) * slice) squares = 0;
      for (std::size_t i = begin; i < end; ++i)
        squares += static_cast<double>(whole[i]) * static_cast<double>(whole[i]);
    });
    double squared = 0;
    for (const double squares : gradient_->squares) squared += squares;
    const auto factor = static_cast<T>(optimizer_.factor(std::sqrt(squared)));
    each_slice<Net>(team, [&](std::ptrdiff_t, std::size_t begin, std::size_t end, bool is_weight) {
      for (std::size_t at = begin; at < end; at += static_cast<std::size_t>(simd_width<T>))
        step_register(at, Simd<T>(factor * load(whole + at)), is_weight);
    });
  }

  struct WholeGradient {
    ParameterGradient<Net> sum;
    std::vector<double> squares = std::vector<double>(static_cast<std::size_t>(slice_count<Net>));
  };

  Optimizer optimizer_;
  std::optional<WholeGradient> gradient_;  ///< where the optimiser clips
  std::optional<Net> average_;             ///< where it averages
};

}  // namespace rbres::RBRES_ABI::detail

#pragma once

#include <rbres/core/parallel.hpp>
#include <rbres/nn/loss.hpp>
#include <rbres/nn/network.hpp>

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace rbres {

/// Gradients of a loss by all parameters (and by the inputs) over one batch. Keeps the activations of `batch`
/// samples and a transposed copy of the weights; allocates only when built.
template <class Net>
class Backpropagation {
  using T = typename Net::Scalar;
  using Passes = typename Net::Passes;
  using Compiled = typename Net::Compiled;

 public:
  /// For batches of up to `batch` samples.
  explicit Backpropagation(Eigen::Index batch)
      : capacity_(batch),
        tape_(static_cast<std::size_t>(batch) * Passes::tape_row),
        transposed_(transposed_offset(Compiled::stage_count)),
        losses_(static_cast<std::size_t>(batch)) {}

  /// The mean loss over the samples order[0], ..., order[count - 1], and everything that gradients are made
  /// from. The bits do not depend on the number of threads. Call transpose() first after the network has
  /// changed.
  double run(const Net& network, const Samples<T>& samples, const Loss<T>& loss,
             std::span<const std::uint32_t> order, const DropoutMask& mask, int threads,
             bool to_input = false) {
    const auto count = static_cast<Eigen::Index>(order.size());
    const auto tape = view();
    const int team = threads > 0 ? threads : default_threads();
    const Eigen::Index share = (count + team - 1) / team;
    parallel_for((count + share - 1) / share, team, [&](std::ptrdiff_t task) {
      const Eigen::Index first = task * share, rows = std::min(share, count - first);
      for (Eigen::Index r = first; r < first + rows; ++r) {
        const T* x = samples.inputs.data() + order[static_cast<std::size_t>(r)] * Net::input_size;
        std::fill(std::copy_n(x, Net::input_size, tape.value(0, r)), tape.value(0, r + 1), T{});
      }
      Passes::record(network.parameters().data(), tape, first, static_cast<int>(rows), mask);
      for (Eigen::Index r = first; r < first + rows; ++r)
        losses_[static_cast<std::size_t>(r)] =
            start_backward(tape, r, samples, loss, order[static_cast<std::size_t>(r)], count);
      Passes::backward(
          tape, first, static_cast<int>(rows), to_input, [&](auto s, const T* in, const auto& finish) {
            constexpr detail::Stage stage = Compiled::stage(s);
            detail::multiply<T>(static_cast<int>(rows), 0, detail::padded<T>(stage.inputs), stage.outputs,
                                detail::Left<T>{in, Passes::stride, 1},
                                detail::Right<T>{transposed_.data() + transposed_offset(s), detail::lanes<T>,
                                                 stage.outputs * detail::lanes<T>},
                                finish);
          });
    });
    rows_ = count;
    double sum = 0;
    for (Eigen::Index r = 0; r < count; ++r) sum += losses_[static_cast<std::size_t>(r)];
    return sum / static_cast<double>(count);
  }

  /// Copies the transposes of all weights.
  void transpose(const Net& network) {
    detail::unrolled<Compiled::stage_count>([&](auto s) {
      constexpr detail::Stage stage = Compiled::stage(s);
      if constexpr (stage.has_linear)
        detail::transpose_panels<T>(stage.outputs, stage.inputs,
                                    network.parameters().data() + Passes::offset(s),
                                    transposed_.data() + transposed_offset(s));
    });
  }

  /// sink(place, g, is_weight) for every register g of the gradient by the parameters, at `place` of the
  /// block, each once, from several threads.
  template <class Sink>
  void parameter_gradient(int threads, const Sink& sink) const {
    parallel_for(Compiled::stage_count, threads, [&](std::ptrdiff_t task) {
      detail::unrolled<Compiled::stage_count>([&](auto s) {
        constexpr detail::Stage stage = Compiled::stage(s);
        if constexpr (stage.has_linear)
          if (task == s) stage_gradient<s>(sink);
      });
    });
  }

  /// The gradient by the inputs of the last run with to_input, a column for each sample.
  auto input_gradient() const {
    using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
    return Eigen::Map<const Matrix, 0, Eigen::OuterStride<>>(view().gradient(0, 0), Net::input_size, rows_,
                                                             Eigen::OuterStride<>(Passes::stride));
  }

 private:
  static constexpr std::size_t transposed_offset(int s) {
    std::size_t sum = 0;
    for (int t = 0; t < s; ++t)
      if (const auto& stage = Compiled::stage(t); stage.has_linear)
        sum += static_cast<std::size_t>(detail::padded<T>(stage.inputs)) *
               static_cast<std::size_t>(stage.outputs);
    return sum;
  }

  typename Passes::Tape view() const {
    T* numbers = const_cast<T*>(tape_.data());
    return {numbers, numbers + tape_.size() / 2, capacity_};
  }

  /// The loss of row r, and its gradient by the last stage's z.
  static double start_backward(const typename Passes::Tape& tape, Eigen::Index r, const Samples<T>& samples,
                               const Loss<T>& loss, Eigen::Index sample, Eigen::Index count) {
    T* last = tape.gradient(Compiled::stage_count, r);
    std::array<T, Net::output_size> gradient;
    const double value =
        loss.evaluate(samples, sample, tape.value(Compiled::stage_count, r), gradient.data());
    const T scale = T{1} / static_cast<T>(count);
    for (std::size_t o = 0; o < gradient.size(); ++o)
      last[o] = scale * gradient[o] * (Passes::output_has_slope ? last[o] : T{1});
    std::fill(last + Net::output_size, last + Passes::stride, T{});
    return value;
  }

  template <int S, class Sink>
  void stage_gradient(const Sink& sink) const {
    constexpr detail::Stage stage = Compiled::stage(S);
    constexpr int width = detail::simd_width<T>, lanes = detail::lanes<T>;
    const auto tape = view();
    const int rows = static_cast<int>(rows_);
    const T* g = tape.gradient(S + 1, 0);
    constexpr std::size_t offset = Passes::offset(S), bias = offset + Passes::weight_size(S);
    detail::multiply<T>(
        stage.inputs, 0, detail::padded<T>(stage.outputs), rows,
        detail::Left<T>{tape.value(S, 0), 1, Passes::stride}, detail::Right<T>{g, Passes::stride, lanes},
        [&](int i, int lane, detail::Simd<T> sum) {
          sink(offset + static_cast<std::size_t>((lane / lanes * stage.inputs + i) * lanes + lane % lanes),
               sum, true);
        });
    for (int lane = 0; lane < detail::padded<T>(stage.outputs); lane += width) {
      detail::Simd<T> sum{};
      for (int r = 0; r < rows; ++r) sum += detail::load(g + std::ptrdiff_t{r} * Passes::stride + lane);
      sink(bias + static_cast<std::size_t>(lane), sum, false);
    }
  }

  Eigen::Index capacity_, rows_ = 0;
  AlignedBuffer<T> tape_, transposed_;
  AlignedBuffer<double> losses_;
};

}  // namespace rbres

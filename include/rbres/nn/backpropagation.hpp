#pragma once

#include <rbres/core/parallel.hpp>
#include <rbres/nn/loss.hpp>
#include <rbres/nn/network.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

namespace rbres {

/// Gradients of a loss by all parameters (and by the inputs) over one batch. Keeps the activations of `batch`
/// samples; allocates only when built. No bit of a result depends on the number of threads.
template <class Net>
class Backpropagation {
  using T = typename Net::Scalar;
  using Passes = typename Net::Passes;
  using Compiled = typename Net::Compiled;
  using Tape = typename Passes::Tape;

 public:
  /// For batches of up to `batch` samples.
  explicit Backpropagation(Eigen::Index batch)
      : capacity_(((batch + 7) / 8 | 1) * 8),  // as Network's chunk
        values_(static_cast<std::size_t>(capacity_ * Tape::sample_size)),
        gradients_(values_.size()),
        losses_(static_cast<std::size_t>(batch)) {}

  /// The mean loss over the samples order[0], order[1], ..., at most as many as a batch has, and all that
  /// gradients are made from. The threads (0: default_threads()) share the samples.
  double run(const Net& network, const Samples<T>& samples, const Loss<T>& loss,
             std::span<const std::uint32_t> order, const DropoutMask& mask, int threads,
             bool to_input = false) {
    count_ = static_cast<Eigen::Index>(order.size());
    const T* parameters = network.parameters().data();
    const Tape tape{values_.data(), gradients_.data(), capacity_};
    const int team = threads > 0 ? threads : default_threads();
    const Eigen::Index share = (count_ + team - 1) / team;
    parallel_for((count_ + share - 1) / share, team, [&](std::ptrdiff_t task) {
      const Eigen::Index first = task * share, last = std::min(count_, first + share);
      const int count = static_cast<int>(last - first);
      for (Eigen::Index c = first; c < last; ++c)
        Passes::template put<Net::input_size>(
            samples.inputs.data() + std::ptrdiff_t{order[static_cast<std::size_t>(c)]} * Net::input_size,
            tape.value(0), c);
      Passes::record(parameters, tape, first, count, mask);
      for (Eigen::Index c = first; c < last; ++c)
        losses_[static_cast<std::size_t>(c)] =
            start(tape, c, samples, loss, order[static_cast<std::size_t>(c)]);
      Passes::backward(parameters, tape, first, count, to_input);
    });
    double sum = 0;
    for (Eigen::Index c = 0; c < count_; ++c) sum += losses_[static_cast<std::size_t>(c)];
    return sum / static_cast<double>(count_);
  }

  /// sink(place, g, is_weight) for every register g of the last run's gradient by the parameters, at `place`
  /// of the block, each once. The threads share the parameters, so that a sink may update what it gets on the
  /// spot.
  template <class Sink>
  void parameter_gradient(int threads, const Sink& sink) const {
    const Tape tape{const_cast<T*>(values_.data()), const_cast<T*>(gradients_.data()), capacity_};
    parallel_for(task_count, threads, [&](std::ptrdiff_t task) {
      detail::unrolled<Compiled::stage_count>([&](auto s) {
        constexpr detail::Stage stage = Compiled::stage(s);
        if constexpr (stage.has_linear)
          if (task >= 0 && task < groups(s))
            detail::linear_gradient<stage.inputs, stage.outputs, T>(
                static_cast<int>(task), static_cast<int>(count_), {tape.value(s).data, tape.samples},
                {tape.gradient(s + 1).data, tape.samples}, Passes::offset(s), sink);
        task -= groups(s);
      });
    });
  }

  /// The gradient by the inputs of the last run with to_input, a column for each sample.
  typename Net::Columns input_gradient() const {
    const Tape tape{nullptr, const_cast<T*>(gradients_.data()), capacity_};
    typename Net::Columns columns(Net::input_size, count_);
    for (Eigen::Index c = 0; c < count_; ++c)
      Passes::template take<Net::input_size>(tape.gradient(0), c, columns.col(c).data());
    return columns;
  }

 private:
  /// A Linear's gradient is made in tasks of one group of outputs.
  static constexpr int groups(int s) {
    const int outputs = detail::padded<T>(Compiled::stage(s).outputs),
              most = detail::tile_vectors * detail::simd_width<T>;
    return Compiled::stage(s).has_linear ? (outputs + most - 1) / most : 0;
  }
  static constexpr int task_count = [] {
    int sum = 0;
    for (int s = 0; s < Compiled::stage_count; ++s) sum += groups(s);
    return sum;
  }();

  /// The loss of sample c of the batch, and its gradient by the last stage's z.
  double start(const Tape& tape, Eigen::Index c, const Samples<T>& samples, const Loss<T>& loss,
               Eigen::Index sample) const {
    typename Net::Output output, gradient;
    Passes::template take<Net::output_size>(tape.value(Compiled::stage_count), c, output.data());
    const double value = loss.evaluate(samples, sample, output.data(), gradient.data());
    gradient /= static_cast<T>(count_);
    if constexpr (Passes::output_has_slope) {
      Passes::template take<Net::output_size>(tape.gradient(Compiled::stage_count), c, output.data());
      gradient.array() *= output.array();
    }
    Passes::template put<Net::output_size>(gradient.data(), tape.gradient(Compiled::stage_count), c);
    return value;
  }

  Eigen::Index capacity_, count_ = 0;
  AlignedBuffer<T> values_, gradients_;
  AlignedBuffer<double> losses_;
};

}  // namespace rbres

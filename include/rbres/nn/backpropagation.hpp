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
  /// gradients are made from. The threads of a team share the samples; all of them call it and get the loss.
  double run(const Net& network, const Samples<T>& samples, const Loss<T>& loss,
             std::span<const std::uint32_t> order, const DropoutMask& mask, const Team& team,
             bool to_input = false) {
    const auto size = static_cast<Eigen::Index>(order.size());
    if (team.index() == 0) count_ = size;
    const T* parameters = network.parameters().data();
    const Tape tape{values_.data(), gradients_.data(), capacity_};
    const Eigen::Index part = (size + team.size() - 1) / team.size();
    team.share((size + part - 1) / part, [&](std::ptrdiff_t task) {
      const Eigen::Index first = task * part, last = std::min(size, first + part);
      const int count = static_cast<int>(last - first);
      for (Eigen::Index c = first; c < last; ++c)
        Passes::template put<Net::input_size>(
            samples.inputs.data() + std::ptrdiff_t{order[static_cast<std::size_t>(c)]} * Net::input_size,
            tape.value(0), c);
      Passes::record(parameters, tape, first, count, mask);
      for (Eigen::Index c = first; c < last; ++c)
        losses_[static_cast<std::size_t>(c)] =
            start(tape, c, size, samples, loss, order[static_cast<std::size_t>(c)]);
      Passes::backward(parameters, tape, first, count, to_input);
    });
    double sum = 0;
    for (Eigen::Index c = 0; c < size; ++c) sum += losses_[static_cast<std::size_t>(c)];
    return sum / static_cast<double>(size);
  }

  /// sink(place, g, is_weight) for every register g of the last run's gradient by the parameters, at `place`
  /// of the block, each once. The threads of a team, which all call it, share the parameters, so that a sink
  /// may update what it gets on the spot.
  template <class Sink>
  void parameter_gradient(const Team& team, const Sink& sink) const {
    const Tape tape{const_cast<T*>(values_.data()), const_cast<T*>(gradients_.data()), capacity_};
    team.share(task_count, [&](std::ptrdiff_t task) {
      detail::unrolled<Compiled::stage_count>([&](auto s) {
        constexpr detail::Stage stage = Compiled::stage(s);
        if constexpr (stage.has_linear)
          if (task >= 0 && task < groups(s)) {
            alignas(64) T waiting[detail::group_size<T>(stage.inputs)];
            detail::linear_gradient<T>(stage.inputs, stage.outputs, static_cast<int>(task),
                                       static_cast<int>(count_), {tape.value(s).data, tape.samples},
                                       {tape.gradient(s + 1).data, tape.samples}, Passes::offset(s), waiting,
                                       sink);
          }
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
    return Compiled::stage(s).has_linear
               ? detail::Groups<T>(detail::padded<T>(Compiled::stage(s).outputs)).count
               : 0;
  }
  static constexpr int task_count = [] {
    int sum = 0;
    for (int s = 0; s < Compiled::stage_count; ++s) sum += groups(s);
    return sum;
  }();

  /// The loss of sample c of a batch of `size`, and the batch's gradient by the last stage's z.
  double start(const Tape& tape, Eigen::Index c, Eigen::Index size, const Samples<T>& samples,
               const Loss<T>& loss, Eigen::Index sample) const {
    typename Net::Output output, gradient;
    Passes::template take<Net::output_size>(tape.value(Compiled::stage_count), c, output.data());
    const double value = loss.evaluate(samples, sample, output.data(), gradient.data());
    gradient /= static_cast<T>(size);
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

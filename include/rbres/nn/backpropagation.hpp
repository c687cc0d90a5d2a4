#pragma once

#include <rbres/nn/loss.hpp>
#include <rbres/nn/tape.hpp>

#include <cstddef>
#include <cstdint>
#include <span>

namespace rbres::RBRES_ABI {

/// Gradients of a loss by all parameters (and by the inputs) over one batch of columns with targets: the
/// fused path of training, whose gradient never stands in memory as a whole. Keeps the activations of `batch`
/// samples. No bit of a result depends on the number of threads.
template <class Net>
class Backpropagation {
  using T = typename Net::Scalar;

 public:
  /// For batches of up to `batch` samples.
  explicit Backpropagation(Eigen::Index batch)
      : tape_("Backpropagation", batch), losses_(static_cast<std::size_t>(batch)) {}

  /// The mean loss over the samples order[0], order[1], ..., one to as many as a batch has, and all that
  /// gradients are made from. The threads of a team share the samples; all of them call it and get the loss.
  /// Throws Error where a size, a number of a sample, a weight of the loss or the mask's rate does not fit.
  double run(const Net& network, const Samples<T>& samples, const Loss<T>& loss,
             std::span<const std::uint32_t> order, const DropoutMask& mask, const Team& team,
             bool to_input = false) {
    check(samples, loss, order);
    mask.check();
    const auto size = static_cast<Eigen::Index>(order.size());
    if (team.index() == 0) count_ = size;
    const Eigen::Index part = (size + team.size() - 1) / team.size();
    team.share((size + part - 1) / part, [&](std::ptrdiff_t task) {
      const Eigen::Index first = task * part, last = std::min(size, first + part);
      const auto sample = [&](Eigen::Index c) { return std::ptrdiff_t{order[static_cast<std::size_t>(c)]}; };
      for (Eigen::Index c = first; c < last; ++c)
        tape_.put_input(samples.inputs.data() + sample(c) * Net::input_size, c);
      tape_.record(network.parameters().data(), first, last - first, mask);
      for (Eigen::Index c = first; c < last; ++c) {
        typename Net::Output output, gradient;
        tape_.take_output(c, output.data());
        losses_[static_cast<std::size_t>(c)] =
            loss.evaluate(samples, sample(c), output.data(), gradient.data());
        gradient /= static_cast<T>(size);
        tape_.put_output_gradient(gradient, c);
      }
      tape_.backward(network.parameters().data(), first, last - first, to_input);
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
    tape_.parameter_gradient(team, count_, sink);
  }

  /// The gradient by the inputs of the last run with to_input, a column for each sample.
  typename Net::Columns input_gradient() const {
    typename Net::Columns columns(Net::input_size, count_);
    for (Eigen::Index c = 0; c < count_; ++c) tape_.take_input_gradient(c, columns.col(c).data());
    return columns;
  }

 private:
  void check(const Samples<T>& samples, const Loss<T>& loss, std::span<const std::uint32_t> order) const {
    if (order.empty() || std::ssize(order) > tape_.capacity())
      detail::refuse("Backpropagation::run: samples of a batch", detail::text("1 to ", tape_.capacity()),
                     order.size());
    detail::expect_shapes("Backpropagation::run: samples", samples, Net::input_size, Net::output_size);
    loss.expect_outputs(Net::output_size);
    for (const std::uint32_t i : order)
      if (i >= samples.count())
        detail::refuse("Backpropagation::run: number of a sample",
                       detail::text("less than ", samples.count()), i);
  }

  detail::BatchTape<Net> tape_;
  AlignedBuffer<double> losses_;
  Eigen::Index count_ = 0;
};

}  // namespace rbres::RBRES_ABI

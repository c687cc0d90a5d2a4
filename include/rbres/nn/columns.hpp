#pragma once

#include <rbres/nn/backpropagation.hpp>
#include <rbres/nn/objective.hpp>

#include <algorithm>
#include <optional>
#include <utility>

namespace rbres::RBRES_ABI {

/// Columns with targets as an objective: an item is a sample, its value the loss. The samples must outlive
/// it. The trainer takes the fused path (Backpropagation) in place of differentiate().
template <class Net>
class ColumnsObjective {
  using T = typename Net::Scalar;
  using Columns = typename Net::Columns;

 public:
  /// What one thread needs.
  struct Scratch {
    /// Of the network.
    typename Net::Workspace workspace;
    /// Of a chunk of samples.
    /// @{
    Columns inputs = Columns(Net::input_size, chunk_size), outputs = Columns(Net::output_size, chunk_size);
    /// @}
    std::optional<Tape<Net>> tape;  ///< from the first differentiate() on
    /// The loss's derivative by the outputs.
    Columns by_outputs;
  };

  /// Throws Error, which begins with `who`, where a size does not fit, or a number is not finite.
  ColumnsObjective(const Samples<T>& samples, Loss<T> loss = {}, const char* who = "ColumnsObjective")
      : samples_(samples), loss_(std::move(loss)) {
    if (samples_.count() != 0) detail::expect_samples(who, samples_, Net::input_size, Net::output_size);
    loss_.expect_outputs(Net::output_size);
  }

  /// What is learned from.
  const Samples<T>& samples() const noexcept { return samples_; }
  /// What is made small.
  const Loss<T>& loss() const noexcept { return loss_; }

  /// What an Objective has.
  /// @{
  Scratch scratch() const { return {}; }
  std::ptrdiff_t count() const noexcept { return samples_.count(); }
  std::ptrdiff_t chunk() const noexcept { return chunk_size; }
  /// @}

  /// The sum of the items' losses.
  double value(const Net& network, Items items, Scratch& own) const {
    const auto outputs = own.outputs.leftCols(std::ssize(items));
    network.forward(gather(items, own), own.outputs.leftCols(std::ssize(items)), own.workspace);
    typename Net::Output gradient;
    double sum = 0;
    for (Eigen::Index c = 0; c < outputs.cols(); ++c)
      sum += loss_.evaluate(samples_, items[static_cast<std::size_t>(c)], outputs.col(c).data(),
                            gradient.data());
    return sum;
  }

  /// The same with what the mask drops; adds the sum's derivative to `gradient`.
  double differentiate(const Net& network, Items items, const DropoutMask& mask, Scratch& own,
                       ParameterGradient<Net>& gradient) const {
    if (!own.tape) {
      own.tape.emplace(chunk_size);
      own.by_outputs.resize(Net::output_size, chunk_size);
    }
    const Eigen::Index count = std::ssize(items);
    own.tape->record(network, gather(items, own), own.outputs.leftCols(count), mask);
    double sum = 0;
    for (Eigen::Index c = 0; c < count; ++c)
      sum += loss_.evaluate(samples_, items[static_cast<std::size_t>(c)], own.outputs.col(c).data(),
                            own.by_outputs.col(c).data());
    own.tape->backward(network, own.by_outputs.leftCols(count), gradient);
    return sum;
  }

  /// Of all samples and weights; a user's own loss term has no bits to know it by.
  std::uint64_t digest() const noexcept {
    detail::Digest digest;
    for (const ColumnsView<T>* view : {&samples_.inputs, &samples_.targets, &samples_.weights})
      digest.add(view->data(), static_cast<std::size_t>(view->size()));
    digest.add(loss_.output_weights.data(), loss_.output_weights.size());
    digest.add(loss_.extra ? 1 : 0);
    return digest.value();
  }

 private:
  static constexpr Eigen::Index chunk_size = 96;

  auto gather(Items items, Scratch& own) const {
    for (std::size_t c = 0; c < items.size(); ++c)
      own.inputs.col(static_cast<Eigen::Index>(c)) = samples_.inputs.col(items[c]);
    return own.inputs.leftCols(std::ssize(items));
  }

  Samples<T> samples_;
  Loss<T> loss_;
};

}  // namespace rbres::RBRES_ABI

#pragma once

#include <rbres/nn/columns.hpp>

#include <algorithm>
#include <vector>

/// @file
/// Where a step of training has its gradient from. Both kinds have
///
///     run(network, objective, items, mask, team)   the mean over the items, and all that gradients need
///     parameter_gradient(team, sink)               sink(place, g, is_weight) for every register, each once
///     useful_threads(asked, batch)
///
/// The threads of a team call them together.
namespace rbres::RBRES_ABI::detail {

/// Of any objective: chunks add to gradients, each of which takes every most_sums-th chunk; the gradients are
/// added in their order. So the bits do not depend on the threads, and memory has a bound.
template <class Net, Objective<Net> O>
class GradientSource {
  using T = typename Net::Scalar;
  using Passes = typename Net::Passes;

 public:
  GradientSource(const O& objective, std::ptrdiff_t batch, int threads)
      : sums_(static_cast<std::size_t>(std::min(chunks(objective, batch), most_sums))),
        values_(static_cast<std::size_t>(chunks(objective, batch))) {
    for (int i = 0; i < useful_threads(threads, batch); ++i) scratch_.push_back(objective.scratch());
  }

  int useful_threads(int asked, std::ptrdiff_t) const {
    return std::min(asked, static_cast<int>(sums_.size()));
  }

  double run(const Net& network, const O& objective, Items items, const DropoutMask& mask, const Team& team) {
    const std::ptrdiff_t chunk = objective.chunk(), count = chunks(objective, std::ssize(items));
    const std::ptrdiff_t sums = std::min(count, std::ssize(sums_));
    if (team.index() == 0) used_ = static_cast<std::size_t>(sums), items_ = items.size();
    team.share(sums, [&](std::ptrdiff_t task) {
      ParameterGradient<Net>& sum = sums_[static_cast<std::size_t>(task)];
      sum.set_zero();
      for (std::ptrdiff_t k = task; k < count; k += sums) {
        DropoutMask own = mask;
        own.first = static_cast<std::uint32_t>(k * chunk);
        values_[static_cast<std::size_t>(k)] = objective.differentiate(
            network, part(items, k, chunk), own, scratch_[static_cast<std::size_t>(team.index())], sum);
      }
    });
    double value = 0;
    for (std::ptrdiff_t k = 0; k < count; ++k) value += values_[static_cast<std::size_t>(k)];
    return value / static_cast<double>(items.size());
  }

  template <class Sink>
  void parameter_gradient(const Team& team, const Sink& sink) const {
    const T share = T{1} / static_cast<T>(items_);
    each_slice<Net>(team, [&](std::ptrdiff_t, std::size_t begin, std::size_t end, bool is_weight) {
      for (std::size_t at = begin; at < end; at += simd_width<T>) {
        Simd<T> g{};
        for (std::size_t i = 0; i < used_; ++i) g += load(sums_[i].numbers().data() + at);
        sink(at, Simd<T>(share * g), is_weight);
      }
    });
  }

 private:
  static constexpr std::ptrdiff_t most_sums = 32;

  std::vector<ParameterGradient<Net>> sums_;
  std::vector<double> values_;                ///< of chunks
  std::vector<typename O::Scratch> scratch_;  ///< one for each thread
  std::size_t used_ = 0, items_ = 0;
};

/// Of columns: the fused path.
template <class Net>
class GradientSource<Net, ColumnsObjective<Net>> {
 public:
  GradientSource(const ColumnsObjective<Net>&, std::ptrdiff_t batch, int) : gradients_(batch) {}

  /// No more than have something to do in a step: at least 8 samples each, for which they read all weights,
  /// and some 20 microseconds, beside which waiting counts little.
  int useful_threads(int asked, std::ptrdiff_t batch) const {
    constexpr std::ptrdiff_t products = 1 << 18;
    const std::ptrdiff_t most =
        std::min((batch + 7) / 8, batch * static_cast<std::ptrdiff_t>(Net::parameter_count) / products);
    return static_cast<int>(std::clamp<std::ptrdiff_t>(asked, 1, std::max<std::ptrdiff_t>(most, 1)));
  }

  double run(const Net& network, const ColumnsObjective<Net>& objective, Items items, const DropoutMask& mask,
             const Team& team) {
    return gradients_.run(network, objective.samples(), objective.loss(), items, mask, team);
  }

  template <class Sink>
  void parameter_gradient(const Team& team, const Sink& sink) const {
    gradients_.parameter_gradient(team, sink);
  }

 private:
  Backpropagation<Net> gradients_;
};

}  // namespace rbres::RBRES_ABI::detail

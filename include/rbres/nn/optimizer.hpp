#pragma once

#include <rbres/nn/schedule.hpp>
#include <rbres/nn/simd.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <utility>

namespace rbres::RBRES_ABI {

/// @file
/// An optimiser is a struct of its hyper-parameters; what it remembers between steps stands in `moment_count`
/// blocks of the layout of the parameters, and starts as zeros. rule<T>(rate, step) gives the update of one
/// step, counted from 1: new w = rule(w, g, moments, is_weight), register by register. check() throws Error
/// where a number is out of its range; text() names all of them, so that a checkpoint knows its optimiser.

namespace detail {
/// Refuses what is not in [least, most), which NaN never is.
inline void expect_within(const char* what, double found, double least, double most) {
  if (!(found >= least && found < most)) refuse(what, text("in [", least, ", ", most, ")"), found);
}
}  // namespace detail

/// Adam (Kingma, Ba 2014, algorithm 1), as PyTorch's torch.optim.Adam.
struct Adam {
  /// As in the paper: decay of both moments, and what keeps the division finite.
  /// @{
  double beta1 = 0.9, beta2 = 0.999, epsilon = 1e-8;
  /// @}
  /// Blocks that it remembers.
  static constexpr int moment_count = 2;

  /// Throws Error where a number is out of its range.
  void check() const {
    detail::expect_within("Adam::beta1", beta1, 0, 1);
    detail::expect_within("Adam::beta2", beta2, 0, 1);
    detail::expect_within("Adam::epsilon", epsilon, std::numeric_limits<float>::min(), 1);
  }
  /// By which a checkpoint knows it again.
  std::string text() const {
    return detail::text("Adam ", detail::exact(beta1), " ", detail::exact(beta2), " ",
                        detail::exact(epsilon));
  }

  /// One step.
  template <class T>
  struct Rule {
    /// rest: 1 - beta, taken in double: in float 1 - 0.999f is wrong by 5e-5; correction: 1 / sqrt(1 -
    /// beta2^step); decay: of a weight per step
    /// @{
    T beta1, rest1, beta2, rest2;
    T rate, correction, epsilon, decay;
    /// @}
    /// The new weight w, given its gradient g.
    template <class V>
    [[gnu::always_inline]] V operator()(V w, const V& g, V* moments, bool is_weight) const noexcept {
      moments[0] = beta1 * moments[0] + rest1 * g;
      moments[1] = beta2 * moments[1] + rest2 * (g * g);
      if (is_weight) w *= 1 - decay;
      return w - rate * moments[0] / (detail::root_of_lanes(moments[1]) * correction + epsilon);
    }
  };
  /// Of step number `step`, from 1, at a learning rate.
  template <class T>
  Rule<T> rule(double rate, std::uint64_t step) const noexcept {
    const double t = static_cast<double>(step);
    return {static_cast<T>(beta1),
            static_cast<T>(1 - beta1),
            static_cast<T>(beta2),
            static_cast<T>(1 - beta2),
            static_cast<T>(rate / (1 - std::pow(beta1, t))),
            static_cast<T>(1 / std::sqrt(1 - std::pow(beta2, t))),
            static_cast<T>(epsilon),
            T{0}};
  }
};

/// Adam with decoupled weight decay (Loshchilov, Hutter 2019, algorithm 2), as PyTorch's torch.optim.AdamW,
/// but biases do not decay. Usually together with TrainingOptions::l2 = 0.
struct AdamW : Adam {
  /// A weight loses this share times the learning rate in a step.
  double weight_decay = 1e-2;

  /// Throws Error where a number is out of its range.
  void check() const {
    Adam::check();
    detail::expect_within("AdamW::weight_decay", weight_decay, 0, std::numeric_limits<double>::infinity());
  }
  /// By which a checkpoint knows it again.
  std::string text() const {
    return detail::text("AdamW ", detail::exact(weight_decay), " of ", Adam::text());
  }

  /// Of step number `step`, from 1, at a learning rate.
  template <class T>
  Rule<T> rule(double rate, std::uint64_t step) const noexcept {
    auto rule = Adam::rule<T>(rate, step);
    rule.decay = static_cast<T>(rate * weight_decay);
    return rule;
  }
};

/// Stochastic gradient descent with momentum (Polyak 1964), as PyTorch's torch.optim.SGD.
struct Sgd {
  /// What is kept of the last step.
  double momentum = 0.9;
  /// Blocks that it remembers.
  static constexpr int moment_count = 1;

  /// Throws Error where a number is out of its range.
  void check() const { detail::expect_within("Sgd::momentum", momentum, 0, 1); }
  /// By which a checkpoint knows it again.
  std::string text() const { return detail::text("Sgd ", detail::exact(momentum)); }

  /// One step.
  template <class T>
  struct Rule {
    /// Of this step.
    /// @{
    T momentum, rate;
    /// @}
    /// The new weight w, given its gradient g.
    template <class V>
    [[gnu::always_inline]] V operator()(const V& w, const V& g, V* moments, bool) const noexcept {
      moments[0] = momentum * moments[0] + g;
      return w - rate * moments[0];
    }
  };
  /// Of any step, at a learning rate.
  template <class T>
  Rule<T> rule(double rate, std::uint64_t) const noexcept {
    return {static_cast<T>(momentum), static_cast<T>(rate)};
  }
};

/// Another optimiser that sees no gradient longer than largest_norm: one whose norm over all parameters, the
/// L2 term apart, is larger is scaled to it (Pascanu, Mikolov, Bengio 2013, algorithm 1), as PyTorch's
/// clip_grad_norm_. An infinite norm clips nothing and costs nothing.
template <class Optimizer>
struct Clipped : Optimizer {
  /// The longest gradient that is not scaled.
  double largest_norm = 1;

  /// Throws Error where a number is out of its range.
  void check() const {
    Optimizer::check();
    if (!(largest_norm > 0)) detail::refuse("Clipped::largest_norm", "above 0", largest_norm);
  }
  /// By which a checkpoint knows it again.
  std::string text() const {
    return detail::text(Optimizer::text(), " clipped at ", detail::exact(largest_norm));
  }

  /// Whether it clips anything.
  bool clips() const noexcept { return std::isfinite(largest_norm); }
  /// What a gradient of this norm is multiplied with.
  double factor(double norm) const noexcept { return std::min(1.0, largest_norm / (norm + 1e-6)); }
};

/// Another optimiser that keeps an exponential moving average of the weights: average = decay average +
/// (1 - decay) w after each step, divided by 1 - decay^step as it starts from zero (Kingma, Ba 2014, section
/// 7.2). The averaged weights are those that are validated and may be the best.
template <class Optimizer>
struct Averaged : Optimizer {
  /// What is kept of the average in a step.
  double decay = 0.999;
  /// The number of the average's block.
  static constexpr int average_moment = Optimizer::moment_count;
  /// Blocks that it remembers.
  static constexpr int moment_count = Optimizer::moment_count + 1;

  /// Throws Error where a number is out of its range.
  void check() const {
    Optimizer::check();
    detail::expect_within("Averaged::decay", decay, 0, 1);
  }
  /// By which a checkpoint knows it again.
  std::string text() const { return detail::text(Optimizer::text(), " averaged ", detail::exact(decay)); }

  /// What the moment is multiplied with to be the average after so many steps.
  double average_scale(std::uint64_t step) const noexcept {
    return 1 / (1 - std::pow(decay, static_cast<double>(step)));
  }

  /// One step.
  template <class T, class Inner>
  struct Rule {
    /// The other optimiser's.
    Inner inner;
    /// Of the average; rest: 1 - decay.
    /// @{
    T decay, rest;
    /// @}
    /// The new weight w, given its gradient g.
    template <class V>
    [[gnu::always_inline]] V operator()(const V& w, const V& g, V* moments, bool is_weight) const noexcept {
      const V next = inner(w, g, moments, is_weight);
      moments[average_moment] = decay * moments[average_moment] + rest * next;
      return next;
    }
  };
  /// Of step number `step`, from 1, at a learning rate.
  template <class T>
  auto rule(double rate, std::uint64_t step) const noexcept {
    const auto inner = Optimizer::template rule<T>(rate, step);
    return Rule<T, std::remove_const_t<decltype(inner)>>{inner, static_cast<T>(decay),
                                                         static_cast<T>(1 - decay)};
  }
};

namespace detail {
template <class Optimizer>
concept ClipsGradients = requires(const Optimizer& o) {
  o.clips();
  o.factor(1.0);
};
template <class Optimizer>
concept AveragesWeights = requires(const Optimizer& o) {
  Optimizer::average_moment;
  o.average_scale(std::uint64_t{1});
};
}  // namespace detail

}  // namespace rbres::RBRES_ABI

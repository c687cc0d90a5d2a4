#pragma once

#include <rbres/nn/simd.hpp>

#include <cmath>
#include <cstdint>

namespace rbres {

/// An optimiser is a struct of its hyper-parameters; what it remembers between steps stands in `moment_count`
/// blocks of the layout of the parameters, and starts as zeros. rule<T>(rate, step) gives the update of one
/// step, counted from 1: new w = rule(w, g, moments, is_weight), register by register.

/// Adam (Kingma, Ba 2014, algorithm 1), as PyTorch's torch.optim.Adam.
struct Adam {
  double beta1 = 0.9, beta2 = 0.999, epsilon = 1e-8;
  static constexpr int moment_count = 2;

  template <class T>
  struct Rule {
    // 1 - beta is given too: taken from a float beta2 it would be off by 1e-5.
    T beta1, beta2, rest1, rest2, rate, correction, epsilon,
        decay;  ///< correction: 1 / sqrt(1 - beta2^step); decay: of a weight per step
    template <class V>
    [[gnu::always_inline]] V operator()(V w, const V& g, V* moments, bool is_weight) const noexcept {
      moments[0] = beta1 * moments[0] + rest1 * g;
      moments[1] = beta2 * moments[1] + rest2 * (g * g);
      if (is_weight) w *= 1 - decay;
      return w - rate * moments[0] / (detail::root_of_lanes(moments[1]) * correction + epsilon);
    }
  };
  template <class T>
  Rule<T> rule(double rate, std::uint64_t step) const noexcept {
    const double t = static_cast<double>(step);
    return {static_cast<T>(beta1),
            static_cast<T>(beta2),
            static_cast<T>(1 - beta1),
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
  double weight_decay = 1e-2;

  template <class T>
  Rule<T> rule(double rate, std::uint64_t step) const noexcept {
    auto rule = Adam::rule<T>(rate, step);
    rule.decay = static_cast<T>(rate * weight_decay);
    return rule;
  }
};

/// Stochastic gradient descent with momentum (Polyak 1964), as PyTorch's torch.optim.SGD.
struct Sgd {
  double momentum = 0.9;
  static constexpr int moment_count = 1;

  template <class T>
  struct Rule {
    T momentum, rate;
    template <class V>
    [[gnu::always_inline]] V operator()(const V& w, const V& g, V* moments, bool) const noexcept {
      moments[0] = momentum * moments[0] + g;
      return w - rate * moments[0];
    }
  };
  template <class T>
  Rule<T> rule(double rate, std::uint64_t) const noexcept {
    return {static_cast<T>(momentum), static_cast<T>(rate)};
  }
};

}  // namespace rbres

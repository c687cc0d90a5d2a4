// The optimiser of a run, chosen when it starts.
#pragma once

#include <rbres/nn/optimizer.hpp>

namespace train {

using namespace rbres;

enum class Method { adam, adamw, sgd };

/// The optimiser that the command line asks for. One type, so that the trainer is compiled once; Adam is
/// AdamW without decay.
struct ChosenOptimizer {
  Method method = Method::adam;
  AdamW adam{};
  Sgd sgd{};
  static constexpr int moment_count = 2;

  void check() const { adam.check(), sgd.check(); }
  std::string text() const { return method == Method::sgd ? sgd.text() : adam.text(); }

  template <class T>
  struct Rule {
    bool is_sgd;
    Adam::Rule<T> adam;
    Sgd::Rule<T> sgd;
    template <class V>
    [[gnu::always_inline]] V operator()(const V& w, const V& g, V* moments, bool is_weight) const noexcept {
      return is_sgd ? sgd(w, g, moments, is_weight) : adam(w, g, moments, is_weight);
    }
  };
  template <class T>
  Rule<T> rule(double rate, std::uint64_t step) const noexcept {
    return {method == Method::sgd, adam.rule<T>(rate, step), sgd.rule<T>(rate, step)};
  }
};

}  // namespace train

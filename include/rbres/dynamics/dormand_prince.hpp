#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <rbres/dynamics/integrators.hpp>
#include <utility>

namespace rbres::RBRES_ABI {

/// One accepted step of DormandPrince54, evaluable anywhere inside.
template <class State, class Rate, class S>
struct DenseStep {
  S start;  ///< s
  S step;   ///< s
  /// The states at its start and its end.
  /// @{
  State from, to;
  /// @}
  /// The time derivatives at the seven stages.
  std::array<Rate, 7> slope;

  /// The state at time t in [start, start + step], to fourth order (Hairer, Norsett, Wanner: Solving ODEs I,
  /// II.6).
  State operator()(const S& t) const {
    constexpr double b[7] = {35.0 / 384, 0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84, 0};
    constexpr double d[7] = {-12715105075.0 / 11282082432.0,  0,
                             87487479700.0 / 32700410799.0,   -10690763975.0 / 1880347072.0,
                             701980252875.0 / 199316789632.0, -1453857185.0 / 822651844.0,
                             69997945.0 / 29380423.0};
    const S x = (t - start) / step, left = S(1) - x;
    const S ends[7] = {x * left * left, 0, 0, 0, 0, 0, -x * x * left};
    State y = from;
    for (std::size_t i = 0; i < 7; ++i) {
      const S weight = x * x * ((S(3) - S(2) * x) * S(b[i]) + left * left * S(d[i])) + ends[i];
      y = advanced(y, S(step * weight), slope[i]);
    }
    detail::normalize(y);
    return y;
  }
};

/// The adaptive pair of order 5(4) of Dormand and Prince (1980), with dense output: the reference against
/// which the others are held. For plain scalars; its step follows the local error.
struct DormandPrince54 {
  /// Of the global error.
  static constexpr int order = 5;

  /// Of a step's error, as a share of each component.
  double relative_tolerance = 1e-12;
  double absolute_tolerance = 1e-13;  ///< in the units of each component

  /// The state after a step h (s) from t (s), in as many steps of its own as the tolerances need.
  template <class Rate, class State, class S>
  State advance(const Rate& rate, const State& y, const S& t, const S& h) const {
    return integrate(rate, y, t, h, [](const auto&) {});
  }

  /// From t to t + h, calling on_step(const DenseStep&) after each accepted step. Where the rate is not
  /// finite, or a million steps do not suffice, the state that is returned is not finite.
  template <class Rate, class State, class S, class OnStep>
  State integrate(const Rate& rate, const State& y0, const S& t0, const S& h, const OnStep& on_step) const {
    static_assert(std::is_floating_point_v<S>,
                  "an adaptive step needs a plain scalar: lanes would disagree about it");
    using Slope = std::decay_t<decltype(rate(t0, y0))>;
    DenseStep<State, Slope, S> dense{t0, h, y0, y0, {}};
    auto& k = dense.slope;
    k[0] = rate(t0, y0);
    S done = 0, step = h;
    for (long tries = 0; done < h; ++tries) {
      step = std::min(step, h - done);
      const S t = t0 + done;
      const State& y = dense.from;
      k[1] = rate(t + step / 5, advanced(y, step / 5, k[0]));
      k[2] = rate(t + step * as<S>(0.3), combine(y, step, k, {3.0 / 40, 9.0 / 40}));
      k[3] = rate(t + step * as<S>(0.8), combine(y, step, k, {44.0 / 45, -56.0 / 15, 32.0 / 9}));
      k[4] = rate(t + step * as<S>(8.0 / 9),
                  combine(y, step, k, {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729}));
      k[5] = rate(
          t + step,
          combine(y, step, k, {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656}));
      dense.to = combine(y, step, k, {35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84});
      detail::normalize(dense.to);
      k[6] = rate(t + step, dense.to);
      const State zero = advanced(y, S(0), k[0]);
      const State fault =
          combine(zero, step, k,
                  {71.0 / 57600, 0.0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40});
      const S error = scaled_error(zero, fault, dense.to);
      // A smaller step may stay clear of what is not finite; where none does, the state says so.
      const bool smallest = step < as<S>(1e-13) * std::max(S(1), std::abs(t)) || tries >= most_tries;
      if (!std::isfinite(error)) {
        if (smallest || !std::isfinite(step)) return dense.to;
        step *= as<S>(0.2);
        continue;
      }
      if (tries >= most_tries) {
        dense.from.vector().setConstant(std::numeric_limits<S>::quiet_NaN());
        return dense.from;
      }
      if (error <= S(1) || smallest) {
        dense.start = t;
        dense.step = step;
        on_step(std::as_const(dense));
        done += step;
        dense.from = dense.to;
        k[0] = k[6];  // first same as last
      }
      const S factor = error > S(0) ? as<S>(0.9) * std::pow(error, as<S>(-0.2)) : S(5);
      step *= std::clamp(factor, as<S>(0.2), S(5));
    }
    return dense.from;
  }

 private:
  static constexpr long most_tries = 1'000'000;

  template <class State, class Slope, class S>
  static State combine(State y, const S& h, const std::array<Slope, 7>& k,
                       std::initializer_list<double> weights) {
    std::size_t i = 0;
    for (const double w : weights) {
      if (w != 0) y = advanced(y, S(h * S(w)), k[i]);
      ++i;
    }
    return y;
  }

  /// Largest component of the local error over its tolerance.
  template <class State>
  auto scaled_error(const State& y, const State& fault, const State& end) const {
    using S = std::decay_t<decltype(y.vector()(0))>;
    // No step of floats reaches the default tolerances.
    const double finest = 8 * static_cast<double>(std::numeric_limits<S>::epsilon());
    const auto tolerance =
        std::max(relative_tolerance, finest) *
            y.vector().cwiseAbs().cwiseMax(end.vector().cwiseAbs()).array().template cast<double>() +
        std::max(absolute_tolerance, std::is_same_v<S, float> ? finest : 0.0);
    return static_cast<S>(
        ((fault.vector() - y.vector()).array().template cast<double>().abs() / tolerance).maxCoeff());
  }
};

}  // namespace rbres::RBRES_ABI

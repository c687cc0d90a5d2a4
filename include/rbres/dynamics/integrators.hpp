#pragma once

#include <rbres/dynamics/equations.hpp>

namespace rbres::RBRES_ABI {

/// Time derivative of a whole system's state.
template <class S, int N>
struct SystemRate {
  /// Body by body.
  detail::BodyList<RigidRate<S>, N> body;
};

namespace detail {
/// A value of as many bodies, its numbers not set.
template <class Value>
Value same_size(const Value& other) {
  Value out;
  if constexpr (requires { out.body.resize(1); }) out.body.resize(other.body.size());
  return out;
}
}  // namespace detail

/// y + h k, the quaternions not normalised; h in s.
template <class S, int N>
SystemState<S, N> advanced(const SystemState<S, N>& y, const S& h, const SystemRate<S, N>& k) {
  auto out = detail::same_size(y);
  for (std::size_t i = 0; i < y.body.size(); ++i) out.body[i] = advanced(y.body[i], h, k.body[i]);
  return out;
}

/// @file
/// An integrator takes a state over a step: advance(rate, y, t, h) with rate(t, y) the time derivative, t (s)
/// the time at the start and h (s) the step. States are RigidState (one body, where no force couples bodies)
/// or SystemState. `order` is that of the global error. The quaternion is normalised once, at the end of the
/// step: the exact flow keeps its length, so this changes nothing up to the method's order.

namespace detail {

template <class S>
[[gnu::always_inline]] inline void normalize(RigidState<S>& y) {
  y.orientation = normalized(y.orientation);
}
template <class S, int N>
void normalize(SystemState<S, N>& y) {
  for (auto& body : y.body) normalize(body);
}

template <class S, class Angular>
RigidState<S> semi_implicit(RigidState<S> y, const S& h, RigidRate<S, Angular> k) {
  y.velocity += h * k.acceleration;
  y.angular_velocity = y.angular_velocity + h * k.angular;
  set_kinematics(k, y);
  k.acceleration = {};
  k.angular = {};
  return advanced(y, h, k);
}
template <class S, int N>
SystemState<S, N> semi_implicit(const SystemState<S, N>& y, const S& h, const SystemRate<S, N>& k) {
  auto out = same_size(y);
  for (std::size_t i = 0; i < y.body.size(); ++i) out.body[i] = semi_implicit(y.body[i], h, k.body[i]);
  return out;
}

/// sum + weight k
template <class S, class Angular>
[[gnu::always_inline]] inline RigidRate<S, Angular> added(const RigidRate<S, Angular>& sum, const S& weight,
                                                          const RigidRate<S, Angular>& k) {
  return {sum.velocity + weight * k.velocity,
          {sum.orientation.x + weight * k.orientation.x, sum.orientation.y + weight * k.orientation.y,
           sum.orientation.z + weight * k.orientation.z, sum.orientation.w + weight * k.orientation.w},
          sum.acceleration + weight * k.acceleration,
          sum.angular + weight * k.angular};
}
template <class S, int N>
SystemRate<S, N> added(const SystemRate<S, N>& sum, const S& weight, const SystemRate<S, N>& k) {
  auto out = same_size(sum);
  for (std::size_t i = 0; i < sum.body.size(); ++i) out.body[i] = added(sum.body[i], weight, k.body[i]);
  return out;
}

}  // namespace detail

/// y1 = y0 + h f(t0, y0).
struct ExplicitEuler {
  /// Of the global error.
  static constexpr int order = 1;

  /// The state after a step h (s) from t (s).
  template <class Rate, class State, class S>
  [[gnu::always_inline]] State advance(const Rate& rate, const State& y, const S& t, const S& h) const {
    State out = advanced(y, h, rate(t, y));
    detail::normalize(out);
    return out;
  }
};

/// Velocities first, then positions with the new velocities (symplectic for forces that depend on position
/// alone).
struct SemiImplicitEuler {
  /// Of the global error.
  static constexpr int order = 1;

  /// The state after a step h (s) from t (s).
  template <class Rate, class State, class S>
  [[gnu::always_inline]] State advance(const Rate& rate, const State& y, const S& t, const S& h) const {
    State out = detail::semi_implicit(y, h, rate(t, y));
    detail::normalize(out);
    return out;
  }
};

/// The classical Runge-Kutta method (Kutta 1901).
struct Rk4 {
  /// Of the global error.
  static constexpr int order = 4;

  /// The state after a step h (s) from t (s).
  template <class Rate, class State, class S>
  [[gnu::always_inline]] State advance(const Rate& rate, const State& y, const S& t, const S& h) const {
    const S half = as<S>(0.5) * h;
    // Slopes are summed before they meet the state, which is then rounded once a step, not four times.
    // Nothing is assigned as a whole: compilers would copy it through memory.
    const auto k1 = rate(t, y);
    const auto k2 = rate(S(t + half), advanced(y, half, k1));
    const auto sum2 = detail::added(k1, S(2), k2);
    const auto k3 = rate(S(t + half), advanced(y, half, k2));
    const auto sum3 = detail::added(sum2, S(2), k3);
    const auto k4 = rate(S(t + h), advanced(y, h, k3));
    State out = advanced(y, S(h / as<S>(6.0)), detail::added(sum3, S(1), k4));
    detail::normalize(out);
    return out;
  }
};

}  // namespace rbres::RBRES_ABI

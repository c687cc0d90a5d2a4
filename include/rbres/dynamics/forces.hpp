#pragma once

#include <rbres/body/system.hpp>
#include <span>
#include <tuple>

namespace rbres::RBRES_ABI {

/// @file
/// A force model gives the wrench on a body, or on all. It is any callable with one of these forms, a user's
/// lambda included:
///
///     (body, state)                 the body and its own state
///     (body, state, index, time)    and which body it is, and when (s)
///     (system, states, index, time) the whole system: forces between bodies; not with `auto` for the system,
///                                   which would pass for a body
///     (system, states, time, wrenches) all bodies at once: adds to each of a std::span<Wrench<S>>, and
///                                   returns nothing; the same holds for `auto`
///
/// Compose with Forces{Gravity{}, FluidFriction{}, ...}; nothing is decided at run time. A model may say with
/// turns() that it never exerts a torque.

/// Uniform gravity: F = m g.
template <class T = double>
struct Gravity {
  Vec3<T> g{T(0), T(0), T(-9.81)};  ///< world frame, m/s^2

  /// Gravity exerts no torque.
  static constexpr bool turns() { return false; }

  /// The force on a body.
  template <class S, class Shape>
  [[gnu::always_inline]] Wrench<S> operator()(const Body<S, Shape>& body, const RigidState<S>&) const {
    return {body.mass() * Vec3<S>{as<S>(g.x), as<S>(g.y), as<S>(g.z)}, {}};
  }
};
/// Gravity of the numbers that it is given, or of doubles.
/// @{
template <class T>
Gravity(Vec3<T>) -> Gravity<T>;
Gravity()->Gravity<double>;
/// @}

/// Quadratic friction of a fluid at rest (the paper's equation 10): F = -1/2 rho C_d A |v| v, A the area that
/// the shape turns towards v; and its rotational counterpart tau = -1/2 rho C_r pi R^5 |omega| omega, R the
/// bounding radius.
template <class T = double>
struct FluidFriction {
  T density = T(1.2);           ///< of the fluid, kg/m^3
  T drag = T(0.47);             ///< C_d
  T rotational_drag = T(0.01);  ///< C_r

  /// Whether it exerts a torque.
  bool turns() const { return density != T(0) && rotational_drag != T(0); }

  /// The force on a body, and the torque.
  template <class S, class Shape>
  [[gnu::always_inline]] Wrench<S> operator()(const Body<S, Shape>& body, const RigidState<S>& state) const {
    if constexpr (std::is_arithmetic_v<T>)  // dual numbers have a derivative by a density of zero
      if (density == T(0)) return {};
    const S factor = as<S>(T(-0.5) * density * drag);
    const S resistance = detail::with_shape(body.shape(), [&](const auto& shape) {
      using Held = std::decay_t<decltype(shape)>;
      if constexpr (std::is_same_v<Held, Sphere<S>>) {
        return shape.frontal(state.velocity, factor);  // the same from every side
      } else {
        const Vec3<S> in_body = rotate_back(state.orientation, state.velocity);
        if constexpr (std::is_floating_point_v<S>) {  // dual numbers know of turns nearby
          if (body.shape_rotation() == Quat<S>{}) return shape.frontal(in_body, factor);
        }
        return shape.frontal(rotate_back(body.shape_rotation(), in_body), factor);
      }
    });
    Wrench<S> wrench{resistance * state.velocity, {}};
    if (turns()) {
      const S r = body.bounding_radius();
      const S spin = as<S>(T(-0.5 * std::numbers::pi) * density * rotational_drag) * (r * r * r * r * r);
      wrench.torque = (spin * norm(state.angular_velocity)) * state.angular_velocity;
    }
    return wrench;
  }
};
/// Of the numbers that it is given, or of doubles.
/// @{
template <class T>
FluidFriction(T, T, T) -> FluidFriction<T>;
FluidFriction()->FluidFriction<double>;
/// @}

/// Linear damping (the paper's equation 12): without other forces, v and omega decay as exp(-rate t).
template <class T = double>
struct Damping {
  T linear = T(0);   ///< 1/s
  T angular = T(0);  ///< 1/s

  /// Whether it exerts a torque.
  bool turns() const { return angular != T(0); }

  /// The force on a body, and the torque.
  template <class S, class Shape>
  [[gnu::always_inline]] Wrench<S> operator()(const Body<S, Shape>& body, const RigidState<S>& state) const {
    return {-(as<S>(linear) * body.mass()) * state.velocity,
            -as<S>(angular) * scale(body.inertia(), state.angular_velocity)};
  }
};
/// Of the numbers that it is given.
template <class T>
Damping(T, T) -> Damping<T>;

/// A wrench of its own on each body, the same at all times.
template <class S, int N>
struct ConstantWrench {
  /// The wrench on each body: force in world frame, N; torque in body frame, N m.
  detail::BodyList<Wrench<S>, N> wrench{};

  /// The wrench on body `index`.
  template <class Shape>
  [[gnu::always_inline]] Wrench<S> operator()(const Body<S, Shape>&, const RigidState<S>&, int index,
                                              const S&) const {
    return wrench[static_cast<std::size_t>(index)];
  }
};

/// Gives lane l of `packed` the wrenches of a scenario.
template <class S, int N, class Wrenches>
void set_lane(ConstantWrench<S, N>& packed, int l, const Wrenches& wrench) {
  for (std::size_t b = 0; b < packed.wrench.size(); ++b) {
    const auto* from = &wrench[b].force.x;
    S* to = &packed.wrench[b].force.x;
    for (int k = 0; k < Wrench<S>::size; ++k) ScalarTraits<S>::set_lane(to[k], l, from[k]);
  }
}

/// The sum of several force models.
template <class... Models>
struct Forces {
  /// The models that are summed.
  std::tuple<Models...> models;

  /// The sum of copies of these.
  Forces(const Models&... m) : models(m...) {}
};

namespace detail {

template <class Model, class S, class Shape>
inline constexpr bool is_local =
    std::is_invocable_v<const Model&, const Body<S, Shape>&, const RigidState<S>&> ||
    std::is_invocable_v<const Model&, const Body<S, Shape>&, const RigidState<S>&, int, S>;
template <class... Models, class S, class Shape>
inline constexpr bool is_local<Forces<Models...>, S, Shape> = (is_local<Models, S, Shape> && ...);

/// Whether a model may exert a torque.
template <class Model>
bool turns(const Model& model) {
  if constexpr (requires { model.turns(); }) {
    return model.turns();
  } else {
    return true;
  }
}
template <class... Models>
bool turns(const Forces<Models...>& forces) {
  return std::apply([](const auto&... m) { return (turns(m) || ...); }, forces.models);
}

/// The wrench of a model that looks at one body only.
template <class Model, class S, class Shape>
[[gnu::always_inline]] inline Wrench<S> local_wrench(const Model& model, const Body<S, Shape>& body,
                                                     const RigidState<S>& state, int i, const S& t) {
  if constexpr (std::is_invocable_v<const Model&, const Body<S, Shape>&, const RigidState<S>&>) {
    return model(body, state);
  } else {
    return model(body, state, i, t);
  }
}
template <class... Models, class S, class Shape>
[[gnu::always_inline]] inline Wrench<S> local_wrench(const Forces<Models...>& forces,
                                                     const Body<S, Shape>& body, const RigidState<S>& state,
                                                     int i, const S& t) {
  if constexpr (sizeof...(Models) == 0) {
    return {};
  } else {
    return std::apply(
        [&](const auto&... m)
            __attribute__((always_inline)) { return (local_wrench(m, body, state, i, t) + ...); },
        forces.models);
  }
}

/// Adds the wrenches of any model.
template <class Model, class System>
void add_wrenches(const Model& model, const System& system, const typename System::State& states,
                  const typename System::Scalar& t, std::span<Wrench<typename System::Scalar>> wrenches) {
  using S = typename System::Scalar;
  const auto add_each = [&](const auto& wrench_on) {
    for (int i = 0; i < system.size(); ++i) {
      Wrench<S>& sum = wrenches[static_cast<std::size_t>(i)];
      sum = sum + wrench_on(i);
    }
  };
  if constexpr (is_local<Model, S, typename System::Shape>) {
    add_each([&](int i) { return local_wrench(model, system[i], states[i], i, t); });
  } else if constexpr (std::is_invocable_v<const Model&, const System&, const typename System::State&, int,
                                           const S&>) {
    add_each([&](int i) { return model(system, states, i, t); });
  } else {
    static_assert(std::is_invocable_r_v<void, const Model&, const System&, const typename System::State&,
                                        const S&, std::span<Wrench<S>>>,
                  "a force model is callable as (body, state), (body, state, index, time), (system, states, "
                  "index, time) or (system, states, time, wrenches)");
    model(system, states, t, wrenches);
  }
}
template <class... Models, class System>
void add_wrenches(const Forces<Models...>& forces, const System& system, const typename System::State& states,
                  const typename System::Scalar& t, std::span<Wrench<typename System::Scalar>> wrenches) {
  std::apply([&](const auto&... m) { (add_wrenches(m, system, states, t, wrenches), ...); }, forces.models);
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

#pragma once

#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/integrators.hpp>

namespace rbres::RBRES_ABI {

/// What contacts add to the force model: nothing.
struct NoPush {
  /// The wrench as it is.
  template <class S>
  Wrench<S> operator()(const RigidState<S>&, int, const S&, const Wrench<S>& wrench) const {
    return wrench;
  }
};

namespace detail {
/// Whether the body keeps its angular velocity while no torque acts.
template <class S, class Shape>
bool has_equal_moments(const Body<S, Shape>& body) {
  const Vec3<S>& moment = body.inertia();
  const MaskOf<S> xy = moment.x == moment.y, yz = moment.y == moment.z;
  return all(xy & yz);
}

/// A state as forces see it. Between the stages of a step quaternions lose their unit length; what forces
/// took for a rotation would depend on how the world is turned.
template <class State>
[[gnu::always_inline]] inline State with_unit_orientation(State y) {
  normalize(y);
  return y;
}
}  // namespace detail

namespace detail {
/// Takes `bodies` of a system h seconds on, body by body, see fly_on().
template <class System, class Bodies, class Model, class Integrator, class Push>
[[gnu::flatten]] void fly_each_on(const System& system, const Bodies& bodies, const Model& forces,
                                  const Integrator& integrator, typename System::State& state,
                                  const typename System::Scalar& t, const typename System::Scalar& h,
                                  const Push& push) {
  using S = typename System::Scalar;
  // Dual numbers take no short cut: their derivatives know of moments nearby.
  constexpr bool short_cut =
      std::is_same_v<Push, NoPush> && std::is_floating_point_v<typename ScalarTraits<S>::Value>;
  for (const int i : bodies) {
    const auto advance = [&]<class Angular>(Angular) __attribute__((always_inline)) {
      state[i] = integrator.advance(
          [&](const S& time, const RigidState<S>& y) __attribute__((always_inline)) {
            RigidRate<S, Angular> rate;
            const auto seen = with_unit_orientation(y);
            set_kinematics(rate, y);
            set_dynamics(rate, system[i], y,
                         push(seen, i, time, local_wrench(forces, system[i], seen, i, time)));
            return rate;
          },
          state[i], t, h);
    };
    if constexpr (short_cut) {
      if (!turns(forces) && has_equal_moments(system[i])) {
        advance(NoVector{});
        continue;
      }
    }
    advance(Vec3<S>{});
  }
}
}  // namespace detail

/// Takes a system's state h seconds on, without impacts. Body by body where no force couples them.
/// `push` (state, index, time, wrench) gives the wrench on a body together with what resting contacts add.
template <class System, class Model, class Integrator, class Push = NoPush>
[[gnu::flatten]] void fly_on(const System& system, const Model& forces, const Integrator& integrator,
                             typename System::State& state, const typename System::Scalar& t,
                             const typename System::Scalar& h, const Push& push = {}) {
  using S = typename System::Scalar;
  if constexpr (detail::is_local<Model, S, typename System::Shape>) {
    detail::fly_each_on(system, detail::all_bodies(system), forces, integrator, state, t, h, push);
  } else {
    state = integrator.advance(
        [&](const S& time, const typename System::State& y) {
          SystemRate<S, System::bodies> rate;
          const auto seen = detail::with_unit_orientation(y);
          if constexpr (System::bodies == dynamic) rate.body.resize(y.body.size());
          auto wrenches = detail::per_body<Wrench<S>>(system);
          detail::add_wrenches(forces, system, seen, time, {wrenches.begin(), wrenches.end()});
          for (int i = 0; i < system.size(); ++i) {
            auto& body = rate.body[static_cast<std::size_t>(i)];
            set_kinematics(body, y[i]);
            set_dynamics(body, system[i], y[i],
                         push(seen[i], i, time, wrenches[static_cast<std::size_t>(i)]));
          }
          return rate;
        },
        state, t, h);
  }
}

namespace detail {
/// Where `bodies` are h seconds from t after y without impacts.
template <class System, class Model, class Integrator, class S, class Push = NoPush>
void fly_bodies(const System& system, const BodyIndices<System>& bodies, const Model& forces,
                const Integrator& integrator, const typename System::State& y, const S& t, const S& h,
                typename System::State& end, const Push& push = {}) {
  for (const int i : bodies) end[i] = y[i];
  if constexpr (is_local<Model, S, typename System::Shape>) {
    fly_each_on(system, bodies, forces, integrator, end, t, h, push);
  } else {
    fly_on(system, forces, integrator, end, t, h, push);
  }
}
}  // namespace detail

/// The state after h seconds of motion without impacts.
template <class System, class Model, class Integrator, class Push = NoPush>
typename System::State fly(const System& system, const Model& forces, const Integrator& integrator,
                           typename System::State state, const typename System::Scalar& t,
                           const typename System::Scalar& h, const Push& push = {}) {
  fly_on(system, forces, integrator, state, t, h, push);
  return state;
}

}  // namespace rbres::RBRES_ABI

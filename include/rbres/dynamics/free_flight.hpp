#pragma once

#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/integrators.hpp>

namespace rbres {

/// What contacts add to the force model: nothing.
struct NoPush {
  template <class S>
  Wrench<S> operator()(const RigidState<S>&, int, const Wrench<S>& wrench) const {
    return wrench;
  }
};

/// Takes a system's state h seconds on, without impacts. Body by body where no force couples them.
/// `push` (state, index, wrench) gives the wrench on a body together with what resting contacts add.
template <class System, class Model, class Integrator, class Push = NoPush>
[[gnu::flatten]] void fly_on(const System& system, const Model& forces, const Integrator& integrator,
                             typename System::State& state, const typename System::Scalar& t,
                             const typename System::Scalar& h, const Push& push = {}) {
  using S = typename System::Scalar;
  if constexpr (detail::is_local<Model, S, typename System::Shape>) {
    for (int i = 0; i < System::bodies; ++i) {
      state[i] = integrator.advance(
          [&](const S& time, const RigidState<S>& y) __attribute__((always_inline)) {
            RigidRate<S> rate;
            set_kinematics(rate, y);
            set_dynamics(rate, system[i], y, push(y, i, detail::local_wrench(forces, system[i], y, i, time)));
            return rate;
          },
          state[i], t, h);
    }
  } else {
    state = integrator.advance(
        [&](const S& time, const typename System::State& y) {
          SystemRate<S, System::bodies> rate;
          for (int i = 0; i < System::bodies; ++i) {
            auto& body = rate.body[static_cast<std::size_t>(i)];
            set_kinematics(body, y[i]);
            set_dynamics(body, system[i], y[i], push(y[i], i, detail::wrench_on(forces, system, y, i, time)));
          }
          return rate;
        },
        state, t, h);
  }
}

/// The state after h seconds of motion without impacts.
template <class System, class Model, class Integrator, class Push = NoPush>
typename System::State fly(const System& system, const Model& forces, const Integrator& integrator,
                           typename System::State state, const typename System::Scalar& t,
                           const typename System::Scalar& h, const Push& push = {}) {
  fly_on(system, forces, integrator, state, t, h, push);
  return state;
}

}  // namespace rbres

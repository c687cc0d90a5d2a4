#pragma once

#include <rbres/dynamics/free_flight.hpp>

namespace rbres::RBRES_ABI {

/// How a scene is stepped from frame to frame.
struct SceneStep {
  int steps = 1;  ///< in a frame, all equal
  /// What a frame's velocity is: at its time, or the mean since the frame before (position after = position
  /// before + frame time * velocity after), as differences of measured positions are.
  enum class Velocity { instant, mean };
  Velocity velocity = Velocity::instant;  ///< what it is here
};

namespace detail {

/// Free flight of h (s) by the integrator under which velocities keep their meaning: Rk4 where they are those
/// of an instant, SemiImplicitEuler where they are means.
template <class System, class Model>
void fly_on(SceneStep::Velocity velocity, const System& system, const Model& forces,
            typename System::State& state, const typename System::Scalar& h) {
  const typename System::Scalar t(0.0);
  if (velocity == SceneStep::Velocity::mean) {
    rbres::fly_on(system, forces, SemiImplicitEuler{}, state, t, h);
  } else {
    rbres::fly_on(system, forces, Rk4{}, state, t, h);
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

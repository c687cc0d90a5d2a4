#pragma once

#include <rbres/body/system.hpp>

namespace rbres::RBRES_ABI {

/// Kinetic energy, J, of a body of this mass (kg) and these principal moments of inertia (kg m^2): that of
/// its centre of mass and that of its rotation about it.
template <class S>
S kinetic_energy(const S& mass, const Vec3<S>& moments, const RigidState<S>& state) {
  const Vec3<S>& w = state.angular_velocity;
  return as<S>(0.5) * (mass * squared_norm(state.velocity) + dot(w, scale(moments, w)));
}

/// Kinetic energy of one body, J.
template <class S, class Shape>
S kinetic_energy(const Body<S, Shape>& body, const RigidState<S>& state) {
  return kinetic_energy(body.mass(), body.inertia(), state);
}

/// Momentum m v of one body, world frame, kg m/s.
template <class S, class Shape>
Vec3<S> linear_momentum(const Body<S, Shape>& body, const RigidState<S>& state) {
  return body.mass() * state.velocity;
}

/// Angular momentum of one body about its own centre of mass, world frame, kg m^2/s: R I omega.
template <class S, class Shape>
Vec3<S> spin_angular_momentum(const Body<S, Shape>& body, const RigidState<S>& state) {
  return rotate(state.orientation, scale(body.inertia(), state.angular_velocity));
}

/// Angular momentum of one body about the world's origin, world frame, kg m^2/s: x cross m v, and its spin.
template <class S, class Shape>
Vec3<S> angular_momentum(const Body<S, Shape>& body, const RigidState<S>& state) {
  return cross(state.position, linear_momentum(body, state)) + spin_angular_momentum(body, state);
}

/// Kinetic energy of all bodies, J.
template <class S, int N, class Shape, int P>
S kinetic_energy(const System<S, N, Shape, P>& system, const SystemState<S, N>& states) {
  detail::check_size(system, states);
  S sum(0);
  for (int i = 0; i < system.size(); ++i) sum += kinetic_energy(system[i], states[i]);
  return sum;
}

/// Potential energy of all bodies, J, under uniform gravity (world frame, m/s^2; of the states' scalar or a
/// plain number's): the sum of -m dot(gravity, position), which is zero at the world's origin.
template <class S, int N, class Shape, int P, class T = S>
S potential_energy(const System<S, N, Shape, P>& system, const SystemState<S, N>& states,
                   const Vec3<T>& gravity) {
  detail::check_size(system, states);
  const Vec3<S> g{as<S>(gravity.x), as<S>(gravity.y), as<S>(gravity.z)};
  S sum(0);
  for (int i = 0; i < system.size(); ++i) sum -= system[i].mass() * dot(g, states[i].position);
  return sum;
}

/// Mechanical energy of all bodies, J: kinetic and potential, gravity as for potential_energy.
template <class S, int N, class Shape, int P, class T = S>
S energy(const System<S, N, Shape, P>& system, const SystemState<S, N>& states, const Vec3<T>& gravity) {
  return kinetic_energy(system, states) + potential_energy(system, states, gravity);
}

/// Momentum of all bodies, world frame, kg m/s.
template <class S, int N, class Shape, int P>
Vec3<S> linear_momentum(const System<S, N, Shape, P>& system, const SystemState<S, N>& states) {
  detail::check_size(system, states);
  Vec3<S> sum;
  for (int i = 0; i < system.size(); ++i) sum += linear_momentum(system[i], states[i]);
  return sum;
}

/// Angular momentum of all bodies about the world's origin, world frame, kg m^2/s.
template <class S, int N, class Shape, int P>
Vec3<S> angular_momentum(const System<S, N, Shape, P>& system, const SystemState<S, N>& states) {
  detail::check_size(system, states);
  Vec3<S> sum;
  for (int i = 0; i < system.size(); ++i) sum += angular_momentum(system[i], states[i]);
  return sum;
}

}  // namespace rbres::RBRES_ABI

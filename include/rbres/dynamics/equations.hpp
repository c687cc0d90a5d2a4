#pragma once

#include <rbres/body/system.hpp>

namespace rbres::RBRES_ABI {

/// A vector known to be zero when compiling: nothing is computed with it.
struct NoVector {};
/// With nothing, nothing is done.
/// @{
template <class S>
NoVector operator*(const S&, NoVector) {
  return {};
}
inline NoVector operator+(NoVector, NoVector) { return {}; }
template <class S>
Vec3<S> operator+(const Vec3<S>& a, NoVector) {
  return in_registers(a);
}
/// @}

/// Time derivative of a body's 13 numbers. The same layout, but rates. With NoVector for the angular
/// acceleration, that of a body which keeps its spin.
template <class S, class Angular = Vec3<S>>
struct RigidRate {
  Vec3<S> velocity;      ///< of the position, m/s
  Quat<S> orientation;   ///< of the quaternion, 1/s
  Vec3<S> acceleration;  ///< world frame, m/s^2
  Angular angular;       ///< angular acceleration, body frame, rad/s^2
};

/// Kinematics: x' = v, q' = 1/2 q (x) [0, omega].
template <class S, class Angular>
[[gnu::always_inline]] inline void set_kinematics(RigidRate<S, Angular>& rate, const RigidState<S>& state) {
  rate.velocity = in_registers(state.velocity);
  rate.orientation = quaternion_rate(state.orientation, state.angular_velocity);
}

/// Newton and Euler (the paper's equations 1 and 2): m v' = F, I omega' = tau - omega x (I omega). Along the
/// principal axes the gyroscopic term is (I_y - I_z) w_y w_z and so on, zero where moments are equal.
template <class S, class Shape>
[[gnu::always_inline]] inline void set_dynamics(RigidRate<S>& rate, const Body<S, Shape>& body,
                                                const RigidState<S>& state, const Wrench<S>& wrench) {
  rate.acceleration = body.inverse_mass() * wrench.force;
  const Vec3<S>&w = state.angular_velocity, &moment = body.inertia();
  const Vec3<S> difference{moment.y - moment.z, moment.z - moment.x, moment.x - moment.y};
  const Vec3<S> gyroscopic = scale(difference, Vec3<S>{w.y * w.z, w.z * w.x, w.x * w.y});
  rate.angular = scale(body.inverse_inertia(), wrench.torque + gyroscopic);
}

/// The same for a body with three equal moments and no torque: there is no gyroscopic term either.
template <class S, class Shape>
[[gnu::always_inline]] inline void set_dynamics(RigidRate<S, NoVector>& rate, const Body<S, Shape>& body,
                                                const RigidState<S>&, const Wrench<S>& wrench) {
  rate.acceleration = body.inverse_mass() * wrench.force;
}

/// y + h k, the quaternion not normalised.
template <class S, class Angular>
[[gnu::always_inline]] inline RigidState<S> advanced(const RigidState<S>& y, const S& h,
                                                     const RigidRate<S, Angular>& k) {
  return {y.position + h * k.velocity,
          {y.orientation.x + h * k.orientation.x, y.orientation.y + h * k.orientation.y,
           y.orientation.z + h * k.orientation.z, y.orientation.w + h * k.orientation.w},
          y.velocity + h * k.acceleration,
          y.angular_velocity + h * k.angular};
}

}  // namespace rbres::RBRES_ABI

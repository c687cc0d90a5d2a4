#pragma once

#include <rbres/learn/contact_flight.hpp>

#include <cmath>

namespace rbres {

/// What a rollout's errors cost: for each body and frame the length of each error times its weight, up to a
/// cap, beyond which a trajectory is lost and teaches nothing.
struct RolloutLoss {
  struct Term {
    double weight, cap;  ///< 1/unit, unit
  };
  Term position{100, 0.3};  ///< m
  Term rotation{1, 1};      ///< rad
  Term velocity{1, 3};      ///< m/s
  Term spin{0.01, 30};      ///< world frame, rad/s
};

namespace detail {

/// Adds the derivative of weight |error| by the error; returns the value.
inline double add_term(const RolloutLoss::Term& term, const Vec3<double>& error, double share,
                       Vec3<double>& by_error) {
  const double faint = 1e-4 * term.cap;  // so that it bends at 0
  const double size = std::sqrt(squared_norm(error) + faint * faint);
  if (size > term.cap) return share * term.weight * term.cap;
  by_error += (share * term.weight / size) * error;
  return share * term.weight * size;
}

/// What a state costs beside the truth, times `share`; adds its derivative by the state.
inline double add_loss(const RolloutLoss& loss, const RigidState<double>& state,
                       const RigidState<double>& truth, double share, RigidState<double>& by_state) {
  double value = add_term(loss.position, state.position - truth.position, share, by_state.position) +
                 add_term(loss.velocity, state.velocity - truth.velocity, share, by_state.velocity);
  Vec3<double> by_spin, by_angle;
  value +=
      add_term(loss.spin, state.angular_velocity_world() - truth.angular_velocity_world(), share, by_spin);
  add_rotation_gradient(state.orientation, state.angular_velocity, by_spin, by_state.orientation,
                        by_state.angular_velocity);
  // Twice the sine of half the angle between them.
  const Quat<double> back = truth.orientation.conjugate(), between = back * state.orientation;
  value += add_term(loss.rotation, 2.0 * between.imaginary(), share, by_angle);
  const Quat<double> by_between{2 * by_angle.x, 2 * by_angle.y, 2 * by_angle.z, 0};
  by_state.orientation = by_state.orientation + truth.orientation * by_between;
  return value;
}

}  // namespace detail
}  // namespace rbres

#pragma once

#include <rbres/learn/physics_terms.hpp>

#include <cmath>
#include <limits>

namespace rbres::RBRES_ABI {

/// What a rollout's errors cost: for each body and frame the length of each error times its weight, up to a
/// cap, beyond which a trajectory is lost and teaches nothing.
struct RolloutLoss {
  /// What one kind of error costs.
  struct Term {
    double weight;  ///< 1/unit
    double cap;     ///< unit
  };
  Term position{100, 0.3};  ///< m
  Term rotation{1, 1};      ///< rad
  Term velocity{1, 3};      ///< m/s
  Term spin{0.01, 30};      ///< world frame, rad/s
  /// On the way back through a rollout, how much more an error may count in all frames that follow than if it
  /// stayed as it is (or, of velocities, grew with time). Impacts can make errors grow without bound; what
  /// such rollouts say of their beginnings drowns all others, and is scaled down to this.
  double largest_growth = std::numeric_limits<double>::infinity();
  /// What breaking rules costs.
  PhysicsTerms physics{};
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

/// Scales a body's derivative down to the loss's largest growth, in a rollout that lasts `time` (s); `share`
/// is what all its errors are multiplied with, summed over frames.
inline void limit_growth(const RolloutLoss& loss, double time, double share, RigidState<double>& by) {
  const double p = loss.position.weight, r = loss.rotation.weight;
  const Quat<double>& q = by.orientation;
  const double squares = squared_norm(by.position) / square(p) + squared_norm(q) / square(r) +
                         squared_norm(by.velocity) / square(loss.velocity.weight + time * p) +
                         squared_norm(by.angular_velocity) / square(loss.spin.weight + time * r);
  const double growth = std::sqrt(squares) / share;
  if (growth <= loss.largest_growth) return;
  by.vector() *= std::isfinite(growth) ? loss.largest_growth / growth : 0.0;
  if (!by.vector().allFinite()) by.vector().setZero();
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

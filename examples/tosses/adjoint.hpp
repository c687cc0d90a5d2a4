#pragma once

#include <Eigen/Core>

#include "corner.hpp"

namespace rbres::tosses {

/// A gradient by a state: by position, by a small rotation in the body frame, by velocity, by angular
/// velocity.
using Adjoint = Eigen::Matrix<double, 12, 1>;

/// How far a predicted pose is from the measured one, m: sqrt(|dx|^2 + (2 w sin(angle / 2))^2 + (4 mm)^2), w
/// the half width. Adds its gradient by the pose times `scale`.
inline double pose_error(const State& predicted, const State& measured, double scale, Adjoint& gradient) {
  const Vec3<double> dx = predicted.position - measured.position;
  const Quat<double> d = measured.orientation.conjugate() * predicted.orientation;
  constexpr double arm = 4 * half_width * half_width;
  const double error = std::sqrt(squared_norm(dx) + arm * squared_norm(d.imaginary()) + 0.004 * 0.004);
  const double s = scale / error, r = s * arm * d.w / 2;
  const double by[6] = {s * dx.x, s * dx.y, s * dx.z, r * d.x, r * d.y, r * d.z};
  for (int i = 0; i < 6; ++i) gradient[i] += by[i];
  return error;
}

/// From the gradient by a rotation that ended with a turn (rotation vector in rad; both in the body frame) to
/// that by the rotation before it, in place, and that by the turn, which is returned.
inline Eigen::Vector3d pull_back_turn(const Vec3<double>& turn, Eigen::Ref<Eigen::Vector3d> gradient) {
  const Vec3<double> after(gradient);
  gradient = Eigen::Vector3d(rotate(quaternion_exp(turn), after));
  return right_jacobian(turn).transposed_times(after);
}

/// The state moved along direction k of its tangent space: position, body-frame rotation, velocity, angular
/// velocity.
inline State moved(State state, int k, double by) {
  const Vec3<double> along(Eigen::Vector3d(by * Eigen::Vector3d::Unit(k % 3)));
  if (k / 3 == 0) state.position += along;
  if (k / 3 == 1) state.orientation = state.orientation * quaternion_exp(along);
  if (k / 3 == 2) state.velocity += along;
  if (k / 3 == 3) state.angular_velocity += along;
  return state;
}

/// The derivative of a step: a row for each direction of the state after it, a column for each of the state
/// before but x and y, with which every step only moves along.
using Slope = Eigen::Matrix<double, 12, 10>;

/// The slope of a prior at `before`, where it leads to `after`, by one-sided differences: a contact solver
/// has no formula for it, and 1e-8 is exact enough for a network's gradient.
inline Slope slope_of(const Prior& prior, const State& before, const State& after) {
  constexpr double h = 1e-7;
  Slope slope;
  for (int k = 0; k < 10; ++k) {
    const State other = prior(moved(before, k + 2, h));
    slope.col(k) << Eigen::Vector3d(other.position - after.position),
        Eigen::Vector3d(rotation_between(after.orientation, other.orientation)),
        Eigen::Vector3d(other.velocity - after.velocity),
        Eigen::Vector3d(other.angular_velocity - after.angular_velocity);
  }
  return slope / h;
}

}  // namespace rbres::tosses

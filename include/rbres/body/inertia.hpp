#pragma once

#include <Eigen/Eigenvalues>
#include <rbres/body/limits.hpp>
#include <rbres/core/vector.hpp>

namespace rbres::RBRES_ABI {

/// A body's inertia in its principal axes.
template <class S>
struct PrincipalInertia {
  Vec3<S> moments;  ///< kg m^2
  Quat<S> axes;     ///< turns principal-axis vectors into the frame in which the tensor was given
};

/// Refuses moments that no body can have: not positive, beyond BodyLimits, or one larger than the sum
/// of the other two.
template <class S>
void check_moments(const Vec3<S>& moments) {
  const S m[3] = {moments.x, moments.y, moments.z};
  const auto found = [&] { return detail::Line("(", m[0], ", ", m[1], ", ", m[2], ")"); };
  for (int i = 0; i < 3; ++i) {
    if (!(m[i] > S(0)) || !is_finite(m[i]))
      detail::refuse("inertia", "three positive moments (kg m^2)", found());
    detail::check_within("inertia", m[i], 1 / BodyLimits<S>::moment, BodyLimits<S>::moment, " kg m^2");
  }
  for (int i = 0; i < 3; ++i) {
    // Flat bodies reach equality, so rounding is let through.
    if (m[i] > (m[(i + 1) % 3] + m[(i + 2) % 3]) * (S(1) + S(8) * S(Constants<S>::epsilon))) {
      detail::refuse("inertia", "no moment larger than the sum of the other two", found());
    }
  }
}

/// Takes a full inertia tensor (about the centre of mass, kg m^2) to its principal axes.
/// Throws Error where the tensor is not symmetric, or belongs to no body.
template <class S>
PrincipalInertia<S> principal_inertia(const Eigen::Matrix<S, 3, 3>& tensor) {
  if (!tensor.allFinite()) detail::refuse("inertia tensor", "finite numbers", detail::text("\n", tensor));
  if ((tensor - tensor.transpose()).cwiseAbs().maxCoeff() > as<S>(1e-6) * tensor.cwiseAbs().maxCoeff()) {
    detail::refuse("inertia tensor", "a symmetric matrix", detail::text("\n", tensor));
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<S, 3, 3>> solver(tensor);
  Eigen::Matrix<S, 3, 3> axes = solver.eigenvectors();
  if (axes.determinant() < S(0)) axes.col(0) = -axes.col(0).eval();
  PrincipalInertia<S> principal{Vec3<S>(solver.eigenvalues()), Quat<S>(Eigen::Quaternion<S>(axes))};
  check_moments(principal.moments);
  return principal;
}

namespace detail {

/// The same of a solid, exact to the relative `precision`: the axes of one that is symmetric about them stay
/// its axes, whatever the rounding. A template, so that only who calls it compiles an eigensolver.
template <class S>
PrincipalInertia<S> principal_inertia_to(const Eigen::Matrix<S, 3, 3>& tensor, const S& precision) {
  const Eigen::Matrix<S, 3, 3> off = tensor - Eigen::Matrix<S, 3, 3>(tensor.diagonal().asDiagonal());
  if (off.cwiseAbs().maxCoeff() <= 8 * precision * tensor.trace()) return {Vec3<S>(tensor.diagonal()), {}};
  return principal_inertia<S>(tensor);
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

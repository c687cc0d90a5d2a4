#pragma once

#include <array>
#include <cstddef>
#include <rbres/contact/impulse.hpp>

namespace rbres::RBRES_ABI::detail {

/// A vector along a contact point's three directions: its normal and two tangents.
template <class S>
using Triple = std::array<S, 3>;

/// How the velocities of an island's bodies move one of its contact points: the lines of the Jacobian.
template <class S>
struct PointJacobian {
  using Line = std::array<S, 6>;            ///< by a body's velocity and its angular velocity
  std::size_t first, second;                ///< the bodies' places in the island
  std::array<Line, 3> on_first, on_second;  ///< on_first is not read where contacts move one body alone
};

/// How the velocity of its second body moves a contact point; of its first body.
/// @{
template <class S, class Point>
std::array<typename PointJacobian<S>::Line, 3> lines_on_second(const Point& point) {
  const auto line = [&](std::size_t d) -> typename PointJacobian<S>::Line {
    const Vec3<S>&way = point.direction(d), &arm = point.second_arm(d);
    return {way.x, way.y, way.z, arm.x, arm.y, arm.z};
  };
  return {line(0), line(1), line(2)};
}
template <class S, class Point>
std::array<typename PointJacobian<S>::Line, 3> lines_on_first(const Point& point) {
  const auto line = [&](std::size_t d) -> typename PointJacobian<S>::Line {
    const Vec3<S> way = -point.direction(d), arm = -point.first_arm(d);
    return {way.x, way.y, way.z, arm.x, arm.y, arm.z};
  };
  return {line(0), line(1), line(2)};
}
/// Of a row, how the velocity of the body that is its moved.second moves the point.
template <class S, class Row, class Point>
std::array<typename PointJacobian<S>::Line, 3> lines_on_moved(const Row& row, const Point& point) {
  if constexpr (requires { point.first_arm(0); }) {
    if (row.moved.second == row.who.first) return lines_on_first<S>(point);
  }
  return lines_on_second<S>(point);
}
/// @}
/// A point's velocity by that of one of its bodies, six numbers.
template <class S>
Triple<S> along(const std::array<typename PointJacobian<S>::Line, 3>& side, const S* v) {
  Triple<S> all;
  for (std::size_t d = 0; d < 3; ++d) {
    all[d] = S(0);
    for (std::size_t k = 0; k < 6; ++k) all[d] += side[d][k] * v[k];
  }
  return all;
}
/// Replaces an impulse and its moment by the change of velocity that they give a body.
template <class S>
void respond_to(const Motion<S>& body, S* six) {
  for (std::size_t d = 0; d < 3; ++d) six[d] *= body.inverse_mass;
  const Vec3<S> spin = body.inverse_inertia * Vec3<S>{six[3], six[4], six[5]};
  six[3] = spin.x, six[4] = spin.y, six[5] = spin.z;
}

}  // namespace rbres::RBRES_ABI::detail

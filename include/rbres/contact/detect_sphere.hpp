#pragma once

#include <rbres/contact/manifold.hpp>

namespace rbres::RBRES_ABI {

/// @file
/// detect(first, its pose, second, its pose): how two shapes meet. There is one function for each pair of
/// shapes, and no fallback: a pair without one does not compile.

namespace detail {

/// Two balls at a and b, of radii ra and rb.
template <class S, bool Central = false>
Manifold<S, 1, Central> detect_balls(const Vec3<S>& a, const S& ra, const Vec3<S>& b, const S& rb) {
  const Vec3<S> between = b - a;
  const Vec3<S> n = direction_or_z(between);
  const S gap = dot(between, n) - ra - rb;
  return {n, gap, {a + (ra + S(0.5) * gap) * n}, {gap}};
}

}  // namespace detail

/// Two balls: one point.
template <class S>
Manifold<S, 1, true> detect(const Sphere<S>& a, const Pose<S>& pa, const Sphere<S>& b, const Pose<S>& pb) {
  return detail::detect_balls<S, true>(pa.position, a.radius, pb.position, b.radius);
}

/// A plane and a ball: one point.
template <class S>
Manifold<S, 1, true> detect(const Plane<S>& plane, const Sphere<S>& b, const Pose<S>& pb) {
  const S gap = dot(plane.normal, pb.position) - plane.offset - b.radius;
  return {in_registers(plane.normal), gap, {pb.position - b.radius * plane.normal}, {gap}};
}

}  // namespace rbres::RBRES_ABI

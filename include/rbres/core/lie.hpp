#pragma once

#include <array>
#include <cstddef>
#include <rbres/core/vector.hpp>

/// @file
/// The group of rotations in space, as unit quaternions and as matrices, and its Lie algebra: a rotation
/// vector phi stands along the axis and is as long as the angle (rad). Equations are those of Sola, Deray,
/// Atchuthan 2018, "A micro Lie theory for state estimation in robotics". S is any scalar: float, double,
/// packs, dual numbers; values and derivatives are accurate for all angles, zero and pi among them.
namespace rbres::RBRES_ABI {

namespace detail {

/// f(x) lane by lane.
template <class S, class F>
S by_lane(const S& x, const F& f) {
  if constexpr (Packed<S>) {
    S y = x;
    for (int i = 0; i < ScalarTraits<S>::lanes; ++i)
      ScalarTraits<S>::set_lane(y, i, f(ScalarTraits<S>::lane(x, i)));
    return y;
  } else {
    return f(x);
  }
}
template <class S>
S sine(const S& x) {
  using std::sin;
  return by_lane(x, [](const auto& lane) { return std::remove_cvref_t<decltype(lane)>(sin(lane)); });
}
template <class S>
S cosine(const S& x) {
  using std::cos;
  return by_lane(x, [](const auto& lane) { return std::remove_cvref_t<decltype(lane)>(cos(lane)); });
}
/// The angle of (x, y) from the x axis, in [0, pi] for y >= 0, rad.
template <class S>
S angle_of(const S& y, const S& x) {
  using std::atan2;
  if constexpr (Packed<S>) {
    S angle = y;
    using Lanes = ScalarTraits<S>;
    for (int i = 0; i < Lanes::lanes; ++i)
      Lanes::set_lane(angle, i, atan2(Lanes::lane(y, i), Lanes::lane(x, i)));
    return angle;
  } else {
    return S(atan2(y, x));
  }
}

/// Stumpff's function c_K(t) = 1/K! - t/(K + 2)! + t^2/(K + 4)! - ... for t >= 0 (Stumpff 1959; Battin 1999,
/// section 4.5). With t = angle^2: c_0 = cos(angle), c_1 = sin(angle)/angle, c_2 = (1 - cos(angle))/angle^2,
/// c_3 = (angle - sin(angle))/angle^3.
template <int K, class S>
S stumpff(const S& t) {
  static_assert(K >= 0 && K <= 3);
  constexpr int terms = 10;  // the next is below 1e-18 for t < 1
  constexpr auto inverse_factorials = [] {
    std::array<double, terms> all{};
    double factorial = 1;
    for (int n = 1; n <= K; ++n) factorial *= n;
    for (int j = 0; j < terms; ++j) {
      all[static_cast<std::size_t>(j)] = 1 / factorial;
      factorial *= (K + 2 * j + 1) * (K + 2 * j + 2);
    }
    return all;
  }();
  const auto small = t < as<S>(1);
  S series = as<S>(inverse_factorials[terms - 1]);
  for (std::size_t j = terms - 1; j-- > 0;) series = as<S>(inverse_factorials[j]) - t * series;
  if (all(small)) return series;
  const S squared = select(small, S(t + as<S>(1)), t);
  const S angle = root(squared);
  if constexpr (K == 0) return select(small, series, cosine(angle));
  if constexpr (K == 1) return select(small, series, S(sine(angle) / angle));
  if constexpr (K == 2) return select(small, series, S((as<S>(1) - cosine(angle)) / squared));
  if constexpr (K == 3) return select(small, series, S((angle - sine(angle)) / (angle * squared)));
}

/// a I + b phi phi^T + c [phi]x
template <class S>
Mat3<S> around(const Vec3<S>& phi, const S& a, const S& b, const S& c) {
  const Vec3<S> bx = S(b * phi.x) * phi, by = S(b * phi.y) * phi, bz = S(b * phi.z) * phi, s = c * phi;
  return {{a + bx.x, bx.y + s.z, bx.z - s.y},
          {by.x - s.z, a + by.y, by.z + s.x},
          {bz.x + s.y, bz.y - s.x, a + bz.z}};
}

}  // namespace detail

/// The unit quaternion of a rotation vector (rad): [cos(|phi|/2), phi/|phi| sin(|phi|/2)] (equation 101).
template <class S>
Quat<S> quaternion_exp(const Vec3<S>& phi) {
  const S t = as<S>(0.25) * squared_norm(phi), s = as<S>(0.5) * detail::stumpff<1>(t);
  return {s * phi.x, s * phi.y, s * phi.z, detail::stumpff<0>(t)};
}

/// The rotation vector (rad) of a quaternion of any length but 0, at most pi long: the shorter way round, the
/// same for q and -q (equation 103). At exactly pi both signs are right; it gives one of them.
template <class S>
Vec3<S> quaternion_log(const Quat<S>& q) {
  const auto far = q.w < as<S>(0);
  const S w = select(far, S(-q.w), q.w), sign = select(far, as<S>(-1), as<S>(1));
  const Vec3<S> v = q.imaginary();
  const S squared = squared_norm(v), w2 = w * w;
  // atan(x)/x = 1 - x^2/3 + x^4/5 - ..., which has a derivative at 0; below 1/10 eleven terms are exact.
  const auto small = squared < S(as<S>(0.01) * w2);
  const S safe = select(small, w, as<S>(1));
  const S x2 = select(small, squared, as<S>(0)) / S(safe * safe);
  S series = as<S>(1.0 / 21);
  for (int n = 19; n > 0; n -= 2) series = as<S>(1.0 / n) - x2 * series;
  const S near_zero = series / safe;
  if (all(small)) return S(as<S>(2) * sign * near_zero) * v;
  const S length = root(select(small, as<S>(1), squared));
  const S elsewhere = detail::angle_of(length, w) / length;
  return S(as<S>(2) * sign * select(small, near_zero, elsewhere)) * v;
}

/// The rotation matrix of a rotation vector (rad): Rodrigues' formula (equation 146).
template <class S>
Mat3<S> rotation_exp(const Vec3<S>& phi) {
  const S t = squared_norm(phi);
  return detail::around(phi, detail::stumpff<0>(t), detail::stumpff<2>(t), detail::stumpff<1>(t));
}

/// A unit quaternion of a rotation matrix, from the largest of its four numbers (Shepperd 1978).
template <class S>
Quat<S> quaternion_of(const Mat3<S>& r) {
  // Each is the quaternion times four times one of its numbers.
  const S one = as<S>(1);
  const S yz = r.y.z + r.z.y, zx = r.z.x + r.x.z, xy = r.x.y + r.y.x;
  const S wx = r.y.z - r.z.y, wy = r.z.x - r.x.z, wz = r.x.y - r.y.x;
  const Quat<S> by_w{wx, wy, wz, one + r.x.x + r.y.y + r.z.z};
  const Quat<S> by_x{one + r.x.x - r.y.y - r.z.z, xy, zx, wx};
  const Quat<S> by_y{xy, one + r.y.y - r.z.z - r.x.x, yz, wy};
  const Quat<S> by_z{zx, yz, one + r.z.z - r.x.x - r.y.y, wz};
  const Quat<S> xw = select(by_x.x > by_w.w, by_x, by_w), yz_ = select(by_z.z > by_y.y, by_z, by_y);
  const S first = maximum(by_x.x, by_w.w), second = maximum(by_z.z, by_y.y);
  return normalized(select(second > first, yz_, xw));
}

/// The rotation vector (rad) of a rotation matrix, at most pi long (equation 147).
template <class S>
Vec3<S> rotation_log(const Mat3<S>& r) {
  return quaternion_log(quaternion_of(r));
}

/// J_r with exp(phi + d) = exp(phi) exp(J_r d) for small d: from changes of a rotation vector to rotations in
/// the body frame (equation 143). The left Jacobian, to rotations in the world frame, is its transpose.
template <class S>
Mat3<S> right_jacobian(const Vec3<S>& phi) {
  const S t = squared_norm(phi);
  return detail::around(phi, detail::stumpff<1>(t), detail::stumpff<3>(t), S(-detail::stumpff<2>(t)));
}

/// Its inverse, from rotations in the body frame to changes of the rotation vector, for |phi| < 2 pi, where
/// it is singular (equation 144).
template <class S>
Mat3<S> right_jacobian_inverse(const Vec3<S>& phi) {
  // In Stumpff's functions of the half angle nothing cancels.
  const S t = as<S>(0.25) * squared_norm(phi), c1 = detail::stumpff<1>(t);
  const S b = as<S>(0.25) * (detail::stumpff<2>(t) - detail::stumpff<3>(t)) / c1;
  return detail::around(phi, S(detail::stumpff<0>(t) / c1), b, as<S>(0.5));
}

}  // namespace rbres::RBRES_ABI

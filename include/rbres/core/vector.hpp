#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <rbres/core/scalar.hpp>

namespace rbres::RBRES_ABI {

/// Three components. Plain structs, not Eigen's, because they are trivially copyable, their alignment does
/// not follow compiler flags, and they carry packs of lanes; they convert from and to Eigen's vectors.
template <class S>
struct Vec3 {
  /// The components.
  /// @{
  S x = S(0), y = S(0), z = S(0);
  /// @}

  Vec3() = default;
  /// From three numbers.
  constexpr Vec3(const S& x_, const S& y_, const S& z_) : x(x_), y(y_), z(z_) {}
  /// From three numbers of Eigen.
  template <class Derived>
  Vec3(const Eigen::MatrixBase<Derived>& v) : x(v(0)), y(v(1)), z(v(2)) {
    static_assert(Derived::SizeAtCompileTime == 3, "a Vec3 is made from three numbers");
  }
  /// As a vector of Eigen.
  operator Eigen::Matrix<S, 3, 1>() const requires(!Packed<S>) { return {x, y, z}; }

  /// The algebra of vectors.
  /// @{
  friend Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend Vec3 operator-(const Vec3& a) { return {-a.x, -a.y, -a.z}; }
  friend Vec3 operator*(const S& s, const Vec3& a) { return {s * a.x, s * a.y, s * a.z}; }
  friend Vec3 operator*(const Vec3& a, const S& s) { return {s * a.x, s * a.y, s * a.z}; }
  Vec3& operator+=(const Vec3& b) { return x += b.x, y += b.y, z += b.z, *this; }
  Vec3& operator-=(const Vec3& b) { return x -= b.x, y -= b.y, z -= b.z, *this; }
  /// @}
  /// Whether all components are equal.
  friend bool operator==(const Vec3&, const Vec3&) = default;
};

/// The inner product.
template <class S>
S dot(const Vec3<S>& a, const Vec3<S>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
/// The cross product a x b.
template <class S>
Vec3<S> cross(const Vec3<S>& a, const Vec3<S>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
/// A copy, see in_register.
template <class S>
Vec3<S> in_registers(const Vec3<S>& a) {
  return {in_register(a.x), in_register(a.y), in_register(a.z)};
}
/// Component by component.
template <class S>
Vec3<S> scale(const Vec3<S>& a, const Vec3<S>& b) {
  return {a.x * b.x, a.y * b.y, a.z * b.z};
}
/// The square of the length.
template <class S>
S squared_norm(const Vec3<S>& a) {
  return dot(a, a);
}
/// The length. Its derivative is finite at zero, too.
template <class S>
[[gnu::always_inline]] inline S norm(const Vec3<S>& a) {
  const S tiny(Constants<S>::tiny);
  const S squared = a.x * a.x + (a.y * a.y + (a.z * a.z + tiny));
  return select(squared == tiny, S(0), positive_root(squared));
}
/// The absolute values of the components.
template <class S>
Vec3<S> absolute(const Vec3<S>& a) {
  using std::abs;
  return {abs(a.x), abs(a.y), abs(a.z)};
}
/// a where the mask holds, else b, lane by lane.
template <Packed S>
Vec3<S> select(const MaskOf<S>& m, const Vec3<S>& a, const Vec3<S>& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z)};
}

/// A Hamilton quaternion, stored x, y, z, w as Eigen's; a unit one turns body vectors into world vectors.
template <class S>
struct Quat {
  /// The imaginary parts x, y, z and the real part w; as it is built, no rotation.
  /// @{
  S x = S(0), y = S(0), z = S(0), w = S(1);
  /// @}

  Quat() = default;
  /// From x, y, z, w: the real part comes last.
  constexpr Quat(const S& x_, const S& y_, const S& z_, const S& w_) : x(x_), y(y_), z(z_), w(w_) {}
  /// From a quaternion of Eigen.
  Quat(const Eigen::Quaternion<S>& q) requires(!Packed<S>) : x(q.x()), y(q.y()), z(q.z()), w(q.w()) {}
  /// As a quaternion of Eigen.
  operator Eigen::Quaternion<S>() const requires(!Packed<S>) { return {w, x, y, z}; }

  /// x, y and z.
  Vec3<S> imaginary() const { return {x, y, z}; }
  /// The inverse of a unit quaternion.
  Quat conjugate() const { return {-x, -y, -z, w}; }
  /// Hamilton's product: the rotation b, then a.
  friend Quat operator*(const Quat& a, const Quat& b) {
    return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
            a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
  }
  /// Whether all numbers are equal; q and -q are not.
  friend bool operator==(const Quat&, const Quat&) = default;
};

/// The square of the length.
template <class S>
S squared_norm(const Quat<S>& q) {
  return q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
}
namespace detail {
/// The distance of two quaternions; of the orientations before and after a turn by t it is 2 sin(t / 4).
template <class S>
S chord(const Quat<S>& a, const Quat<S>& b) {
  return positive_root(
      S(squared_norm(Quat<S>{a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w}) + S(Constants<S>::tiny)));
}
}  // namespace detail

/// q over its length, which must not be 0.
template <class S>
[[gnu::always_inline]] inline Quat<S> normalized(const Quat<S>& q) {
  const S s = inverse_root(squared_norm(q));
  return {s * q.x, s * q.y, s * q.z, s * q.w};
}
/// a where the mask holds, else b, lane by lane.
template <Packed S>
Quat<S> select(const MaskOf<S>& m, const Quat<S>& a, const Quat<S>& b) {
  return {select(m, a.x, b.x), select(m, a.y, b.y), select(m, a.z, b.z), select(m, a.w, b.w)};
}

/// Three columns; as a rotation, the body's axes in the world frame.
template <class S>
struct Mat3 {
  /// The columns.
  /// @{
  Vec3<S> x, y, z;
  /// @}

  /// M v
  friend Vec3<S> operator*(const Mat3& m, const Vec3<S>& v) {
    return {m.x.x * v.x + m.y.x * v.y + m.z.x * v.z, m.x.y * v.x + m.y.y * v.y + m.z.y * v.z,
            m.x.z * v.x + m.y.z * v.y + m.z.z * v.z};
  }
  /// M^T v
  Vec3<S> transposed_times(const Vec3<S>& v) const { return {dot(x, v), dot(y, v), dot(z, v)}; }
};

/// The rotation matrix of a unit quaternion.
template <class S>
Mat3<S> rotation_matrix(const Quat<S>& q) {
  const S x2 = q.x + q.x, y2 = q.y + q.y, z2 = q.z + q.z;
  const S xx = q.x * x2, yy = q.y * y2, zz = q.z * z2;
  const S xy = q.x * y2, xz = q.x * z2, yz = q.y * z2;
  const S wx = q.w * x2, wy = q.w * y2, wz = q.w * z2;
  return {{S(1) - (yy + zz), xy + wz, xz - wy},
          {xy - wz, S(1) - (xx + zz), yz + wx},
          {xz + wy, yz - wx, S(1) - (xx + yy)}};
}

/// R diag(d) R^T, symmetric.
template <class S>
Mat3<S> rotated_diagonal(const Mat3<S>& r, const Vec3<S>& d) {
  const Vec3<S> a = d.x * r.x, b = d.y * r.y, c = d.z * r.z;
  const S xy = a.x * r.x.y + b.x * r.y.y + c.x * r.z.y;
  const S xz = a.x * r.x.z + b.x * r.y.z + c.x * r.z.z;
  const S yz = a.y * r.x.z + b.y * r.y.z + c.y * r.z.z;
  return {{a.x * r.x.x + b.x * r.y.x + c.x * r.z.x, xy, xz},
          {xy, a.y * r.x.y + b.y * r.y.y + c.y * r.z.y, yz},
          {xz, yz, a.z * r.x.z + b.z * r.y.z + c.z * r.z.z}};
}

/// The inverse of a symmetric matrix.
template <class S>
Mat3<S> symmetric_inverse(const Mat3<S>& m) {
  const Vec3<S> x = cross(m.y, m.z), y = cross(m.z, m.x), z = cross(m.x, m.y);
  const S over = S(1) / dot(m.x, x);
  return {over * x, over * y, over * z};
}

/// The rate 1/2 q (x) [0, w] of an orientation under the body-frame angular velocity w (the paper's equation
/// 3).
template <class S>
[[gnu::always_inline]] inline Quat<S> quaternion_rate(const Quat<S>& q, const Vec3<S>& w) {
  const Vec3<S> h = S(0.5) * w;
  return {q.w * h.x + q.y * h.z - q.z * h.y, q.w * h.y + q.z * h.x - q.x * h.z,
          q.w * h.z + q.x * h.y - q.y * h.x, -(q.x * h.x + q.y * h.y + q.z * h.z)};
}

/// A body vector in the world frame, and back.
template <class S>
[[gnu::always_inline]] inline Vec3<S> rotate(const Quat<S>& q, const Vec3<S>& v) {
  const Vec3<S> t = S(2) * cross(q.imaginary(), v);
  return v + q.w * t + cross(q.imaginary(), t);
}
/// A vector of the world frame in the body frame.
template <class S>
[[gnu::always_inline]] inline Vec3<S> rotate_back(const Quat<S>& q, const Vec3<S>& v) {
  return rotate(q.conjugate(), v);
}

}  // namespace rbres::RBRES_ABI

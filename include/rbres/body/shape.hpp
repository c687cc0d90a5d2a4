#pragma once

#include <numbers>
#include <rbres/body/limits.hpp>
#include <rbres/core/vector.hpp>
#include <variant>

namespace rbres::RBRES_ABI {

/// @file
/// A shape is centred at the body's centre of mass. Every shape gives: bounding_radius() (m), lever() (the
/// largest speed at which a unit spin moves the surface along its normal, m), volume() (m^3),
/// unit_inertia() (principal moments of a uniform solid over its mass, m^2; a PrincipalInertia where they are
/// not along the shape's axes), and frontal(v, factor): the factor times the area it turns towards a velocity
/// v along its axes times |v| (m^3/s), from which the fluid's friction follows; scaled(factor), the shape
/// with all lengths multiplied; describe(), for messages; and check(), which throws Error for sizes that no
/// shape has, or beyond BodyLimits.

/// A ball.
template <class S>
struct Sphere {
  S radius;  ///< m

  /// A ball of this radius, m.
  Sphere(const S& radius_) : radius(radius_) {}
  /// What every shape gives: the radius of the ball around it (m), the largest speed at which a unit spin
  /// moves the surface along its normal (m), volume (m^3), principal moments over mass of a uniform solid
  /// (m^2), `factor` times the area turned towards the body-frame velocity v times |v| (m^3/s), the shape
  /// with all lengths multiplied, or in another scalar, words for messages, and check(), which throws Error
  /// for sizes that no shape has.
  /// @{
  S bounding_radius() const { return radius; }
  S lever() const { return S(0); }
  S volume() const { return as<S>(4.0 / 3.0 * std::numbers::pi) * radius * radius * radius; }
  Vec3<S> unit_inertia() const {
    const S i = as<S>(0.4) * radius * radius;
    return {i, i, i};
  }
  S frontal(const Vec3<S>& v, const S& factor) const {
    return (factor * as<S>(std::numbers::pi) * radius * radius) * norm(v);
  }
  Sphere scaled(const S& factor) const { return {factor * radius}; }
  template <class T>
  Sphere<T> cast() const {
    return {as<T>(radius)};
  }
  std::string describe() const { return detail::text("sphere of radius ", radius, " m"); }
  void check() const { detail::check_length("sphere radius", radius); }
  /// @}
};

/// A cuboid, axes along the body's.
template <class S>
struct Box {
  Vec3<S> half;  ///< half extents, m

  /// A box of these half extents, m.
  Box(const S& hx, const S& hy, const S& hz) : half(hx, hy, hz) {}
  /// A box of these half extents, m.
  explicit Box(const Vec3<S>& half_extents) : half(half_extents) {}
  /// What every shape gives: the radius of the ball around it (m), the largest speed at which a unit spin
  /// moves the surface along its normal (m), volume (m^3), principal moments over mass of a uniform solid
  /// (m^2), `factor` times the area turned towards the body-frame velocity v times |v| (m^3/s), the shape
  /// with all lengths multiplied, or in another scalar, words for messages, and check(), which throws Error
  /// for sizes that no shape has.
  /// @{
  S bounding_radius() const { return norm(half); }
  S lever() const { return norm(half); }
  S volume() const { return S(8) * half.x * half.y * half.z; }
  Vec3<S> unit_inertia() const {
    const S third = S(1) / S(3);
    return {third * (square(half.y) + square(half.z)), third * (square(half.x) + square(half.z)),
            third * (square(half.x) + square(half.y))};
  }
  S frontal(const Vec3<S>& v, const S& factor) const {
    using std::abs;
    return S(4) * factor *
           (half.y * half.z * abs(v.x) + half.x * half.z * abs(v.y) + half.x * half.y * abs(v.z));
  }
  Box scaled(const S& factor) const { return Box(factor * half); }
  template <class T>
  Box<T> cast() const {
    return {as<T>(half.x), as<T>(half.y), as<T>(half.z)};
  }
  std::string describe() const {
    return detail::text("box of half extents (", half.x, ", ", half.y, ", ", half.z, ") m");
  }
  void check() const {
    for (const S& h : {half.x, half.y, half.z}) detail::check_length("box half extent", h);
  }
  /// @}
};

/// A cylinder along the body's z axis with half balls at its ends.
template <class S>
struct Capsule {
  S radius;       ///< m
  S half_length;  ///< of the cylinder, m; from its centre to the centre of either half ball

  /// A capsule of this radius and this half length of its cylinder, m.
  Capsule(const S& radius_, const S& half_length_) : radius(radius_), half_length(half_length_) {}
  /// What every shape gives: the radius of the ball around it (m), the largest speed at which a unit spin
  /// moves the surface along its normal (m), volume (m^3), principal moments over mass of a uniform solid
  /// (m^2), `factor` times the area turned towards the body-frame velocity v times |v| (m^3/s), the shape
  /// with all lengths multiplied, or in another scalar, words for messages, and check(), which throws Error
  /// for sizes that no shape has.
  /// @{
  S bounding_radius() const { return radius + half_length; }
  S lever() const { return half_length; }
  S volume() const {
    return as<S>(std::numbers::pi) * radius * radius * (S(2) * half_length + as<S>(4.0 / 3.0) * radius);
  }
  Vec3<S> unit_inertia() const {
    const S r2 = square(radius), length = S(2) * half_length;
    const S cylinder = length / (length + as<S>(4.0 / 3.0) * radius),
            balls = S(1) - cylinder;  // shares of the mass
    const S across = cylinder * (r2 / S(4) + square(length) / S(12)) +
                     balls * (as<S>(0.4) * r2 + square(half_length) + S(0.75) * half_length * radius);
    return {across, across, cylinder * r2 / S(2) + balls * as<S>(0.4) * r2};
  }
  S frontal(const Vec3<S>& v, const S& factor) const {
    return (factor * as<S>(std::numbers::pi) * radius * radius) * norm(v) +
           (factor * S(4) * radius * half_length) * norm(Vec3<S>{v.x, v.y, S(0)});
  }
  Capsule scaled(const S& factor) const { return {factor * radius, factor * half_length}; }
  template <class T>
  Capsule<T> cast() const {
    return {as<T>(radius), as<T>(half_length)};
  }
  std::string describe() const {
    return detail::text("capsule of radius ", radius, " m and half length ", half_length, " m");
  }
  void check() const {
    detail::check_length("capsule radius", radius);
    if (!(half_length >= S(0)) || !is_finite(half_length)) {
      detail::refuse("capsule half length", "a length of 0 or more", half_length);
    }
    detail::check_within("capsule half length", half_length, 0, BodyLimits<S>::length, " m");
  }
  /// @}
};

/// Any of the shapes, chosen at run time.
template <class S>
using AnyShape = std::variant<Sphere<S>, Box<S>, Capsule<S>>;

namespace detail {

/// Calls f with the shape, whether its type is known when compiling or not.
template <class Shape, class F>
decltype(auto) with_shape(const Shape& shape, F&& f) {
  return f(shape);
}
template <class... Shapes, class F>
decltype(auto) with_shape(const std::variant<Shapes...>& shape, F&& f) {
  return std::visit(f, shape);
}

/// Puts a shape into lane l of another of the same kind.
template <class S, class T>
void set_shape_lane(Sphere<S>& to, int l, const Sphere<T>& from) {
  ScalarTraits<S>::set_lane(to.radius, l, from.radius);
}
template <class S, class T>
void set_shape_lane(Box<S>& to, int l, const Box<T>& from) {
  ScalarTraits<S>::set_lane(to.half.x, l, from.half.x);
  ScalarTraits<S>::set_lane(to.half.y, l, from.half.y);
  ScalarTraits<S>::set_lane(to.half.z, l, from.half.z);
}
template <class S, class T>
void set_shape_lane(Capsule<S>& to, int l, const Capsule<T>& from) {
  ScalarTraits<S>::set_lane(to.radius, l, from.radius);
  ScalarTraits<S>::set_lane(to.half_length, l, from.half_length);
}
template <class... Packed, class... Shapes>
void set_shape_lane(std::variant<Packed...>& to, int l, const std::variant<Shapes...>& from) {
  ((std::holds_alternative<Packed>(to)
        ? set_shape_lane(*std::get_if<Packed>(&to), l, *std::get_if<Shapes>(&from))
        : void()),
   ...);
}

/// What contacts meet: the parts of a shape that has some, as a Compound has, or else the shape itself.
template <class Shape_>
struct PartsOf {
  using Shape = Shape_;  ///< of a part
  static constexpr bool compound = false;
  static constexpr int most = 1;  ///< how many there may be
};
template <class Shape_>
requires requires { typename Shape_::PartShape; }
struct PartsOf<Shape_> {
  using Shape = typename Shape_::PartShape;
  static constexpr bool compound = true;
  static constexpr int most = Shape_::most_parts;
};

template <class Shape, class T>
struct CastShape;
template <template <class> class Shape, class S, class T>
struct CastShape<Shape<S>, T> {
  using type = Shape<T>;
};
template <class... Shapes, class T>
struct CastShape<std::variant<Shapes...>, T> {
  using type = std::variant<typename CastShape<Shapes, T>::type...>;
};

}  // namespace detail
}  // namespace rbres::RBRES_ABI

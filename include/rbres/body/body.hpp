#pragma once

#include <rbres/body/inertia.hpp>
#include <rbres/body/shape.hpp>

namespace rbres::RBRES_ABI {

/// How a surface answers a contact. Two surfaces combine to the larger restitution and the geometric mean of
/// friction.
template <class S>
struct Material {
  S restitution = as<S>(0.5);  ///< speed after over speed before along the normal, in [0, 1]
  S friction = as<S>(0.3);     ///< Coulomb coefficient, 0 or more
};

/// The larger restitution of two surfaces.
template <class S>
S combined_restitution(const Material<S>& a, const Material<S>& b) {
  return maximum(a.restitution, b.restitution);
}
/// The geometric mean of the friction of two surfaces.
template <class S>
S combined_friction(const Material<S>& a, const Material<S>& b) {
  using std::sqrt;
  return sqrt(S(a.friction * b.friction));
}

namespace detail {
template <class S>
void check_material(const Material<S>& m) {
  if (!(m.restitution >= S(0) && m.restitution <= S(1))) {
    refuse("restitution", "a number in [0, 1]", m.restitution);
  }
  if (!(m.friction >= S(0)) || !is_finite(m.friction)) {
    refuse("friction", "a number of 0 or more", m.friction);
  }
  check_within("friction", m.friction, 0, BodyLimits<S>::friction, "");
}

/// The inertia of a uniform solid of this mass from what its shape gives.
/// @{
template <class S>
PrincipalInertia<S> uniform_inertia(const S& mass, const Vec3<S>& unit) {
  return {mass * unit, {}};
}
template <class S>
PrincipalInertia<S> uniform_inertia(const S& mass, const PrincipalInertia<S>& unit) {
  return {mass * unit.moments, unit.axes};
}
/// @}
}  // namespace detail

/// One rigid body: what it is, not where. The body frame is at the centre of mass along the principal axes of
/// inertia. Every constructor throws Error for a mass, shape, inertia or material that no body can have.
///
/// A body is dynamic, moved by forces and contacts, or kinematic: see kinematic().
template <class S, class Shape_ = AnyShape<S>>
class Body {
 public:
  /// Its numbers.
  using Scalar = S;
  /// Of its surface: one shape, or AnyShape.
  using Shape = Shape_;

  /// A uniform solid of this mass (kg).
  Body(const Shape& shape, const S& mass, const Material<S>& material = {})
      : Body(shape, mass,
             detail::with_shape(
                 shape, [&](const auto& s) { return detail::uniform_inertia(mass, s.unit_inertia()); }),
             material) {}

  /// A body of this mass (kg) and these principal moments (kg m^2), along the shape's axes.
  Body(const Shape& shape, const S& mass, const Vec3<S>& moments, const Material<S>& material = {})
      : Body(shape, mass, PrincipalInertia<S>{moments, {}}, material) {}

  /// A body of this mass (kg) and this inertia tensor (kg m^2), a 3 by 3 matrix given along the shape's axes.
  /// Its orientation is that of the principal axes; shape_rotation() says how the shape stands in them.
  template <class Tensor>
  Body(const Shape& shape, const S& mass, const Eigen::MatrixBase<Tensor>& tensor,
       const Material<S>& material = {}) requires(!Packed<S> && Tensor::RowsAtCompileTime == 3 &&
                                                  Tensor::ColsAtCompileTime == 3)
      : Body(shape, mass, naming([&] { return principal_inertia<S>(tensor); }, shape, mass, " kg"),
             material) {}

  /// A uniform solid of this density (kg/m^3).
  static Body of_density(const Shape& shape, const S& density, const Material<S>& material = {}) {
    return Body(shape, density * detail::with_shape(shape, [](const auto& s) { return s.volume(); }),
                material);
  }

  /// A kinematic body: neither forces nor contacts move it, and it keeps the velocity and the angular
  /// velocity of its state. Where these are zero it is static: a table, a ramp; else a lift, a turntable, a
  /// paddle; a program with its own Stepper may set them anew before each step. Its frame is its shape's.
  /// Kinematic bodies and planes do not collide with one another. Its mass, moments of inertia and their
  /// inverses are zero here, so that energy, momentum and the like are those of the dynamic bodies.
  static Body kinematic(const Shape& shape, const Material<S>& material = {}) {
    return {Kinematic{}, shape, material};
  }

  /// A body of one shape where any shape may stand.
  template <class Other>
  requires(!std::is_same_v<Other, Shape_> && std::is_constructible_v<Shape_, const Other&>)
      Body(const Body<S, Other>& other)
      : shape_(other.shape()),
        shape_rotation_(other.shape_rotation()),
        mass_(other.mass()),
        inertia_(other.inertia()),
        inverse_mass_(other.inverse_mass()),
        inverse_inertia_(other.inverse_inertia()),
        material_(other.material()),
        bounding_radius_(other.bounding_radius()),
        kinematic_(other.is_kinematic()) {}

  /// The shape, in its own axes.
  const Shape& shape() const { return shape_; }
  /// Shape's axes to body frame.
  const Quat<S>& shape_rotation() const { return shape_rotation_; }
  /// Where the origin of the frame stands in which the shape's points were given, body frame, m: zero, but
  /// for a ConvexHull and a Compound. A point p of that frame is shape_origin() + rotate(shape_rotation(), p)
  /// in the body frame.
  Vec3<S> shape_origin() const {
    return detail::with_shape(shape_, [&](const auto& s) {
      if constexpr (requires { s.centre_of_mass(); }) {
        return rotate(shape_rotation_, -s.centre_of_mass());
      } else {
        return Vec3<S>{};
      }
    });
  }
  /// Whether it was made by kinematic().
  bool is_kinematic() const { return kinematic_; }
  const S& mass() const { return mass_; }                              ///< kg
  const Vec3<S>& inertia() const { return inertia_; }                  ///< principal moments, kg m^2
  const S& inverse_mass() const { return inverse_mass_; }              ///< 1/kg
  const Vec3<S>& inverse_inertia() const { return inverse_inertia_; }  ///< 1/(kg m^2)
  /// How its surface answers a contact.
  const Material<S>& material() const { return material_; }
  const S& bounding_radius() const { return bounding_radius_; }  ///< m

  /// This body with its lengths, mass and moments of inertia multiplied, each by a factor of its own, and
  /// another material.
  Body scaled(const S& length, const S& mass, const S& inertia, const Material<S>& material) const {
    const Shape shape = detail::with_shape(shape_, [&](const auto& s) { return Shape(s.scaled(length)); });
    if (kinematic_) return kinematic(shape, material);
    return Body(shape, mass * mass_, PrincipalInertia<S>{inertia * inertia_, shape_rotation_.conjugate()},
                material);
  }

  /// The same body in another scalar; packs get it in every lane.
  template <class T>
  auto cast() const {
    using Other = typename detail::CastShape<Shape, T>::type;
    const Other shape = detail::with_shape(shape_, [](const auto& s) { return Other(s.template cast<T>()); });
    const Material<T> material{as<T>(material_.restitution), as<T>(material_.friction)};
    if (kinematic_) return Body<T, Other>::kinematic(shape, material);
    const Quat<S> axes = shape_rotation_.conjugate();
    return Body<T, Other>(shape, as<T>(mass_),
                          PrincipalInertia<T>{{as<T>(inertia_.x), as<T>(inertia_.y), as<T>(inertia_.z)},
                                              {as<T>(axes.x), as<T>(axes.y), as<T>(axes.z), as<T>(axes.w)}},
                          material);
  }

  /// Puts a body into lane l of this one. Both have the same kind of shape.
  template <class T, class Other>
  void set_lane(int l, const Body<T, Other>& body) noexcept {
    const auto set = [l](auto... numbers) {
      (ScalarTraits<S>::set_lane(*numbers.first, l, *numbers.second), ...);
    };
    detail::set_shape_lane(shape_, l, body.shape_);
    const auto vector = [&](Vec3<S>& to, const Vec3<T>& from) {
      set(std::pair(&to.x, &from.x), std::pair(&to.y, &from.y), std::pair(&to.z, &from.z));
    };
    vector(inertia_, body.inertia_);
    vector(inverse_inertia_, body.inverse_inertia_);
    const Quat<T>& q = body.shape_rotation_;
    set(std::pair(&shape_rotation_.x, &q.x), std::pair(&shape_rotation_.y, &q.y),
        std::pair(&shape_rotation_.z, &q.z), std::pair(&shape_rotation_.w, &q.w),
        std::pair(&mass_, &body.mass_), std::pair(&inverse_mass_, &body.inverse_mass_),
        std::pair(&material_.restitution, &body.material_.restitution),
        std::pair(&material_.friction, &body.material_.friction),
        std::pair(&bounding_radius_, &body.bounding_radius_));
  }

 private:
  template <class, class>
  friend class Body;

  /// What f() refuses names this body by what it is: an index it has only in a System.
  template <class F, class... What>
  static auto naming(const F& f, const Shape& shape, const What&... what) {
    const auto name = [&] {
      const auto of = detail::with_shape(shape, [](const auto& s) { return s.describe(); });
      return detail::text("body (", of, ", ", what..., "), ");
    };
    return detail::naming(name, f);
  }

  Body(const Shape& shape, const S& mass, const PrincipalInertia<S>& inertia, const Material<S>& material)
      : shape_(shape),
        shape_rotation_(inertia.axes.conjugate()),
        mass_(mass),
        inertia_(inertia.moments),
        inverse_mass_(S(1) / mass),
        inverse_inertia_(S(1) / inertia.moments.x, S(1) / inertia.moments.y, S(1) / inertia.moments.z),
        material_(material),
        bounding_radius_(detail::with_shape(shape, [](const auto& s) { return s.bounding_radius(); })) {
    if constexpr (std::is_floating_point_v<S>) {  // packs and dual numbers are cast from bodies that were
                                                  // checked
      const auto check = [&] {
        if (!(mass > S(0)) || !is_finite(mass)) detail::refuse("mass", "a positive number of kg", mass);
        detail::check_within("mass", mass, 1 / BodyLimits<S>::mass, BodyLimits<S>::mass, " kg");
        detail::with_shape(shape, [](const auto& s) { s.check(); });
        check_moments(inertia.moments);
        detail::check_material(material);
      };
      naming(check, shape, mass, " kg");
    }
  }

  struct Kinematic {};
  Body(Kinematic, const Shape& shape, const Material<S>& material)
      : shape_(shape),
        mass_(0),
        inverse_mass_(0),
        material_(material),
        bounding_radius_(detail::with_shape(shape, [](const auto& s) { return s.bounding_radius(); })),
        kinematic_(true) {
    if constexpr (std::is_floating_point_v<S>) {
      const auto check = [&] {
        detail::with_shape(shape, [](const auto& s) { s.check(); });
        detail::check_material(material);
      };
      naming(check, shape, "kinematic");
    }
  }

  Shape shape_;
  Quat<S> shape_rotation_;
  S mass_;
  Vec3<S> inertia_;
  S inverse_mass_;
  Vec3<S> inverse_inertia_;
  Material<S> material_;
  S bounding_radius_;
  bool kinematic_ = false;
};

/// A body of one shape, whose scalar is that of the shape.
/// @{
template <template <class> class Shape, class S>
Body(const Shape<S>&, S, Material<S>) -> Body<S, Shape<S>>;
template <template <class> class Shape, class S>
Body(const Shape<S>&, S) -> Body<S, Shape<S>>;
template <template <class> class Shape, class S>
Body(const Shape<S>&, S, Vec3<S>) -> Body<S, Shape<S>>;
template <template <class> class Shape, class S>
Body(const Shape<S>&, S, Vec3<S>, Material<S>) -> Body<S, Shape<S>>;
/// @}

}  // namespace rbres::RBRES_ABI

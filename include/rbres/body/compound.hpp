#pragma once

#include <initializer_list>
#include <memory>
#include <rbres/body/body.hpp>
#include <rbres/body/check_state.hpp>
#include <rbres/body/convex_hull.hpp>
#include <span>
#include <vector>

namespace rbres::RBRES_ABI {

/// A part of a Compound: a convex shape, and where it stands in the frame of the whole.
template <class S, class Shape = AnyShape<S>>
struct CompoundPart {
  Shape shape;            ///< convex
  Vec3<S> position{};     ///< of the shape's centre; of a ConvexHull, of the frame of its points; m
  Quat<S> orientation{};  ///< unit quaternion, the shape's axes to the frame of the whole
  S density = S(1);       ///< kg/m^3, or over that of the other parts
};

/// Where a part of a Compound stands from the centre of mass of the whole, along its axes.
template <class S>
struct PlacedPart {
  Vec3<S> centre;  ///< of mass, m
  Mat3<S> axes;    ///< the shape's, as columns
};

namespace detail {

/// Where a uniform solid's centre of mass stands in its shape's own frame, m.
template <class S, class Shape>
Vec3<S> centre_in_shape(const Shape& shape) {
  return with_shape(shape, [](const auto& s) {
    if constexpr (requires { s.centre_of_mass(); }) {
      return s.centre_of_mass();
    } else {
      return Vec3<S>{};
    }
  });
}

/// How far the farthest point of a placed shape is from the origin, m; of shapes of the user's own a bound.
template <class S, class Shape>
S farthest_point(const Shape& shape, const PlacedPart<S>& at) {
  return with_shape(shape, [&](const auto& s) {
    using Own = std::decay_t<decltype(s)>;
    if constexpr (std::is_same_v<Own, Box<S>>) {
      return S(norm(absolute(at.axes.transposed_times(at.centre)) + s.half));
    } else if constexpr (std::is_same_v<Own, Capsule<S>>) {
      const Vec3<S> end = s.half_length * at.axes.z;
      return S(maximum(norm(at.centre + end), norm(at.centre - end)) + s.radius);
    } else if constexpr (std::is_same_v<Own, ConvexHull<S>>) {
      S most(0);
      for (const Vec3<S>& v : s.vertices()) most = maximum(most, norm(at.centre + at.axes * v));
      return most;
    } else {
      return S(norm(at.centre) + s.bounding_radius());
    }
  });
}

/// What a Compound holds.
template <class S, class Shape>
struct CompoundData {
  std::vector<CompoundPart<S, Shape>> parts;
  std::vector<PlacedPart<S>> placed;
  Vec3<S> centre_of_mass;
  PrincipalInertia<S> unit_inertia;
  S volume, mass, bounding_radius, lever;

  /// The same with lengths multiplied, in another scalar.
  template <class T>
  auto scaled(const T& factor) const {
    const auto vector = [](const Vec3<S>& v) { return Vec3<T>{as<T>(v.x), as<T>(v.y), as<T>(v.z)}; };
    const auto quaternion = [](const Quat<S>& q) {
      return Quat<T>{as<T>(q.x), as<T>(q.y), as<T>(q.z), as<T>(q.w)};
    };
    using Other = typename CastShape<Shape, T>::type;
    CompoundData<T, Other> to;
    for (const auto& part : parts) {
      const Other shape =
          with_shape(part.shape, [&](const auto& s) { return Other(s.template cast<T>().scaled(factor)); });
      to.parts.push_back(
          {shape, factor * vector(part.position), quaternion(part.orientation), as<T>(part.density)});
    }
    for (const auto& at : placed) {
      to.placed.push_back(
          {factor * vector(at.centre), {vector(at.axes.x), vector(at.axes.y), vector(at.axes.z)}});
    }
    const T cube = factor * square(factor);
    to.centre_of_mass = factor * vector(centre_of_mass);
    to.unit_inertia = {square(factor) * vector(unit_inertia.moments), quaternion(unit_inertia.axes)};
    to.volume = cube * as<T>(volume);
    to.mass = cube * as<T>(mass);
    to.bounding_radius = factor * as<T>(bounding_radius);
    to.lever = factor * as<T>(lever);
    return to;
  }
};

/// Mass, centre of mass and inertia of the parts together, which are where they are placed then.
template <class S, class Shape>
CompoundData<S, Shape> compound_data(std::vector<CompoundPart<S, Shape>> parts) {
  CompoundData<double, typename CastShape<Shape, double>::type> exact;
  exact.volume = exact.mass = 0;
  const auto plain = [](const auto& v) {
    return Vec3<double>{static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
  };
  const auto turn = [](const auto& q) {
    return Quat<double>{static_cast<double>(q.x), static_cast<double>(q.y), static_cast<double>(q.z),
                        static_cast<double>(q.w)};
  };
  // Shares of the mass first: of a single part all are exact.
  std::vector<double> share;
  for (const auto& part : parts) {
    const double volume =
        with_shape(part.shape, [](const auto& s) { return s.template cast<double>().volume(); });
    share.push_back(static_cast<double>(part.density) * volume);
    exact.volume += volume;
    exact.mass += share.back();
  }
  std::vector<Vec3<double>> centre;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& part = parts[i];
    share[i] /= exact.mass;
    centre.push_back(plain(part.position) +
                     rotate(turn(part.orientation), plain(centre_in_shape<S>(part.shape))));
    exact.centre_of_mass += share[i] * centre[i];
  }
  Eigen::Matrix3d tensor = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const PrincipalInertia<double> own = with_shape(parts[i].shape, [&](const auto& s) {
      return uniform_inertia(share[i], s.template cast<double>().unit_inertia());
    });
    const Mat3<double> about =
        rotated_diagonal(rotation_matrix(turn(parts[i].orientation) * own.axes), own.moments);
    const Eigen::Vector3d r = centre[i] - exact.centre_of_mass;
    Eigen::Matrix3d columns;
    columns << Eigen::Vector3d(about.x), Eigen::Vector3d(about.y), Eigen::Vector3d(about.z);
    tensor += columns + share[i] * (r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose());
  }
  exact.unit_inertia = principal_inertia_to(tensor, Constants<double>::epsilon);
  exact.bounding_radius = exact.lever = 0;
  CompoundData<S, Shape> data = exact.template scaled<S>(S(1));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Vec3<double> at = centre[i] - exact.centre_of_mass;
    data.placed.push_back({{as<S>(at.x), as<S>(at.y), as<S>(at.z)}, rotation_matrix(parts[i].orientation)});
    const S far = farthest_point(parts[i].shape, data.placed[i]);
    const S lever = with_shape(parts[i].shape, [](const auto& s) { return s.lever(); });
    data.bounding_radius = maximum(data.bounding_radius, far);
    data.lever = maximum(data.lever, minimum(far, S(norm(data.placed[i].centre) + lever)));
  }
  data.parts = std::move(parts);
  return data;
}

}  // namespace detail

/// A rigid body of up to M convex parts, which need not be convex itself: a table, a hammer, a ring of boxes.
/// Each part has a place of its own in one frame of the user's choice, and meets other bodies by itself;
/// parts of one body do not meet. Mass, centre of mass and inertia are those of all parts, each uniform:
/// where parts overlap, each counts in full. Body::shape_origin() and Body::shape_rotation() say where the
/// user's frame stands in that of the body. Copies share their parts. There are no lanes of compounds.
///
/// `Shape` is what a part may be: AnyShape, AnyConvexShape, or one shape alone.
template <class S, int M, class Shape = AnyShape<S>>
class Compound {
  static_assert(!Packed<S>, "a Compound is not for lanes: simulate it with a plain scalar");
  static_assert(M >= 1, "a Compound has a part or more");

 public:
  /// Of a part.
  using PartShape = Shape;
  /// A part and its place.
  using Part = CompoundPart<S, Shape>;
  /// For how many there is room.
  static constexpr int most_parts = M;

  /// These parts. Throws Error where there are none, more than M, or one has a size that no shape has, a
  /// position that is not finite, an orientation that is no unit quaternion, or no positive density.
  /// @{
  Compound(std::initializer_list<Part> parts) requires std::is_floating_point_v<S>
      : Compound(std::vector<Part>(parts)) {}
  explicit Compound(const std::vector<Part>& parts) requires std::is_floating_point_v<S>
      : Compound(detail::compound_data(checked(parts))) {
    check();
  }
  /// @}
  /// One shape where compounds stand, at the origin.
  Compound(const Shape& shape) requires std::is_floating_point_v<S> : Compound({Part{shape}}) {}
  /// A compound of fewer parts where there is room for more.
  template <int Fewer>
  requires(Fewer < M) Compound(const Compound<S, Fewer, Shape>& other) : data_(other.data_) {}

  /// The parts as they were given.
  std::span<const Part> parts() const& { return data_->parts; }
  /// The same parts from the centre of mass, along the axes of the frame in which they were given.
  std::span<const PlacedPart<S>> placed() const& { return data_->placed; }
  /// What a compound holds ends with the last copy of it.
  /// @{
  void parts() const&& = delete;
  void placed() const&& = delete;
  /// @}
  /// How many parts there are.
  int size() const { return static_cast<int>(data_->parts.size()); }
  /// Where the centre of mass stands in the frame in which the parts were given, m.
  const Vec3<S>& centre_of_mass() const { return data_->centre_of_mass; }
  /// The sum of each part's density times its volume: kg, where the densities are in kg/m^3.
  const S& mass() const { return data_->mass; }

  /// What every shape gives: the radius of the ball around it (m), the largest speed at which a unit spin
  /// moves the surface along its normal (m), volume (m^3; the sum of the parts'), the principal inertia over
  /// the mass (m^2), `factor` times the area turned towards the body-frame velocity v times |v| (m^3/s; the
  /// sum of the parts', an upper bound, since none stands in the lee of another), the shape with all lengths
  /// multiplied, or in another scalar, words for messages, and check(), which throws Error for sizes that no
  /// shape has.
  /// @{
  S bounding_radius() const { return data_->bounding_radius; }
  S lever() const { return data_->lever; }
  S volume() const { return data_->volume; }
  PrincipalInertia<S> unit_inertia() const { return data_->unit_inertia; }
  S frontal(const Vec3<S>& v, const S& factor) const {
    S sum(0);
    for (std::size_t i = 0; i < data_->parts.size(); ++i) {
      const Vec3<S> along = data_->placed[i].axes.transposed_times(v);
      sum +=
          detail::with_shape(data_->parts[i].shape, [&](const auto& s) { return s.frontal(along, factor); });
    }
    return sum;
  }
  Compound scaled(const S& factor) const { return Compound(data_->scaled(factor)); }
  template <class T>
  auto cast() const {
    return Compound<T, M, typename detail::CastShape<Shape, T>::type>(data_->scaled(T(1)));
  }
  std::string describe() const {
    return detail::text("compound of ", size(), size() == 1 ? " part" : " parts", " and bounding radius ",
                        bounding_radius(), " m");
  }
  void check() const {
    for (int i = 0; i < size(); ++i) check_part(data_->parts[static_cast<std::size_t>(i)], i);
    detail::check_length("compound bounding radius", bounding_radius());
  }
  /// @}

 private:
  template <class, int, class>
  friend class Compound;

  explicit Compound(detail::CompoundData<S, Shape> data)
      : data_(std::make_shared<const detail::CompoundData<S, Shape>>(std::move(data))) {}

  /// The parts, with orientations of length 1.
  static std::vector<Part> checked(std::vector<Part> parts) {
    if (parts.empty()) detail::refuse("compound", "a part or more", "none");
    if (parts.size() > std::size_t(M))
      detail::refuse("compound", detail::Line("at most ", M, M == 1 ? " part" : " parts"), parts.size());
    for (std::size_t i = 0; i < parts.size(); ++i) {
      check_part(parts[i], static_cast<int>(i));
      detail::make_unit(parts[i].orientation);
    }
    return parts;
  }
  static void check_part(const Part& part, int number) {
    const auto check = [&] {
      detail::with_shape(part.shape, [](const auto& s) { s.check(); });
      RigidState<S> at;
      at.position = part.position;
      at.orientation = part.orientation;
      detail::check_rigid_state(at);
      constexpr double most = BodyLimits<S>::length;
      for (const S& x : {part.position.x, part.position.y, part.position.z})
        detail::check_within("position", x, -most, most, " m");
      if (!(part.density > S(0)) || !is_finite(part.density))
        detail::refuse("density", "a positive number", part.density);
    };
    detail::naming([&] { return detail::text("part ", number, ", "); }, check);
  }

  std::shared_ptr<const detail::CompoundData<S, Shape>> data_;
};

/// A body of a compound, whose scalar is that of the shape.
/// @{
template <class S, int M, class Shape>
Body(const Compound<S, M, Shape>&, S, Material<S>) -> Body<S, Compound<S, M, Shape>>;
template <class S, int M, class Shape>
Body(const Compound<S, M, Shape>&, S) -> Body<S, Compound<S, M, Shape>>;
/// @}

namespace detail {

template <class S, int M, class Shape, class T>
struct CastShape<Compound<S, M, Shape>, T> {
  using type = Compound<T, M, typename CastShape<Shape, T>::type>;
};

}  // namespace detail
}  // namespace rbres::RBRES_ABI

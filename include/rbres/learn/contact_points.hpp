#pragma once

#include <rbres/contact/detect.hpp>
#include <rbres/learn/contact_flight.hpp>

#include <algorithm>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// A place where two surfaces meet or nearly meet, halfway through a frame of free flight.
struct ContactPlace {
  Vec3<double> normal;  ///< unit, from the first to the second body, world frame
  Vec3<double> point;   ///< world frame, m
  double gap;           ///< m
};

/// The pose of a shape in any scalar. Balls look the same from every side.
template <class S, template <class> class Shape>
Pose<S> pose_of(const Shape<S>&, const Vec3<S>& position, const Quat<S>& orientation,
                const Quat<double>& shape_rotation) {
  if constexpr (std::is_same_v<Shape<S>, Sphere<S>>) {
    return {position, {}};
  } else {
    const Quat<double>& r = shape_rotation;
    return {position, rotation_matrix(orientation * Quat<S>{S(r.x), S(r.y), S(r.z), S(r.w)})};
  }
}

/// Calls f(manifold) with how two bodies meet halfway.
template <class Shape, class F>
void with_places(const Body<double, Shape>& first, const ContactFlight& at_first,
                 const Body<double, Shape>& second, const ContactFlight& at_second, const F& f) {
  with_shape(first.shape(), [&](const auto& a) {
    with_shape(second.shape(), [&](const auto& b) {
      f(detect(a, pose_of(a, at_first.middle, at_first.turned, first.shape_rotation()), b,
               pose_of(b, at_second.middle, at_second.turned, second.shape_rotation())));
    });
  });
}
/// The same for a plane and a body.
template <class Shape, class F>
void with_places(const Plane<double>& plane, const Body<double, Shape>& body, const ContactFlight& at,
                 const F& f) {
  with_shape(body.shape(), [&](const auto& b) {
    f(detect(plane, b, pose_of(b, at.middle, at.turned, body.shape_rotation())));
  });
}

/// Numbers of a pose that a shape's contacts depend on: balls have no orientation.
template <class Shape>
inline constexpr int pose_size = 7;
template <class S>
inline constexpr int pose_size<Sphere<S>> = 3;

/// A body's pose as inputs `first`, ... of N, for derivatives.
template <int N, class Shape>
auto dual_pose(const Shape& shape, const ContactFlight& at, const Quat<double>& shape_rotation, int first) {
  const auto dual = shape.template cast<Dual<N>>();
  Quat<Dual<N>> turned;
  if constexpr (pose_size<Shape> == 7) turned = dual_quaternion<N>(at.turned, first + 3);
  return std::pair(dual, pose_of(dual, dual_vector<N>(at.middle, first), turned, shape_rotation));
}
/// Adds the derivatives by a pose that stand at `first` of `by`.
template <class Shape, class Vector>
void add_pose_gradient(const Vector& by, int first, ContactFlight& by_flight) {
  by_flight.middle += Vec3<double>{by[first], by[first + 1], by[first + 2]};
  if constexpr (pose_size<Shape> == 7)
    by_flight.turned =
        by_flight.turned + Quat<double>{by[first + 3], by[first + 4], by[first + 5], by[first + 6]};
}

/// The derivative by all inputs of a manifold of duals, from those by its places: by_place(i) is nullptr
/// where a place was left out.
template <int N, int P, bool C, class ByPlace>
Eigen::Matrix<double, N, 1> pull_back_places(const Manifold<Dual<N>, P, C>& m, const ByPlace& by_place) {
  Eigen::Matrix<double, N, 1> by = Eigen::Matrix<double, N, 1>::Zero();
  for (int i = 0; i < P; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (const ContactPlace* place = by_place(i)) {
      by += pull_back<N>(place->normal, m.normal) + pull_back<N>(place->point, m.point[k]);
      by += place->gap * m.gap[k].derivatives();
    }
  }
  return by;
}

/// The way back through with_places: adds to the derivatives by the flights, given those by the places.
template <class Shape, class ByPlace>
void add_place_gradient(const Body<double, Shape>& first, const ContactFlight& at_first,
                        const Body<double, Shape>& second, const ContactFlight& at_second,
                        const ByPlace& by_place, ContactFlight& by_first, ContactFlight& by_second) {
  with_shape(first.shape(), [&](const auto& a) {
    with_shape(second.shape(), [&](const auto& b) {
      using A = std::remove_cvref_t<decltype(a)>;
      using B = std::remove_cvref_t<decltype(b)>;
      constexpr int size = pose_size<A>, all = size + pose_size<B>;
      const auto [da, pa] = dual_pose<all>(a, at_first, first.shape_rotation(), 0);
      const auto [db, pb] = dual_pose<all>(b, at_second, second.shape_rotation(), size);
      const auto by = pull_back_places<all>(detect(da, pa, db, pb), by_place);
      add_pose_gradient<A>(by, 0, by_first);
      add_pose_gradient<B>(by, size, by_second);
    });
  });
}
template <class Shape, class ByPlace>
void add_place_gradient(const Plane<double>& plane, const Body<double, Shape>& body, const ContactFlight& at,
                        const ByPlace& by_place, ContactFlight& by_flight) {
  with_shape(body.shape(), [&](const auto& b) {
    using B = std::remove_cvref_t<decltype(b)>;
    constexpr int all = pose_size<B>;
    const auto [db, pb] = dual_pose<all>(b, at, body.shape_rotation(), 0);
    const auto by = pull_back_places<all>(detect(plane.template cast<Dual<all>>(), db, pb), by_place);
    add_pose_gradient<B>(by, 0, by_flight);
  });
}

}  // namespace rbres::RBRES_ABI::detail

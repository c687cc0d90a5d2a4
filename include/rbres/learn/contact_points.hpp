#pragma once

#include <rbres/contact/detect.hpp>
#include <rbres/learn/contact_moment.hpp>

#include <algorithm>
#include <cmath>
#include <optional>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// A place where two surfaces meet or nearly meet, at the moment of a frame's free flight at which the law
/// looks at it.
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

/// The pose of a body's shape at some moment of its flight.
template <class Shape>
Pose<double> pose_at(const Shape& shape, const ContactFlight& f, const Moment& m, double frame_time,
                     const Quat<double>& shape_rotation) {
  if (m.share == 0.5 && m.bend == 0) return pose_of(shape, f.middle, f.turned, shape_rotation);
  return pose_of(shape, position_at(f, m, frame_time), orientation_at(f, m, frame_time), shape_rotation);
}

/// How fast surfaces come closer that meet as `m` says: by the deepest of its points, or where it has none by
/// the bodies' centres. `first` is nullptr for a plane. m/s
template <class Manifold>
double opening_speed(const Manifold& m, const ContactFlight* first, const ContactFlight& second,
                     const Moment& moment, double frame_time) {
  double deepest = Manifold::none / 2;
  Vec3<double> point;
  each_point(m, [&](int, const Vec3<double>& p, double gap) {
    if (gap < deepest) deepest = gap, point = p;
  });
  const bool some = deepest < Manifold::none / 2;
  const auto velocity = [&](const ContactFlight& f) {
    const Vec3<double> v = velocity_at(f, moment);
    return some ? v + cross(f.spin, point - position_at(f, moment, frame_time)) : v;
  };
  return dot(m.normal, first ? velocity(second) - velocity(*first) : velocity(second));
}

/// When the law looks at a pair whose manifold is manifold(Moment), from share `from` of the frame on; none
/// where it has no impact.
template <class F>
std::optional<Moment> contact_moment(const ContactScales& scales, double from, const F& manifold,
                                     const ContactFlight* first, const ContactFlight& second) {
  if (scales.moment == ContactMoment::halfway) return Moment{};
  const double time = scales.frame_time;
  return find_impact(from, [&](const Moment& m) {
    const auto found = manifold(m);
    return Separation{found.separation, time * opening_speed(found, first, second, m, time)};
  });
}

/// Calls f(manifold, moment) with how two bodies meet, and when, from share `from` of the frame on.
template <class Shape, class F>
void with_places(const Body<double, Shape>& first, const ContactFlight& of_first,
                 const Body<double, Shape>& second, const ContactFlight& of_second,
                 const ContactScales& scales, double from, const F& f) {
  with_shape(first.shape(), [&](const auto& a) {
    with_shape(second.shape(), [&](const auto& b) {
      const double time = scales.frame_time;
      // In one place for all that look at it: detection is large.
      const auto manifold = [&](const Moment& m) __attribute__((noinline)) {
        return detect(a, pose_at(a, of_first, m, time, first.shape_rotation()), b,
                      pose_at(b, of_second, m, time, second.shape_rotation()));
      };
      if (const auto moment = contact_moment(scales, from, manifold, &of_first, of_second))
        f(manifold(*moment), *moment);
    });
  });
}
/// The same for a plane and a body.
template <class Shape, class F>
void with_places(const Plane<double>& plane, const Body<double, Shape>& body, const ContactFlight& flight,
                 const ContactScales& scales, double from, const F& f) {
  with_shape(body.shape(), [&](const auto& b) {
    const auto manifold = [&](const Moment& m) __attribute__((noinline)) {
      return detect(plane, b, pose_at(b, flight, m, scales.frame_time, body.shape_rotation()));
    };
    if (const auto moment = contact_moment(scales, from, manifold, nullptr, flight))
      f(manifold(*moment), *moment);
  });
}

/// Numbers of a pose that a shape's contacts depend on: balls have no orientation.
template <class Shape>
inline constexpr int pose_size = 7;
template <class S>
inline constexpr int pose_size<Sphere<S>> = 3;

/// A body's pose at a moment as inputs `first`, ... of N, for derivatives.
template <int N, class Shape>
auto dual_pose(const Shape& shape, const ContactFlight& f, const Moment& m, double frame_time,
               const Quat<double>& shape_rotation, int first) {
  const auto dual = shape.template cast<Dual<N>>();
  Quat<Dual<N>> turned;
  if constexpr (pose_size<Shape> == 7)
    turned = dual_quaternion<N>(orientation_at(f, m, frame_time), first + 3);
  const auto position = dual_vector<N>(position_at(f, m, frame_time), first);
  return std::pair(dual, pose_of(dual, position, turned, shape_rotation));
}
/// What the inputs of a pose change by in a share of a frame.
template <class Shape, class Vector>
void set_pose_rate(const ContactFlight& f, const Moment& m, double frame_time, int first, Vector& rate) {
  const Vec3<double> way = frame_time * velocity_at(f, m);
  rate[first] = way.x, rate[first + 1] = way.y, rate[first + 2] = way.z;
  if constexpr (pose_size<Shape> == 7) {
    const Vec3<double> half = (0.5 * frame_time) * f.spin;
    const Quat<double> turn = Quat<double>{half.x, half.y, half.z, 0} * orientation_at(f, m, frame_time);
    rate[first + 3] = turn.x, rate[first + 4] = turn.y, rate[first + 5] = turn.z, rate[first + 6] = turn.w;
  }
}
/// Adds the derivatives by a pose that stand at `first` of `by`.
template <class Shape, class Vector>
void add_pose_gradient(const Vector& by, int first, const ContactFlight& f, const Moment& m,
                       double frame_time, ContactFlight& by_flight) {
  double by_share = 0;  // is in `by` already
  add_position_gradient(f, m, frame_time, {by[first], by[first + 1], by[first + 2]}, by_flight, by_share);
  if constexpr (pose_size<Shape> == 7)
    add_orientation_gradient(f, m, frame_time, {by[first + 3], by[first + 4], by[first + 5], by[first + 6]},
                             by_flight);
}

/// The derivative by all inputs of a manifold of duals, from those by its places and by the moment's share:
/// by_place(i) is nullptr where a place was left out. `rate` is what the inputs change by in a share of a
/// frame.
template <int N, int P, bool C, class ByPlace>
Eigen::Matrix<double, N, 1> pull_back_places(const Manifold<Dual<N>, P, C>& m, const ByPlace& by_place,
                                             const Moment& moment, const Eigen::Matrix<double, N, 1>& rate,
                                             double by_share, const ContactScales& scales) {
  Eigen::Matrix<double, N, 1> by = Eigen::Matrix<double, N, 1>::Zero();
  for (int i = 0; i < P; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (const ContactPlace* place = by_place(i)) {
      by += pull_back<N>(place->normal, m.normal) + pull_back<N>(place->point, m.point[k]);
      by += place->gap * m.gap[k].derivatives();
    }
  }
  if (moment.touching) {
    // The separation is 0 at this moment whatever the inputs are. Where surfaces only graze one another, the
    // moment depends on them without bound.
    const Eigen::Matrix<double, N, 1>& separation = m.separation.derivatives();
    const double closing = std::max(-separation.dot(rate), scales.frame_time * scales.slip());
    by += ((by_share + by.dot(rate)) / closing) * separation;
  }
  return by;
}

/// The way back through with_places: adds to the derivatives by the flights, given those by the places and by
/// the moment's share.
template <class Shape, class ByPlace>
void add_place_gradient(const Body<double, Shape>& first, const ContactFlight& of_first,
                        const Body<double, Shape>& second, const ContactFlight& of_second,
                        const Moment& moment, const ContactScales& scales, const ByPlace& by_place,
                        double by_share, ContactFlight& by_first, ContactFlight& by_second) {
  with_shape(first.shape(), [&](const auto& a) {
    with_shape(second.shape(), [&](const auto& b) {
      using A = std::remove_cvref_t<decltype(a)>;
      using B = std::remove_cvref_t<decltype(b)>;
      constexpr int size = pose_size<A>, all = size + pose_size<B>;
      const double time = scales.frame_time;
      const auto [da, pa] = dual_pose<all>(a, of_first, moment, time, first.shape_rotation(), 0);
      const auto [db, pb] = dual_pose<all>(b, of_second, moment, time, second.shape_rotation(), size);
      Eigen::Matrix<double, all, 1> rate;
      set_pose_rate<A>(of_first, moment, time, 0, rate);
      set_pose_rate<B>(of_second, moment, time, size, rate);
      const auto by = pull_back_places<all>(detect(da, pa, db, pb), by_place, moment, rate, by_share, scales);
      add_pose_gradient<A>(by, 0, of_first, moment, time, by_first);
      add_pose_gradient<B>(by, size, of_second, moment, time, by_second);
    });
  });
}
template <class Shape, class ByPlace>
void add_place_gradient(const Plane<double>& plane, const Body<double, Shape>& body,
                        const ContactFlight& flight, const Moment& moment, const ContactScales& scales,
                        const ByPlace& by_place, double by_share, ContactFlight& by_flight) {
  with_shape(body.shape(), [&](const auto& b) {
    using B = std::remove_cvref_t<decltype(b)>;
    constexpr int all = pose_size<B>;
    const double time = scales.frame_time;
    const auto [db, pb] = dual_pose<all>(b, flight, moment, time, body.shape_rotation(), 0);
    Eigen::Matrix<double, all, 1> rate;
    set_pose_rate<B>(flight, moment, time, 0, rate);
    const auto by = pull_back_places<all>(detect(plane.template cast<Dual<all>>(), db, pb), by_place, moment,
                                          rate, by_share, scales);
    add_pose_gradient<B>(by, 0, flight, moment, time, by_flight);
  });
}

}  // namespace rbres::RBRES_ABI::detail

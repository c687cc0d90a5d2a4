#pragma once

#include <rbres/contact/detect_box_box.hpp>
#include <rbres/contact/detect_hull_hull.hpp>

namespace rbres::RBRES_ABI {

// The pairs in the other order.
/// The pair in the other order.
/// @{
template <class S>
auto detect(const Box<S>& a, const Pose<S>& pa, const Sphere<S>& b, const Pose<S>& pb) {
  return detail::flipped(detect(b, pb, a, pa));
}
template <class S>
auto detect(const Box<S>& a, const Pose<S>& pa, const Capsule<S>& b, const Pose<S>& pb) {
  return detail::flipped(detect(b, pb, a, pa));
}
template <class S>
auto detect(const Capsule<S>& a, const Pose<S>& pa, const Sphere<S>& b, const Pose<S>& pb) {
  return detail::flipped(detect(b, pb, a, pa));
}
template <class S>
auto detect(const ConvexHull<S>& a, const Pose<S>& pa, const Sphere<S>& b, const Pose<S>& pb) {
  return detail::flipped(detect(b, pb, a, pa));
}
template <class S>
auto detect(const ConvexHull<S>& a, const Pose<S>& pa, const Capsule<S>& b, const Pose<S>& pb) {
  return detail::flipped(detect(b, pb, a, pa));
}
/// @}

namespace detail {

/// The most points that two of these shapes, or a plane and one of them, have.
/// @{
template <class S, class A, class... B>
constexpr int most_points_with() {
  const Pose<S>* pose = nullptr;
  return std::max(
      {decltype(detect(Plane<S>{}, std::declval<const A&>(), *pose))::points,
       decltype(detect(std::declval<const A&>(), *pose, std::declval<const B&>(), *pose))::points...});
}
template <class S, class... Shapes>
inline constexpr int most_points = std::max({most_points_with<S, Shapes, Shapes...>()...});
/// @}

template <int Most, class S, int P, bool C>
Manifold<S, Most> widened(const Manifold<S, P, C>& from) {
  Manifold<S, Most> m{from.normal, from.separation, {}, {}};
  for (std::size_t i = 0; i < std::size_t(Most); ++i) {
    m.gap[i] = i < P ? from.gap[i] : S(m.none);
    if (i < P) m.point[i] = from.point[i];
  }
  return m;
}

}  // namespace detail

/// Shapes that are chosen at run time: every pair must have its function, or this does not compile.
template <class... Shapes, class S>
auto detect(const std::variant<Shapes...>& a, const Pose<S>& pa, const std::variant<Shapes...>& b,
            const Pose<S>& pb) {
  constexpr int most = detail::most_points<S, Shapes...>;
  return std::visit([&](const auto& x, const auto& y) { return detail::widened<most>(detect(x, pa, y, pb)); },
                    a, b);
}
/// The same for a plane.
template <class... Shapes, class S>
auto detect(const Plane<S>& plane, const std::variant<Shapes...>& b, const Pose<S>& pb) {
  constexpr int most = detail::most_points<S, Shapes...>;
  return std::visit([&](const auto& x) { return detail::widened<most>(detect(plane, x, pb)); }, b);
}

/// What detect gives for two bodies of this shape, of a compound for two parts.
template <class S, class Shape>
using PairManifold =
    decltype(detect(std::declval<const typename detail::PartsOf<Shape>::Shape&>(), Pose<S>{},
                    std::declval<const typename detail::PartsOf<Shape>::Shape&>(), Pose<S>{}));
/// What detect gives for a plane and a body of this shape, of a compound for a part.
template <class S, class Shape>
using PlaneManifold =
    decltype(detect(Plane<S>{}, std::declval<const typename detail::PartsOf<Shape>::Shape&>(), Pose<S>{}));

namespace detail {

/// Calls f(manifold, is_plane) with how the pair (as in Candidate) meets in this state.
template <class System, class F>
void with_manifold(const System& system, const typename System::State& y, int first, int second, const F& f) {
  const auto pose = shape_pose(system[second], y[second]);
  if (first < 0) {
    f(detect(system.planes()[static_cast<std::size_t>(-1 - first)], system[second].shape(), pose),
      std::true_type{});
  } else {
    f(detect(system[first].shape(), shape_pose(system[first], y[first]), system[second].shape(), pose),
      std::false_type{});
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI

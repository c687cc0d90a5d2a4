#pragma once

#include <rbres/contact/detect_box_box.hpp>

namespace rbres {

// The pairs in the other order.
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

namespace detail {

template <class S, int P, bool C>
Manifold<S, 12> widened(const Manifold<S, P, C>& from) {
  Manifold<S, 12> m{from.normal, from.separation, {}, {}};
  for (std::size_t i = 0; i < 12; ++i) {
    m.gap[i] = i < P ? from.gap[i] : S(m.none);
    if (i < P) m.point[i] = from.point[i];
  }
  return m;
}

}  // namespace detail

/// Shapes that are chosen at run time: every pair must have its function, or this does not compile.
template <class... Shapes, class S>
Manifold<S, 12> detect(const std::variant<Shapes...>& a, const Pose<S>& pa, const std::variant<Shapes...>& b,
                       const Pose<S>& pb) {
  return std::visit([&](const auto& x, const auto& y) { return detail::widened(detect(x, pa, y, pb)); }, a,
                    b);
}
template <class... Shapes, class S>
Manifold<S, 12> detect(const Plane<S>& plane, const std::variant<Shapes...>& b, const Pose<S>& pb) {
  return std::visit([&](const auto& x) { return detail::widened(detect(plane, x, pb)); }, b);
}

/// What detect gives for two bodies of this shape, and for a body and a plane.
template <class S, class Shape>
using PairManifold =
    decltype(detect(std::declval<const Shape&>(), Pose<S>{}, std::declval<const Shape&>(), Pose<S>{}));
template <class S, class Shape>
using PlaneManifold = decltype(detect(Plane<S>{}, std::declval<const Shape&>(), Pose<S>{}));

}  // namespace rbres

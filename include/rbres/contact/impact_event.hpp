#pragma once

#include <rbres/core/vector.hpp>

namespace rbres::RBRES_ABI {

/// What an observer hears of an impact: the impulse at one point where a pair touched, friction with it.
template <class S>
struct Impact {
  S time;           ///< s
  int first;        ///< index of a body; -1 - p for plane p of System::planes()
  int second;       ///< index of a body, larger than first
  Vec3<S> point;    ///< where it acts, world frame, m
  Vec3<S> normal;   ///< unit, from the first surface to the second, world frame
  Vec3<S> impulse;  ///< on the second body; the first gets its opposite; world frame, N s

  /// Whether a body hit a plane, and which one.
  bool with_plane() const noexcept { return first < 0; }
  /// The number of that plane among System::planes().
  int plane() const noexcept { return -1 - first; }
};

namespace detail {
/// Where nobody asks for the impulses of impacts.
struct Unheard {
  template <class... Event>
  void operator()(const Event&...) const {}
};
/// An impulse at a contact point, world frame, N s.
template <class Point>
auto impulse_of(const Point& point) {
  const auto& p = point.impulse();
  return p[0] * point.direction(0) + p[1] * point.direction(1) + p[2] * point.direction(2);
}
}  // namespace detail

}  // namespace rbres::RBRES_ABI

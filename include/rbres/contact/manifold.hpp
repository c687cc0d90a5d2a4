#pragma once

#include <rbres/body/system.hpp>

namespace rbres::RBRES_ABI {

/// Where a shape, or a part of a Compound, stands: its centre and its axes, world frame.
template <class S>
struct Pose {
  /// Of the centre of mass, m.
  Vec3<S> position;
  /// The shape's axes, as columns.
  Mat3<S> axes;
};

/// Where two surfaces meet or nearly meet: up to P points under one normal.
template <class S, int P, bool Central = false>
struct Manifold {
  /// Room for so many points.
  static constexpr int points = P;
  /// The normal passes through both centres of mass, so that a normal impulse spins nothing.
  static constexpr bool central = Central;
  /// The gap of a point that is not there.
  static constexpr auto none = typename Constants<S>::Real(1e30);

  Vec3<S> normal;  ///< unit, from the first surface to the second, world frame
  S separation;    ///< signed distance of the surfaces along the normal, m; negative: they overlap
  std::array<Vec3<S>, std::size_t(P)> point;  ///< world frame, m
  std::array<S, std::size_t(P)> gap;          ///< signed distance at each point, m
};

/// Moves the points that count to the front, lane by lane and in their order, so that lanes in which
/// different points count share a place.
template <Packed S, int P, bool Central>
void gather(Manifold<S, P, Central>& m, std::array<MaskOf<S>, std::size_t(P)>& counts) {
  for (std::size_t from = 1; from < P; ++from) {
    for (std::size_t to = 0; to < from && any(counts[from]); ++to) {
      const MaskOf<S> move = counts[from] & !counts[to];
      m.point[to] = select(move, m.point[from], m.point[to]);
      m.gap[to] = select(move, m.gap[from], m.gap[to]);
      counts[to] = counts[to] | move;
      counts[from] = counts[from] & !move;
    }
  }
}

namespace detail {

/// Calls f(i, point, gap) for the points of a manifold that are there, in at least one lane.
template <class S, int P, bool Central, class F>
void each_point(const Manifold<S, P, Central>& m, const F& f) {
  for (int i = 0; i < P; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (any(m.gap[k] < S(m.none / 2))) f(i, m.point[k], m.gap[k]);
  }
}

}  // namespace detail

/// The body's shape in the world. Balls look the same from every side: their axes are left out.
template <class S, class Shape>
Pose<S> shape_pose(const Body<S, Shape>& body, const RigidState<S>& state) {
  if constexpr (std::is_same_v<Shape, Sphere<S>>) {
    return {in_registers(state.position), {}};
  } else {
    return {state.position, rotation_matrix(state.orientation * body.shape_rotation())};
  }
}

/// Unit vector along v; along z where v has no length.
template <class S>
Vec3<S> direction_or_z(const Vec3<S>& v) {
  const S squared = squared_norm(v);
  const MaskOf<S> usable = squared > S(Constants<S>::tiny);
  const S inverse = inverse_root(select(usable, squared, S(1)));
  return select(usable, inverse * v, Vec3<S>{S(0), S(0), S(1)});
}

}  // namespace rbres::RBRES_ABI

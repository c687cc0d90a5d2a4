#pragma once

#include <rbres/body/compound.hpp>
#include <rbres/contact/detect.hpp>
#include <rbres/contact/near_pairs.hpp>

namespace rbres::RBRES_ABI {

/// Where a part of a compound stands, whose own pose is `whole`.
template <class S>
Pose<S> part_pose(const Pose<S>& whole, const PlacedPart<S>& part) {
  return {whole.position + whole.axes * part.centre,
          {whole.axes * part.axes.x, whole.axes * part.axes.y, whole.axes * part.axes.z}};
}

/// The points of all parts, part by part.
template <class S, int M, class Shape>
auto detect(const Plane<S>& plane, const Compound<S, M, Shape>& b, const Pose<S>& pb) {
  constexpr auto each = std::size_t(PlaneManifold<S, Shape>::points);
  Manifold<S, M* int(each)> all{plane.normal, S(PlaneManifold<S, Shape>::none), {}, {}};
  all.point.fill(pb.position);
  all.gap.fill(S(all.none));
  for (std::size_t k = 0; k < b.parts().size(); ++k) {
    const auto m = detect(plane, b.parts()[k].shape, part_pose(pb, b.placed()[k]));
    all.separation = minimum(all.separation, m.separation);
    for (std::size_t i = 0; i < each; ++i) {
      all.point[each * k + i] = m.point[i];
      all.gap[each * k + i] = m.gap[i];
    }
  }
  return all;
}

namespace detail {

/// Which parts of two bodies meet. A shape that is no Compound is one part.
template <int Most, bool Compound>
struct PartPair {
  static constexpr bool compound = true;
  static constexpr std::size_t count = std::size_t(Most) * std::size_t(Most);

  int first = 0;  ///< with a plane 0
  int second = 0;

  /// Of this pair among all, in the order in which they are found.
  std::size_t number() const { return std::size_t(first) * std::size_t(Most) + std::size_t(second); }
};
template <int Most>
struct PartPair<Most, false> {
  static constexpr bool compound = false;
  static constexpr std::size_t count = 1;
  static constexpr int first = 0, second = 0;
  static constexpr std::size_t number() { return 0; }
};
template <class System>
using PartPairOf = PartPair<PartsOf<typename System::Shape>::most, PartsOf<typename System::Shape>::compound>;

/// Calls f(shape, pose) with a part of a body in this state.
template <class S, class Shape, class F>
decltype(auto) with_part(const Body<S, Shape>& body, const RigidState<S>& state, int part, const F& f) {
  if constexpr (PartsOf<Shape>::compound) {
    const auto k = static_cast<std::size_t>(part);
    return f(body.shape().parts()[k].shape, part_pose(shape_pose(body, state), body.shape().placed()[k]));
  } else {
    return f(body.shape(), shape_pose(body, state));
  }
}

/// Calls f(manifold, is_plane) with how two parts meet in this state.
template <class System, class F>
void with_part_manifold(const System& system, const typename System::State& y, int first, int second,
                        const PartPairOf<System>& parts, const F& f) {
  if constexpr (!PartPairOf<System>::compound) {
    with_manifold(system, y, first, second, f);
  } else {
    // The normal through the centres of two balls need not pass through those of the bodies.
    const auto off_centre = [](const auto& m) { return widened<std::decay_t<decltype(m)>::points>(m); };
    with_part(system[second], y[second], parts.second, [&](const auto& b, const auto& pb) {
      if (first < 0) {
        f(off_centre(detect(system.planes()[static_cast<std::size_t>(-1 - first)], b, pb)), std::true_type{});
      } else {
        with_part(system[first], y[first], parts.first, [&](const auto& a, const auto& pa) {
          f(off_centre(detect(a, pa, b, pb)), std::false_type{});
        });
      }
    });
  }
}

/// How many pairs of parts two bodies have, or a plane and a body; and one of them.
/// @{
template <class System>
std::size_t part_pairs(const System& system, const Candidate& who) {
  if constexpr (PartPairOf<System>::compound) {
    const auto parts = [&](int i) { return static_cast<std::size_t>(i < 0 ? 1 : system[i].shape().size()); };
    return parts(who.first) * parts(who.second);
  } else {
    return 1;
  }
}
template <class System>
PartPairOf<System> part_pair(const System& system, const Candidate& who, std::size_t number) {
  if constexpr (PartPairOf<System>::compound) {
    const auto parts = static_cast<std::size_t>(system[who.second].shape().size());
    return {static_cast<int>(number / parts), static_cast<int>(number % parts)};
  } else {
    return {};
  }
}
/// @}

/// The ball around a part, grown by `more` (m).
template <class S>
struct PartBall {
  Vec3<S> centre;
  S radius;

  template <class Shape>
  PartBall(const Body<S, Shape>& body, const Pose<S>& whole, int part, const S& more) {
    const auto k = static_cast<std::size_t>(part);
    centre = whole.position + whole.axes * body.shape().placed()[k].centre;
    radius = with_shape(body.shape().parts()[k].shape, [](const auto& s) { return s.bounding_radius(); });
    radius = as<S>(1.001) * radius + as<S>(0.001) * body.bounding_radius() + more;
  }
  bool meets(const PartBall& b) const {
    return squared_norm(centre - b.centre) < square(S(radius + b.radius));
  }
};

/// Whether the balls of two parts overlap, each grown by half of `margin` (m) or more. True for shapes that
/// have no parts.
template <class System>
bool parts_near(const System& system, const typename System::State& y, const Candidate& who,
                const PartPairOf<System>& parts, const typename System::Scalar& margin) {
  if constexpr (PartPairOf<System>::compound) {
    using Ball = PartBall<typename System::Scalar>;
    const auto ball = [&](int i, int part) {
      return Ball(system[i], shape_pose(system[i], y[i]), part, margin);
    };
    const Ball b = ball(who.second, parts.second);
    if (who.first >= 0) return ball(who.first, parts.first).meets(b);
    return near_plane(system.planes()[static_cast<std::size_t>(-1 - who.first)], b.centre, b.radius);
  } else {
    return true;
  }
}

/// Calls found(PartPair) for the parts of a pair of a system of compounds whose balls overlap when each has
/// gone as far as way(i), m, with its body.
template <class System, class Way, class Found>
void each_near_part(const System& system, const typename System::State& y, const Candidate& who,
                    const Way& way, const Found& found) {
  using Ball = PartBall<typename System::Scalar>;
  const auto& b = system[who.second];
  const auto pose_b = shape_pose(b, y[who.second]);
  const auto way_b = way(who.second);
  if (who.first < 0) {
    const auto& plane = system.planes()[static_cast<std::size_t>(-1 - who.first)];
    for (int l = 0; l < b.shape().size(); ++l) {
      const Ball ball(b, pose_b, l, way_b);
      if (near_plane(plane, ball.centre, ball.radius)) found(PartPairOf<System>{0, l});
    }
    return;
  }
  const auto& a = system[who.first];
  const auto pose_a = shape_pose(a, y[who.first]);
  const auto way_a = way(who.first);
  for (int k = 0; k < a.shape().size(); ++k) {
    const Ball ball(a, pose_a, k, way_a);
    for (int l = 0; l < b.shape().size(); ++l) {
      if (ball.meets(Ball(b, pose_b, l, way_b))) found(PartPairOf<System>{k, l});
    }
  }
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
